"""What a calibration gets wrong is in every uncertainty that rests on it, and does not average out."""

from __future__ import annotations

import numpy as np
import pytest

from alignment.calibration.prediction import angle_covariance
from alignment.measure import measure_wheel
from alignment.measure_spin import measure_spin
from alignment.values import MeasureSettings, RigCalibration, StereoImages, WheelMeasurement
from alignment.vehicle.axles import WheelAngles, vehicle_angles
from alignment.wheel.spin import SpinMeasurement
from tests import rendered
from tests.once import once

SETTINGS = MeasureSettings()
VAGUE = 1e-4
"""Standard deviation of every camera parameter with which the calibration outweighs the noise."""


@once
def shots() -> tuple[list[StereoImages], ...]:
    """Eight pictures of the wheel with noise of their own."""
    out = []
    for number in range(8):
        rng = np.random.default_rng(number)
        pairs = []
        for pair in rendered.images():
            left, right = (
                np.clip(np.round(image + rng.normal(0.0, 0.7, image.shape)), 0, 255).astype(np.uint8)
                for image in (pair.left, pair.right)
            )
            pairs.append(StereoImages(left, right))
        out.append(pairs)
    return tuple(out)


def wheel(calibration: RigCalibration) -> WheelMeasurement:
    found = measure_wheel(rendered.images(), calibration, SETTINGS)
    assert isinstance(found, WheelMeasurement), found
    return found


def spin(calibration: RigCalibration) -> SpinMeasurement:
    found = measure_spin(shots(), calibration, SETTINGS)
    assert isinstance(found, SpinMeasurement), found
    return found


def test_a_wheel_has_the_share_of_its_calibration_once() -> None:
    known = rendered.known_rig(VAGUE)
    share = angle_covariance(known)
    assert np.diag(share).min() > 100.0 * np.diag(wheel(rendered.rig()).angle_covariance).max()
    expected = wheel(rendered.rig()).angle_covariance + share
    assert wheel(known).angle_covariance == pytest.approx(expected, rel=1e-9)


def test_eight_shots_of_a_wheel_share_the_error_of_their_calibration() -> None:
    """Taken as noise of each shot it would be divided by √8."""
    known = rendered.known_rig(VAGUE)
    share = angle_covariance(known)
    found, bare = spin(known), spin(rendered.rig())
    assert found.angle_covariance == pytest.approx(bare.angle_covariance + share, rel=1e-6)
    assert found.camber_u == pytest.approx(np.sqrt(share[0, 0]), rel=0.01)
    assert found.toe_u == pytest.approx(np.sqrt(share[1, 1]), rel=0.01)
    # Without a calibration's covariance only the noise is left.
    assert bare.camber_u < 0.05 * found.camber_u


def test_the_thrust_angle_has_half_of_what_both_rear_wheels_have() -> None:
    known = wheel(rendered.known_rig(VAGUE))
    exact, rear = WheelAngles(0.0, 0.0), WheelAngles(known.camber, known.toe, known.camber_u, known.toe_u)
    for left, right, expected in (
        (rear, exact, 0.5 * known.toe_u),
        (exact, rear, 0.5 * known.toe_u),
        (rear, rear, known.toe_u / np.sqrt(2.0)),
    ):
        found = vehicle_angles(exact, exact, left, right)
        assert found.thrust_angle_u == pytest.approx(expected)
        assert found.thrust_angle_u > 5.0 * wheel(rendered.rig()).toe_u
    assert vehicle_angles(rear, rear, exact, exact).thrust_angle_u == 0.0
