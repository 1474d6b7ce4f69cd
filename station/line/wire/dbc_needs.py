"""What the line needs of a DBC: its messages, their signals, and what each signal must offer at least."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from station.cycle import (
    GEOMETRY,
    GEOMETRY_ANGLES,
    RESERVED_CODES,
    RESERVED_MODES,
    AxisKind,
    ErrorCode,
    LiveState,
    Mode,
    Outcome,
    Quality,
    QuantityState,
    StationState,
)
from station.line.wire.messages import Answer, CommandCode, HandshakeState, Part

INVALID = "invalid"
INTERFACE_MAJOR, UNSTATED_MAJOR = 3, 2
"""Major version of the interface that this program speaks, and of a controller that states none."""


@dataclass(frozen=True)
class Need:
    """What one signal must at least offer: a physical range, a resolution, the words of its value table."""

    lowest: float = 0.0
    highest: float = 1.0
    step: float = 1.0
    words: tuple[str, ...] = ()


SEQUENCE = Need(highest=255)
FLAG = Need()
_OUTCOME = Need(words=("none", *Outcome))
_ANGLE = Need(lowest=-10.0, highest=10.0, step=1e-4, words=(INVALID,))
_SUM = Need(lowest=-20.0, highest=20.0, step=1e-4, words=(INVALID,))
_UNCERTAINTY = Need(highest=1.0, step=1e-4, words=(INVALID,))

_KIND = Need(words=tuple(AxisKind))
GEOMETRY_MESSAGES = {
    name: "Geometry" + "".join(part.capitalize() for part in re.split(r"[._]", name)) for name in GEOMETRY
}
"""Message of each quantity of the vehicle's geometry, in the order of sending."""


def _quantity(name: str) -> dict[str, Need]:
    value = _ANGLE
    if name not in GEOMETRY_ANGLES:
        value = Need(lowest=-8000.0, highest=8000.0, step=0.01, words=(INVALID,))
    u95 = _UNCERTAINTY if name in GEOMETRY_ANGLES else Need(highest=50.0, step=0.01, words=(INVALID,))
    return {"State": Need(words=tuple(QuantityState)), "Sequence": SEQUENCE, "Value": value, "U95": u95}


VIN = {
    "Vin1": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(1, 7)}},
    "Vin2": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(7, 13)}},
    "Vin3": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(13, 18)}},
}
FIXED = {
    **VIN,
    "Command": {
        "Code": Need(words=tuple(CommandCode)),
        "Sequence": SEQUENCE,
        "Mode": Need(words=tuple(Mode)),
        "VehicleType": Need(highest=65535),
        "Heartbeat": SEQUENCE,
        "InterfaceMajor": Need(highest=15),
    },
    "Status": {
        "State": Need(words=tuple(StationState)),
        "Sequence": SEQUENCE,
        "Ready": FLAG,
        "Busy": FLAG,
        "ResultValid": FLAG,
        "Fault": FLAG,
        "Handshake": Need(words=tuple(HandshakeState)),
        "AliveCounter": Need(highest=255),
        "ErrorCode": Need(words=tuple(ErrorCode)),
        "ErrorSequence": SEQUENCE,
    },
    "CommandAnswer": {
        "Code": Need(words=tuple(CommandCode)),
        "Sequence": SEQUENCE,
        "Answer": Need(words=tuple(Answer)),
        "LinkUp": FLAG,
        "ErrorCode": Need(words=tuple(ErrorCode)),
        "HeartbeatEcho": SEQUENCE,
    },
    "StationInfo": dict.fromkeys(
        ("InterfaceMajor", "InterfaceMinor", "SoftwareMajor", "SoftwareMinor", "SoftwarePatch", "Boot"),
        SEQUENCE,
    ),
    "ErrorDetail": {
        "Part": Need(words=tuple(Part)),
        "ErrorCode": Need(words=tuple(ErrorCode)),
        "Sequence": SEQUENCE,
        "Wheel": Need(words=("none",)),
        "Count": Need(highest=65535),
    },
    "VehicleResult": {
        "Outcome": _OUTCOME,
        "Sequence": SEQUENCE,
        "ThrustAngle": _ANGLE,
        "ThrustSign": Need(words=("left_positive", "right_positive")),
        "ThrustAngleU95": _UNCERTAINTY,
    },
    "VehicleReference": {
        "Reference": Need(words=("none", "stand", "vehicle")),
        "Sequence": SEQUENCE,
        "Between": Need(words=("none", "sidewalls", "wheel_centres", "contact_centres")),
    },
    **{message: _quantity(name) for name, message in GEOMETRY_MESSAGES.items()},
}
PER_WHEEL = {
    "WheelUncertainty": {
        "Quality": Need(words=tuple(Quality)),
        "Sequence": SEQUENCE,
        "CamberU95": _UNCERTAINTY,
        "ToeU95": _UNCERTAINTY,
        "Residual": Need(highest=1.0, step=0.01, words=(INVALID,)),
    },
    "WheelAxis": {
        "Kind": _KIND,
        "Sequence": SEQUENCE,
        "RunOut": Need(highest=50.0, step=0.01, words=(INVALID,)),
        "HighSpot": Need(highest=359.0, step=1.0, words=(INVALID,)),
        "RunOutU95": Need(highest=5.0, step=0.02, words=(INVALID,)),
        "RunOutState": Need(words=tuple(QuantityState)),
    },
    "WheelResult": {"Outcome": _OUTCOME, "Sequence": SEQUENCE, "Camber": _ANGLE, "Toe": _ANGLE},
    "LiveAngles": {
        "State": Need(words=tuple(LiveState)),
        "Shot": SEQUENCE,
        "Camber": _ANGLE,
        "Toe": _ANGLE,
    },
    "LiveAge": {
        "Kind": _KIND,
        "Shot": SEQUENCE,
        "Age": Need(highest=60_000.0, step=100.0, words=(INVALID,)),
    },
}
PER_AXLE = {
    "AxleUncertainty": {
        "Sequence": SEQUENCE,
        "TotalToeU95": _UNCERTAINTY,
        "CamberDifferenceU95": _UNCERTAINTY,
    },
    "AxleResult": {"Outcome": _OUTCOME, "Sequence": SEQUENCE, "TotalToe": _SUM, "CamberDifference": _SUM},
}
_MESSAGES_OF_3 = {"VehicleReference", "WheelAxis", "LiveAge", *GEOMETRY_MESSAGES.values()}
_SIGNALS_OF_3 = {"InterfaceMajor"}
_WORDS_OF_3 = {
    *RESERVED_MODES,
    *RESERVED_CODES,
    Mode.SWEEP,
    CommandCode.STEP,
    ErrorCode.WRONG_INTERFACE,
    ErrorCode.NOTHING_TO_STEP,
    ErrorCode.SWEEP_FAULT,
    ErrorCode.STEERING_FAULT,
}
Needs = Mapping[str, Mapping[str, Need]]
"""By message, by signal."""


def needed_since_2(needs: Needs) -> Needs:
    """What of these needs the DBC of an older interface has too, for who reads recorded traffic by it."""
    return {
        message: {
            name: _of_2(need)
            for name, need in signals.items()
            if message != "Command" or name not in _SIGNALS_OF_3
        }
        for message, signals in needs.items()
        if message not in _MESSAGES_OF_3
    }


def _of_2(need: Need) -> Need:
    if not set(need.words) & _WORDS_OF_3:
        return need
    return replace(need, words=tuple(word for word in need.words if word not in _WORDS_OF_3))
