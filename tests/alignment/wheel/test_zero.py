"""The correction by a master wheel: exact at the master, reversible, and its uncertainty is added."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from alignment.units import ARCMIN
from alignment.values import Side
from alignment.vehicle.angles import camber_toe, normal_from_angles
from alignment.wheel.zero import zero_correction
from tests.alignment.wheel.test_spin import plane
from tests.assertions import assert_angle_within
from tests.strategies import sides, small_angles

offsets = st.floats(-math.radians(1), math.radians(1))
COVARIANCE = np.array([[4.0, 1.0], [1.0, 9.0]]) * 1e-12


@given(sides, small_angles, small_angles, offsets, offsets)
def test_the_master_gets_its_certified_angles(
    side: Side, camber: float, toe: float, camber_off: float, toe_off: float
) -> None:
    certified = camber + camber_off, toe + toe_off
    zero = zero_correction((camber, toe), certified, COVARIANCE, side)
    found = zero.corrected(plane(camber, toe))
    assert_angle_within(found.camber, certified[0], 1e-8, "camber")
    assert_angle_within(found.toe, certified[1], 1e-8, "toe")


@given(sides, small_angles, small_angles, offsets, offsets)
def test_the_correction_can_be_taken_back(
    side: Side, camber: float, toe: float, camber_off: float, toe_off: float
) -> None:
    zero = zero_correction((camber_off, toe_off), (0.0, 0.0), COVARIANCE, side)
    measured = plane(camber, toe)
    again = zero.removed(zero.corrected(measured))
    assert_angle_within(again.camber, camber, 1e-8, "camber")
    assert_angle_within(again.toe, toe, 1e-8, "toe")
    assert again.angle_covariance == pytest.approx(measured.angle_covariance, abs=1e-20)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_rig_that_stands_askew_is_put_right_for_all_wheels(side: Side) -> None:
    """Three arcminutes about the vehicle's X and Z, which a rig's pose gets wrong, vanish over ±3°."""
    askew = RigidTransform.from_rotvec(3 * ARCMIN * np.array([1.0, 0.0, -1.0]), np.zeros(3)).rotation

    def seen(camber: float, toe: float) -> tuple[float, float]:
        return camber_toe(askew @ normal_from_angles(camber, toe, side), side)

    zero = zero_correction(seen(0.0, 0.0), (0.0, 0.0), COVARIANCE, side)
    three = math.radians(3.0)
    for camber in (-three, 0.0, three):
        for toe in (-three, 0.0, three):
            found = zero.corrected(plane(*seen(camber, toe)))
            assert_angle_within(found.camber, camber, 1e-3, "camber")
            assert_angle_within(found.toe, toe, 1e-3, "toe")


def test_the_uncertainty_is_combined() -> None:
    measured = plane(0.0, 0.0, u=3e-6)
    found = zero_correction((1e-4, 0.0), (0.0, 0.0), COVARIANCE, "left").corrected(measured)
    assert found.camber_u == pytest.approx(math.hypot(3e-6, 2e-6))
    assert found.toe_u == pytest.approx(math.hypot(3e-6, 3e-6))
    assert found.angle_covariance[0, 1] == pytest.approx(1e-12)


def test_nonsense_is_refused() -> None:
    with pytest.raises(DegenerateInputError, match="angles near the measured"):
        zero_correction((0.0, 0.0), (0.0, 2.0), COVARIANCE, "left")
    with pytest.raises(DegenerateInputError, match="covariance"):
        zero_correction((0.0, 0.0), (0.0, 0.0), -COVARIANCE, "left")
    with pytest.raises(DegenerateInputError, match="covariance"):
        zero_correction((0.0, 0.0), (0.0, 0.0), np.eye(3), "left")
