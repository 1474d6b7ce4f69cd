from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from db.records import CycleOutcome
from station.cycle.words.cycle import Abort, ErrorCode, Mode, Outcome, Reset, StationState
from tests.station.bench import Bench, assert_set, camera_error, open_bench, store_error


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


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
    assert bench.line.status.error_code is ErrorCode.CAMERA_FAULT
    bench.trigger(2)
    assert bench.line.refused == [(2, ErrorCode.RESET_REQUIRED)]
    setattr(bench.rigs["rear_left"], f"{moment}_error", None)
    bench.line.queue.append(Reset(3))
    assert bench.cycle.step(0.1) is None
    assert bench.cycle.state is StationState.IDLE
    report = bench.trigger(4)
    assert report is not None
    assert report.told is Outcome.OK


def test_reset_does_not_leave_the_fault_while_a_camera_is_away(bench: Bench) -> None:
    bench.rigs["front_left"].shoot_error = camera_error()
    bench.trigger()
    bench.rigs["front_left"].connect_error = camera_error()
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is ErrorCode.CAMERA_FAULT
    bench.rigs["front_left"].connect_error = None
    bench.line.queue.append(Reset(3))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE


def test_reset_does_not_leave_the_fault_while_the_database_fails(bench: Bench) -> None:
    bench.store.error = store_error()
    bench.trigger()
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    assert bench.line.status.error_code is ErrorCode.STORE_FAULT
    bench.store.error = None
    bench.line.queue.append(Reset(3))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE


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
    first, last = bench.store.cycles
    assert (first.outcome, last.outcome) == (CycleOutcome.OK, CycleOutcome.ABORTED)
    assert str(first.uuid) in (last.reason_text or "")
    assert set(bench.line.outcomes.values()) == {Outcome.ABORTED}
    assert "aborted_late" in bench.store.event_codes
    assert bench.log.index("commit") < bench.log.index("results")
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
    assert bench.store.cycles[-1].outcome is CycleOutcome.ABORTED
    assert len(bench.store.cycles) == (2 if state is StationState.STORING else 1)
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


@pytest.mark.parametrize(
    ("command", "told"), [(Abort(1, ErrorCode.COMMUNICATION_LOST), Outcome.ABORTED), (Reset(9), None)]
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


def test_camera_that_still_hangs_after_an_abort_ends_in_fault() -> None:
    with open_bench(measure_s=0.05) as bench:
        rig = bench.rigs["rear_right"]
        rig.gate = threading.Event()
        bench.line.at[StationState.MEASURING] = Abort(1)
        bench.line.on_delivery = lambda: assert_set(rig.shooting)
        bench.trigger()
        assert set(bench.line.outcomes.values()) == {Outcome.ABORTED}
        assert bench.cycle.state is StationState.FAULT
        assert bench.line.status.error_code is ErrorCode.CYCLE_TIMEOUT


def test_calibrate_ends_when_a_reset_comes(tmp_path: Path) -> None:
    with open_bench(image_folder=tmp_path) as bench:
        bench.line.at[StationState.REPORTING] = Reset(9)
        bench.trigger(mode=Mode.CALIBRATE)
        assert bench.line.sent == []
        assert bench.cycle.state is StationState.IDLE
