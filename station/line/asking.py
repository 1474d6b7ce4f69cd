"""What the controller asks for: a command's signals and the VIN before it, as the handshake takes them."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping

from station.cycle import ErrorCode, Mode, Trigger
from station.line.handshake import Asked
from station.line.told import ToldByController
from station.line.wire import (
    INTERFACE_MAJOR,
    MEANINGS,
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


def known_code(values: Mapping[str, Value], modes: Collection[str]) -> CommandCode | None:
    """The command, where a station with these modes takes such a one."""
    word = str(values["Code"])
    if word not in set(CommandCode) or (word == CommandCode.STEP and Mode.SWEEP not in modes):
        return None
    return CommandCode(word)


def heard_in_words(interface: int) -> tuple[int, str, str]:
    """Level, kind and text of the log for a controller that is heard, of this interface."""
    if interface == INTERFACE_MAJOR:
        return logging.INFO, "heard", "controller is heard"
    return (
        logging.WARNING,
        "heard",
        f"controller is heard, of interface {interface}: its commands are refused, as this station speaks "
        f"interface {INTERFACE_MAJOR}",
    )


def read_asked(
    code: CommandCode,
    sequence: int,
    values: Mapping[str, Value],
    endings: Mapping[str, str],
    vins: VinAssembly,
    told: ToldByController,
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
    told
        What else the controller told, such as the position of a step.
    modes
        Modes of a start that this station has.
    now
        Monotonic seconds.
    """
    wheels = tuple(wheel for wheel in endings if values[f"Wheel{endings[wheel]}"])
    trouble, vin, mode = ErrorCode.NONE, "", Mode.AUTOMATIC
    if interface_of(values) != INTERFACE_MAJOR:
        return Asked(code, sequence, received_s=now, trouble=ErrorCode.WRONG_INTERFACE)
    if code is CommandCode.STEP:
        step = told.step(sequence)
        if step is None:
            return Asked(code, sequence, received_s=now, trouble=ErrorCode.STEP_INCOMPLETE)
        return Asked(code, sequence, received_s=now, position=step.position, angle_deg=step.angle_deg)
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
