"""Interface 3.2: where the station stands with its master checks; 3.0 and 3.1 go on unchanged."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import LineError
from station.cycle.words.cycle import SERVED_MODES, ErrorCode, StationState, StationStatus
from station.cycle.words.master import MasterShown
from station.duty.words import MasterState
from station.line.interface import StationLine
from station.line.wire.bus import LineBus
from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.master_frames import master_frame, read_master
from station.line.wire.messages import LineMaster
from station.line.wire.options import LineOptions
from station.line.wire.reserved import RESERVED_FOR_VINS, reserved_for
from tests.station.line.line_bench import DBC, Bench, Clock, FakeCanBus

DATABASE = load_line_database(DBC)
OWED = {
    MasterState.OVERDUE: ErrorCode.MASTER_CHECK_OVERDUE,
    MasterState.FAILED: ErrorCode.MASTER_CHECK_FAILED,
}


def dbc_of_interface_3_1() -> str:
    """The shipped DBC without what 3.2 brought."""
    text = DBC.read_text(encoding="cp1252")
    number = re.findall(r"^BO_ (\d+) MasterCheck:", text, re.MULTILINE)[0]
    pattern = rf"^BO_ {number} (?:.*\n(?: SG_.*\n)*)|^(?:CM_|BA_|VAL_)[^\n]* {number} [^\n]*\n"
    text = re.sub(pattern, "", text, flags=re.MULTILINE)
    text = re.sub(r' \d+ "master_check_\w+"', "", text)
    return text.replace('BA_ "InterfaceMinor" 2;', 'BA_ "InterfaceMinor" 1;')


def bench_of(database: LineDatabase) -> tuple[Bench, FakeCanBus]:
    fake, clock = FakeCanBus(), Clock()
    bus = LineBus(lambda: fake)
    bench = Bench(
        database, fake, bus, clock, StationLine(bus, database, clock, LineOptions(modes=SERVED_MODES))
    )
    bench.idle()
    bench.command("none", 0)
    return bench, fake


@pytest.fixture
def old(tmp_path: Path) -> LineDatabase:
    file = tmp_path / "line.dbc"
    file.write_text(dbc_of_interface_3_1(), encoding="cp1252")
    return load_line_database(file)


@pytest.fixture(params=["today", "3.1"])
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    database = DATABASE if request.param == "today" else request.getfixturevalue("old")
    made, _ = bench_of(database)
    with made.bus:
        yield made
        made.line.close()


def masters(bench: Bench) -> list[LineMaster]:
    return [read_master(values) for name, values in bench.messages() if name == "MasterCheck"]


@pytest.mark.parametrize("state", MasterState)
def test_ready_is_no_while_a_check_is_owed(bench: Bench, state: MasterState) -> None:
    assert bench.line.status.ready
    bench.line.publish_master(MasterShown(state, 0, None, 3))
    status = bench.status
    assert status.ready is state.ready
    word = OWED.get(state, ErrorCode.NONE)
    if word is not ErrorCode.NONE and not bench.database.has_master:
        word = ErrorCode.MODE_NOT_AVAILABLE
    assert status.error_code is word
    assert status.takes_start
    # A start still reaches the cycle, which knows its mode.
    bench.start(1, mode="master_check")
    assert bench.status.busy
    assert bench.status.error_code is ErrorCode.NONE
    bench.line.refuse(1, ErrorCode.MASTER_CHECK_OVERDUE)
    assert bench.answer.error_code is (
        ErrorCode.MASTER_CHECK_OVERDUE if bench.database.has_master else ErrorCode.MODE_NOT_AVAILABLE
    )


def test_a_fault_and_a_refusal_are_told_before_a_check_that_is_owed(bench: Bench) -> None:
    bench.line.publish_master(MasterShown(MasterState.FAILED))
    bench.start(1, mode="locate")
    assert bench.status.error_code is ErrorCode.MODE_NOT_AVAILABLE
    bench.line.publish(StationStatus(StationState.FAULT, ErrorCode.CAMERA_FAULT, "front_left"))
    assert bench.status.error_code is ErrorCode.CAMERA_FAULT
    assert not bench.status.ready


def test_what_is_left_is_told_every_second_and_at_once() -> None:
    made, _ = bench_of(DATABASE)
    with made.bus:
        made.line.tick()
        assert masters(made)[-1] == LineMaster(MasterState.NOT_REQUIRED, None, None, 0)
        made.line.publish_master(MasterShown(MasterState.GOOD, 12, made.clock.now + 3601.0, 0))
        assert masters(made)[-1] == LineMaster(MasterState.GOOD, 12, 61, 0)
        for _ in range(25):
            made.clock.now += 0.1
            made.line.tick()
        assert len(masters(made)) in (2, 3)
        made.clock.now += 3600.0
        made.line.tick()
        # Nothing is left of it, whatever the cycle has had time to say.
        assert masters(made)[-1].minutes_left == 0
        made.line.close()


def test_a_station_with_a_dbc_of_3_1_sends_what_3_1_has(old: LineDatabase) -> None:
    assert old.interface_version == (3, 1)
    assert (old.has_steering, old.has_master) == (True, False)
    assert set(DATABASE.protected) - set(old.protected) == {"MasterCheck"}
    assert DATABASE.result_messages == old.result_messages
    made, _ = bench_of(old)
    with made.bus:
        made.line.publish_master(MasterShown(MasterState.FAILED, 0, None, 7))
        made.line.tick()
        assert {name for name, _ in made.messages()} <= set(old.protected)
        made.line.close()


def test_what_3_1_had_has_kept_its_bits(old: LineDatabase) -> None:
    for name in old.protected:
        one, other = (d.definition.get_message_by_name(name) for d in (old, DATABASE))
        assert (one.frame_id, one.length, one.senders) == (other.frame_id, other.length, other.senders)
        assert old.protected[name] == DATABASE.protected[name]
        for before, today in zip(one.signals, other.signals, strict=True):
            for what in ("name", "start", "length", "scale", "offset", "is_signed", "unit"):
                assert getattr(before, what) == getattr(today, what)
            words = {int(n): str(w) for n, w in (before.choices or {}).items()}
            assert words.items() <= {int(n): str(w) for n, w in (today.choices or {}).items()}.items()


def test_a_controller_of_3_1_sees_no_word_that_it_does_not_know(old: LineDatabase) -> None:
    """Of a station that asks for no checks, whose DBC is that of today."""
    made, _ = bench_of(DATABASE)
    with made.bus:
        for sequence, mode in ((1, "automatic"), (2, "adjust"), (3, "master_check")):
            made.start(sequence, mode=mode)
            made.command("abort", sequence)
            made.line.publish(StationStatus(StationState.IDLE))
        for name, values in made.messages():
            if name in old.protected:
                message = old.definition.get_message_by_name(name)
                for signal in message.signals:
                    words = {str(word) for word in (signal.choices or {}).values()}
                    assert (
                        not words or not isinstance(values[signal.name], str) or values[signal.name] in words
                    )
        made.line.close()


_LEFT = st.none() | st.integers(0, 65_000)


@given(st.sampled_from(MasterState), _LEFT, _LEFT, st.integers(0, 65_535))
def test_what_is_read_is_what_was_shown(
    state: MasterState, vehicles: int | None, minutes: int | None, doubted: int
) -> None:
    said = LineMaster(state, vehicles, minutes, doubted)
    assert read_master(DATABASE.decode(master_frame(DATABASE, said))) == said


def test_more_than_a_signal_holds_is_the_most_that_it_holds() -> None:
    said = LineMaster(MasterState.GOOD, 1_000_000, 1_000_000, 1_000_000)
    found = read_master(DATABASE.decode(master_frame(DATABASE, said)))
    assert (found.vehicles_left, found.minutes_left, found.doubted) == (65_000, 65_000, 65_535)


def test_a_word_of_a_later_interface_is_not_understood() -> None:
    values = DATABASE.decode(master_frame(DATABASE, LineMaster(MasterState.GOOD, 1, 1, 0)))
    with pytest.raises(LineError, match="not understood"):
        read_master(values | {"State": "half_good"})


def test_identifiers_are_kept_for_the_results_of_a_vin() -> None:
    assert not {message.frame_id for message in DATABASE.definition.messages} & set(RESERVED_FOR_VINS)
    assert {reserved_for(identifier) for identifier in RESERVED_FOR_VINS} == {"results of a VIN"}
