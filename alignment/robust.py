"""Scales that a few wrong values do not spoil.

Kernels name `DEVIATION_OF_MEDIAN` through this module (``robust.DEVIATION_OF_MEDIAN``): compiled code is then
made anew when it changes.
"""

from __future__ import annotations

import numpy as np

from alignment.arrays import Array

DEVIATION_OF_MEDIAN = 1.4826
"""Standard deviation of normal values about zero, in medians of absolute values (Rousseeuw, Croux 1993)."""
BIWEIGHT = 4.685
"""Scales at which Tukey's biweight ends: 95 % efficient for normal values (Holland, Welsch 1977)."""


def deviation_of(residuals: Array) -> float:
    """Standard deviation of (N,) residuals about zero, by the median of their absolute values."""
    return DEVIATION_OF_MEDIAN * float(np.median(np.abs(residuals)))
