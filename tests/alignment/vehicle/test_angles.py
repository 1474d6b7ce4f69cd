import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from alignment.errors import DegenerateInputError
from alignment.values import Side, nominal_vehicle_from_rig
from alignment.vehicle.angles import camber_toe, camber_toe_jacobian, normal_from_angles
from tests.strategies import sides, small_angles


@given(small_angles, small_angles, sides)
def test_angles_and_normal_are_inverse(camber: float, toe: float, side: Side) -> None:
    assert camber_toe(normal_from_angles(camber, toe, side), side) == pytest.approx((camber, toe), abs=1e-14)


@given(small_angles, small_angles, sides, st.floats(-math.pi, math.pi))
def test_turning_the_wheel_about_its_own_axis_changes_neither_angle(
    camber: float, toe: float, side: Side, spin: float
) -> None:
    axis = normal_from_angles(camber, toe, side)
    # Three points of the tyre plane, turned with the wheel; its normal from their cross product.
    first = np.cross(axis, [0.0, 0.0, 1.0])
    plane = np.array([first, np.cross(axis, first)])
    turned = Rotation.from_rotvec(spin * axis).apply(plane)
    normal = np.cross(turned[0], turned[1])
    assert camber_toe(normal, side) == pytest.approx((camber, toe), abs=1e-12)


@given(small_angles, small_angles)
def test_mirroring_left_to_right_keeps_both_angles(camber: float, toe: float) -> None:
    mirrored = normal_from_angles(camber, toe, "left") * np.array([1.0, -1.0, 1.0])
    assert camber_toe(mirrored, "right") == pytest.approx((camber, toe), abs=1e-14)


@given(small_angles, small_angles, sides)
def test_the_jacobian_agrees_with_differences(camber: float, toe: float, side: Side) -> None:
    normal = normal_from_angles(camber, toe, side)
    jacobian = camber_toe_jacobian(normal, side)
    # Along the sphere: steps square to the normal.
    for tangent in (np.cross(normal, [1.0, 0, 0]), np.cross(normal, [0, 0, 1.0])):
        step = 1e-6 * tangent
        ahead, behind = camber_toe(normal + step, side), camber_toe(normal - step, side)
        np.testing.assert_allclose((np.array(ahead) - np.array(behind)) / 2.0, jacobian @ step, atol=1e-12)


def test_a_top_that_leans_outboard_is_positive_camber() -> None:
    # The outboard normal of a wheel whose top leans outboard points down.
    assert camber_toe(np.array([0.0, 1.0, -0.1]), "left")[0] > 0
    assert camber_toe(np.array([0.0, -1.0, -0.1]), "right")[0] > 0


def test_wheels_that_point_inward_in_front_are_toe_in() -> None:
    # Heading (1, −0.1) of the left wheel points to the right, inward; its outboard normal is (0.1, 1).
    assert camber_toe(np.array([0.1, 1.0, 0.0]), "left")[1] > 0
    assert camber_toe(np.array([0.1, -1.0, 0.0]), "right")[1] > 0


def test_an_inboard_normal_is_refused() -> None:
    with pytest.raises(DegenerateInputError, match="outboard"):
        camber_toe(np.array([0.0, -1.0, 0.0]), "left")


@pytest.mark.parametrize("side", ["left", "right"])
def test_rig_axes_lie_as_the_conventions_say(side: Side) -> None:
    vehicle_from_rig = nominal_vehicle_from_rig(side)
    outboard = {"left": [0.0, 1.0, 0.0], "right": [0.0, -1.0, 0.0]}[side]
    np.testing.assert_array_equal(vehicle_from_rig.apply_vectors([0.0, 0.0, 1.0]), outboard)
    np.testing.assert_array_equal(vehicle_from_rig.apply_vectors([0.0, 1.0, 0.0]), [0.0, 0.0, 1.0])
