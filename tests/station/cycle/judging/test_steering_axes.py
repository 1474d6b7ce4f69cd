"""Steering axes of a sweep in the station: found, judged, stored and told; what brings none is never OK."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from alignment.arrays import Array
from alignment.geometry.transforms import RigidTransform
from alignment.values import Side, WheelMeasurement, WheelReference, nominal_vehicle_from_rig
from alignment.vehicle.angles import normal_from_angles
from alignment.vehicle.wheel_axes import Stand
from db.records import CycleOutcome, Verdict
from station.configuration.vehicle_types import VehicleType
from station.cycle.wheels.frame import CommonFrame
from station.cycle.words.cycle import ErrorCode, Mode, Outcome, Stop
from station.cycle.words.geometry import QuantityState
from station.cycle.words.steering import Step, SweepProgress, SweepState
from station.cycle.words.vehicle import SteeringWheel, ToldOfVehicle
from tests.station.bench import KIND, WHEELS, Bench, measurement, open_bench
from tests.steered import ROAD, WIDTH, SteeredTruth

RATIO = 16.0
TRUTH = {
    "front_left": SteeredTruth("left", caster=math.radians(6.0), kpi=math.radians(12.0), camber=-0.004),
    "front_right": SteeredTruth("right", caster=math.radians(5.5), kpi=math.radians(12.2), camber=-0.004),
}
PLAN = {"largest_deg": 160.0, "positions": 21, "tolerance_deg": 2.0}
LIMITS = {
    "caster": {"nominal_deg": 5.75, "tolerance_deg": 0.75},
    "kpi": {"nominal_deg": 12.0, "tolerance_deg": 1.0},
    "caster_difference": {"nominal_deg": 0.0, "tolerance_deg": 1.0},
}


def kind(**changes: object) -> VehicleType:
    """A vehicle type with a sweep and limits of its axes; the road and the tyres are known."""
    said: dict[str, object] = KIND.model_dump(exclude_none=True)
    said |= {"sweep": PLAN, "steering_axis": LIMITS, "tyre_width_mm": WIDTH, "tyre_width_sigma_mm": 0.0}
    return VehicleType.model_validate(said | changes)


class Steered(dict[str, Any]):
    """What the rigs find: front wheels as they are steered, the rear ones as ever."""

    def __init__(self) -> None:
        super().__init__()
        self.angle = 0.0

    def get(self, wheel: str, default: Any = None) -> Any:
        if wheel in self:
            return self[wheel]
        truth = TRUTH.get(wheel)
        if truth is not None:
            return plane_at(truth, math.radians(self.angle / RATIO))
        side: Side = "left" if wheel == "rear_left" else "right"
        return plane(side, 0.001, 0.0, REAR[wheel])


PLACES = dict.fromkeys(WHEELS, (0.0, 0.0, 0.0))
REAR = {"rear_left": np.array([-1350.0, 850.0, 3.0]), "rear_right": np.array([-1350.0, -850.0, 3.0])}


def plane_at(truth: SteeredTruth, angle: float) -> WheelMeasurement:
    """The tyre plane of a wheel that is steered by an angle, as its rig sees it."""
    camber, toe, point = truth.at(angle)
    return plane(truth.side, camber, toe, point)


def plane(side: Side, camber: float, toe: float, point: Array) -> WheelMeasurement:
    stand_from_rig = RigidTransform(nominal_vehicle_from_rig(side).rotation, np.zeros(3))
    normal = stand_from_rig.rotation.T @ normal_from_angles(camber, toe, side)
    point = stand_from_rig.rotation.T @ point
    covariance = np.diag([2e-6, 2e-6, 0.002, 0.002, 0.002]) ** 2
    return replace(
        measurement(camber, toe),
        angle_covariance=covariance[:2, :2],
        normal=normal,
        reference=WheelReference(point, covariance),
    )


@pytest.fixture
def bench() -> Iterator[Bench]:
    with made(kind()) as bench:
        yield bench


def made(of: VehicleType) -> Any:
    frame = CommonFrame(Stand(road_z_mm=ROAD), "stand")
    return open_bench(types={1: of}, frame=frame, places=PLACES)


def swept(bench: Bench) -> Any:
    """Turn the steering as it is wanted."""
    found = Steered()
    found |= bench.found
    bench.found = found

    def progress(told: SweepProgress) -> None:
        if told.state is SweepState.TURN and told.wanted_deg is not None:
            bench.clock.now += 1.0
            found.angle = told.wanted_deg
            bench.line.queue.append(Step(1, told.position, told.wanted_deg))

    bench.line.on_sweep = progress
    bench.line.vehicle = lambda: ToldOfVehicle(SteeringWheel(found.angle))
    report = bench.trigger(mode=Mode.SWEEP)
    assert report is not None
    return report


def test_a_sweep_tells_caster_and_kingpin_inclination_with_their_verdicts(bench: Bench) -> None:
    report = swept(bench)
    assert report.record.reason_text is None
    axes = {axis.wheel: axis for axis in report.record.steering_axes}
    for wheel, truth in TRUTH.items():
        axis = axes[wheel]
        assert axis.caster == pytest.approx(truth.caster, abs=math.radians(0.01))
        assert axis.kpi == pytest.approx(truth.kpi, abs=math.radians(0.05))
        assert axis.verdict is Verdict.OK
        assert axis.positions == PLAN["positions"]
    steering = bench.line.sent[-1][3].steering
    assert steering.of("front_left.caster").state is QuantityState.OK
    assert steering.of("front_left.caster").value == pytest.approx(6.0, abs=0.01)
    assert steering.of("front_left.trail").state is QuantityState.UNJUDGED
    assert steering.of("caster_difference").value == pytest.approx(0.5, abs=0.02)
    assert report.record.outcome is CycleOutcome.OK
    assert report.told is Outcome.OK


def test_a_caster_out_of_its_limits_makes_the_vehicle_nok() -> None:
    limits = LIMITS | {"caster": {"nominal_deg": 3.0, "tolerance_deg": 0.5}}
    with made(kind(steering_axis=limits)) as bench:
        report = swept(bench)
        assert report.told is Outcome.NOK
        assert report.record.outcome is CycleOutcome.NOK
        assert bench.line.sent[-1][3].steering.of("front_right.caster").state is QuantityState.NOK


def test_a_sweep_that_is_too_small_is_a_fault_with_its_reason() -> None:
    small = {"largest_deg": 32.0, "positions": 7, "tolerance_deg": 2.0}
    with made(kind(sweep=small)) as bench:
        report = swept(bench)
        assert report.told is Outcome.FAULT
        assert report.record.reason_code == str(ErrorCode.SWEEP_FAULT)
        assert "at least 7.5°" in report.record.reason_text
        assert {axis.reason_code for axis in report.record.steering_axes} == {"no_steering_axis"}
        axes = bench.line.sent[-1][3].steering.axes
        assert {axis.state for axis in axes if "." in axis.name} == {QuantityState.NOT_MEASURED}
        assert all(axis.value is None for axis in axes)


def test_wheels_whose_place_is_not_known_have_no_axis(bench: Bench) -> None:
    bench.found["front_left"] = measurement()
    report = swept(bench)
    assert report.told is Outcome.FAULT
    assert "the place of the wheel is not known" in report.record.reason_text


def test_a_run_out_that_rolls_needs_road_and_tyre() -> None:
    said = kind().model_copy(update={"tyre_width_mm": None})
    with made(said) as bench:
        report = swept(bench)
        assert report.told is Outcome.FAULT
        assert "the width of the tyres" in report.record.reason_text
    held = said.model_copy(update={"sweep": said.sweep.model_copy(update={"brakes_held": True})})  # type: ignore[union-attr]
    with made(held) as bench:
        report = swept(bench)
        assert report.record.steering_axes[0].caster is not None


def test_the_record_has_differences_and_toe_out_of_both_turns(bench: Bench) -> None:
    report = swept(bench)
    assert report.record.steering.straight_ahead == "not_asked"
    assert report.record.steering.verdict is Verdict.OK
    assert report.record.steering.kpi_difference == pytest.approx(math.radians(-0.2), abs=math.radians(0.05))
    assert all(axis.toe_out is not None for axis in report.record.steering_axes)


def test_a_sweep_that_was_stopped_tells_that_its_axes_were_not_measured(bench: Bench) -> None:
    found = Steered()
    bench.found = found
    bench.line.vehicle = lambda: ToldOfVehicle(SteeringWheel(0.0))
    bench.line.on_sweep = lambda told: bench.line.queue.append(Stop(1))
    report = bench.trigger(mode=Mode.SWEEP)
    assert report is not None
    assert report.told is Outcome.FAULT
    assert {axis.reason_code for axis in report.record.steering_axes} == {"no_steering_axis"}
    steering = bench.line.sent[-1][3].steering
    assert steering.of("front_left.caster").state is QuantityState.NOT_MEASURED
