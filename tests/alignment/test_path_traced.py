"""Images of another program: wheels rendered by a path tracer, true cameras given."""

from pathlib import Path

import numpy as np
import pytest

from alignment.measure import measure_wheel
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, RefusalCode, StereoImages, WheelMeasurement
from tests import path_traced
from tests.assertions import assert_angle_within

SETTINGS = MeasureSettings()


@pytest.fixture(scope="module")
def folder(published_data: Path) -> Path:
    return published_data / "path_traced"


@pytest.mark.parametrize("wheel", path_traced.WHEELS)
def test_path_traced_wheels_are_measured_to_a_second_of_arc(folder: Path, wheel: str) -> None:
    result = measure_wheel(path_traced.images(folder, wheel), path_traced.calibration(folder), SETTINGS)
    assert isinstance(result, WheelMeasurement)
    truth = path_traced.truth(folder, wheel)
    assert_angle_within(result.camber, np.radians(truth.camber_deg), 0.015, "camber")
    assert_angle_within(result.toe, np.radians(truth.toe_deg), 0.015, "toe")
    assert result.camber_u95 < 0.05 * ARCMIN


def test_swapped_left_and_right_images_are_refused(folder: Path) -> None:
    images = [StereoImages(p.right, p.left) for p in path_traced.images(folder, "wheel_00")]
    result = measure_wheel(images, path_traced.calibration(folder), SETTINGS)
    assert not result


def test_a_dark_head_is_refused_by_name(folder: Path) -> None:
    images = path_traced.images(folder, "wheel_00")
    images[1] = StereoImages(np.full_like(images[1].left, 6), images[1].right)
    result = measure_wheel(images, path_traced.calibration(folder), SETTINGS)
    assert not isinstance(result, WheelMeasurement)
    assert result.code is RefusalCode.HEAD_DARK
    assert "head_2 left" in result.reason


def test_images_of_another_camera_are_refused(folder: Path) -> None:
    images = path_traced.images(folder, "wheel_00")
    images[0] = StereoImages(images[0].left[:582, :752], images[0].right)
    result = measure_wheel(images, path_traced.calibration(folder), SETTINGS)
    assert not isinstance(result, WheelMeasurement)
    assert result.code is RefusalCode.WRONG_IMAGES


def test_a_rig_with_fewer_heads_than_images_is_refused(folder: Path) -> None:
    images = path_traced.images(folder, "wheel_00")[:2]
    result = measure_wheel(images, path_traced.calibration(folder), SETTINGS)
    assert not isinstance(result, WheelMeasurement)
    assert result.code is RefusalCode.WRONG_IMAGES


def test_heads_in_the_wrong_order_are_refused(folder: Path) -> None:
    images = path_traced.images(folder, "wheel_03")
    result = measure_wheel(images[1:] + images[:1], path_traced.calibration(folder), SETTINGS)
    assert not result


def test_a_depth_range_beside_the_wheel_is_refused(folder: Path) -> None:
    settings = MeasureSettings(depth_range_mm=(60.0, 100.0))
    result = measure_wheel(path_traced.images(folder, "wheel_00"), path_traced.calibration(folder), settings)
    assert not result
