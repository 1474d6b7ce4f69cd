"""What the controller asks for: a command's signals and the VIN before it, as the handshake takes them."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from station.cycle import ErrorCode, Mode, Trigger
from station.line.handshake import Asked
from station.line.wire import (
    INTERFACE_MAJOR,
    MEANINGS,
    RESERVED_COMMANDS,
    UNSTATED_MAJOR,
    CommandCode,
    Value,
    VinAssembly,
    VinState,
)

_VIN_TROUBLE = {
    VinState.INCOMPLETE: ErrorCode.VIN_INCOMPLETE,
    VinState.INVALID: ErrorCode.VIN_INVALID,
}


def interface_of(values: Mapping[str, Value]) -> int:
    """Major version of the interface that a controller speaks, from the signals of its Command."""
    return int(values["InterfaceMajor"]) or UNSTATED_MAJOR


def known_code(values: Mapping[str, Value]) -> CommandCode | None:
    """The command, where a station takes such a one."""
    word = str(values["Code"])
    if word not in set(CommandCode) or word in RESERVED_COMMANDS:
        return None
    return CommandCode(word)


def read_asked(
    code: CommandCode,
    sequence: int,
    values: Mapping[str, Value],
    endings: Mapping[str, str],
    vins: VinAssembly,
    modes: Collection[str],
    now: float,
) -> Asked:
    """Read a command, with what is wrong in it.

    Parameters
    ----------
    code, sequence
        What is asked, under which number.
    values
        Signals of the message Command.
    endings
        Wheels of the line, and how each one's signals end.
    vins
        The VIN that is assembled from its messages.
    modes
        Modes of a start that this station has.
    now
        Monotonic seconds.
    """
    wheels = tuple(wheel for wheel in endings if values[f"Wheel{endings[wheel]}"])
    trouble, vin, mode = ErrorCode.NONE, "", Mode.AUTOMATIC
    if interface_of(values) != INTERFACE_MAJOR:
        return Asked(code, sequence, received_s=now, trouble=ErrorCode.WRONG_INTERFACE)
    if code in (CommandCode.START, CommandCode.PREPARE):
        known = values["Mode"] in modes
        mode = Mode(str(values["Mode"])) if known else Mode.AUTOMATIC
        found = vins.read(sequence, now)
        if sequence == 0:
            trouble = ErrorCode.WRONG_SEQUENCE
        elif not known:
            trouble = ErrorCode.MODE_NOT_AVAILABLE
        elif not wheels:
            trouble = ErrorCode.NO_WHEELS
        elif code is CommandCode.START and isinstance(found, VinState):
            trouble = _VIN_TROUBLE[found]
        elif isinstance(found, str):
            vin = found
    return Asked(code, sequence, wheels, int(values["VehicleType"]), mode, vin, now, trouble)


def refusal_in_words(command: str, sequence: int, why: ErrorCode, of: Asked | Trigger | None = None) -> str:
    """Return a sentence for the log: which command was refused, of which vehicle, and why.

    Parameters
    ----------
    command, sequence
        What was asked, under which number.
    why
        The answer.
    of
        The start, where it is one.
    """
    vehicle = ""
    # What the bits of another interface mean is not known.
    if of is not None and why is not ErrorCode.WRONG_INTERFACE:
        vehicle = f", VIN {of.vin or 'not whole'}, vehicle type {of.vehicle_type},"
    return f"{command} {sequence}{vehicle} was refused: {why}. {MEANINGS[why].cause}"
