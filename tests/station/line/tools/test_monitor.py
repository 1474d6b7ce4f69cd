"""Traffic decoded from logs and live, and the order of events in it."""

from __future__ import annotations

import itertools
from pathlib import Path

import can
import pytest

from alignment.errors import FormatError
from station.line.tools.monitor import DecodedFrame, decode_frame, decode_log, recorded, trace_cycles, watch
from station.line.wire.bus import LineBus
from station.line.wire.dbc import LineDatabase, Value
from tests.station.line.line_bench import Clock, command_frame


def message(identifier: int, data: bytes, **kind: bool) -> can.Message:
    return can.Message(timestamp=1.5, arbitration_id=identifier, is_extended_id=False, data=data, **kind)


def test_readable_line_of_a_good_frame(database: LineDatabase) -> None:
    frame = command_frame(database, "start", 4, wheels=1)
    frame.timestamp = 1.5
    assert str(decode_frame(frame, database)) == (
        "1.500000  110  Command  E2eCrc=0 E2eCounter=0 Code=start Sequence=4 "
        "WheelFrontLeft=1 WheelFrontRight=0 WheelRearLeft=0 "
        "WheelRearRight=0 VehicleType=7 Heartbeat=4 Mode=automatic InterfaceMajor=3"
    )


def test_errors_are_marked(database: LineDatabase) -> None:
    short = decode_frame(message(0x110, b"\0\0"), database)
    assert (short.name, short.values) == ("Command", {})
    assert "8 bytes" in str(short.error)
    assert "!! expected a classic data frame" in str(short)
    foreign = decode_frame(message(0x7F0, bytes(8)), database)
    assert "7F0  ?  !! expected an identifier of the line" in str(foreign)
    assert decode_frame(message(0, b"", is_error_frame=True), database).error == "error frame"
    remote = can.Message(arbitration_id=0x110, is_extended_id=False, is_remote_frame=True, dlc=8)
    assert "remote" in str(decode_frame(remote, database).error)


def test_numbers_are_short(database: LineDatabase) -> None:
    assert str(DecodedFrame(0.0, 0x131, "X", {"Toe": 0.8200000000000001})).endswith("Toe=0.82")


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("absent.log", None, "no such file"),
        ("traffic.xlsx", b"", "log ending in"),
        ("damaged.log", b"(1.0) can0 110#0000000000000000\n(x) can0 11", "after 1 frame"),
        ("damaged.blf", b"LOGGnonsense", "whole BLF log"),
        ("damaged.blf", b"", "whole BLF log"),
        ("binary.log", b"\xff\xfe\x00\x81", "whole candump log"),
    ],
)
def test_damaged_log(
    tmp_path: Path, database: LineDatabase, name: str, content: bytes | None, expected: str
) -> None:
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(FormatError, match=expected) as caught:
        list(decode_log(file, database))
    assert str(file) in str(caught.value)


@pytest.mark.parametrize("ending", [".log", ".asc"])
@pytest.mark.parametrize("hole", ["whole", "within", "letters"])
def test_a_line_without_an_end_is_not_read_into_memory(
    tmp_path: Path, database: LineDatabase, ending: str, hole: str
) -> None:
    """A log of 20 GB of nothing was read for minutes, as one line, into memory."""
    log = tmp_path / f"traffic{ending}"
    start = b"(1.0) can0 110#0000000000000000\n" if ending == ".log" else b"date Mon Nov 30 08:00:00 2026\n"
    with log.open("wb") as binary:
        if hole == "letters":
            binary.write(start + b"a" * 200_000)
        else:
            binary.write(start if hole == "within" else b"")
            binary.truncate(20 * 10**9)
    with pytest.raises(FormatError, match="which no log has"):
        list(decode_log(log, database))


def test_live_traffic_for_a_bounded_time(
    station_bus: LineBus, plc_bus: LineBus, database: LineDatabase
) -> None:
    times = iter([0.0, 1.0, 2.0, 6.0])

    def clock_that_sends() -> float:
        now = next(times)
        plc_bus.send(command_frame(database, "reset", int(now)))
        return now

    frames = list(watch(station_bus, database, 5.0, clock_that_sends))
    assert [(f.name, f.values["Sequence"]) for f in frames] == [("Command", 0), ("Command", 1)]


def test_live_traffic_of_a_silent_bus(station_bus: LineBus, database: LineDatabase) -> None:
    assert list(watch(station_bus, database, 0.01, Clock())) == []


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf"])
@pytest.mark.parametrize("whole", [True, False])
def test_recorded_frames_are_in_the_file_when_it_ends_or_is_ended(
    tmp_path: Path, database: LineDatabase, ending: str, whole: bool
) -> None:
    """A BLF file that is not closed has no frames, an ASC file no end."""
    file = tmp_path / f"traffic{ending}"
    frames = [command_frame(database, code, 1) for code in ("reset", "start", "acknowledge")]
    for number, frame in enumerate(frames):
        frame.timestamp = 1_000.0 + number
    passed = recorded(iter(frames), file)
    seen = list(itertools.islice(passed, None if whole else 2))
    # As a user who ends it with Ctrl+C.
    passed.close()  # type: ignore[attr-defined]
    assert len(seen) == (3 if whole else 2)
    found = [frame.values["Code"] for frame in decode_log(file, database)]
    assert found == ["reset", "start", "acknowledge"][: len(seen)]


def status(time_s: float, sequence: int, busy: int = 0, done: int = 0) -> DecodedFrame:
    return DecodedFrame(time_s, 0x120, "Status", {"Sequence": sequence, "Busy": busy, "ResultValid": done})


def command(time_s: float, code: str, sequence: int) -> DecodedFrame:
    return DecodedFrame(time_s, 0x110, "Command", {"Code": code, "Sequence": sequence})


def result(time_s: float, sequence: int) -> DecodedFrame:
    values: dict[str, Value] = {"Sequence": sequence}
    return DecodedFrame(time_s, 0x131, "WheelResultFrontLeft", values)


def test_trace_of_a_good_cycle_with_repetitions() -> None:
    cycles = trace_cycles(
        [
            status(0, 0),
            command(1, "start", 1),
            command(2, "start", 1),
            status(3, 1, busy=1),
            status(4, 1, busy=1),
            result(5, 1),
            result(6, 1),
            status(7, 1, done=1),
            status(8, 1, done=1),
            command(9, "none", 1),
            command(10, "acknowledge", 1),
            command(11, "acknowledge", 1),
            status(12, 1),
            command(13, "start", 2),
        ]
    )
    good, started = cycles
    assert (good.start_s, good.busy_s, good.done_s, good.acknowledged_s) == (1, 3, 7, 10)
    assert good.result_times_s == [5, 6]
    assert good.in_order
    assert started.sequence == 2
    assert not started.in_order
    assert started.out_of_order == []


def test_trace_of_what_comes_before_its_turn() -> None:
    start = command(0, "start", 1)
    busy, done = status(1, 1, busy=1), status(2, 1, done=1)
    for frames, problem in (
        ([start, result(1, 1), busy, done], "before busy"),
        ([start, busy, done, result(3, 1)], "done came before any result"),
        ([start, busy, command(1, "acknowledge", 1), result(2, 1), done], "acknowledge came before done"),
    ):
        (cycle,) = trace_cycles(frames)
        assert not cycle.in_order
        assert any(problem in text for text in cycle.out_of_order)


@pytest.mark.parametrize("name", ["WheelAxisRearLeft", "VehicleReference", "GeometryYaw", "AxleResultRear"])
def test_any_message_of_the_results_that_comes_before_busy_is_told(name: str) -> None:
    early = DecodedFrame(1, 0x162, name, {"Sequence": 1})
    (cycle,) = trace_cycles([command(0, "start", 1), early, status(1, 1, busy=1), status(2, 1, done=1)])
    assert cycle.out_of_order == [f"{name} came before busy"]


def test_messages_of_the_results_are_those_that_a_trace_follows(database: LineDatabase) -> None:
    """A name that begins otherwise would never count as a result."""
    start, busy = command(0, "start", 1), status(1, 1, busy=1)
    for name in database.protected:
        shown = DecodedFrame(2, 0, name, {"Sequence": 1, "Busy": 1, "ResultValid": 0, "Code": "none"})
        (cycle,) = trace_cycles([start, busy, shown])
        assert (cycle.result_times_s == [2]) == (name in database.result_messages), name


def test_reused_sequence_after_the_acknowledgement_is_another_cycle() -> None:
    frames = [command(0, "start", 1), command(1, "acknowledge", 1), command(2, "start", 1)]
    assert [cycle.start_s for cycle in trace_cycles(frames)] == [0, 2]
