"""What the line was told and what is stored agree in the end, whatever outlasts its bound."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from alignment.errors import InputError
from alignment.values import Refusal, RefusalCode
from db.queries import ResultReader, since_last_good_check, vin_history
from db.records import CycleOutcome, CycleRecord, EventRecord, Verdict, WheelOutcome
from db.store import ResultStore
from station.cycle.words.cycle import (
    Abort,
    Acknowledge,
    Command,
    ErrorCode,
    Mode,
    Outcome,
    Reset,
    StationState,
)
from tests.station.bench import (
    GATE_S,
    MASTER,
    VIN,
    WHEELS,
    Bench,
    Restarted,
    camera_error,
    measurement,
    open_bench,
    store_error,
)

STORE_S = 0.1
REFUSING = InputError(field="vin", expected="text that a database stores")
REFUSED = Refusal(RefusalCode.HEAD_DARK, "head_1 left: no light lines")


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench(store_s=STORE_S) as bench:
        yield bench


class Delay:
    """Holds the first record of a kind until it is let go."""

    def __init__(self, of: Callable[[Any], bool]) -> None:
        self.gate = threading.Event()
        self._of = of
        self._held = False

    def __call__(self, record: Any) -> None:
        if self._of(record) and not self._held:
            self._held = True
            assert self.gate.wait(GATE_S)


def is_cycle(record: Any) -> bool:
    return isinstance(record, CycleRecord)


def is_offer(record: Any) -> bool:
    return isinstance(record, EventRecord) and record.code == "offered"


def ends_well(bench: Bench, delay: Delay) -> None:
    delay.gate.set()
    assert bench.everything_stored()


def last_word(bench: Bench) -> CycleOutcome:
    return bench.store.cycles[-1].outcome


@pytest.mark.parametrize("moment", ["hold", "landed"])
@pytest.mark.parametrize("of", [is_cycle, is_offer])
@pytest.mark.parametrize("found", [measurement(), measurement(toe=0.02), REFUSED])
def test_commit_that_outlasts_its_bound_is_set_right_behind_it(
    bench: Bench, moment: str, of: Callable[[Any], bool], found: Any
) -> None:
    """The line was told fault and acknowledged it; then the cycle landed as ok, and was offered as ok."""
    delay = Delay(of)
    setattr(bench.store, moment, delay)
    bench.found["rear_left"] = found
    report = bench.trigger(7)
    assert report is not None
    assert report.told is Outcome.FAULT
    assert bench.cycle.state is StationState.FAULT
    ends_well(bench, delay)
    first, last = bench.store.cycles
    assert first == report.record
    assert last.outcome is CycleOutcome.FAULT
    assert (last.trigger_sequence, last.vehicle, last.received_utc) == (7, first.vehicle, first.received_utc)
    assert last.reason_code == "store_fault"
    assert str(first.uuid) in (last.reason_text or "")
    assert {(wheel.wheel, wheel.outcome, wheel.verdict) for wheel in last.wheels} == {
        (wheel, WheelOutcome.FAULT, Verdict.NONE) for wheel in WHEELS
    }
    (said,) = (event for event in bench.store.events if event.code == "contradicted")
    assert str(first.uuid) in said.text
    assert f"stored as '{first.outcome}'" in said.text
    with Restarted(bench) as after:
        assert after.line.sent == []
        assert after.cycle.state is StationState.IDLE


def test_station_is_not_reset_while_the_late_commit_hangs(bench: Bench) -> None:
    delay = bench.store.hold = Delay(is_cycle)
    bench.trigger()
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is ErrorCode.STORE_FAULT
    ends_well(bench, delay)
    bench.line.queue.append(Reset(3))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE
    bench.trigger(4)
    assert last_word(bench) is CycleOutcome.OK


@pytest.mark.parametrize("moment", ["hold", "landed"])
@pytest.mark.parametrize("of", [is_cycle, is_offer])
@pytest.mark.parametrize(
    ("command", "told"), [(Abort(7), Outcome.ABORTED), (Reset(9), None)], ids=["abort", "reset"]
)
def test_late_commit_of_a_vehicle_that_was_aborted_or_forgotten(
    bench: Bench, moment: str, of: Callable[[Any], bool], command: Command, told: Outcome | None
) -> None:
    delay = Delay(of)
    setattr(bench.store, moment, delay)
    bench.line.at[StationState.STORING] = command
    report = bench.trigger(7)
    assert report is not None
    assert report.told is told
    ends_well(bench, delay)
    assert last_word(bench) is CycleOutcome.ABORTED
    with Restarted(bench) as after:
        assert after.line.sent == []


@pytest.mark.parametrize("seen", ["cycle only", "offered too"])
def test_station_that_was_killed_amid_the_commit_does_not_offer_ok(bench: Bench, seen: str) -> None:
    """Whether the line was told of a fault before the end is not known then, so it can only be a fault."""
    bench.line.acknowledges = False
    bench.trigger(7)
    if seen == "cycle only":
        bench.store.events = [event for event in bench.store.events if event.code == "started"]
    with Restarted(bench) as after:
        offered = Outcome.FAULT if seen == "cycle only" else Outcome.OK
        assert set(after.line.outcomes.values()) == {offered}
        assert after.line.sent[0][0] == 7
        assert str(last_word(after)) == str(offered)
        assert ("contradicted" in after.store.event_codes) == (offered is Outcome.FAULT)
        with Restarted(after) as again:
            assert again.line.sent == after.line.sent
            assert len(again.store.cycles) == len(after.store.cycles)
        after.line.queue = [Acknowledge(7)]
        after.cycle.step(0.1)
        with Restarted(after) as again:
            assert again.line.sent == []


@pytest.mark.parametrize("found", [measurement(), REFUSED])
def test_vehicle_told_as_fault_is_stored_as_fault_when_the_database_is_back(bench: Bench, found: Any) -> None:
    bench.found["rear_left"] = found
    bench.store.error = store_error()
    bench.trigger(7)
    assert bench.store.cycles == []
    bench.store.error = None
    bench.line.queue.append(Reset(8))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE
    (record,) = bench.store.cycles
    assert record.outcome is CycleOutcome.FAULT
    assert {wheel.verdict for wheel in record.wheels} == {Verdict.NONE}
    (said,) = (event for event in bench.store.events if event.code == "contradicted")
    assert "not stored" in said.text


def test_database_that_comes_back_is_given_what_it_is_owed_without_a_reset(bench: Bench) -> None:
    bench.store.error = store_error()
    bench.trigger()
    bench.store.error = None
    while bench.owes:
        bench.cycle.step(1.0)
    assert last_word(bench) is CycleOutcome.FAULT
    assert "acknowledged" in bench.store.event_codes
    assert bench.cycle.state is StationState.FAULT


def test_record_that_says_what_was_told_is_stored_itself(bench: Bench) -> None:
    for rig in bench.rigs.values():
        rig.shoot_error = camera_error()
    delay = bench.store.hold = Delay(is_cycle)
    report = bench.trigger()
    ends_well(bench, delay)
    assert report is not None
    assert bench.store.cycles == [report.record]


def test_record_that_no_database_takes_does_not_keep_the_station_at_fault(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(record: CycleRecord) -> None:
        raise REFUSING

    monkeypatch.setattr(bench.store, "write_cycle", refuse)
    bench.trigger()
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE


def test_master_is_no_good_check_before_its_cycle_is_stored(bench: Bench) -> None:
    bench.store.hold = Delay(is_cycle)
    bench.trigger(vehicle_type=MASTER.number, mode=Mode.MASTER_CHECK)
    assert bench.store.checks == []
    bench.store.hold.gate.set()
    assert bench.everything_stored()
    assert bench.store.checks == []


@pytest.mark.parametrize("how", [Acknowledge(1), Reset(2)])
def test_end_of_a_vehicle_that_could_not_be_stored_is_not_followed_by_ready(
    bench: Bench, how: Command
) -> None:
    """The station went on; after a restart it offered the acknowledged results once more."""
    bench.line.acknowledges = False
    bench.trigger()
    bench.store.error = store_error()
    bench.line.queue.append(how)
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is ErrorCode.STORE_FAULT
    bench.line.queue.append(Reset(3))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.FAULT
    bench.store.error = None
    bench.line.queue.append(Reset(4))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE
    with Restarted(bench) as after:
        assert after.line.sent == []


def test_acknowledgement_that_hangs_is_not_followed_by_ready(bench: Bench) -> None:
    delay = bench.store.hold = Delay(lambda record: getattr(record, "code", "") == "acknowledged")
    bench.trigger()
    assert bench.cycle.state is StationState.FAULT
    ends_well(bench, delay)
    with Restarted(bench) as after:
        assert after.line.sent == []


def test_store_that_hangs_for_ever_does_not_hang_the_end_of_the_station() -> None:
    """Closing waited for the call under way, for ever."""
    bench = Bench(store_s=STORE_S)
    bench.cycle.start()
    delay = bench.store.hold = Delay(is_cycle)
    bench.trigger()
    ended = threading.Thread(target=bench.cycle.close)
    ended.start()
    ended.join(GATE_S / 2)
    assert not ended.is_alive()
    delay.gate.set()


class LateStore(ResultStore):
    """A real database whose commits outlast their bound."""

    delay: Delay

    def write_cycle(self, record: CycleRecord) -> None:
        super().write_cycle(record)
        self.delay(record)


def test_last_word_of_the_vehicle_is_fault_in_the_database_too(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'results.db'}"
    delay = Delay(is_cycle)
    with LateStore(url, create=True) as store:
        store.delay = delay
        with open_bench(store_s=0.5, store=store) as bench:
            report = bench.trigger(7)
            assert report is not None
            assert report.told is Outcome.FAULT
            ends_well(bench, delay)
    with ResultReader(url) as reader:
        history = vin_history(reader, VIN)
        groups = since_last_good_check(reader)
    assert [stored.record.outcome for stored in history.cycles] == [CycleOutcome.OK, CycleOutcome.FAULT]
    assert {"contradicted", "acknowledged"} <= {event.code for event in history.events}
    (since,) = groups
    assert [vehicle.outcome for vehicle in since.vehicles] == [CycleOutcome.OK, CycleOutcome.FAULT]
    with ResultStore(url) as store, open_bench(store=store) as again:
        assert again.line.sent == []
        assert again.cycle.state is StationState.IDLE
