"""Whether a spread was seen at all: gauges that stand still, and displays coarser than what they show."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from alignment.statistics.summary import as_values, moments

ALL_EQUAL = (
    "All values are equal: the resolution is too coarse to judge the spread, or the gauge stands still"
)
"""Why there is no verdict; the cure follows it."""
CURE = "record more digits, or look whether the gauge follows a change"


def coarse_step(values: ArrayLike, deviation: float | None = None) -> float | None:
    """Step of a display that is too coarse for its own spread; None for a finer one.

    Of (N,) values the smallest difference between different ones, where it exceeds their standard
    deviation: then limits and indices follow the display's rounding. Too few values leave large gaps by
    chance, so None for fewer than 10, and where all are equal.

    Parameters
    ----------
    deviation
        Of repeated readings, where the values are of several parts; that of the values without.

    Source: Wheeler, Understanding Statistical Process Control (1992), on inadequate measurement units.
    """
    found = np.unique(as_values(values))
    if np.size(values) < 10 or len(found) < 2:
        return None
    step = float(np.diff(found).min())
    return step if step > (moments(values).deviation if deviation is None else deviation) else None
