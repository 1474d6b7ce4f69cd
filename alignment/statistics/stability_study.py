"""Stability of a gauge: the same master over weeks, on a control chart, and as a drift.

Source: AIAG, Measurement Systems Analysis, 4th edition, chapter III, section on stability.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from alignment.errors import DegenerateInputError
from alignment.statistics.charts import ControlChart, control_chart
from alignment.statistics.choices import ChartKind, RuleSet
from alignment.statistics.linearity_study import BiasResult, bias
from alignment.statistics.summary import as_values, moments

_DAY_S = 86_400.0

LEAST_SPAN_DAYS = 1.0
"""A change per day is told of values that span a day: of minutes it would be their noise, times hundreds."""
LEAST_POINTS, USUAL_POINTS = 8, 20
"""A chart of fewer points can hardly signal: its limits come from the same few; and what a study has."""


@dataclass(frozen=True, eq=False)
class StabilityResult:
    """What the repeated master says.

    Attributes
    ----------
    chart
        Control chart of the values in their order.
    deviation
        Standard deviation of all values: the gauge's contribution over the time of the study.
    drift
        Change per day; None without times, or for values that span less than a day.
    drift_p
        Chance probability of such a drift of a stable gauge.
    bias
        Against the certified value, when there is one.
    """

    chart: ControlChart
    deviation: float
    drift: float | None
    drift_p: float | None
    bias: BiasResult | None

    @property
    def stable(self) -> bool | None:
        """Whether there is no signal; None without a spread, or where too few points could have given one."""
        found = self.chart.in_control
        return None if found and len(self.chart.location.points) < LEAST_POINTS else found


def stability(
    values: ArrayLike,
    times_s: ArrayLike | None = None,
    *,
    size: int = 1,
    reference: float | None = None,
    kind: ChartKind = ChartKind.XBAR_R,
    rules: RuleSet = RuleSet.WESTERN_ELECTRIC,
) -> StabilityResult:
    """Judge (N,) values of one master, in the order of time.

    Parameters
    ----------
    times_s
        (N,) seconds since any origin.
    size
        Values taken together; 1 makes a chart of single values whatever `kind` says.

    Raises
    ------
    DegenerateInputError
        For fewer than three values, or times of another number.
    """
    found = as_values(values)
    if len(found) < 3:
        raise DegenerateInputError(
            expected="at least 3 values", seen=str(len(found)), cure=f"{USUAL_POINTS} are usual"
        )
    chart = control_chart(ChartKind.INDIVIDUALS if size == 1 else kind, found, rules, size=size)
    drift, drift_p = (None, None) if times_s is None else drift_per_day(found, times_s)
    return StabilityResult(
        chart,
        moments(found).deviation,
        drift,
        drift_p,
        None if reference is None else bias(found, reference),
    )


def drift_per_day(values: ArrayLike, times_s: ArrayLike) -> tuple[float | None, float | None]:
    """As `drift_of`, over (N,) seconds; None for both where these span less than `LEAST_SPAN_DAYS`."""
    days = as_values(times_s) / _DAY_S
    if not len(days) or np.ptp(days) < LEAST_SPAN_DAYS:
        return None, None
    return drift_of(values, days)


def drift_of(values: ArrayLike, at: ArrayLike) -> tuple[float | None, float | None]:
    """Slope of (N,) values over (N,) abscissae, and the chance probability of one as steep.

    None for both where all abscissae are equal or there are fewer than three; p is None on a perfect line.

    Raises
    ------
    DegenerateInputError
        For different numbers of both.
    """
    y, x = as_values(values), as_values(at)
    if len(y) != len(x):
        raise DegenerateInputError(expected=f"{len(y)} times", seen=str(len(x)))
    if len(y) < 3 or not np.ptp(x) > 0.0:
        return None, None
    dx, dy = x - moments(x).mean, y - moments(y).mean
    sxx = math.fsum(np.square(dx))
    slope = math.fsum(dx * dy) / sxx
    rest = math.fsum(np.square(dy - slope * dx)) / (len(y) - 2)
    if not rest > 0.0:
        return slope, None
    return slope, float(2 * stats.t.sf(abs(slope) / math.sqrt(rest / sxx), len(y) - 2))
