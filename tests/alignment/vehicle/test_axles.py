import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.vehicle.axles import WheelAngles, axle_angles, vehicle_angles

angles = st.floats(-0.1, 0.1)


def wheel(toe: float = 0.0, camber: float = 0.0) -> WheelAngles:
    return WheelAngles(camber=camber, toe=toe, camber_u=1e-5, toe_u=2e-5)


def test_total_toe_adds_and_camber_difference_subtracts() -> None:
    axle = axle_angles(wheel(toe=0.002, camber=0.01), wheel(toe=0.001, camber=0.004))
    assert axle.total_toe == pytest.approx(0.003)
    assert axle.camber_difference == pytest.approx(0.006)
    assert axle.total_toe_u == pytest.approx(2e-5 * math.sqrt(2))
    assert axle.camber_difference_u == pytest.approx(1e-5 * math.sqrt(2))


def test_a_rear_axle_that_steers_left_gives_a_positive_thrust_angle() -> None:
    # Both rear wheels head to the left: toe-in on the right, toe-out on the left.
    angles = vehicle_angles(wheel(), wheel(), wheel(toe=-0.003), wheel(toe=0.003))
    assert angles.thrust_angle == pytest.approx(0.003)
    # Straight front wheels then head to the right of the thrust line: left toe-in, right toe-out.
    assert angles.front_toe_left_to_thrust == pytest.approx(0.003)
    assert angles.front_toe_right_to_thrust == pytest.approx(-0.003)


def test_the_other_sign_convention_changes_the_thrust_angle_alone() -> None:
    wheels = (wheel(0.001), wheel(0.002), wheel(-0.003), wheel(0.004))
    ours, theirs = vehicle_angles(*wheels), vehicle_angles(*wheels, thrust_sign="right_positive")
    assert theirs.thrust_angle == -ours.thrust_angle
    assert theirs.front_toe_left_to_thrust == ours.front_toe_left_to_thrust
    assert theirs.thrust_sign == "right_positive"


@given(angles, angles, angles, angles, angles)
def test_a_vehicle_that_stands_askew_keeps_its_angles_to_the_thrust_line(
    fl: float, fr: float, rl: float, rr: float, yaw: float
) -> None:
    # A vehicle yawed to the left turns every left wheel toe-out and every right wheel toe-in.
    straight = vehicle_angles(wheel(fl), wheel(fr), wheel(rl), wheel(rr))
    askew = vehicle_angles(wheel(fl - yaw), wheel(fr + yaw), wheel(rl - yaw), wheel(rr + yaw))
    assert askew.front_toe_left_to_thrust == pytest.approx(straight.front_toe_left_to_thrust, abs=1e-12)
    assert askew.front_toe_right_to_thrust == pytest.approx(straight.front_toe_right_to_thrust, abs=1e-12)
    assert askew.front.total_toe == pytest.approx(straight.front.total_toe, abs=1e-12)
    assert askew.thrust_angle == pytest.approx(straight.thrust_angle + yaw, abs=1e-12)
