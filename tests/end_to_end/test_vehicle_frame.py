"""A station that sees a whole vehicle stand askew: from rendered images to what is judged and stored."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from sensors.simulation.vehicle import VehicleDraw, passing_vehicle
from station.configuration.settings import read_configuration
from station.cycle.judging.evaluation import evaluate
from station.cycle.wheels.frame import CommonFrame
from station.running.composition import open_station
from station.running.frame import common_frame

SEED, MOST_YAW_DEG, MOST_OFFSET_MM = 5, 0.5, 20.0
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


def seeing_vehicles(configs: Path) -> Path:
    """The shipped station with rigs that see whole vehicles, with the cameras that are rendered soonest."""
    path = configs / "station.toml"
    head, _, _ = path.read_text(encoding="utf-8").partition("[[rigs]]")
    vehicle = f"vehicle = {{ yaw_deg = {MOST_YAW_DEG}, offset_mm = {MOST_OFFSET_MM} }}"
    rigs = [
        f'[[rigs]]\nname = "{name}"\nsimulated = {{ seed = {SEED}, rig = "ccir", {vehicle} }}\n'
        for name in WHEELS
    ]
    path.write_text(head + "\n".join(rigs), encoding="utf-8")
    return path


@pytest.mark.slow(6)
def test_vehicle_askew_before_rendered_rigs_has_its_own_toe(configs: Path) -> None:
    """The same images judged against the stand's axis are off by the vehicle's yaw."""
    configuration = read_configuration(seeing_vehicles(configs))
    true = passing_vehicle(SEED, 1, VehicleDraw(), math.radians(MOST_YAW_DEG), MOST_OFFSET_MM)
    assert abs(true.yaw) > math.radians(0.05)
    with open_station(configuration) as station:
        for position in station.positions:
            position.rig.arm()
        results = [position.run() for position in station.positions]
        frame = common_frame(configuration, [each.in_force.calibration for each in station.positions])
    assert frame is not None
    assert frame.reference == "vehicle"
    assert [result.failure for result in results] == [None] * 4
    kind = configuration.vehicle_types[1]
    own, clamped = (evaluate(kind, results, 2.0, each) for each in (frame, CommonFrame(frame.stand, "stand")))
    assert own.vehicle is not None
    geometry = own.vehicle.geometry
    assert geometry is not None
    assert geometry.value("yaw") == pytest.approx(true.yaw, abs=math.radians(0.1 / 60.0))
    assert [geometry.value("place_x"), geometry.value("place_y")] == pytest.approx(true.place_mm, abs=0.1)
    for by_vehicle, by_stand in zip(own.wheels, clamped.wheels, strict=True):
        wheel = by_vehicle.result.wheel
        camber, toe = true.corners[wheel].angles
        assert by_vehicle.values is not None
        assert by_stand.values is not None
        assert by_vehicle.values.toe == pytest.approx(toe, abs=math.radians(0.1 / 60.0))
        assert by_vehicle.values.camber == pytest.approx(camber, abs=math.radians(0.1 / 60.0))
        assert abs(by_stand.values.toe - toe) == pytest.approx(abs(true.yaw), rel=0.05)
    assert {length.name for length in own.vehicle.lengths} == {*kind.lengths.stated, "yaw"}
    assert all(length.value is not None for length in own.vehicle.lengths)
