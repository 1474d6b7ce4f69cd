"""What the line needs of a DBC: its messages, their signals, and what each signal must offer at least."""

from __future__ import annotations

from dataclasses import dataclass

from station.cycle import ErrorCode, LiveState, Mode, Outcome, Quality, StationState
from station.line.wire.messages import Answer, CommandCode, HandshakeState, Part

INVALID = "invalid"


@dataclass(frozen=True)
class Need:
    """What one signal must at least offer: a physical range, a resolution, the words of its value table."""

    lowest: float = 0.0
    highest: float = 1.0
    step: float = 1.0
    words: tuple[str, ...] = ()


_SEQUENCE = Need(highest=255)
FLAG = Need()
_OUTCOME = Need(words=("none", *Outcome))
_ANGLE = Need(lowest=-10.0, highest=10.0, step=1e-4, words=(INVALID,))
_SUM = Need(lowest=-20.0, highest=20.0, step=1e-4, words=(INVALID,))
_UNCERTAINTY = Need(highest=1.0, step=1e-4, words=(INVALID,))

VIN = {
    "Vin1": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(1, 7)}},
    "Vin2": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(7, 13)}},
    "Vin3": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(13, 18)}},
}
FIXED = {
    **VIN,
    "Command": {
        "Code": Need(words=tuple(CommandCode)),
        "Sequence": _SEQUENCE,
        "Mode": Need(words=tuple(Mode)),
        "VehicleType": Need(highest=65535),
        "Heartbeat": _SEQUENCE,
    },
    "Status": {
        "State": Need(words=tuple(StationState)),
        "Sequence": _SEQUENCE,
        "Ready": FLAG,
        "Busy": FLAG,
        "ResultValid": FLAG,
        "Fault": FLAG,
        "Handshake": Need(words=tuple(HandshakeState)),
        "AliveCounter": Need(highest=255),
        "ErrorCode": Need(words=tuple(ErrorCode)),
        "ErrorSequence": _SEQUENCE,
    },
    "CommandAnswer": {
        "Code": Need(words=tuple(CommandCode)),
        "Sequence": _SEQUENCE,
        "Answer": Need(words=tuple(Answer)),
        "LinkUp": FLAG,
        "ErrorCode": Need(words=tuple(ErrorCode)),
        "HeartbeatEcho": _SEQUENCE,
    },
    "StationInfo": dict.fromkeys(
        ("InterfaceMajor", "InterfaceMinor", "SoftwareMajor", "SoftwareMinor", "SoftwarePatch", "Boot"),
        _SEQUENCE,
    ),
    "ErrorDetail": {
        "Part": Need(words=tuple(Part)),
        "ErrorCode": Need(words=tuple(ErrorCode)),
        "Sequence": _SEQUENCE,
        "Wheel": Need(words=("none",)),
        "Count": Need(highest=65535),
    },
    "VehicleResult": {
        "Outcome": _OUTCOME,
        "Sequence": _SEQUENCE,
        "ThrustAngle": _ANGLE,
        "ThrustSign": Need(words=("left_positive", "right_positive")),
        "ThrustAngleU95": _UNCERTAINTY,
    },
}
PER_WHEEL = {
    "WheelUncertainty": {
        "Quality": Need(words=tuple(Quality)),
        "Sequence": _SEQUENCE,
        "CamberU95": _UNCERTAINTY,
        "ToeU95": _UNCERTAINTY,
        "Residual": Need(highest=1.0, step=0.01, words=(INVALID,)),
    },
    "WheelResult": {"Outcome": _OUTCOME, "Sequence": _SEQUENCE, "Camber": _ANGLE, "Toe": _ANGLE},
    "LiveAngles": {
        "State": Need(words=tuple(LiveState)),
        "Shot": _SEQUENCE,
        "Camber": _ANGLE,
        "Toe": _ANGLE,
    },
}
PER_AXLE = {
    "AxleUncertainty": {
        "Sequence": _SEQUENCE,
        "TotalToeU95": _UNCERTAINTY,
        "CamberDifferenceU95": _UNCERTAINTY,
    },
    "AxleResult": {"Outcome": _OUTCOME, "Sequence": _SEQUENCE, "TotalToe": _SUM, "CamberDifference": _SUM},
}
