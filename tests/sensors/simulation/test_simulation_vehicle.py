"""A vehicle stands askew and keeps its own angles; its rods, bolts and wheels do what they say."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from alignment.errors import ConfigurationError
from alignment.vehicle.angles import camber_toe
from alignment.vehicle.wheel_axes import FOUR_WHEELS
from sensors.camera import CameraSettings
from sensors.drivers.driver import RigPlace
from sensors.formats.vehicle import VehicleTruthFile
from sensors.frames import FrameTolerance
from sensors.simulation import simulated_rig
from sensors.simulation.driver import DRIVER, SimulatedOptions
from sensors.simulation.scene import truth_of
from sensors.simulation.simulated_rig import SimulatedRig
from sensors.simulation.vehicle import (
    ROAD_Z_MM,
    TIE_ROD,
    SimulatedStand,
    Vehicle,
    VehicleDraw,
    VehicleSpec,
    build_stand,
    draw_vehicle,
    passing_vehicle,
    side_of,
)
from sensors.simulation.vehicle_truth import truth_of_vehicle

SPEC = VehicleSpec()
SQUARE = VehicleDraw(angles=0.0, place_mm=0.0)


@pytest.fixture(scope="module")
def stand() -> SimulatedStand:
    return build_stand(SPEC, 3)


def truth(vehicle: Vehicle, stand: SimulatedStand) -> VehicleTruthFile:
    return truth_of_vehicle(
        vehicle, stand, {wheel: truth_of(vehicle.scene(wheel, stand)) for wheel in FOUR_WHEELS}, turned=False
    )


def test_a_nominal_vehicle_has_the_measures_that_its_maker_states(stand: SimulatedStand) -> None:
    found = truth(draw_vehicle(1, SPEC, SQUARE), stand)
    assert (found.wheelbase_left_mm, found.wheelbase_right_mm) == pytest.approx((2700.0, 2700.0), abs=0.05)
    assert (found.track_front_mm, found.track_rear_mm) == pytest.approx((1512.0, 1508.0), abs=1e-2)
    assert (found.thrust_angle_deg, found.yaw_deg) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert (found.setback_front_mm, found.setback_rear_mm) == pytest.approx((0.0, 0.0), abs=1e-6)
    front, rear = found.wheels["front_left"], found.wheels["rear_right"]
    assert (front.camber_deg, front.toe_deg) == pytest.approx((-0.5, 0.1))
    assert (rear.camber_deg, rear.toe_deg) == pytest.approx((-1.3, 0.15))


@pytest.mark.parametrize(("yaw_deg", "place"), [(0.5, (0.0, 20.0)), (-0.5, (-20.0, -20.0))])
def test_a_vehicle_that_stands_askew_keeps_its_own_angles_and_shows_the_stand_others(
    stand: SimulatedStand, yaw_deg: float, place: tuple[float, float]
) -> None:
    draw = VehicleDraw(tyre_width_sigma_mm=1.0)
    square, askew = (
        truth(draw_vehicle(4, SPEC, draw, math.radians(yaw), at), stand)
        for yaw, at in ((0.0, (0.0, 0.0)), (yaw_deg, place))
    )
    assert askew.yaw_deg == pytest.approx(yaw_deg, abs=1e-9)
    assert askew.place_mm == pytest.approx(place, abs=1e-9)
    for wheel in FOUR_WHEELS:
        own, before = askew.wheels[wheel], square.wheels[wheel]
        assert (own.camber_deg, own.toe_deg) == pytest.approx((before.camber_deg, before.toe_deg), abs=1e-9)
        turned = -yaw_deg if side_of(wheel) == "left" else yaw_deg
        assert own.stand_toe_deg == pytest.approx(before.toe_deg + turned, abs=1e-9)
    same = [
        name for name in VehicleTruthFile.model_fields if name.endswith(("_mm", "toe_front_deg", "angle_deg"))
    ]
    for name in set(same) - {"place_mm"}:
        assert getattr(askew, name) == pytest.approx(getattr(square, name), abs=1e-6), name


def test_the_truth_is_where_the_scenes_put_the_wheels(stand: SimulatedStand) -> None:
    """By another way: the pose that is rendered, taken through the rig's pose into the stand's frame."""
    vehicle = draw_vehicle(5, SPEC, VehicleDraw(tyre_width_sigma_mm=1.0), math.radians(0.3), (5.0, -8.0))
    found = truth(vehicle, stand)
    middles = {}
    for wheel in FOUR_WHEELS:
        scene, rig = vehicle.scene(wheel, stand), stand.rigs[wheel]
        pose = rig.vehicle_from_rig @ scene.rig_from_tyre(rig)
        normal = pose.rotation[:, 2]
        camber, toe = camber_toe(normal, side_of(wheel))
        assert math.degrees(camber) == pytest.approx(found.wheels[wheel].camber_deg, abs=1e-9)
        assert math.degrees(toe) == pytest.approx(found.wheels[wheel].stand_toe_deg, abs=1e-9)
        radius = np.linspace(scene.tyre.rim_edge_mm, scene.tyre.outer_radius_mm - 1.0, 4001)
        bare = scene.tyre.surface._replace(
            profile=scene.tyre.smooth_profile, relief=np.zeros((4, 8), np.float32)
        )
        plain = replace(scene.tyre, surface=bare)  # a section width counts neither ridges nor letters
        highest = plain.height(np.column_stack([radius, np.zeros_like(radius)]))[0].max()
        reference = pose.apply(np.array([0.0, 0.0, highest]))
        np.testing.assert_allclose(found.wheels[wheel].reference_mm, reference, atol=1e-3)
        middles[wheel] = reference - 0.5 * found.wheels[wheel].tyre_width_mm * normal
    along = sum(middles[w] if w.startswith("front") else -middles[w] for w in FOUR_WHEELS)
    assert math.degrees(math.atan2(along[1], along[0])) == pytest.approx(found.yaw_deg, abs=1e-5)
    # The contact centre lies under the middle, by camber further out or in.
    height = middles["rear_left"][2] - ROAD_Z_MM
    outboard = found.track_rear_mm - (middles["rear_left"] - middles["rear_right"])[1]
    lean = sum(math.tan(math.radians(found.wheels[w].camber_deg)) for w in ("rear_left", "rear_right"))
    assert outboard == pytest.approx(-height * lean, abs=0.05)


def test_a_rod_turns_the_toe_of_its_wheel_alone_and_a_bolt_its_camber(stand: SimulatedStand) -> None:
    before = draw_vehicle(6, SPEC)
    rod, bolt = before.with_rod_turned("front_left", 0.5), before.with_bolt_turned("rear_right", -1.0)
    a, b, c = (truth(vehicle, stand) for vehicle in (before, rod, bolt))
    turned = b.wheels["front_left"]
    assert turned.rod_turns == 0.5
    assert turned.toe_deg - a.wheels["front_left"].toe_deg == pytest.approx(0.5 * math.degrees(TIE_ROD.toe))
    assert 0 < turned.camber_deg - a.wheels["front_left"].camber_deg < 0.05
    assert c.wheels["rear_right"].camber_deg - a.wheels["rear_right"].camber_deg == pytest.approx(-0.5)
    assert c.wheels["rear_right"].bolt_turns == -1.0
    for wheel in ("front_right", "rear_left"):
        for after in (b, c):
            assert after.wheels[wheel].toe_deg == pytest.approx(a.wheels[wheel].toe_deg, abs=1e-9)
            assert after.wheels[wheel].camber_deg == pytest.approx(a.wheels[wheel].camber_deg, abs=1e-9)
    assert b.thrust_angle_deg == pytest.approx(a.thrust_angle_deg)
    back = rod.with_rod_turned("front_left", -0.5)
    assert back.corners == before.corners


def test_one_seed_is_one_vehicle_whatever_it_weighs(stand: SimulatedStand) -> None:
    light, loaded = draw_vehicle(7, SPEC), draw_vehicle(7, SPEC, VehicleDraw(load_mm=6.0))
    other = draw_vehicle(8, SPEC)
    for wheel in FOUR_WHEELS:
        assert loaded.corners[wheel].angles == light.corners[wheel].angles != other.corners[wheel].angles
        assert light.corners[wheel].load is None
        load = loaded.corners[wheel].load
        assert load is not None
        assert load.bulge_mm == pytest.approx(6.0 if wheel.startswith("front") else 4.8, rel=0.11)
        assert vehicle_load_is_told(loaded, stand, wheel)
    assert stand.rigs["front_left"].id == build_stand(SPEC, 3).rigs["front_left"].id
    assert len({rig.id for rig in stand.rigs.values()}) == 4


def vehicle_load_is_told(vehicle: Vehicle, stand: SimulatedStand, wheel: str) -> bool:
    scene = vehicle.scene(wheel, stand)
    return scene.load == vehicle.corners[wheel].load == truth_of(scene).load


def test_run_out_leaves_the_spin_axes_and_turns_with_the_wheels(stand: SimulatedStand) -> None:
    plain, uneven = (draw_vehicle(9, SPEC, VehicleDraw(runout_mm=mm)) for mm in (0.0, 2.0))
    a, b = truth(plain, stand), truth(uneven, stand)
    for wheel in FOUR_WHEELS:
        one, two = a.wheels[wheel], b.wheels[wheel]
        assert (two.spin_camber_deg, two.spin_toe_deg) == pytest.approx(
            (one.camber_deg, one.toe_deg), abs=0.01
        )
        assert 0.6 <= two.runout_mm <= 2.0
        tilt = math.hypot(two.camber_deg - two.spin_camber_deg, two.toe_deg - two.spin_toe_deg)
        assert tilt == pytest.approx(math.degrees(two.runout_mm / 600.0), rel=0.05)
        assert uneven.corners[wheel].wobble is not None


def rig_of(name: str, **options: Any) -> SimulatedRig:
    side = side_of(name)
    place = RigPlace(name, side, (), Path(), CameraSettings(), FrameTolerance())
    made = DRIVER.make(SimulatedOptions.model_validate({"seed": 4, "rig": "ccir", **options}), place)
    assert isinstance(made, SimulatedRig)
    return made


def test_rigs_of_one_seed_see_the_wheels_of_one_vehicle_and_then_of_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    noise = np.random.default_rng(1)
    monkeypatch.setattr(
        simulated_rig, "camera_image", lambda *_: noise.integers(0, 9, (4, 4), dtype=np.uint8)
    )
    asked = {"yaw_deg": 0.5, "offset_mm": 20.0, "load_mm": 5.0}
    rigs = {wheel: rig_of(wheel, vehicle=asked) for wheel in FOUR_WHEELS}
    stand = build_stand(SPEC, 4, "ccir")
    yaws = []
    for _ in range(2):
        for rig in rigs.values():
            rig.connect()
            rig.arm()
            rig.shoot(1.0)
        vehicle = passing_vehicle(4, len(yaws) + 1, VehicleDraw(load_mm=5.0), math.radians(0.5), 20.0)
        found = truth_of_vehicle(vehicle, stand, {wheel: rig.truth for wheel, rig in rigs.items()}, False)
        assert math.radians(found.yaw_deg) == pytest.approx(vehicle.yaw, abs=1e-9)
        assert found.place_mm == pytest.approx(vehicle.place_mm, abs=1e-6)
        assert all(wheel.load is not None for wheel in found.wheels.values())
        yaws.append(found.yaw_deg)
    assert yaws[0] != yaws[1]
    assert np.abs(yaws).max() <= 0.5


def test_a_rig_whose_name_is_no_corner_of_a_vehicle_is_refused_and_two_sources_of_wheels_are() -> None:
    with pytest.raises(ConfigurationError, match="four wheels"):
        rig_of("bench_left", vehicle={})
    with pytest.raises(ValidationError, match="vehicle"):
        SimulatedOptions.model_validate({"seed": 1, "camber_deg": -0.5, "vehicle": {}})
