"""Steering wheel and ride heights in the measuring cycle: read around the exposures, never OK without."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from db.records import CycleOutcome
from station.configuration.vehicle_types import VehicleType
from station.cycle.words.cycle import ErrorCode, LiveState, Mode, Outcome, StationState, Stop
from station.cycle.words.vehicle import RideHeights, SteeringWheel, ToldOfVehicle
from tests.station.bench import MASTER, WHEELS, Bench, measurement, open_bench, store_error
from tests.station.cycle.judging.test_corrections import OFFSET, RIDE_HEIGHT, STEERING, kind_of

LEVEL = RideHeights(dict.fromkeys(WHEELS, 380.0))


@contextmanager
def bench_of(kind: VehicleType, *told: ToldOfVehicle) -> Iterator[Bench]:
    """A bench whose line tells these one after the other, and the last of them ever after."""
    with open_bench() as bench:
        bench.types[1] = kind
        bench.found = dict.fromkeys(WHEELS, measurement(0.0, 0.0))
        said = itertools.chain(told, itertools.repeat(told[-1]))
        bench.line.vehicle = lambda: next(said)
        yield bench


def steering(angle_deg: float | None, age_s: float = 0.1) -> ToldOfVehicle:
    return ToldOfVehicle(SteeringWheel(angle_deg, age_s), LEVEL)


KIND = kind_of(STEERING | {"offset": OFFSET}, RIDE_HEIGHT)


def test_a_fresh_angle_and_heights_make_a_good_vehicle_good_and_the_line_is_told_of_them() -> None:
    with bench_of(KIND, steering(0.8)) as bench:
        report = bench.trigger()
        answer = bench.line.sent[-1][3]
    assert report is not None
    assert report.told is Outcome.OK
    assert report.record.steering is not None
    assert report.record.steering.straight_ahead == "checked"
    assert answer.steering.wheel.straight_ahead == "checked"
    assert answer.steering.wheel.used_deg == pytest.approx(0.8)
    assert answer.steering.wheel.offset_deg == pytest.approx(0.8)
    corner = answer.steering.corner("front_left")
    assert (corner.height, corner.height_mm, corner.correction) == ("used", 380.0, "both")
    assert (corner.raw_toe_deg, answer.steering.corner("rear_left").correction) == (0.0, "ride_height")
    assert report.record.wheels[0].toe == pytest.approx(math.radians(0.05))


@pytest.mark.parametrize(
    "told",
    [
        (ToldOfVehicle(None, LEVEL),),
        (steering(None),),
        (steering(0.0, 0.6),),
        # Lost, or turned, while the wheels were measured.
        (steering(0.0), ToldOfVehicle(None, LEVEL)),
        (steering(0.0), steering(0.0, 2.0)),
        (steering(0.0), steering(3.0)),
        (steering(700.0),),
        (steering(-5.5),),
    ],
    ids=["lost", "not valid", "stale", "lost meanwhile", "stale meanwhile", "jumped", "absurd", "turned"],
)
def test_an_angle_that_is_lost_stale_absurd_or_moves_ends_in_a_fault_and_never_in_ok(
    told: tuple[ToldOfVehicle, ...],
) -> None:
    with bench_of(KIND, *told) as bench:
        report = bench.trigger()
        status = bench.line.status
    assert report is not None
    assert (report.told, report.record.outcome) == (Outcome.FAULT, CycleOutcome.FAULT)
    assert report.record.reason_code == "steering_fault"
    assert StationState.FAULT not in bench.states
    assert status.state is StationState.IDLE
    assert ErrorCode.STEERING_FAULT in [one.error_code for one in bench.line.statuses]
    assert bench.line.outcomes["front_left"] is Outcome.FAULT
    assert bench.line.outcomes["rear_left"] is Outcome.OK
    assert report.record.steering is not None
    assert report.record.steering.straight_ahead == "refused"


@pytest.mark.parametrize("height_mm", [None, 20.0, 9999.0, 415.0])
def test_a_ride_height_that_is_missing_or_absurd_ends_in_a_fault_and_never_in_ok(
    height_mm: float | None,
) -> None:
    known = dict(LEVEL.heights_mm) | {"rear_left": height_mm}
    heights = RideHeights({name: height for name, height in known.items() if height is not None})
    with bench_of(KIND, ToldOfVehicle(SteeringWheel(0.0), heights)) as bench:
        report = bench.trigger()
        answer = bench.line.sent[-1][3]
    assert report is not None
    assert (report.told, report.record.reason_code) == (Outcome.FAULT, "measurement_refused")
    assert bench.line.outcomes["rear_left"] is Outcome.FAULT
    assert answer.steering.corner("rear_left").height == ("missing" if height_mm is None else "absurd")
    assert answer.steering.wheel.state == "not_measured"


def test_where_the_type_allows_it_the_line_is_told_that_straight_ahead_was_not_checked() -> None:
    allowed = kind_of(STEERING | {"require_straight_ahead": False}, RIDE_HEIGHT | {"require": False})
    with bench_of(allowed, ToldOfVehicle()) as bench:
        report = bench.trigger()
        answer = bench.line.sent[-1][3]
    assert report is not None
    assert report.told is Outcome.OK
    assert answer.steering.wheel.straight_ahead == "not_checked"
    assert answer.steering.corner("front_left").height == "missing"


def test_masters_are_checked_as_they_stand() -> None:
    """Who tells the steering wheel's angle of a master wheel?"""
    given: dict[str, Any] = MASTER.model_dump(exclude_none=True) | {
        "steering": STEERING,
        "ride_height": RIDE_HEIGHT,
    }
    with bench_of(VehicleType.model_validate(given), ToldOfVehicle()) as bench:
        report = bench.trigger(mode=Mode.MASTER_CHECK)
    assert report is not None
    assert report.told is Outcome.OK
    assert report.record.steering is None
    assert report.record.wheels[0].ride_height is None


def test_live_toe_is_that_of_straight_ahead_and_vanishes_with_the_angle() -> None:
    """Else the operator would adjust to a toe by which the vehicle is not judged."""
    told = {"now": steering(3.2)}
    with bench_of(KIND, steering(3.2)) as bench:
        bench.line.vehicle = lambda: told["now"]

        lost_at: list[int] = []

        # How often each wheel is seen is up to the machine.
        def lost_then_done() -> None:
            seen = [angles.wheel for angles, _ in bench.line.live]
            looked_at = {"front_left", "rear_left"}
            if not lost_at and looked_at <= set(seen):
                told["now"] = ToldOfVehicle(None, LEVEL)
                lost_at.append(len(seen))
            elif lost_at and looked_at <= set(seen[lost_at[0] :]):
                bench.line.queue.append(Stop(1))

        bench.line.on_live = lost_then_done
        report = bench.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.FAULT
    shown = [angles for angles, _ in bench.line.live if angles.wheel == "front_left"]
    assert shown[0].toe_deg == pytest.approx(0.2)
    assert shown[0].state is LiveState.INSIDE
    assert (shown[-1].state, shown[-1].toe_deg) == (LiveState.NOT_MEASURED, None)
    rear = [angles for angles, _ in bench.line.live if angles.wheel == "rear_left"]
    assert rear[-1].state is LiveState.INSIDE


def test_results_that_were_not_committed_tell_nothing_of_the_steering() -> None:
    with bench_of(KIND, steering(0.0)) as bench:
        bench.store.error = store_error()
        report = bench.trigger()
        answer = bench.line.sent[-1][3]
    assert report is not None
    assert report.told is Outcome.FAULT
    assert (answer.steering.wheel.straight_ahead, answer.steering.wheel.used_deg) == ("none", None)
