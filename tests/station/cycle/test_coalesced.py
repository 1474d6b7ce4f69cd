"""What a controller or a cable can provoke at will fills neither the database nor the program's log."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from db.records import Severity
from station.cycle.coalesced import MOST_KINDS, Coalesced
from station.cycle.words.cycle import Mode, Reset, StationState
from tests.station.bench import Clock, camera_error, open_bench
from tests.station.line.line_bench import Clock as LineClock


def test_start_that_is_refused_over_and_over_is_one_event_and_its_summaries() -> None:
    """1,309 refused starts in four seconds were 1,309 events."""
    with open_bench() as bench:
        before = len(bench.store.events)
        for number in range(1309):
            bench.trigger(sequence=number % 255 + 1, vehicle_type=77)
            bench.clock.now += 0.003
        assert [event.code for event in bench.store.events[before:]] == ["unknown_vehicle_type"]
        assert len(bench.line.refused) == 1309, "the line is still answered each time"
        bench.clock.now += 10.0
        bench.cycle.step(0.0)
        first, summary = bench.store.events[before:]
        assert "was refused" in first.text
        assert re.match(r"1308 more within \d+\.\d s, the last: start .*was refused", summary.text)
        assert (summary.severity, summary.code) == (Severity.WARNING, "unknown_vehicle_type")


def test_each_reason_of_a_refusal_is_recorded_at_once() -> None:
    with open_bench() as bench:
        before = len(bench.store.events)
        for number in range(30):
            bench.trigger(sequence=number + 1, vehicle_type=77)
            bench.trigger(sequence=number + 101, mode=Mode.CALIBRATE)
            bench.trigger(sequence=number + 201, vehicle_type=9)
        codes = [event.code for event in bench.store.events[before:]]
        assert codes == ["unknown_vehicle_type", "mode_not_available", "wheel_not_available"]


def test_refusals_of_vehicles_that_come_one_by_one_are_all_recorded() -> None:
    with open_bench() as bench:
        before = len(bench.store.events)
        for number in range(5):
            bench.clock.now += 20.0
            bench.trigger(sequence=number + 1, vehicle_type=77)
        assert len(bench.store.events) - before == 5


def test_what_was_counted_is_recorded_at_the_stop() -> None:
    with open_bench() as bench:
        for number in range(7):
            bench.trigger(sequence=number + 1, vehicle_type=77)
        store = bench.store
    assert "6 more within" in store.events[-1].text


def test_reset_of_a_station_whose_camera_is_away_is_one_event() -> None:
    with open_bench() as bench:
        bench.rigs["front_left"].arm_error = bench.rigs["front_left"].connect_error = camera_error()
        bench.trigger()
        assert bench.cycle.state is StationState.FAULT
        before = len(bench.store.events)
        for number in range(50):
            bench.line.queue.append(Reset(number + 1))
            bench.cycle.step(0.1)
        assert [event.code for event in bench.store.events[before:]] == ["camera_fault"]


def test_pauses_between_summaries_grow_and_a_quiet_pause_ends_them() -> None:
    clock, said = Clock(), list[tuple[float, str]]()
    coalesced = Coalesced[str](lambda kind, text: said.append((clock.now - 1000.0, text)), clock)
    for _ in range(3600 * 2):
        coalesced.say("x", "again")
        clock.now += 0.5
    times = [time_s for time_s, _ in said]
    assert times == [0, 10, 30, 70, 150, 310, 630, 1230, 1830, 2430, 3030]
    clock.now += 700.0
    coalesced.flush_due()
    clock.now += 700.0
    coalesced.flush_due()
    coalesced.say("x", "anew")
    assert said[-1][1] == "anew"


@given(st.lists(st.tuples(st.integers(0, 200), st.floats(0, 30)), max_size=300))
def test_nothing_is_lost_and_memory_is_bounded(messages: list[tuple[int, float]]) -> None:
    clock, counted = LineClock(), 0

    def say(kind: int, text: str) -> None:
        nonlocal counted
        found = re.match(r"(\d+) more within", text)
        counted += int(found[1]) if found else 1

    coalesced = Coalesced[int](say, clock)
    for kind, pause_s in messages:
        coalesced.say(kind, f"message of {kind}")
        assert len(coalesced) <= MOST_KINDS == 64
        clock.now += pause_s
    coalesced.flush()
    assert counted == len(messages)


def test_flush_ends_when_nothing_can_be_said() -> None:
    tries = []
    coalesced = Coalesced[int](lambda kind, text: bool(tries.append(kind)), Clock())
    for kind in (1, 2, 3, 1, 2, 3):
        coalesced.say(kind, "text")
    tries.clear()
    coalesced.flush()
    coalesced.flush()
    assert tries == [1]
