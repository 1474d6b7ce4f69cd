"""What interface 3.1 added to the DBC: steering wheel, ride heights, sweep and guidance.

A DBC of 3.0 has none of it; with such a one a station goes on as it did.
"""

from __future__ import annotations

from dataclasses import replace

from station.cycle import (
    AXIS_DIFFERENCES,
    AXIS_LENGTHS,
    AXIS_QUANTITIES,
    AngleCorrection,
    ErrorCode,
    HeightState,
    QuantityState,
    SteeringSource,
    StraightAhead,
    SweepState,
)
from station.guidance import AdjusterKind, GuidanceState, OutOfReach, TurnDirection
from station.line.wire.dbc_needs import INVALID, SEQUENCE, Need, Needs
from station.line.wire.messages import HandshakeState

STEERING_SINCE = (3, 1)
"""Version of the interface that has all this."""
_STEERING = Need(lowest=-1000.0, highest=1000.0, step=0.1, words=(INVALID,))
_AGE = Need(highest=60_000.0, step=100.0, words=(INVALID,))
_HEIGHT = Need(highest=1500.0, step=0.1, words=(INVALID,))
_TARGET = Need(lowest=-10.0, highest=10.0, step=0.0005, words=(INVALID,))
_RAW = Need(lowest=-10.0, highest=10.0, step=1e-4, words=(INVALID,))
_STATE = Need(words=tuple(QuantityState))


def _quantity(name: str) -> dict[str, Need]:
    value = Need(lowest=-45.0, highest=45.0, step=1e-4, words=(INVALID,))
    u95 = Need(highest=5.0, step=1e-4, words=(INVALID,))
    if name in AXIS_LENGTHS:
        value = Need(lowest=-500.0, highest=500.0, step=0.01, words=(INVALID,))
        u95 = Need(highest=50.0, step=0.01, words=(INVALID,))
    return {"State": _STATE, "Sequence": SEQUENCE, "Value": value, "U95": u95}


def _message(name: str) -> str:
    return "Sweep" + "".join(part.capitalize() for part in name.split("_"))


STEERING_FIXED: Needs = {
    "SteeringWheel": {
        "Source": Need(words=tuple(SteeringSource)),
        "Sample": SEQUENCE,
        "Angle": _STEERING,
        "Age": _AGE,
    },
    "SweepStep": {"Sequence": SEQUENCE, "Position": SEQUENCE, "Angle": _STEERING},
    "SweepProgress": {
        "State": Need(words=tuple(SweepState)),
        "Sequence": SEQUENCE,
        "Position": SEQUENCE,
        "Positions": SEQUENCE,
        "Wanted": _STEERING,
    },
    "SteeringWheelResult": {
        "State": _STATE,
        "Sequence": SEQUENCE,
        "Used": _STEERING,
        "Offset": Need(lowest=-180.0, highest=180.0, step=0.01, words=(INVALID,)),
        "StraightAhead": Need(words=tuple(StraightAhead)),
    },
    **{_message(name): _quantity(name) for name in AXIS_DIFFERENCES},
}
STEERING_PER_WHEEL: Needs = {
    "Guidance": {
        "State": Need(words=tuple(GuidanceState)),
        "Shot": SEQUENCE,
        "Adjuster": Need(words=tuple(AdjusterKind)),
        "Direction": Need(words=tuple(TurnDirection)),
        "Turns": Need(lowest=-100.0, highest=100.0, step=0.01, words=(INVALID,)),
        "Age": _AGE,
    },
    "GuidanceTarget": {
        "Reason": Need(words=tuple(OutOfReach)),
        "Shot": SEQUENCE,
        "Camber": _TARGET,
        "Toe": _TARGET,
        "Drift": Need(lowest=-0.5, highest=0.5, step=0.005, words=(INVALID,)),
    },
    "WheelRaw": {
        "Correction": Need(words=tuple(AngleCorrection)),
        "Sequence": SEQUENCE,
        "Camber": _RAW,
        "Toe": _RAW,
    },
}
STEERING_PER_AXLE: Needs = {
    "RideHeight": {"Sample": Need(highest=15), "Left": _HEIGHT, "Right": _HEIGHT, "Age": _AGE},
    "RideHeightUsed": {
        "LeftState": Need(words=tuple(HeightState)),
        "Sequence": SEQUENCE,
        "Left": _HEIGHT,
        "Right": _HEIGHT,
        "RightState": Need(words=tuple(HeightState)),
    },
}
PER_STEERED: Needs = {_message(name): _quantity(name) for name in AXIS_QUANTITIES}
"""Of each wheel that is steered: those that the DBC has any of these messages of."""
_WORDS = frozenset({HandshakeState.SWEEPING, HandshakeState.TURNING, ErrorCode.STEP_INCOMPLETE})


def without_steering(needs: Needs) -> Needs:
    """What of these needs a DBC of an earlier interface has too: without the words that came with 3.1."""
    return {message: {name: _before(n) for name, n in of.items()} for message, of in needs.items()}


def _before(need: Need) -> Need:
    if not set(need.words) & _WORDS:
        return need
    return replace(need, words=tuple(word for word in need.words if word not in _WORDS))


def axis_message(name: str, ending: str = "") -> str:
    """Message of a quantity of the steering axes: of a wheel with this ending, or of a difference."""
    return _message(name) + ending
