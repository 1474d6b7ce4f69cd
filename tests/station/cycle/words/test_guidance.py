"""Guidance is told whole: values that contradict its state are refused where they are made."""

from __future__ import annotations

import math

import pytest

from alignment.errors import InputError
from station.cycle.words.guidance import Guidance
from station.guidance.words import AdjusterKind, GuidanceState, OutOfReach, TurnDirection


def test_turns_say_which_way_a_person_turns() -> None:
    rod = Guidance("front_left", GuidanceState.TURN, 1, AdjusterKind.TIE_ROD, 0.5)
    assert rod.direction is TurnDirection.LENGTHEN
    bolt = Guidance("front_left", GuidanceState.TURN, 1, AdjusterKind.CAMBER_BOLT, -0.5)
    assert bolt.direction is TurnDirection.IN


def test_who_holds_turns_nothing() -> None:
    held = Guidance("front_left", GuidanceState.HOLD, 1, AdjusterKind.TIE_ROD, 0.01)
    assert held.direction is TurnDirection.NONE
    assert not held.done


@pytest.mark.parametrize(
    ("field", "made"),
    [
        ("turns_to_go", lambda: Guidance("w", GuidanceState.TURN, 0, AdjusterKind.TIE_ROD)),
        ("turns_to_go", lambda: Guidance("w", GuidanceState.DONE, turns_to_go=0.0)),
        ("turns_to_go", lambda: Guidance("w", GuidanceState.TURN, 0, AdjusterKind.TIE_ROD, math.nan)),
        ("adjuster", lambda: Guidance("w", GuidanceState.TURN, turns_to_go=1.0)),
        ("reason", lambda: Guidance("w", GuidanceState.UNREACHABLE)),
        ("reason", lambda: Guidance("w", GuidanceState.DONE, reason=OutOfReach.RANGE)),
        ("target_toe_deg", lambda: Guidance("w", GuidanceState.CHECK, target_toe_deg=math.inf)),
    ],
)
def test_values_that_contradict_the_state_are_refused(field: str, made: object) -> None:
    with pytest.raises(InputError, match=field):
        made()  # type: ignore[operator]
