"""The cycle corrects angles by the zero measurement in force, names it in each record, and never guesses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest

from db.records import CycleOutcome, WheelOutcome, ZeroRecord
from station.cycle.words.cycle import ErrorCode, Outcome, StationState
from tests.db.example_records import zero
from tests.station.bench import WHEELS, Bench, measurement, open_bench, store_error


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


def zero_of(wheel: str, **changes: object) -> ZeroRecord:
    values = {"rig": wheel, "calibration_id": f"cal-{wheel}", "certified_toe": 0.0} | changes
    return zero(f"zero-{wheel}", **values)


def test_each_wheel_is_corrected_by_the_zero_of_its_rig_and_the_record_names_it(bench: Bench) -> None:
    bench.store.zeros = (
        zero_of("front_left", camber=2e-4, toe=-3e-4),
        zero_of("front_right", camber=-1e-4, toe=0.0),
    )
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.OK
    wheels = {wheel.wheel: wheel for wheel in report.record.wheels}
    left, right, rear = wheels["front_left"], wheels["front_right"], wheels["rear_left"]
    assert (left.camber, left.toe) == (pytest.approx(8e-4, abs=1e-8), pytest.approx(13e-4, abs=1e-8))
    assert (right.camber, right.toe) == (pytest.approx(11e-4, abs=1e-8), pytest.approx(10e-4, abs=1e-8))
    assert left.camber_u == pytest.approx(math.hypot(1e-5, 3e-6))
    assert left.toe_u == pytest.approx(math.hypot(1e-5, 4e-6))
    assert left.zero_measurement_id == "zero-front_left"
    assert right.zero_measurement_id == "zero-front_right"
    # Without a zero measurement nothing changes.
    assert (rear.camber, rear.toe, rear.camber_u, rear.zero_measurement_id) == (0.001, 0.001, 1e-5, None)
    # The line is told the same angles as are stored.
    told = bench.line.sent[-1][1][0]
    assert told.camber_deg == pytest.approx(math.degrees(8e-4), abs=1e-6)


def test_a_zero_of_an_older_calibration_corrects_nothing(bench: Bench) -> None:
    bench.store.zeros = (zero_of("front_left", calibration_id="cal-older", camber=0.01),)
    report = bench.trigger()
    assert report is not None
    assert {wheel.zero_measurement_id for wheel in report.record.wheels} == {None}
    assert {wheel.camber for wheel in report.record.wheels} == {0.001}


def test_a_zero_revoked_between_two_starts_corrects_only_the_first(bench: Bench) -> None:
    bench.store.zeros = (zero_of("front_left"),)
    bench.trigger(1)
    bench.store.zeros = ()
    bench.trigger(2)
    ids = [record.wheels[0].zero_measurement_id for record in bench.store.cycles]
    assert ids == ["zero-front_left", None]


def test_a_correction_can_turn_the_verdict(bench: Bench) -> None:
    bench.found["rear_left"] = measurement(toe=0.02)
    bench.store.zeros = (zero_of("rear_left", camber=0.0, toe=0.019),)
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.OK


def test_a_wheel_without_angles_names_no_zero(bench: Bench) -> None:
    bench.rigs["front_left"].shoot_error = store_error()
    bench.store.zeros = tuple(zero_of(wheel) for wheel in WHEELS)
    report = bench.trigger()
    assert report is not None
    wheels = {wheel.wheel: wheel for wheel in report.record.wheels}
    assert wheels["front_left"].outcome is WheelOutcome.FAULT
    assert wheels["front_left"].zero_measurement_id is None
    assert wheels["front_right"].zero_measurement_id == "zero-front_right"


def test_when_the_zeros_cannot_be_read_nothing_is_measured_without_them(bench: Bench) -> None:
    bench.store.zeros_error = store_error()
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    assert {wheel.outcome for wheel in report.record.wheels} == {WheelOutcome.FAULT}
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is ErrorCode.STORE_FAULT


def test_a_large_uncertainty_of_the_master_refuses_the_wheel(bench: Bench) -> None:
    bench.store.zeros = (replace(zero_of("front_left"), toe_u=0.1),)
    report = bench.trigger()
    assert report is not None
    assert report.record.wheels[0].reason_code == "too_uncertain"
    assert report.record.wheels[0].zero_measurement_id is None
