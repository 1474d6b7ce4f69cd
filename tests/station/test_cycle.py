from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest

from alignment.errors import CameraError, LineConnectionError, StoreUnavailableError
from alignment.values import Refusal, RefusalCode
from db.records import CheckOutcome, CycleOutcome, Verdict, WheelOutcome
from sensors.formats import read_shot
from station.line.messages import (
    Abort,
    Acknowledge,
    LineErrorCode,
    LiveAngles,
    LiveState,
    Mode,
    Outcome,
    Prepare,
    Reset,
    StationState,
    Stop,
)
from station.wheels import WheelPosition, connect_all
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
    assert bench.line.sent[0][2:] == ((), None)


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
    assert LineErrorCode.MEASUREMENT_REFUSED in {status.error_code for status in bench.line.statuses}


@pytest.mark.parametrize("moment", ["arm", "shoot"])
def test_failing_camera_ends_in_fault_until_reset(bench: Bench, moment: str) -> None:
    setattr(bench.rigs["rear_left"], f"{moment}_error", camera_error())
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    assert report.record.reason_code == "camera_fault"
    assert "it burns" in (report.record.reason_text or "")
    assert bench.line.outcomes["rear_left"] is Outcome.FAULT
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is LineErrorCode.CAMERA_FAULT
    bench.trigger(2)
    assert bench.line.refused == [(2, LineErrorCode.RESET_REQUIRED)]
    setattr(bench.rigs["rear_left"], f"{moment}_error", None)
    bench.line.queue.append(Reset(3))
    assert bench.cycle.step(0.1) is None
    assert bench.cycle.state is StationState.IDLE
    report = bench.trigger(4)
    assert report is not None
    assert report.told is Outcome.OK


def test_all_cameras_failing_to_arm_still_gives_a_record_and_an_answer(bench: Bench) -> None:
    for rig in bench.rigs.values():
        rig.arm_error = camera_error()
    bench.trigger()
    assert StationState.MEASURING not in bench.states
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
    assert bench.cycle.state is StationState.FAULT


def test_reset_does_not_leave_the_fault_while_a_camera_is_away(bench: Bench) -> None:
    bench.rigs["front_left"].shoot_error = camera_error()
    bench.trigger()
    bench.rigs["front_left"].connect_error = camera_error()
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is LineErrorCode.CAMERA_FAULT
    bench.rigs["front_left"].connect_error = None
    bench.line.queue.append(Reset(3))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE


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
    assert bench.line.status.error_code is LineErrorCode.STORE_FAULT
    assert bench.cycle.state is StationState.FAULT


def test_reset_does_not_leave_the_fault_while_the_database_fails(bench: Bench) -> None:
    bench.store.error = store_error()
    bench.trigger()
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    assert bench.line.status.error_code is LineErrorCode.STORE_FAULT
    bench.store.error = None
    bench.line.queue.append(Reset(3))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE


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


@pytest.mark.parametrize(
    "state",
    [StationState.ARMED, StationState.MEASURING, StationState.EVALUATING],
)
def test_abort_before_the_commit_is_recorded_and_told_as_aborted(bench: Bench, state: StationState) -> None:
    bench.line.at[state] = Abort(1)
    if state is StationState.MEASURING:
        gate = bench.rigs["rear_right"].gate = threading.Event()
        bench.line.on_delivery = gate.set
    report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.ABORTED
    assert report.record.reason_code == "aborted"
    assert set(bench.line.outcomes.values()) == {Outcome.ABORTED}
    assert bench.cycle.state is StationState.IDLE
    assert [record.outcome for record in bench.store.cycles] == [CycleOutcome.ABORTED]


def test_abort_during_the_commit_keeps_the_record_and_tells_aborted(bench: Bench) -> None:
    bench.line.at[StationState.STORING] = Abort(1)
    report = bench.trigger()
    assert report is not None
    assert [record.outcome for record in bench.store.cycles] == [CycleOutcome.OK]
    assert set(bench.line.outcomes.values()) == {Outcome.ABORTED}
    assert "aborted_late" in bench.store.event_codes
    assert bench.cycle.state is StationState.IDLE


def test_abort_after_the_results_changes_nothing(bench: Bench) -> None:
    bench.line.at[StationState.REPORTING] = Abort(1)
    report = bench.trigger()
    assert report is not None
    assert report.told is Outcome.OK
    assert bench.cycle.state is StationState.IDLE


@pytest.mark.parametrize("state", [StationState.IDLE, StationState.FAULT])
def test_abort_without_a_cycle_is_harmless(bench: Bench, state: StationState) -> None:
    if state is StationState.FAULT:
        bench.store.error = store_error()
        bench.trigger()
    bench.line.queue.append(Abort(1))
    assert bench.cycle.step(0.1) is None
    assert bench.cycle.state is state


def test_abort_of_another_cycle_is_ignored(bench: Bench) -> None:
    bench.line.at[StationState.ARMED] = Abort(77)
    report = bench.trigger()
    assert report is not None
    assert report.told is Outcome.OK


@pytest.mark.parametrize(
    "state", [StationState.ARMED, StationState.MEASURING, StationState.EVALUATING, StationState.STORING]
)
def test_reset_in_a_cycle_tells_nothing_of_the_forgotten_vehicle(bench: Bench, state: StationState) -> None:
    bench.line.at[state] = Reset(9)
    if state is StationState.MEASURING:
        gate = bench.rigs["rear_right"].gate = threading.Event()
        bench.line.on_delivery = gate.set
    report = bench.trigger()
    assert report is not None
    assert report.told is None
    assert bench.line.sent == []
    assert len(bench.store.cycles) == 1
    assert bench.cycle.state is StationState.IDLE


def test_reset_after_the_results_of_a_fault_leaves_the_fault(bench: Bench) -> None:
    bench.rigs["front_left"].shoot_error = camera_error()
    bench.line.at[StationState.REPORTING] = Reset(9)
    bench.line.acknowledges = False
    bench.trigger()
    assert StationState.FAULT in bench.states
    assert bench.cycle.state is StationState.IDLE


def test_reset_of_an_idle_station_is_harmless(bench: Bench) -> None:
    bench.line.queue.append(Reset(9))
    assert bench.cycle.step(0.1) is None
    assert bench.cycle.state is StationState.IDLE


def test_results_are_held_until_they_are_acknowledged(bench: Bench) -> None:
    bench.line.acknowledges = False
    before = bench.clock.now
    report = bench.trigger()
    assert report is not None
    assert bench.clock.now - before == pytest.approx(2.0)
    assert "not_acknowledged" in bench.store.event_codes
    assert bench.cycle.step(0.1) is None
    assert bench.cycle.state is StationState.REPORTING
    bench.line.queue.append(Acknowledge(200))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.REPORTING
    bench.line.queue.append(Acknowledge(1))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE
    (event,) = (e for e in bench.store.events if e.code == "acknowledged")
    assert event.text.startswith(str(report.record.uuid))


def test_reset_gives_held_results_up_and_says_so(bench: Bench) -> None:
    bench.line.acknowledges = False
    bench.trigger()
    bench.line.queue.append(Reset(9))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE
    assert "discarded" in bench.store.event_codes


class Restarted:
    """The same station after its program ended: the same database, a new line, a new cycle."""

    def __init__(self, before: Bench) -> None:
        self.bench = Bench()
        self.bench.store.cycles = before.store.cycles
        self.bench.store.events = before.store.events
        self.bench.cycle.start()

    def __enter__(self) -> Bench:
        return self.bench

    def __exit__(self, *error: object) -> None:
        self.bench.cycle.close()


def test_unacknowledged_results_are_offered_again_after_a_restart(bench: Bench) -> None:
    bench.line.acknowledges = False
    bench.found["rear_left"] = measurement(toe=0.02)
    bench.trigger(7)
    with Restarted(bench) as after:
        assert after.line.sent == bench.line.sent
        assert after.cycle.state is StationState.REPORTING
        after.line.queue = [Acknowledge(7)]
        after.cycle.step(0.1)
        assert after.cycle.state is StationState.IDLE
        with Restarted(after) as again:
            assert again.line.sent == []
            assert again.cycle.state is StationState.IDLE


@pytest.mark.parametrize("command", [Acknowledge(1), Reset(2)])
def test_results_that_were_taken_or_given_up_are_not_offered_again(bench: Bench, command: object) -> None:
    bench.line.acknowledges = False
    bench.trigger()
    bench.line.queue.append(command)  # type: ignore[arg-type]
    bench.cycle.step(0.1)
    with Restarted(bench) as after:
        assert after.line.sent == []


def test_vehicle_that_was_told_aborted_is_not_offered_as_ok(bench: Bench) -> None:
    bench.line.acknowledges = False
    bench.line.at[StationState.STORING] = Abort(1)
    bench.trigger()
    assert [record.outcome for record in bench.store.cycles] == [CycleOutcome.OK]
    with Restarted(bench) as after:
        assert set(after.line.outcomes.values()) == {Outcome.ABORTED}


def test_vehicle_that_a_reset_forgot_amid_its_commit_is_not_offered(bench: Bench) -> None:
    bench.line.at[StationState.STORING] = Reset(9)
    bench.trigger()
    with Restarted(bench) as after:
        assert after.line.sent == []


def test_acknowledgement_is_found_behind_many_other_events(bench: Bench) -> None:
    bench.trigger()
    bench.store.events += [replace(bench.store.events[0], uuid=uuid4()) for _ in range(150)]
    with Restarted(bench) as after:
        assert after.line.sent == []


def test_results_of_another_station_in_the_same_database_are_not_ours(bench: Bench) -> None:
    bench.line.acknowledges = False
    bench.trigger()
    bench.store.cycles = [replace(record, station="station_2", uuid=uuid4()) for record in bench.store.cycles]
    with Restarted(bench) as after:
        assert after.line.sent == []


def test_aborted_and_faulty_cycles_are_offered_as_what_they_are(bench: Bench) -> None:
    bench.line.acknowledges = False
    bench.found["front_right"] = REFUSED
    bench.trigger()
    with Restarted(bench) as after:
        assert after.line.sent == bench.line.sent


def test_master_wheel_is_stored_as_a_check_too(bench: Bench) -> None:
    bench.found["rear_left"] = measurement(toe=0.02)
    bench.trigger(mode=Mode.MASTER_CHECK)
    outcomes = {check.calibration_id: check.outcome for check in bench.store.checks}
    assert outcomes == {
        f"cal-{wheel}": CheckOutcome.OUT if wheel == "rear_left" else CheckOutcome.WITHIN for wheel in WHEELS
    }
    assert len(bench.store.cycles) == 1


def test_adjusting_shows_live_angles_until_stop_and_then_measures(bench: Bench) -> None:
    bench.found["rear_left"] = measurement(toe=0.02)
    shown: list[int] = []

    def stop_after_two_of_each() -> None:
        shown.append(1)
        wheels = [angles.wheel for angles, _ in bench.line.live]
        if min(wheels.count(wheel) for wheel in WHEELS) == 2:
            bench.line.queue.append(Stop(1))

    bench.line.on_live = stop_after_two_of_each
    report = bench.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.NOK
    assert bench.states[1:4] == [StationState.ARMED, StationState.ADJUSTING, StationState.MEASURING]
    last = {angles.wheel: angles for angles, _ in bench.line.live}
    assert last["rear_left"].state is LiveState.OUTSIDE
    assert last["front_left"].state is LiveState.INSIDE
    assert last["front_left"].camber_deg == pytest.approx(math.degrees(0.001))
    assert last["front_left"].shot >= 2
    assert len(bench.store.cycles) == 1


def test_camera_that_fails_amid_adjusting_is_shown_and_does_not_end_it(bench: Bench) -> None:
    bench.rigs["front_left"].shoot_error = camera_error()

    def mend() -> None:
        if bench.line.live[-1][0] == LiveAngles("front_left", LiveState.NOT_MEASURED, 1):
            bench.rigs["front_left"].shoot_error = None
            bench.line.queue.append(Stop(1))

    bench.line.on_live = mend
    report = bench.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.OK


@pytest.mark.parametrize(
    ("command", "told"), [(Abort(1, LineErrorCode.COMMUNICATION_LOST), Outcome.ABORTED), (Reset(9), None)]
)
def test_adjusting_ends_by_abort_and_reset(
    bench: Bench, command: Abort | Reset, told: Outcome | None
) -> None:
    bench.line.at[StationState.ADJUSTING] = command
    report = bench.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is told
    assert StationState.MEASURING not in bench.states
    assert report.record.outcome is CycleOutcome.ABORTED
    assert bench.cycle.state is StationState.IDLE


def test_adjusting_without_end_is_aborted() -> None:
    with open_bench(adjust_s=0.0) as bench:
        report = bench.trigger(mode=Mode.ADJUST)
        assert report is not None
        assert report.told is Outcome.ABORTED
        assert "adjust_timeout" in (report.record.reason_text or "")
        assert bench.cycle.state is StationState.IDLE


def test_prepare_arms_the_cameras_or_is_refused(bench: Bench) -> None:
    bench.rigs["front_left"].arm_error = camera_error()
    bench.line.queue.append(Prepare(3, WHEELS, 1))
    bench.cycle.step(0.1)
    assert [name for name in bench.log if name.startswith("armed")] == [f"armed {w}" for w in WHEELS[1:]]
    bench.line.queue.append(Prepare(4, WHEELS, 77))
    bench.cycle.step(0.1)
    assert bench.line.refused == [(4, LineErrorCode.UNKNOWN_VEHICLE_TYPE)]
    assert bench.cycle.state is StationState.IDLE


def test_acknowledgement_of_another_start_does_not_count(bench: Bench) -> None:
    bench.line.at[StationState.REPORTING] = Acknowledge(200)
    bench.line.acknowledges = False
    bench.trigger()
    assert "not_acknowledged" in bench.store.event_codes


def test_bus_that_fails_at_the_results_ends_in_fault_with_the_record_kept(bench: Bench) -> None:
    bench.line.send_error = LineConnectionError("bus off")
    report = bench.trigger()
    assert report is not None
    assert report.told is None
    assert len(bench.store.cycles) == 1
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is LineErrorCode.LINE_FAULT
    assert "not_reported" in bench.store.event_codes


def test_wheel_that_takes_too_long_ends_in_fault_until_it_is_done() -> None:
    with open_bench(measure_s=0.0) as bench:
        gates = [threading.Event() for _ in WHEELS]
        for rig, gate in zip(bench.rigs.values(), gates, strict=True):
            rig.gate = gate
        report = bench.trigger()
        assert report is not None
        assert report.record.reason_code == "cycle_timeout"
        assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
        bench.line.queue.append(Reset(2))
        bench.cycle.step(0.1)
        assert bench.cycle.state is StationState.FAULT
        assert bench.line.status.error_code is LineErrorCode.CYCLE_TIMEOUT
        for gate in gates:
            gate.set()
        for future in bench.cycle._running:
            future.result(10.0)
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
        (WHEELS, 5, LineErrorCode.UNKNOWN_VEHICLE_TYPE),
        (("third_left",), 1, LineErrorCode.WHEEL_NOT_AVAILABLE),
        (("rear_left",), 9, LineErrorCode.WHEEL_NOT_AVAILABLE),
    ],
)
def test_start_that_cannot_be_served_is_refused_and_leaves_the_station_ready(
    bench: Bench, wheels: tuple[str, ...], vehicle_type: int, code: LineErrorCode
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
    assert bench.line.status.error_code is LineErrorCode.INTERNAL_FAULT


def test_camera_that_still_hangs_after_an_abort_ends_in_fault() -> None:
    with open_bench(measure_s=0.05) as bench:
        bench.rigs["rear_right"].gate = threading.Event()
        bench.line.at[StationState.MEASURING] = Abort(1)
        bench.trigger()
        assert set(bench.line.outcomes.values()) == {Outcome.ABORTED}
        assert bench.cycle.state is StationState.FAULT
        assert bench.line.status.error_code is LineErrorCode.CYCLE_TIMEOUT


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


def test_connecting_reports_every_rig_that_failed(bench: Bench) -> None:
    for name in ("front_left", "rear_right"):
        bench.rigs[name].connect_error = CameraError(name, "no answer")
    failures = connect_all(list(bench.rigs.values()))
    assert [str(failure) for failure in failures] == [
        "camera front_left: no answer",
        "camera rear_right: no answer",
    ]


def test_times_of_a_cycle_run_on_the_monotonic_clock(bench: Bench) -> None:
    bench.trigger()
    (record,) = bench.store.cycles
    assert record.received_monotonic_s is not None
    assert record.measured_monotonic_s is not None
    assert record.received_monotonic_s <= record.measured_monotonic_s
    assert np.isfinite(record.received_monotonic_s)


def test_calibrate_records_images_and_judges_nothing(bench: Bench, tmp_path: Path) -> None:
    assert bench.trigger(mode=Mode.CALIBRATE) is None
    assert bench.line.refused == [(1, LineErrorCode.MODE_NOT_AVAILABLE)]
    with open_bench(image_folder=tmp_path / "images") as able:
        able.rigs["rear_right"].shoot_error = camera_error()
        able.trigger(2, wheels=WHEELS[:3], mode=Mode.CALIBRATE)
        assert set(able.line.outcomes.values()) == {Outcome.RECORDED}
        assert able.store.cycles == []
        assert "images" in able.store.event_codes
        assert able.cycle.state is StationState.IDLE
        (folder,) = (tmp_path / "images").iterdir()
        assert sorted(path.name for path in folder.iterdir()) == sorted(WHEELS[:3])
        assert read_shot(folder / "front_left").rig == "front_left"
        able.trigger(3, mode=Mode.CALIBRATE)
        assert able.line.outcomes["rear_right"] is Outcome.FAULT
        assert able.line.outcomes["front_left"] is Outcome.RECORDED
        assert able.cycle.state is StationState.FAULT
        assert able.line.status.error_code is LineErrorCode.CAMERA_FAULT


def test_calibrate_ends_when_a_reset_comes(tmp_path: Path) -> None:
    with open_bench(image_folder=tmp_path) as bench:
        bench.line.at[StationState.REPORTING] = Reset(9)
        bench.trigger(mode=Mode.CALIBRATE)
        assert bench.line.sent == []
        assert bench.cycle.state is StationState.IDLE
