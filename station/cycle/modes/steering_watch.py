"""Looks at the steering wheel's angle during a sweep: lost, jumping, standing still, elsewhere, moved."""

from __future__ import annotations

from station.configuration import SweepPlan
from station.cycle.modes.sweep_ends import SweepEnd
from station.cycle.words import SteeringWheel, Step

_SLACK_DEG = 2.0
"""By which an angle may change between two samples however near they are: steps of sensor and frame."""
_STILL_SHARE = 0.1
"""Of the way between two positions: an angle that changed by less has stood still."""
_BEGINNING_S = 1.0
"""Within which the first angle must be known."""
Ended = tuple[SweepEnd, str]
"""Why a sweep ended, and what was seen."""


class SteeringWatch:
    """What was seen of the angle since the sweep began.

    Parameters
    ----------
    plan
        Of the sweep.
    began_s
        When it began, monotonic seconds.

    Attributes
    ----------
    watched
        Whether there must be an angle: it is required, or was there once.
    """

    def __init__(self, plan: SweepPlan, began_s: float) -> None:
        self._plan = plan
        self._began_s = began_s
        self.watched = plan.require_angle
        self._last: tuple[float, float] | None = None
        self._taken_deg: float | None = None
        self._held_deg: float | None = None

    def look(self, told: SteeringWheel | None, now: float) -> Ended | None:
        """Look at what is told now; why the sweep ends, if it does.

        Parameters
        ----------
        told
            What the line tells.
        now
            Monotonic seconds.
        """
        if told is None or not told.fresh(self._plan.oldest_s):
            # The first frame of a message that begins only sets its counter.
            begins = self._last is None and now - self._began_s < _BEGINNING_S
            return (SweepEnd.LOST, _unknown(told)) if self.watched and not begins else None
        angle_deg, measured_s = _angle(told), now - told.age_s
        self.watched = True
        before, self._last = self._last, (angle_deg, measured_s)
        if before is not None:
            moved_deg, within_s = abs(angle_deg - before[0]), max(measured_s - before[1], 0.0)
            if moved_deg > self._plan.fastest_deg_s * within_s + _SLACK_DEG:
                return SweepEnd.JUMPED, f"from {before[0]:g}° to {angle_deg:g}° within {within_s:.3f} s"
        held_deg = self._held_deg
        if held_deg is not None and abs(angle_deg - held_deg) > self._plan.held_deg:
            return SweepEnd.MOVED, f"from {held_deg:g}° to {angle_deg:g}°"
        return None

    def reached(self, told: SteeringWheel | None, step: Step, wanted_deg: float) -> bool | Ended:
        """Whether a step reached the angle that is wanted; or why the sweep ends.

        Call it after `look`, with the same.
        """
        known = told is not None and told.fresh(self._plan.oldest_s)
        told_deg = _angle(told) if told is not None and known else None
        angle_deg = step.angle_deg if told_deg is None else told_deg
        if angle_deg is None:
            return SweepEnd.LOST, "neither the line nor the step told an angle"
        if step.angle_deg is not None and abs(step.angle_deg - angle_deg) > self._plan.tolerance_deg:
            seen = f"the step says {step.angle_deg:g}°, the line {angle_deg:g}°"
            return (SweepEnd.FROZEN if self._stands(angle_deg) else SweepEnd.CONTRADICTED), seen
        if abs(angle_deg - wanted_deg) > self._plan.tolerance_deg:
            return False
        self._taken_deg = self._held_deg = angle_deg
        return True

    def released(self) -> None:
        """Images were taken; the steering may be turned again."""
        self._held_deg = None

    def never_reached(self, told: SteeringWheel | None, step: Step, wanted_deg: float) -> Ended:
        """Why the sweep ends after the last attempt at a position."""
        told_deg = None if told is None else told.angle_deg
        angle_deg = step.angle_deg if told_deg is None else told_deg
        seen = "no angle was told" if angle_deg is None else f"{angle_deg:g}° was told"
        stands = angle_deg is not None and self._stands(angle_deg)
        return (SweepEnd.FROZEN if stands else SweepEnd.ELSEWHERE), f"{wanted_deg:g}° was wanted, {seen}"

    def _stands(self, angle_deg: float) -> bool:
        still_deg = _STILL_SHARE * self._plan.spacing_deg
        return self._taken_deg is not None and abs(angle_deg - self._taken_deg) <= still_deg


def _angle(told: SteeringWheel) -> float:
    assert told.angle_deg is not None
    return told.angle_deg


def _unknown(told: SteeringWheel | None) -> str:
    if told is None:
        return "no frame tells it"
    if not told.valid:
        return "it is told as not valid"
    return f"it is {told.age_s:.2f} s old"
