"""Traffic as a person reads it: what changes, and one line for each start."""

from __future__ import annotations

from pathlib import Path

import pytest

from alignment.errors import ConfigurationError
from station.line.tools.monitor import DecodedFrame, decoded
from station.line.tools.view import ChangeView, VehicleView, chosen_messages, clock_time
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.protection import Protector
from tests.station.line.line_bench import VIN, command_frame, vin_frame

NOON = 1_795_780_800.25


def status(time_s: float, **values: Value) -> DecodedFrame:
    counting: dict[str, Value] = {"E2eCrc": int(time_s * 10) % 256, "AliveCounter": int(time_s * 10) % 256}
    return DecodedFrame(time_s, 0x120, "Status", counting | {"State": "idle", "Sequence": 0, **values})


def told(view: ChangeView, *frames: DecodedFrame) -> list[str]:
    return [line for frame in frames if (line := view.line(frame)) is not None]


def test_a_station_that_says_the_same_is_one_line() -> None:
    """Ten frames a second for each of five messages, with CRC and counter, hid what happened."""
    said = told(ChangeView({}), *(status(0.1 * k) for k in range(100)), status(20.0, State="armed"))
    assert said == [
        "       0.000  120  Status  State=idle Sequence=0",
        "      20.000  120  Status  State=armed",
    ]


def test_counters_and_repetitions_are_shown_to_who_asks() -> None:
    assert len(told(ChangeView({}, every=True), *(status(0.1 * k) for k in range(10)))) == 10
    assert "E2eCrc=5 AliveCounter=5 State=idle" in told(ChangeView({}, counting=True), status(0.5))[0]


def test_live_angles_that_grow_old_are_one_line(database: LineDatabase) -> None:
    """An age is another number in every frame: four wheels would fill a screen in a second."""
    frames = [
        DecodedFrame(0.1 * k, 0x144, "LiveAgeFrontLeft", {"Kind": "tyre_plane", "Shot": 1, "Age": 100 * k})
        for k in range(10)
    ]
    assert len(told(ChangeView(database.vin_messages), *frames)) == 1
    assert len(told(ChangeView(database.vin_messages, counting=True), *frames)) == 10


def test_an_error_is_told_when_it_begins_and_when_it_is_over() -> None:
    bad = DecodedFrame(1.0, 0x120, "Status", {"State": "idle"}, "end-to-end protection: wrong_crc")
    said = told(ChangeView({}), status(0.0), bad, bad, bad, status(0.0), status(0.0))
    assert len(said) == 3
    assert "!! end-to-end protection: wrong_crc  State=idle" in said[1]
    assert said[2].endswith("State=idle Sequence=0")
    foreign = DecodedFrame(1.0, 0x7F0, None, {}, "expected an identifier of the line, found 0x7F0")
    assert told(ChangeView({}), foreign, foreign) == [
        "       1.000  7F0  ?  !! expected an identifier of the line, found 0x7F0"
    ]


def test_a_vin_is_text(database: LineDatabase) -> None:
    [frame, *_] = a_cycle(database, 4, NOON)
    [line] = told(ChangeView(database.vin_messages), frame)
    assert line.endswith(f"Vin1  SequenceLow=4 Text={VIN[:6]}")


def test_messages_are_chosen_by_name(database: LineDatabase) -> None:
    names = database.protected
    assert chosen_messages([], names) == frozenset()
    assert chosen_messages(["status"], names) == {"Status"}
    assert len(chosen_messages(["WheelResult*", "VehicleResult"], names)) == 5
    with pytest.raises(ConfigurationError, match=r"a message of the line: AxleResultFront, .*found 'Statsu'"):
        chosen_messages(["Statsu"], names)


def a_cycle(database: LineDatabase, number: int, start_s: float) -> list[DecodedFrame]:
    frames = [vin_frame(database, name, number) for name in database.vin_messages]
    frames.append(command_frame(database, "start", number))
    protector = Protector(database.protected)
    for frame in frames:
        name = database.name_of(frame)
        assert name is not None
        data = bytearray(frame.data)
        protector.protect(name, data)
        frame.data, frame.timestamp = data, start_s
    return list(decoded(frames, database))


def after(number: int, start_s: float, outcome: str = "nok") -> list[DecodedFrame]:
    def of(time_s: float, name: str, **values: Value) -> DecodedFrame:
        return DecodedFrame(start_s + time_s, 0x1, name, {"Sequence": number, **values})

    answer = {"Code": "start", "ErrorCode": "none"}
    return [
        of(0.01, "CommandAnswer", **(answer | {"Answer": "refused", "ErrorCode": "vin_incomplete"})),
        of(0.02, "Status", Busy=1, ResultValid=0),
        of(0.03, "CommandAnswer", **(answer | {"Answer": "accepted"})),
        of(1.5, "WheelResultFrontLeft", Outcome=outcome),
        of(1.5, "VehicleResult", Outcome=outcome),
        of(1.6, "Status", Busy=0, ResultValid=1),
        of(1.7, "Command", Code="acknowledge"),
        of(1.8, "VehicleResult", Outcome="none"),
    ]


def lines(view: VehicleView, frames: list[DecodedFrame]) -> list[str]:
    return [*(line for frame in frames for line in view.lines(frame)), *view.end()]


def test_each_start_is_one_line_when_it_is_acknowledged(database: LineDatabase) -> None:
    first = [*a_cycle(database, 4, NOON), *after(4, NOON)]
    second = [*a_cycle(database, 5, NOON + 9.0), *after(5, NOON + 9.0, "ok")]
    view = VehicleView(database.vin_messages)
    said = [line for frame in first for line in view.lines(frame)]
    assert said == [f"12:00:00.250   4 {VIN} nok  busy 0.020 done 1.600 taken 1.700 s"]
    assert [line.partition("  busy")[0] for line in lines(view, second)] == [f"12:00:09.250   5 {VIN} ok"]


def test_a_start_that_is_refused_or_without_an_end_is_a_line_too(database: LineDatabase) -> None:
    begun = a_cycle(database, 4, NOON)
    [line] = lines(VehicleView(database.vin_messages), begun)
    assert line == f"12:00:00.250   4 {VIN} no result"
    refused = DecodedFrame(
        NOON + 0.1,
        0x121,
        "CommandAnswer",
        {"Code": "start", "Sequence": 4, "Answer": "refused", "ErrorCode": "busy"},
    )
    [line] = lines(VehicleView(database.vin_messages), [*begun, refused])
    assert line == f"12:00:00.250   4 {VIN} refused: busy"


def test_times_that_are_no_date_are_seconds() -> None:
    assert clock_time(1.5) == "       1.500"
    assert clock_time(1e30).strip() == "1000000000000000019884624838656.000"


def test_a_log_without_a_start_has_no_lines(database: LineDatabase, tmp_path: Path) -> None:
    assert lines(VehicleView(database.vin_messages), [status(0.0)]) == []
