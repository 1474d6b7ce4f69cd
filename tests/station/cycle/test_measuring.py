from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from alignment.errors import CameraError, LineConnectionError, StoreUnavailableError
from alignment.values import Refusal, RefusalCode
from db.records import CycleOutcome, Verdict, WheelOutcome
from station.cycle.wheels.positions import WheelPosition
from station.cycle.words.cycle import ErrorCode, Mode, Outcome, Reset, StationState
from tests.station.bench import WHEELS, Bench, camera_error, measurement, open_bench, store_error

GOOD_WAY = [
    StationState.ARMED,
    StationState.MEASURING,
    StationState.EVALUATING,
    StationState.STORING,
    StationState.REPORTING,
    StationState.IDLE,
]
REFUSED = Refusal(RefusalCode.HEAD_DARK, "head_1 left: no light lines")


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


def test_start_records_calibrations_and_says_idle(bench: Bench) -> None:
    assert [record.id for record in bench.store.calibrations] == [f"cal-{wheel}" for wheel in WHEELS]
    assert bench.store.event_codes == ["started"]
    assert bench.states == [StationState.IDLE]


def test_good_vehicle_is_committed_before_anything_is_told(bench: Bench) -> None:
    report = bench.trigger()
    assert report is not None
    assert bench.states[1:] == GOOD_WAY
    assert bench.log.index("commit") < bench.log.index("state reporting") < bench.log.index("results")
    (record,) = bench.store.cycles
    assert record.outcome is CycleOutcome.OK
    assert record.config_hash == "abc"
    assert {wheel.verdict for wheel in record.wheels} == {Verdict.OK}
    assert {(w.knock_evidence, w.camber_unseen, w.toe_unseen) for w in record.wheels} == {(-5.0, 2e-4, 1e-4)}
    assert [axle.axle for axle in record.axles] == ["front", "rear"]
    assert record.vehicle_angles is not None
    assert set(bench.line.outcomes.values()) == {Outcome.OK}
    assert report.told is Outcome.OK
    assert report.committed_s is not None


def test_answers_carry_degrees_and_expanded_uncertainty(bench: Bench) -> None:
    bench.trigger()
    _, wheels, axles, vehicle = bench.line.sent[0]
    assert wheels[0].camber_deg == pytest.approx(math.degrees(0.001))
    assert wheels[0].toe_u95_deg == pytest.approx(math.degrees(2e-5))
    assert axles[0].total_toe_deg == pytest.approx(math.degrees(0.002))
    assert axles[0].total_toe_u95_deg == pytest.approx(math.degrees(2e-5 * math.sqrt(2)))
    assert vehicle.thrust_angle_deg == pytest.approx(0.0)


def test_wheel_out_of_tolerance_makes_the_vehicle_nok_and_the_station_stays_ready(bench: Bench) -> None:
    bench.found["rear_left"] = measurement(toe=0.02)
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.NOK
    assert bench.line.outcomes == {w: Outcome.NOK if w == "rear_left" else Outcome.OK for w in WHEELS}
    assert report.told is Outcome.NOK
    assert bench.cycle.state is StationState.IDLE


def test_single_wheel_has_no_axle_and_no_thrust_angle(bench: Bench) -> None:
    bench.trigger(wheels=["front_left"])
    (record,) = bench.store.cycles
    assert [wheel.wheel for wheel in record.wheels] == ["front_left"]
    assert record.axles == ()
    assert record.vehicle_angles is None
    axles, vehicle = bench.line.sent[0][2:]
    assert (axles, vehicle.outcome, vehicle.geometry.quantities) == ((), Outcome.NOT_REQUESTED, ())


def test_refused_wheel_is_a_fault_of_the_station_and_never_nok(bench: Bench) -> None:
    bench.found["front_right"] = REFUSED
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    assert report.record.reason_code == "head_dark"
    wheel = next(w for w in report.record.wheels if w.wheel == "front_right")
    assert (wheel.outcome, wheel.verdict) == (WheelOutcome.REFUSED, Verdict.NONE)
    assert "no light lines" in (wheel.reason_text or "")
    assert bench.line.outcomes["front_right"] is Outcome.FAULT
    assert bench.line.outcomes["front_left"] is Outcome.OK
    assert report.told is Outcome.FAULT
    assert bench.cycle.state is StationState.IDLE
    assert ErrorCode.MEASUREMENT_REFUSED in {status.error_code for status in bench.line.statuses}


def test_all_cameras_failing_to_arm_still_gives_a_record_and_an_answer(bench: Bench) -> None:
    for rig in bench.rigs.values():
        rig.arm_error = camera_error()
    bench.trigger()
    assert StationState.MEASURING not in bench.states
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
    assert bench.cycle.state is StationState.FAULT


@pytest.mark.parametrize("outcome", ["good", "bad"])
def test_failing_commit_is_told_as_fault_and_never_as_ok_or_nok(bench: Bench, outcome: str) -> None:
    if outcome == "bad":
        bench.found["front_left"] = measurement(toe=0.1)
    bench.store.error = store_error()
    report = bench.trigger()
    assert report is not None
    assert report.committed_s is None
    assert bench.store.cycles == []
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
    assert report.told is Outcome.FAULT
    assert bench.line.status.error_code is ErrorCode.STORE_FAULT
    assert bench.cycle.state is StationState.FAULT


def test_hanging_database_is_told_as_fault_within_the_bound() -> None:
    with open_bench(store_s=0.05) as bench:
        bench.store.gate = threading.Event()
        report = bench.trigger()
        assert report is not None
        assert report.committed_s is None
        assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
        assert bench.cycle.state is StationState.FAULT


def test_start_fails_when_the_database_does() -> None:
    bench = Bench()
    bench.store.error = store_error()
    with pytest.raises(StoreUnavailableError, match="locked"):
        bench.cycle.start()
    bench.cycle.close()


def test_bus_that_fails_at_the_results_ends_in_fault_with_the_record_kept(bench: Bench) -> None:
    bench.line.send_error = LineConnectionError("bus off")
    report = bench.trigger()
    assert report is not None
    assert report.told is None
    assert [record.outcome for record in bench.store.cycles] == [CycleOutcome.OK, CycleOutcome.FAULT]
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is ErrorCode.LINE_FAULT
    assert "not_reported" in bench.store.event_codes


def test_wheel_that_takes_too_long_ends_in_fault_until_it_is_done() -> None:
    with open_bench(measure_s=1.0) as bench:
        gate = threading.Event()
        for rig in bench.rigs.values():
            rig.gate = gate
        bench.line.on_poll = bench.let_the_rigs_shoot_too_long
        report = bench.trigger()
        assert report is not None
        assert report.record.reason_code == "cycle_timeout"
        assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
        bench.line.queue.append(Reset(2))
        bench.cycle.step(0.1)
        assert bench.cycle.state is StationState.FAULT
        assert bench.line.status.error_code is ErrorCode.CYCLE_TIMEOUT
        assert [name for name in bench.log if name.startswith("connected")] == []
        gate.set()
        assert bench.wheels_at_rest(10.0)
        bench.line.queue.append(Reset(3))
        bench.cycle.step(0.1)
        assert bench.cycle.state is StationState.IDLE


def test_mistake_in_the_measurement_is_an_internal_fault_and_not_a_silent_line(bench: Bench) -> None:
    bench.raises = ZeroDivisionError("division by zero")
    report = bench.trigger()
    assert report is not None
    assert report.record.reason_code == "internal_fault"
    assert "ZeroDivisionError" in (report.record.reason_text or "")
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
    assert bench.cycle.state is StationState.FAULT


@pytest.mark.parametrize(
    "found",
    [measurement(camber=math.nan), measurement(toe=math.inf), measurement(u=0.0), measurement(u=math.nan)],
)
def test_angles_that_are_no_numbers_or_have_no_uncertainty_are_a_fault(bench: Bench, found: object) -> None:
    bench.found["front_left"] = found  # type: ignore[assignment]
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    assert bench.line.outcomes["front_left"] is Outcome.FAULT
    assert bench.cycle.state is StationState.FAULT


def test_angle_with_an_uncertainty_that_says_nothing_is_refused(bench: Bench) -> None:
    bench.found["front_left"] = measurement(u=math.radians(0.6))
    report = bench.trigger()
    assert report is not None
    assert report.record.reason_code == "too_uncertain"
    assert bench.line.outcomes["front_left"] is Outcome.FAULT


@pytest.mark.parametrize("days", [-2, 40])
def test_calibration_out_of_date_gives_no_verdict(bench: Bench, days: int) -> None:
    bench.today += timedelta(days=days)
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    assert report.record.reason_code == "calibration_fault"
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}


def test_images_of_other_cameras_than_the_calibration_are_a_fault(bench: Bench) -> None:
    bench.rigs["front_left"].shot = bench.rigs["front_right"].shot
    report = bench.trigger()
    assert report is not None
    assert report.record.reason_code == "calibration_fault"
    assert "front_right" in (report.record.reason_text or "")


@pytest.mark.parametrize(
    ("wheels", "vehicle_type", "code"),
    [
        (WHEELS, 5, ErrorCode.UNKNOWN_VEHICLE_TYPE),
        (("third_left",), 1, ErrorCode.WHEEL_NOT_AVAILABLE),
        (("rear_left",), 9, ErrorCode.WHEEL_NOT_AVAILABLE),
    ],
)
def test_start_that_cannot_be_served_is_refused_and_leaves_the_station_ready(
    bench: Bench, wheels: tuple[str, ...], vehicle_type: int, code: ErrorCode
) -> None:
    assert bench.trigger(wheels=wheels, vehicle_type=vehicle_type) is None
    assert bench.line.refused == [(1, code)]
    assert bench.store.cycles == []
    assert bench.cycle.state is StationState.IDLE
    assert str(code) in bench.store.event_codes


def test_serving_ends_when_told(bench: Bench) -> None:
    stopping = threading.Event()
    stopping.set()
    bench.cycle.serve(stopping)
    assert bench.cycle.state is StationState.IDLE


@pytest.mark.parametrize("state", [StationState.IDLE, StationState.FAULT])
def test_line_is_told_of_a_fault_when_the_program_breaks(bench: Bench, state: StationState) -> None:
    if state is StationState.FAULT:
        bench.rigs["front_left"].shoot_error = camera_error()
        bench.trigger()

    def broken(timeout_s: float) -> None:
        raise ZeroDivisionError

    bench.line.next_command = broken  # type: ignore[method-assign, assignment]
    with pytest.raises(ZeroDivisionError):
        bench.cycle.serve(threading.Event())
    assert bench.line.status.state is StationState.FAULT
    assert bench.line.status.error_code is ErrorCode.INTERNAL_FAULT


def test_angles_without_a_valid_calibration_are_a_fault_even_when_measured(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = WheelPosition.run
    monkeypatch.setattr(
        WheelPosition, "run", lambda self, zeros: replace(run(self, zeros), calibration_valid=False)
    )
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    assert report.record.reason_code == "calibration_fault"
    assert {wheel.verdict for wheel in report.record.wheels} == {Verdict.NONE}
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}


def test_reset_reports_every_rig_that_does_not_connect(bench: Bench) -> None:
    bench.store.error = store_error()
    bench.trigger()
    bench.store.error = None
    for name in ("front_left", "rear_right"):
        bench.rigs[name].connect_error = CameraError(name, "no answer")
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    (event,) = (event for event in bench.store.events if event.code == "camera_fault")
    assert event.text == "camera front_left: no answer; camera rear_right: no answer"
    assert bench.cycle.state is StationState.FAULT


def test_times_of_a_cycle_run_on_the_monotonic_clock(bench: Bench) -> None:
    bench.trigger()
    (record,) = bench.store.cycles
    assert record.received_monotonic_s is not None
    assert record.measured_monotonic_s is not None
    assert record.received_monotonic_s <= record.measured_monotonic_s
    assert np.isfinite(record.received_monotonic_s)


def test_time_of_the_start_is_when_it_was_received_not_when_it_was_served(bench: Bench) -> None:
    bench.queue_trigger()
    bench.clock.now += 3.0
    bench.cycle.step(0.1)
    (record,) = bench.store.cycles
    assert record.received_utc == bench.today - timedelta(seconds=3.0)


@pytest.mark.parametrize("coverage_factor", [1.0, 3.0])
def test_verdicts_and_records_use_the_configured_coverage_factor(coverage_factor: float) -> None:
    with open_bench(coverage_factor=coverage_factor) as bench:
        limit = math.radians(0.5)
        bench.found["front_left"] = measurement(toe=limit - 1.5e-5, u=1e-5)
        report = bench.trigger(wheels=["front_left"])
        assert report is not None
        assert report.told is (Outcome.OK if coverage_factor < 1.5 else Outcome.NOK)
        assert report.record.wheels[0].coverage_factor == coverage_factor
        assert bench.line.sent[0][1][0].toe_u95_deg in (
            None,
            pytest.approx(math.degrees(coverage_factor * 1e-5)),
        )


@pytest.mark.parametrize("part", ["camber_u", "toe_u"])
def test_either_uncertainty_that_says_nothing_refuses_the_wheel(bench: Bench, part: str) -> None:
    large = math.radians(0.6) ** 2
    covariance = np.diag([large, 1e-10] if part == "camber_u" else [1e-10, large])
    bench.found["front_left"] = replace(measurement(), angle_covariance=covariance)
    report = bench.trigger(wheels=["front_left"])
    assert report is not None
    assert report.record.reason_code == "too_uncertain"


@pytest.mark.parametrize("covariance", [np.diag([0.0, 1e-10]), np.diag([1e-10, 0.0])])
def test_either_uncertainty_of_nothing_is_a_fault(bench: Bench, covariance: object) -> None:
    bench.found["front_left"] = replace(measurement(), angle_covariance=covariance)  # type: ignore[arg-type]
    report = bench.trigger(wheels=["front_left"])
    assert report is not None
    assert report.record.reason_code == "internal_fault"


def test_device_time_is_that_of_the_first_camera(bench: Bench) -> None:
    rig = bench.rigs["front_left"]
    first, *others = rig.shot.heads
    rig.shot = replace(
        rig.shot, heads=(replace(first, left=replace(first.left, device_time_s=987.5)), *others)
    )
    bench.trigger(wheels=["front_left"])
    assert bench.store.cycles[0].wheels[0].device_time_s == 987.5


def test_store_fault_is_not_told_of_the_wheel_that_was_refused(bench: Bench) -> None:
    """The wheel of the cycle's own failure stayed beside an error that was about no wheel."""
    bench.found["rear_left"] = REFUSED
    bench.store.error = store_error()
    bench.trigger()
    assert bench.cycle.state is StationState.FAULT
    assert (bench.line.status.error_code, bench.line.status.wheel) == (ErrorCode.STORE_FAULT, None)


def test_what_is_noted_of_a_cycle_names_it(bench: Bench) -> None:
    bench.line.acknowledges = False
    report = bench.trigger(mode=Mode.MASTER_CHECK)
    assert report is not None
    named = {event.code: event.cycle_uuid for event in bench.store.events}
    assert named == {"started": None} | dict.fromkeys(
        ("no_master", "offered", "not_acknowledged"), report.record.uuid
    )
