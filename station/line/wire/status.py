"""Status, answers and versions to frames and back: the one place that knows their signals."""

from __future__ import annotations

from collections.abc import Mapping

import can

from alignment.errors import LineError
from station.cycle import ErrorCode, StationState
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.error_codes import MEANINGS
from station.line.wire.master_frames import known_word
from station.line.wire.messages import (
    Answer,
    CommandAnswer,
    CommandCode,
    HandshakeState,
    LineStatus,
    StationInfo,
)

LARGEST_COUNT = 65_535


def status_frame(database: LineDatabase, status: LineStatus) -> can.Message:
    """One Status message."""
    return database.encode(
        "Status",
        {
            "State": str(status.state),
            "Sequence": status.sequence,
            "Ready": int(status.ready),
            "Busy": int(status.busy),
            "ResultValid": int(status.done),
            "Fault": int(status.fault),
            "Handshake": str(status.handshake),
            "AliveCounter": status.alive_counter,
            "ErrorCode": str(known_word(database, status.error_code)),
            "ErrorSequence": status.error_sequence,
        },
    )


def answer_frame(database: LineDatabase, answer: CommandAnswer) -> can.Message:
    """One CommandAnswer message."""
    return database.encode(
        "CommandAnswer",
        {
            "Code": str(answer.code),
            "Sequence": answer.sequence,
            "Answer": str(answer.answer),
            "LinkUp": int(answer.link_up),
            "ErrorCode": str(known_word(database, answer.error_code)),
            "HeartbeatEcho": answer.heartbeat,
        },
    )


def info_frame(database: LineDatabase, info: StationInfo) -> can.Message:
    """One StationInfo message; numbers of a version beyond 255 are sent as 255."""
    names = ("InterfaceMajor", "InterfaceMinor", "SoftwareMajor", "SoftwareMinor", "SoftwarePatch")
    numbers = (min(number, 255) for number in (*info.interface, *info.software))
    return database.encode("StationInfo", {**dict(zip(names, numbers, strict=True)), "Boot": info.boot})


def detail_frame(
    database: LineDatabase, code: ErrorCode, sequence: int, wheel: str | None, count: int
) -> can.Message:
    """One ErrorDetail message; `count` is of the faults since the program started."""
    return database.encode(
        "ErrorDetail",
        {
            "Part": str(MEANINGS[code].part),
            "ErrorCode": str(known_word(database, code)),
            "Sequence": sequence,
            "Wheel": wheel if wheel in database.wheels else "none",
            "Count": min(count, LARGEST_COUNT),
        },
    )


def read_status(values: Mapping[str, Value]) -> LineStatus:
    """Status from its decoded message.

    Raises
    ------
    LineError
        When a word is none of its value table.
    """
    try:
        return LineStatus(
            state=StationState(str(values["State"])),
            sequence=int(values["Sequence"]),
            ready=bool(values["Ready"]),
            busy=bool(values["Busy"]),
            done=bool(values["ResultValid"]),
            fault=bool(values["Fault"]),
            alive_counter=int(values["AliveCounter"]),
            error_code=ErrorCode(str(values["ErrorCode"])),
            error_sequence=int(values["ErrorSequence"]),
            handshake=HandshakeState(str(values["Handshake"])),
        )
    except ValueError as error:
        raise LineError(f"the status of the station is not understood: {error}") from error


def read_answer(values: Mapping[str, Value]) -> CommandAnswer:
    """Answer to a command from its decoded message; raises like `read_status`."""
    try:
        return CommandAnswer(
            code=CommandCode(str(values["Code"])),
            sequence=int(values["Sequence"]),
            answer=Answer(str(values["Answer"])),
            error_code=ErrorCode(str(values["ErrorCode"])),
            link_up=bool(values["LinkUp"]),
            heartbeat=int(values["HeartbeatEcho"]),
        )
    except ValueError as error:
        raise LineError(f"the answer of the station is not understood: {error}") from error


def read_info(values: Mapping[str, Value]) -> StationInfo:
    """Versions from their decoded message."""
    return StationInfo(
        (int(values["InterfaceMajor"]), int(values["InterfaceMinor"])),
        (int(values["SoftwareMajor"]), int(values["SoftwareMinor"]), int(values["SoftwarePatch"])),
        int(values["Boot"]),
    )
