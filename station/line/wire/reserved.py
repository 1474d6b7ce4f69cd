"""What the next minor versions of the interface will use: reserved, so that they only add to it.

Nothing here is sent or taken yet. A start in a reserved mode is refused as one that the station has not; no
message of a line may lie in reserved identifiers.
"""

from __future__ import annotations

from dataclasses import dataclass

from station.cycle import ErrorCode, Mode


@dataclass(frozen=True)
class Reserved:
    """What is reserved for one mode: identifiers of the station's messages, as far as free; error codes."""

    mode: Mode
    what: str
    identifiers: range
    codes: tuple[ErrorCode, ...] = ()


RESERVED_FOR_MODES = (
    Reserved(Mode.SWEEP, "the steering is turned through angles, for its axes", range(0x18F, 0x190)),
    Reserved(
        Mode.GUIDANCE,
        "the operator is told what to turn, without adjusting being asked for",
        range(0x198, 0x1A0),
        (ErrorCode.GUIDANCE_FAULT,),
    ),
    Reserved(Mode.STEERING, "the steering wheel is held straight ahead", range(0x1A7, 0x1B0)),
    Reserved(
        Mode.LOCATE,
        "places on the vehicle are found, for whoever works there",
        range(0x1B0, 0x1C0),
        (ErrorCode.LOCATE_FAULT,),
    ),
)
RESERVED_FOR_VINS = range(0x126, 0x130)
"""Identifiers of the station's answers to what a controller will ask of the last result of a VIN."""
CONTROLLER_IDENTIFIERS = range(0x115, 0x120)
"""Identifiers of what the controller will say in these modes."""


def reserved_for(identifier: int) -> str | None:
    """For what an identifier is reserved; None where it is free."""
    if identifier in CONTROLLER_IDENTIFIERS:
        return "the controller"
    if identifier in RESERVED_FOR_VINS:
        return "results of a VIN"
    return next((each.mode for each in RESERVED_FOR_MODES if identifier in each.identifiers), None)
