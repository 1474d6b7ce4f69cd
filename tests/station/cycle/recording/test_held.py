from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from uuid import uuid4

import pytest

from alignment.values import Refusal, RefusalCode
from db.records import CycleOutcome
from station.cycle.words.cycle import Abort, Acknowledge, Outcome, Reset, StationState
from tests.station.bench import Bench, Restarted, measurement, open_bench

REFUSED = Refusal(RefusalCode.HEAD_DARK, "head_1 left: no light lines")


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


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
    assert event.cycle_uuid == report.record.uuid


def test_reset_gives_held_results_up_and_says_so(bench: Bench) -> None:
    bench.line.acknowledges = False
    bench.trigger()
    bench.line.queue.append(Reset(9))
    bench.cycle.step(0.1)
    assert bench.cycle.state is StationState.IDLE
    assert "discarded" in bench.store.event_codes


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
    assert [record.outcome for record in bench.store.cycles] == [CycleOutcome.OK, CycleOutcome.ABORTED]
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


def test_acknowledgement_of_another_start_does_not_count(bench: Bench) -> None:
    bench.line.at[StationState.REPORTING] = Acknowledge(200)
    bench.line.acknowledges = False
    bench.trigger()
    assert "not_acknowledged" in bench.store.event_codes


def test_clock_that_was_set_back_brings_no_acknowledged_cycle_back(bench: Bench) -> None:
    """The search for the acknowledgement ended at the first event that was older than the start."""
    bench.line.acknowledges = False
    bench.trigger()
    bench.today -= timedelta(hours=1)
    bench.line.queue.append(Acknowledge(1))
    bench.cycle.step(0.1)
    later = replace(bench.store.events[-1], code="refused", text="a start was refused")
    bench.store.events += [replace(later, uuid=uuid4()) for _ in range(150)]
    with Restarted(bench) as after:
        assert after.line.sent == []
        assert after.cycle.state is StationState.IDLE


@pytest.mark.parametrize("hours", [-1, 1])
def test_last_cycle_is_the_one_stored_last_whatever_the_clock_says(bench: Bench, hours: int) -> None:
    bench.trigger(1)
    bench.today += timedelta(hours=hours)
    bench.line.acknowledges = False
    bench.trigger(2)
    with Restarted(bench) as after:
        assert [sent[0] for sent in after.line.sent] == [2]


def test_acknowledgement_that_an_earlier_program_stored_counts(bench: Bench) -> None:
    """Its events have UUIDs of their own."""
    bench.trigger()
    bench.store.events = [replace(event, uuid=uuid4()) for event in bench.store.events]
    with Restarted(bench) as after:
        assert after.line.sent == []


def test_no_text_is_an_acknowledgement(bench: Bench) -> None:
    """An event of whatever text that began with the cycle's UUID took its results from the line."""
    bench.line.acknowledges = False
    bench.trigger(7)
    (record,) = bench.store.cycles
    said = next(event for event in bench.store.events if event.code == "offered")
    bench.store.events.append(replace(said, uuid=uuid4(), code="acknowledged", cycle_uuid=None))
    with Restarted(bench) as after:
        assert [sent[0] for sent in after.line.sent] == [7]
        # Nor is any text needed for one.
        after.store.events = [replace(event, text="") for event in after.store.events]
        after.line.queue = [Acknowledge(7)]
        after.cycle.step(0.1)
        after.store.events = [replace(event, text="taken") for event in after.store.events]
        with Restarted(after) as again:
            assert again.line.sent == []
    assert record.uuid in {event.cycle_uuid for event in bench.store.events}
