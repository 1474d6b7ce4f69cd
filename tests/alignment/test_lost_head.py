"""A lost head: refused by name, or tolerated where the settings allow it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from alignment.measure import measure_wheel
from alignment.values import MeasureSettings, Refusal, RigCalibration, StereoImages, WheelMeasurement
from tests import path_traced, rendered
from tests.assertions import assert_angle_within

TOLERANT = MeasureSettings(allow_lost_head=True)


@dataclass(frozen=True, eq=False)
class Wheel:
    """Images of one wheel, the cameras, and the true angles, radians."""

    images: Callable[[], list[StereoImages]]
    calibration: RigCalibration
    camber: float
    toe: float

    def darkened(self, *heads: int) -> list[StereoImages]:
        images = self.images()
        for k in heads:
            images[k] = StereoImages(np.full_like(images[k].left, 6), images[k].right)
        return images


@pytest.fixture(scope="module", params=["rendered", "path traced"])
def wheel(request: pytest.FixtureRequest) -> Wheel:
    """A wheel of our own simulator, and one of an independent one where it is at hand."""
    if request.param == "rendered":
        return Wheel(rendered.images, rendered.rig(), rendered.CAMBER, rendered.TOE)
    folder = request.getfixturevalue("published_data") / "path_traced"
    truth = path_traced.truth(folder, "wheel_00")
    return Wheel(
        lambda: path_traced.images(folder, "wheel_00"),
        path_traced.calibration(folder),
        *np.radians([truth.camber_deg, truth.toe_deg]),
    )


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_two_heads_measure_with_a_larger_uncertainty_and_say_so(wheel: Wheel, lost: int) -> None:
    whole = measure_wheel(wheel.images(), wheel.calibration, TOLERANT)
    result = measure_wheel(wheel.darkened(lost), wheel.calibration, TOLERANT)
    assert isinstance(whole, WheelMeasurement)
    assert isinstance(result, WheelMeasurement)
    assert result.degraded
    assert not whole.degraded
    assert max(result.camber_u, result.toe_u) > max(whole.camber_u, whole.toe_u)
    assert [head.name for head in result.heads] == [f"head_{k + 1}" for k in range(3) if k != lost]
    assert_angle_within(result.camber, wheel.camber, 0.05, "camber")
    assert_angle_within(result.toe, wheel.toe, 0.05, "toe")
    assert abs(result.camber - wheel.camber) < 3.0 * result.camber_u
    assert abs(result.toe - wheel.toe) < 3.0 * result.toe_u


def test_without_leave_a_lost_head_is_refused_by_name(wheel: Wheel) -> None:
    result = measure_wheel(wheel.darkened(2), wheel.calibration, MeasureSettings())
    assert isinstance(result, Refusal)
    assert result.head == "head_3"


def test_two_lost_heads_are_too_many(wheel: Wheel) -> None:
    assert not measure_wheel(wheel.darkened(0, 2), wheel.calibration, TOLERANT)


def test_calibration_without_a_head_keeps_the_covariance_of_the_others() -> None:
    calibration = rendered.rig()
    size = len(calibration.parameter_names)
    numbered = replace(calibration, covariance=np.diag(np.arange(size, dtype=np.float64)))
    rest = numbered.without_head(1)
    assert rest.covariance is not None
    third = size // 3
    assert np.diag(rest.covariance).tolist() == [*range(third), *range(2 * third, size)]
    assert [head.name for head in rest.heads] == ["head_1", "head_3"]


def test_two_heads_are_as_uncertain_as_their_own_calibration_makes_them() -> None:
    """The covariance of the lost head must not count, that of the others must."""
    calibration = rendered.known_rig(1e-4)
    names = calibration.parameter_names
    assert calibration.covariance is not None
    huge = np.diag([1e4 if name.startswith("head_2.") else 1.0 for name in names]) @ calibration.covariance
    images = Wheel(rendered.images, calibration, rendered.CAMBER, rendered.TOE).darkened(1)
    small, same = (
        measure_wheel(images, replace(calibration, covariance=covariance), TOLERANT)
        for covariance in (calibration.covariance, huge)
    )
    assert isinstance(small, WheelMeasurement)
    assert isinstance(same, WheelMeasurement)
    assert same.angle_covariance == pytest.approx(small.angle_covariance, rel=1e-9)
    bare = measure_wheel(images, rendered.rig(), TOLERANT)
    assert isinstance(bare, WheelMeasurement)
    assert small.camber_u > 10.0 * bare.camber_u


@pytest.mark.parametrize("shift", [60, -60])
def test_something_before_a_head_does_not_spoil_the_others(wheel: Wheel, shift: int) -> None:
    """A patch of one head's right image moved along the epipolar lines is an object before the wheel."""
    images = wheel.images()
    right = images[0].right.copy()
    height, width = right.shape
    rows, columns = slice(height // 3, 2 * height // 3), slice(width // 4, 3 * width // 4)
    right[rows, columns] = np.roll(images[0].right, shift, axis=1)[rows, columns]
    images[0] = StereoImages(images[0].left, right)
    result = measure_wheel(images, wheel.calibration, MeasureSettings())
    assert isinstance(result, WheelMeasurement)
    assert_angle_within(result.camber, wheel.camber, 0.03, "camber")
    assert_angle_within(result.toe, wheel.toe, 0.03, "toe")
