"""A lost head: refused by name, or tolerated where the settings allow it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from alignment.measure import measure_wheel
from alignment.values import MeasureSettings, Refusal, StereoImages, WheelMeasurement
from tests import path_traced
from tests.assertions import assert_angle_within

TOLERANT = MeasureSettings(allow_lost_head=True)


@pytest.fixture(scope="module")
def folder(published_data: Path) -> Path:
    return published_data / "path_traced"


def darkened(folder: Path, *heads: int) -> list[StereoImages]:
    images = path_traced.images(folder, "wheel_00")
    for k in heads:
        images[k] = StereoImages(np.full_like(images[k].left, 6), images[k].right)
    return images


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_two_heads_measure_with_a_larger_uncertainty_and_say_so(folder: Path, lost: int) -> None:
    calibration = path_traced.calibration(folder)
    whole = measure_wheel(path_traced.images(folder, "wheel_00"), calibration, TOLERANT)
    result = measure_wheel(darkened(folder, lost), calibration, TOLERANT)
    assert isinstance(whole, WheelMeasurement)
    assert isinstance(result, WheelMeasurement)
    assert result.degraded
    assert not whole.degraded
    assert max(result.camber_u, result.toe_u) > max(whole.camber_u, whole.toe_u)
    assert len(result.heads) == 2
    truth = path_traced.truth(folder, "wheel_00")
    assert_angle_within(result.camber, np.radians(truth.camber_deg), 0.3, "camber")
    assert_angle_within(result.toe, np.radians(truth.toe_deg), 0.3, "toe")


def test_without_leave_a_lost_head_is_refused_by_name(folder: Path) -> None:
    result = measure_wheel(darkened(folder, 2), path_traced.calibration(folder), MeasureSettings())
    assert isinstance(result, Refusal)
    assert result.head == "head_3"


def test_two_lost_heads_are_too_many(folder: Path) -> None:
    assert not measure_wheel(darkened(folder, 0, 2), path_traced.calibration(folder), TOLERANT)


def test_calibration_without_a_head_keeps_the_covariance_of_the_others(folder: Path) -> None:
    calibration = path_traced.calibration(folder)
    size = len(calibration.parameter_names)
    numbered = replace(calibration, covariance=np.diag(np.arange(size, dtype=np.float64)))
    rest = numbered.without_head(1)
    assert rest.covariance is not None
    third = size // 3
    assert np.diag(rest.covariance).tolist() == [*range(third), *range(2 * third, size)]
    assert [head.name for head in rest.heads] == ["head_1", "head_3"]


@pytest.mark.parametrize("shift", [60, -60])
def test_something_before_a_head_does_not_spoil_the_others(folder: Path, shift: int) -> None:
    """A patch of one head's right image moved along the epipolar lines is an object before the wheel."""
    images = path_traced.images(folder, "wheel_00")
    right = images[0].right.copy()
    height, width = right.shape
    rows, columns = slice(height // 3, 2 * height // 3), slice(width // 4, 3 * width // 4)
    right[rows, columns] = np.roll(images[0].right, shift, axis=1)[rows, columns]
    images[0] = StereoImages(images[0].left, right)
    result = measure_wheel(images, path_traced.calibration(folder), MeasureSettings())
    assert isinstance(result, WheelMeasurement)
    truth = path_traced.truth(folder, "wheel_00")
    assert_angle_within(result.camber, np.radians(truth.camber_deg), 0.1, "camber")
    assert_angle_within(result.toe, np.radians(truth.toe_deg), 0.1, "toe")
