"""A simulated vehicle that steers: wheels go about their axes, by the rack, and roll by the scrub radius."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.vehicle import SteeringAxis, normal_from_angles, steering_axis
from sensors.simulation.steering import (
    FRONT_WHEELS,
    SteeredVehicle,
    SteeringGeometry,
    draw_steering,
    straight_vehicle,
)
from sensors.simulation.vehicle import VehicleDraw, draw_vehicle
from station.studies.steered_wheels import exact_sweep


@pytest.fixture(scope="module")
def steered() -> SteeredVehicle:
    return draw_steering(straight_vehicle(draw_vehicle(7, None, VehicleDraw(runout_mm=2.0))))


def test_straight_ahead_nothing_has_moved(steered: SteeredVehicle) -> None:
    for wheel, corner in steered.at(0.0).corners.items():
        assert corner.angles == pytest.approx(steered.straight.corners[wheel].angles, abs=1e-15)
        assert corner.centre_mm == pytest.approx(steered.straight.corners[wheel].centre_mm)


def test_a_drawn_steering_is_straight_ahead(steered: SteeredVehicle) -> None:
    toe = {wheel: corner.angles[1] for wheel, corner in steered.straight.corners.items()}
    thrust = 0.5 * (toe["rear_right"] - toe["rear_left"])
    assert toe["front_left"] + thrust == pytest.approx(toe["front_right"] - thrust, abs=1e-15)


def test_the_angle_between_wheel_and_axis_stays(steered: SteeredVehicle) -> None:
    for wheel in FRONT_WHEELS:
        direction, point = steered.axis(wheel)
        side = "left" if wheel.endswith("left") else "right"
        along, far = [], []
        for steer in np.radians([-12.0, -5.0, 0.0, 3.0, 12.0]):
            corner = steered.at(float(steer)).corners[wheel]
            along.append(float(direction @ normal_from_angles(*corner.angles, side)))  # type: ignore[arg-type]
            far.append(float(np.linalg.norm(np.cross(direction, np.array(corner.centre_mm) - point))))
        assert np.ptp(along) < 1e-12
        assert np.ptp(far) < 1e-9


def test_to_the_left_the_left_wheel_turns_farther_and_toe_out_grows(steered: SteeredVehicle) -> None:
    angles = steered.wheel_angles(math.radians(10.0))
    assert angles["front_left"] > math.radians(10.0) > angles["front_right"]
    mirrored = steered.wheel_angles(math.radians(-10.0))
    assert mirrored["front_right"] == pytest.approx(-angles["front_left"])
    parallel = replace(steered, ackermann=0.0).wheel_angles(math.radians(10.0))
    assert parallel["front_left"] == parallel["front_right"] == math.radians(10.0)
    # Caster leans the inner wheel's top outboard.
    left = steered.at(math.radians(10.0)).corners["front_left"]
    assert left.angles[0] > steered.straight.corners["front_left"].angles[0]


def test_a_sweep_of_it_gives_its_axis_back(steered: SteeredVehicle) -> None:
    sweep = exact_sweep(steered, tuple(np.radians(np.linspace(-10.0, 10.0, 41))))
    found = steering_axis(sweep.series, sweep.stand, None, sweep.run_out)
    assert isinstance(found, SteeringAxis)
    assert found.value("caster") == pytest.approx(math.radians(sweep.truth.caster_deg), abs=1e-9)
    assert found.value("kpi") == pytest.approx(math.radians(sweep.truth.kpi_deg), abs=1e-9)
    assert found.value("trail") == pytest.approx(sweep.truth.trail_mm, abs=1e-6)
    assert found.value("scrub") == pytest.approx(sweep.truth.scrub_mm, abs=1e-6)


def test_brakes_that_are_held_keep_the_wheel_from_rolling(steered: SteeredVehicle) -> None:
    """What is left of the spin is the knuckle's own, which the axis leans the wheel by."""
    steer = math.radians(8.0)
    rolls, slips = steered, replace(steered, rolls=0.0)
    spin = [one.at(steer).corners["front_left"].pose.spin for one in (rolls, slips)]
    scrub = steered.geometry["front_left"].scrub_mm
    angle = steered.wheel_angles(steer)["front_left"]
    turned = math.remainder(spin[0] - spin[1], 2.0 * math.pi)
    assert turned == pytest.approx(-scrub / 310.0 * angle, rel=0.05)


def test_a_lower_corner_bump_steers(steered: SteeredVehicle) -> None:
    geometry = SteeringGeometry()
    low = replace(steered, lower_mm={"front_left": 20.0}).at(0.0).corners
    usual = steered.at(0.0).corners
    assert low["front_left"].angles[1] - usual["front_left"].angles[1] == pytest.approx(
        20.0 * geometry.bump_toe
    )
    assert low["front_left"].angles[0] < usual["front_left"].angles[0]
    assert low["front_right"].angles == pytest.approx(usual["front_right"].angles)


def test_a_bushing_gives_way_with_the_cube_of_the_angle(steered: SteeredVehicle) -> None:
    soft = draw_steering(steered.straight, give=math.radians(0.1))
    off = [
        soft.at(steer).corners["front_left"].angles[0] - steered.at(steer).corners["front_left"].angles[0]
        for steer in (math.radians(5.0), math.radians(10.0))
    ]
    assert abs(off[1]) > 8.0 * abs(off[0])


def test_a_steering_without_an_axis_for_each_front_wheel_is_none(steered: SteeredVehicle) -> None:
    with pytest.raises(DegenerateInputError, match="geometry"):
        SteeredVehicle(steered.straight, {"front_left": SteeringGeometry()})
