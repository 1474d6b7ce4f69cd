"""Wear of a projector: the brightness of its lines over months, compared with that after commissioning.

Tyres differ in blackness by more than a lamp fades in a year, so medians of many wheels are compared, and
their own scatter says whether they can tell a difference.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.robust import deviation_of

WORN_SHARE, SPENT_SHARE = 0.7, 0.4
"""Of the brightness after commissioning, below which a projector is worn, and is to be replaced."""
LEAST_WHEELS = 30
"""Of each of the two times; fewer tell the tyres and not the projector."""
_MEDIAN_SPREAD = math.sqrt(math.pi / 2.0)  # standard error of a median over that of a mean, normal values
_SIGNIFICANT = 3.0


class WearState(enum.StrEnum):
    """What is to be done about a projector."""

    GOOD = "good"
    WORN = "worn"
    SPENT = "spent"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class ProjectorWear:
    """How bright the lines are beside what they were.

    Attributes
    ----------
    state
        ``unknown`` where there are too few wheels.
    share
        Recent median over that of the first wheels; None where unknown.
    share_u
        Its standard uncertainty, from the scatter of the wheels.
    worn_in_days
        When it will be worn at this rate; None where it does not fade clearly, or is worn already.
    reason
        A sentence.
    """

    state: WearState
    share: float | None
    share_u: float | None
    worn_in_days: float | None
    reason: str


def projector_wear(days: ArrayLike, brightness: ArrayLike, window_days: float = 14.0) -> ProjectorWear:
    """Compare the recent brightness of light lines with the first.

    Parameters
    ----------
    days
        (N,) when each wheel was measured, days from any origin, in any order. Begin anew when exposure, gain,
        brightness or projector were changed: the figures before are of another light.
    brightness
        (N,) `line_brightness` of one camera, or a mean of both of a head, above 0.
    window_days
        The first and the last so many days are compared.

    Raises
    ------
    DegenerateInputError
        When the two differ in number, a value is not finite, or a brightness is below 0.
    """
    when, light = np.asarray(days, dtype=float).ravel(), np.asarray(brightness, dtype=float).ravel()
    if when.shape != light.shape or not np.isfinite([when, light]).all() or (light < 0.0).any():
        raise DegenerateInputError(
            field="days, brightness",
            expected="as many finite days as brightnesses of at least 0",
            seen=f"{when.size} and {light.size}",
        )
    first = light[when <= when.min(initial=np.inf) + window_days]
    last = light[when > when.max(initial=-np.inf) - window_days]
    span = float(np.ptp(when)) if when.size else 0.0
    if min(first.size, last.size) < LEAST_WHEELS or span < 2.0 * window_days or np.median(first) <= 0.0:
        return ProjectorWear(
            WearState.UNKNOWN, None, None, None,
            f"{first.size} wheels at first, {last.size} lately over {span:.0f} days; at least {LEAST_WHEELS} "
            f"each and {2.0 * window_days:.0f} days tell the wear of a projector",
        )  # fmt: skip
    share = float(np.median(last) / np.median(first))
    relative = math.hypot(_relative(first), _relative(last) if share > 0.0 else 0.0)
    share_u = share * relative
    state = WearState.GOOD
    if share < SPENT_SHARE:
        state = WearState.SPENT
    elif share < WORN_SHARE:
        state = WearState.WORN
    left = None
    if state is WearState.GOOD and 1.0 - share > _SIGNIFICANT * share_u:
        # Between the middles of both windows; light fades by the same share in the same time.
        rate = -math.log(share) / (span - window_days)
        left = math.log(share / WORN_SHARE) / rate
    return ProjectorWear(state, share, share_u, left, _sentence(state, share, share_u, left))


def _relative(light: Array) -> float:
    """Standard error of the median of some wheels, over it."""
    median = float(np.median(light))
    return _MEDIAN_SPREAD * deviation_of(light - median) / math.sqrt(light.size) / median


def _sentence(state: WearState, share: float, share_u: float, left: float | None) -> str:
    text = f"the light lines are {share:.0%} (± {2.0 * share_u:.0%}) as bright as at first"
    if state is WearState.SPENT:
        return f"{text}; replace the projector's lamp"
    if state is WearState.WORN:
        return f"{text}; clean its window and those of the cameras, and plan a new lamp"
    if left is not None:
        return f"{text}; at this rate it is worn in {left:.0f} days"
    return text
