"""How a sweep of the steering can end without results: one table for cycle, documents and tests."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from db.records import WheelOutcome
from station.cycle.words import ErrorCode, Failure


class SweepEnd(enum.StrEnum):
    """Why a sweep brought nothing; the reason code of its record."""

    STOPPED = "sweep_stopped"
    LATE = "sweep_step_late"
    LOST = "steering_angle_lost"
    FROZEN = "steering_angle_frozen"
    JUMPED = "steering_angle_jumped"
    CONTRADICTED = "steering_angle_contradicted"
    ELSEWHERE = "steering_elsewhere"
    MOVED = "steering_moved"
    NOT_MEASURED = "sweep_not_measured"


@dataclass(frozen=True)
class SweepEnding:
    """What the line is told of such an end, and when it comes."""

    code: ErrorCode
    when: str


_SWEEP, _STEERING = ErrorCode.SWEEP_FAULT, ErrorCode.STEERING_FAULT
SWEEP_ENDS: dict[SweepEnd, SweepEnding] = {
    SweepEnd.STOPPED: SweepEnding(_SWEEP, "stop came before the last position"),
    SweepEnd.LATE: SweepEnding(_SWEEP, "no step came within the time of the vehicle type"),
    SweepEnd.LOST: SweepEnding(
        _STEERING, "the steering wheel's angle was not told, was told as not valid, or grew too old"
    ),
    SweepEnd.FROZEN: SweepEnding(
        _STEERING, "the angle stayed what it was at the position before, though steps were claimed"
    ),
    SweepEnd.JUMPED: SweepEnding(_STEERING, "the angle changed faster than a steering wheel turns"),
    SweepEnd.CONTRADICTED: SweepEnding(_STEERING, "the angle of a step is not the one that is told"),
    SweepEnd.ELSEWHERE: SweepEnding(
        _STEERING, "steps were claimed, as often as the vehicle type allows, at another angle than wanted"
    ),
    SweepEnd.MOVED: SweepEnding(_STEERING, "the steering wheel moved while images were taken"),
    SweepEnd.NOT_MEASURED: SweepEnding(_SWEEP, "a wheel was refused at more positions than may be left out"),
}
"""By end; each leads to the outcome fault of all wheels, never to ok, and the station stays ready."""


def sweep_failure(end: SweepEnd, seen: str) -> Failure:
    """Return why the wheels of a sweep that ended so have no angles.

    `seen` is what was seen, in words.
    """
    ending = SWEEP_ENDS[end]
    return Failure(WheelOutcome.REFUSED, ending.code, str(end), f"the sweep ended: {ending.when}; {seen}")
