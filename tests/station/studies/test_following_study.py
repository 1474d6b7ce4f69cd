"""The study of followed wheels in short, and its goals."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from alignment.units import ARCMIN
from station.studies.following import STUDY, FollowedFrame, frames_to_follow, order, summed_up

GOOD = FollowedFrame(False, (0.01, 0.02), (0.01, 0.02), (0.01, 0.02), (1e-6, 1e-6), "")
JUMPED = replace(GOOD, jumped=True)


def off(frame: FollowedFrame, arcmin: float) -> FollowedFrame:
    assert frame.whole is not None
    return replace(frame, followed=(frame.whole[0], frame.whole[1] + arcmin * ARCMIN))


@pytest.mark.slow
def test_a_rendered_wheel_is_followed_to_the_angles_of_whole_measurements() -> None:
    result = STUDY.run(3, True, lambda done, doing: None)
    assert not result.missed, [(str(goal), result.figures[goal.figure]) for goal in result.missed]
    assert result.figures["frames_to_follow_a_jump"] == 1.0
    assert result.figures["followed_share"] < 1.0
    assert result.as_json()["figures"]["largest_difference_arcmin"] > 0.0


def test_a_jump_comes_in_the_middle_and_the_wheel_turns_a_step_a_frame_elsewhere() -> None:
    numbers = list(order(40, 6))
    assert numbers.count(6) == 5
    steps = [abs(b - a) for a, b in pairwise(numbers) if 6 not in (a, b)]
    assert set(steps) == {1}


@pytest.mark.parametrize(
    ("frames", "missed"),
    [
        ([GOOD] * 4, set()),
        ([GOOD, off(GOOD, 0.011), GOOD, GOOD], {"largest_difference_arcmin"}),
        ([GOOD] * 3 + [replace(GOOD, followed=None, whole=None)], {"refused"}),
        (
            [GOOD] * 3 + [replace(GOOD, followed=None)],
            {"refused", "largest_difference_arcmin"},
        ),
        ([replace(GOOD, why="in doubt")] * 2 + [GOOD] * 2, {"followed_share"}),
        (
            [GOOD] * 8 + [off(JUMPED, 0.5)] * 2 + [JUMPED] * 2,
            {"largest_difference_arcmin", "frames_to_follow_a_jump"},
        ),
    ],
)
def test_a_goal_that_is_missed_is_said(frames: list[FollowedFrame], missed: set[str]) -> None:
    assert {goal.figure for goal in summed_up(frames).missed} == missed


def test_the_frame_of_a_jump_is_the_first_in_which_it_may_be_followed() -> None:
    assert frames_to_follow([GOOD, JUMPED, JUMPED]) == 1
    assert frames_to_follow([GOOD, off(JUMPED, 0.5), JUMPED]) == 2
    assert frames_to_follow([GOOD, off(JUMPED, 0.5), off(JUMPED, 0.5)]) == 3
    assert math.isinf(replace(GOOD, followed=None).difference)
