"""The words of guidance: what can be turned, which way, where an adjusting stands, why it cannot end well."""

from __future__ import annotations

import enum


class AdjusterKind(enum.StrEnum):
    """What of a wheel is turned; the words of the DBC's value table."""

    NONE = "none"
    TIE_ROD = "tie_rod"
    CAMBER_BOLT = "camber_bolt"


class TurnDirection(enum.StrEnum):
    """Which way an adjuster is turned, as a person says it; the words of the DBC's value table.

    A tie rod is lengthened (positive turns) or shortened, a camber bolt moves the top of the wheel out
    (positive turns) or in.
    """

    NONE = "none"
    LENGTHEN = "lengthen"
    SHORTEN = "shorten"
    OUT = "out"
    IN = "in"

    @classmethod
    def of(cls, adjuster: AdjusterKind, turns: float) -> TurnDirection:
        """Return the direction of so many turns."""
        if adjuster is AdjusterKind.NONE or turns == 0.0:
            return cls.NONE
        if adjuster is AdjusterKind.TIE_ROD:
            return cls.LENGTHEN if turns > 0.0 else cls.SHORTEN
        return cls.OUT if turns > 0.0 else cls.IN


class GuidanceState(enum.StrEnum):
    """Where the adjusting of one wheel stands; the words of the DBC's value table.

    What each means, and what may follow it, is in `station.guidance.states.GUIDANCE_STATES`.
    """

    NONE = "none"
    WAITING = "waiting"
    TURN = "turn"
    HOLD = "hold"
    LOCK_NUT = "lock_nut"
    CHECK = "check"
    DONE = "done"
    UNREACHABLE = "unreachable"
    LOST = "lost"


class OutOfReach(enum.StrEnum):
    """Why a wheel cannot be adjusted: bent, not misadjusted; the words of the DBC's value table.

    NO_ADJUSTER: nothing on this wheel changes the angle that is out of its limits. RANGE: what is needed lies
    beyond the range of the adjuster. REACTION: turns do not do what they do on a sound axle.
    """

    NONE = "none"
    NO_ADJUSTER = "no_adjuster"
    RANGE = "range"
    REACTION = "reaction"
