"""The states of guidance in one table: what the operator does, what it means, what may follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from station.guidance.words import GuidanceState as State


@dataclass(frozen=True)
class GuidanceRule:
    """One row of the table.

    Attributes
    ----------
    says
        To the operator, a short sentence.
    means
        What is known of the wheel.
    follows
        States that may follow it, beside itself and LOST.
    """

    says: str
    means: str
    follows: frozenset[State]


GUIDANCE_STATES: Mapping[State, GuidanceRule] = {
    State.NONE: GuidanceRule(
        "No guidance.",
        "the vehicle type names no adjuster, or the wheel was not seen yet",
        frozenset(State) - {State.HOLD, State.LOCK_NUT},
    ),
    State.WAITING: GuidanceRule(
        "Wait: another wheel comes first.",
        "out of its limits; the rear axle is adjusted first",
        frozenset({State.TURN, State.CHECK, State.DONE, State.UNREACHABLE}),
    ),
    State.TURN: GuidanceRule(
        "Loosen the nut and turn.",
        "the angle is not where it should be before the nut is locked",
        frozenset({State.HOLD, State.UNREACHABLE}),
    ),
    State.HOLD: GuidanceRule(
        "Stop turning.",
        "the angle is where it should be, and is not yet at rest",
        frozenset({State.TURN, State.LOCK_NUT, State.UNREACHABLE}),
    ),
    State.LOCK_NUT: GuidanceRule(
        "Lock the nut.",
        "the angle rests where it should be; what locking adds is awaited",
        frozenset({State.TURN, State.CHECK}),
    ),
    State.CHECK: GuidanceRule(
        "Hands off: it is checked.",
        "the wheel rests, or should, and several results in a row decide",
        frozenset({State.WAITING, State.TURN, State.DONE, State.UNREACHABLE}),
    ),
    State.DONE: GuidanceRule(
        "Done.",
        "every result says that all angles of this wheel are inside their limits, and the last said it too",
        frozenset({State.CHECK}),
    ),
    State.UNREACHABLE: GuidanceRule(
        "Cannot be reached: bent, not misadjusted.",
        "no adjuster, its range, or its reaction keeps the angle out of its limits",
        frozenset({State.WAITING, State.TURN, State.CHECK, State.DONE}),
    ),
    State.LOST: GuidanceRule(
        "Not seen.",
        "the last result measured nothing; where the wheel stands is not known",
        frozenset({State.TURN, State.HOLD, State.LOCK_NUT, State.CHECK}),
    ),
}
"""Every state; LOST may follow any but NONE."""
