"""Process capability and performance with confidence limits, and a test of normality.

Sources: ISO 22514-2; Kotz and Johnson, Process Capability Indices (1993); Bissell, Applied Statistics 39
(1990), for the limits of Cpk and Ppk; Stephens, in D'Agostino and Stephens, Goodness-of-Fit Techniques
(1986), for the Anderson-Darling test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.special import log_ndtr

from alignment.errors import DegenerateInputError
from alignment.statistics.choices import Conclusion
from alignment.statistics.spread import ALL_EQUAL, CURE
from alignment.statistics.summary import Moments, as_values

LEAST_CPK = 1.33
"""What plants ask of Cpk; shown only where the lower confidence limit is above it."""
LEAST_VALUES = 10
"""Fewer values judge no process: their spread may be small by chance, or by the display's step."""
LEAST_FOR_QUANTILES = 1000
"""Values without which a quantile of 0.135 % says nothing."""


@dataclass(frozen=True)
class CapabilityIndex:
    """An index with its two-sided confidence limits."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Capability:
    """Indices of one characteristic.

    Attributes
    ----------
    overall
        Moments of all values.
    within_sigma, within_df
        Standard deviation within subgroups and its degrees of freedom; None where no subgroups are known.
    low, high
        Specification limits, None where there is none.
    cp, cpk
        From the deviation within subgroups; None without it, `cp` without both limits.
    pp, ppk
        From the deviation of all values.
    expected_outside_ppm
        Share of a normal process with these values that lies outside the limits, parts per million.
    confidence
        Of the limits of the indices.
    """

    overall: Moments
    within_sigma: float | None
    within_df: int | None
    low: float | None
    high: float | None
    cp: CapabilityIndex | None
    cpk: CapabilityIndex | None
    pp: CapabilityIndex | None
    ppk: CapabilityIndex | None
    expected_outside_ppm: float | None
    confidence: float

    @property
    def decisive(self) -> CapabilityIndex | None:
        """Cpk where the spread within subgroups is known, else Ppk; None where there is no spread."""
        return self.ppk if self.within_sigma is None else self.cpk


@dataclass(frozen=True)
class CapabilityJudgement:
    """Whether a process has shown that it is capable, and why."""

    judgement: Conclusion
    reason: str


def judged(found: Capability, least: float = LEAST_CPK) -> CapabilityJudgement:
    """Judge by the lower confidence limit, and only where enough values differ.

    Parameters
    ----------
    least
        Target of Cpk, or of Ppk where no spread within subgroups is known.
    """
    n = found.overall.n
    if not found.overall.varied:
        return CapabilityJudgement(Conclusion.NONE, f"{ALL_EQUAL}: {CURE}")
    index = found.decisive
    if index is None:
        return CapabilityJudgement(
            Conclusion.NONE, f"Values of one hour are all equal: no short-term spread was seen: {CURE}"
        )
    if n < LEAST_VALUES:
        return CapabilityJudgement(
            Conclusion.NONE, f"{n} values say nothing of a process: measure {LEAST_VALUES} at least"
        )
    name = "Ppk" if index is found.ppk else "Cpk"
    limit = f"the lower limit of {name}, {index.low:.2f}, is"
    if index.low > least:
        return CapabilityJudgement(Conclusion.SHOWN, f"{limit} above {least:g}")
    if index.high < least:
        return CapabilityJudgement(
            Conclusion.NOT_SHOWN,
            f"{limit} below {least:g}, and so is the upper: centre the process or narrow it",
        )
    more = "more values may show it" if index.value > least else "centre the process or narrow it"
    return CapabilityJudgement(Conclusion.NOT_SHOWN, f"{limit} not above {least:g}: {more}")


def capability(
    overall: Moments,
    low: float | None,
    high: float | None,
    *,
    within_sigma: float | None = None,
    within_df: int | None = None,
    confidence: float = 0.95,
) -> Capability:
    """Indices from moments, so that pre-aggregated values serve as well as raw ones.

    Parameters
    ----------
    overall
        Of all values, at least two.
    low, high
        Specification limits; one is enough for Cpk and Ppk.
    within_sigma, within_df
        Standard deviation within subgroups, and its degrees of freedom.

    Raises
    ------
    DegenerateInputError
        For fewer than two values, no limit at all, or limits that are not in order.
    """
    if low is None and high is None:
        raise DegenerateInputError(expected="at least one specification limit", seen="none")
    if low is not None and high is not None and not low < high:
        raise DegenerateInputError(expected=f"an upper limit above {low}", seen=str(high))
    if (within_sigma is None) != (within_df is None):
        raise DegenerateInputError(expected="within_sigma and within_df together", seen="only one")
    s = overall.deviation
    pp = ppk = cp = cpk = ppm = None
    if overall.varied and s > 0.0:
        pp = _potential(low, high, s, overall.n - 1, confidence)
        ppk = _actual(low, high, overall.mean, s, overall.n, overall.n - 1, confidence)
        below = 0.0 if low is None else stats.norm.cdf((low - overall.mean) / s)
        above = 0.0 if high is None else stats.norm.sf((high - overall.mean) / s)
        ppm = 1e6 * float(below + above)
    within_seen = overall.varied and within_sigma is not None and within_sigma > 0.0
    if within_seen and within_sigma is not None and within_df is not None and within_df > 0:
        cp = _potential(low, high, within_sigma, within_df, confidence)
        cpk = _actual(low, high, overall.mean, within_sigma, overall.n, within_df, confidence)
    return Capability(overall, within_sigma, within_df, low, high, cp, cpk, pp, ppk, ppm, confidence)


def moving_range_sigma(values: ArrayLike) -> tuple[float, int] | None:
    """Short-term deviation of single values in their order, and its effective degrees of freedom.

    From mean squared successive differences (von Neumann 1941), whose efficiency is two thirds: (N − 1) · 2/3
    degrees. None for fewer than two values.
    """
    found = as_values(values)
    if len(found) < 2:
        return None
    steps = np.diff(found)
    return math.sqrt(math.fsum(np.square(steps)) / (2 * len(steps))), max(1, (2 * len(steps)) // 3)


def quantile_performance(
    values: ArrayLike, low: float | None, high: float | None
) -> tuple[float | None, float] | None:
    """Pp and Ppk from the quantiles 0.135 %, 50 % and 99.865 %, for a process that is not normal.

    ISO 22514-2, general geometric method. Empirical quantiles, so at least 1000 values; None for fewer,
    without a limit, or where the quantiles coincide. Pp is None without both limits.
    """
    found = as_values(values)
    if len(found) < LEAST_FOR_QUANTILES or (low is None and high is None):
        return None
    bottom, middle, top = (float(q) for q in np.quantile(found, (0.00135, 0.5, 0.99865)))
    if not (bottom < middle < top):
        return None
    pp = None if low is None or high is None else (high - low) / (top - bottom)
    return pp, min(
        math.inf if low is None else (middle - low) / (middle - bottom),
        math.inf if high is None else (high - middle) / (top - middle),
    )


def normality_p(values: ArrayLike) -> float | None:
    """Chance probability of such values from a normal process, by Anderson-Darling.

    None for fewer than 8 values, or values that are all equal.
    """
    found = np.sort(as_values(values))
    n = len(found)
    if n < 8 or not found[-1] > found[0]:
        return None
    s = float(np.std(found, ddof=1))
    z = (found - found.mean()) / s
    weights = 2.0 * np.arange(1, n + 1) - 1.0
    a = -n - float(np.mean(weights * (log_ndtr(z) + log_ndtr(-z[::-1]))))
    a *= 1.0 + 0.75 / n + 2.25 / n**2
    if a >= 0.6:
        p = math.exp(1.2937 - 5.709 * a + 0.0186 * a * a) if a < 13.0 else 0.0
    elif a >= 0.34:
        p = math.exp(0.9177 - 4.279 * a - 1.38 * a * a)
    elif a >= 0.2:
        p = 1.0 - math.exp(-8.318 + 42.796 * a - 59.938 * a * a)
    else:
        p = 1.0 - math.exp(-13.436 + 101.14 * a - 223.73 * a * a)
    return min(max(p, 0.0), 1.0)


def _potential(
    low: float | None, high: float | None, sigma: float, df: int, confidence: float
) -> CapabilityIndex | None:
    if low is None or high is None:
        return None
    value = (high - low) / (6.0 * sigma)
    tail = (1.0 - confidence) / 2.0
    return CapabilityIndex(
        value,
        value * math.sqrt(float(stats.chi2.ppf(tail, df)) / df),
        value * math.sqrt(float(stats.chi2.ppf(1.0 - tail, df)) / df),
    )


def _actual(
    low: float | None, high: float | None, mean: float, sigma: float, n: int, df: int, confidence: float
) -> CapabilityIndex:
    room = min(
        math.inf if low is None else mean - low,
        math.inf if high is None else high - mean,
    )
    value = room / (3.0 * sigma)
    half = float(stats.norm.ppf(0.5 + confidence / 2.0)) * math.sqrt(1.0 / (9.0 * n) + value**2 / (2.0 * df))
    return CapabilityIndex(value, value - half, value + half)
