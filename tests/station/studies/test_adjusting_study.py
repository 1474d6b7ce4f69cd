"""The study of adjusting in its quick form: the product's guidance with vehicles that were drawn worse."""

from __future__ import annotations

import pytest

from station.cycle.modes.guiding import Guiding
from station.studies.adjusting import STUDY


@pytest.mark.slow
def test_vehicles_out_of_their_limits_end_inside_and_bent_ones_are_named() -> None:
    found = STUDY.run(1, True, lambda fraction, text: None)
    assert not found.missed
    assert found.figures["sound_called_bent"] == 0.0
    assert found.figures["wheels_called_done_that_are_not"] == 0.0


def test_the_study_misses_its_goal_without_the_guidance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever turns the other way round gets no vehicle right."""
    from station.studies import adjusting

    take = Guiding.take

    def mirrored(self: Guiding, *arguments: object) -> object:
        from dataclasses import replace

        told = take(self, *arguments)  # type: ignore[arg-type]
        return told if told.turns_to_go is None else replace(told, turns_to_go=-told.turns_to_go)

    monkeypatch.setattr(Guiding, "take", mirrored)
    monkeypatch.setattr("station.rehearsal.adjusting.MOST_S", 30.0)
    found = adjusting.run_adjusting(1, 2, 1, 1, lambda fraction, text: None)
    assert {goal.figure for goal in found.missed} >= {"inside_after_two_corrections"}
