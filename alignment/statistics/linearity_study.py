"""Bias over the measuring range: a line through the errors of several masters.

Source: AIAG, Measurement Systems Analysis, 4th edition, chapter III, sections on bias and linearity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.statistics.summary import as_values, moments


@dataclass(frozen=True)
class BiasResult:
    """Bias at one reference value.

    Attributes
    ----------
    reference, n, mean, deviation
        Certified value; repetitions, their mean and standard deviation.
    low, high
        Confidence limits of the bias.
    t, p
        Test of no bias; None when nothing varied.
    """

    reference: float
    n: int
    mean: float
    deviation: float
    low: float
    high: float
    t: float | None
    p: float | None

    @property
    def bias(self) -> float:
        """Mean less reference."""
        return self.mean - self.reference

    @property
    def significant(self) -> bool | None:
        """Whether zero lies outside the confidence limits; None when nothing varied, so there are none."""
        return None if self.t is None else not self.low <= 0.0 <= self.high


@dataclass(frozen=True)
class LinearityResult:
    """The line bias = intercept + slope · reference.

    Attributes
    ----------
    biases
        At each reference value, in rising order.
    slope, intercept, residual_deviation, r_squared
        Of the line through all single errors; R² is None when all errors are equal.
    slope_t, slope_p, intercept_t, intercept_p
        Tests of zero; None when no master was ever read differently, or all errors lie on the line.
    confidence
        Of the band and of the biases' limits.
    df, reference_mean, reference_squares
        Degrees of freedom of the line, mean and squared deviations of the references: what the band needs.
    """

    biases: tuple[BiasResult, ...]
    slope: float
    intercept: float
    residual_deviation: float
    r_squared: float | None
    slope_t: float | None
    slope_p: float | None
    intercept_t: float | None
    intercept_p: float | None
    confidence: float
    n: int
    reference_mean: float
    reference_squares: float

    def band(self, reference: Array) -> tuple[Array, Array]:
        """Lower and upper confidence limit of the mean bias at (K,) reference values."""
        at = self.intercept + self.slope * reference
        away = np.square(reference - self.reference_mean) / self.reference_squares
        t = stats.t.ppf(0.5 + self.confidence / 2, self.n - 2)
        half = t * self.residual_deviation * np.sqrt(1.0 / self.n + away)
        return at - half, at + half

    @property
    def acceptable(self) -> bool | None:
        """Whether the line of zero bias lies within the band over the whole range (AIAG).

        The range goes from the smallest to the largest master; between them the band is narrower than at
        both. None when no master was ever read differently: a band without spread holds nothing or all.
        """
        if not any(bias.deviation > 0.0 for bias in self.biases):
            return None
        low, high = self.band(np.array([self.worst_reference]))
        return not (low[0] > 0.0 or high[0] < 0.0)

    @property
    def worst_reference(self) -> float:
        """Value within the masters' range where the line exceeds half the band the most (in squares)."""
        first, last = self.biases[0].reference, self.biases[-1].reference
        t = stats.t.ppf(0.5 + self.confidence / 2, self.n - 2)
        opening = float(t * self.residual_deviation) ** 2 / self.reference_squares
        middle = self.intercept + self.slope * self.reference_mean
        # (middle + slope u)² - opening (squares/n + u²), a parabola in u, the distance from the mean.
        places = [first, last]
        if opening > self.slope**2:
            peak = self.reference_mean + self.slope * middle / (opening - self.slope**2)
            places.append(min(max(peak, first), last))
        u = np.array(places) - self.reference_mean
        excess = np.square(middle + self.slope * u) - opening * (
            self.reference_squares / self.n + np.square(u)
        )
        return places[int(excess.argmax())]

    @property
    def outside_band(self) -> int:
        """Number of masters at which the line of zero bias lies outside of the band."""
        low, high = self.band(np.array([bias.reference for bias in self.biases]))
        return int(((low > 0.0) | (high < 0.0)).sum())

    def percent_linearity(self) -> float:
        """Size of the slope in percent: change of the bias over the change of the value."""
        return 100.0 * abs(self.slope)


def bias(values: Sequence[float] | Array, reference: float, confidence: float = 0.95) -> BiasResult:
    """Bias of (N,) repetitions on one master.

    Raises
    ------
    DegenerateInputError
        For fewer than two values.
    """
    found = moments(values)
    s = found.deviation
    error = s / math.sqrt(found.n)
    away = found.mean - reference
    half = float(stats.t.ppf(0.5 + confidence / 2, found.n - 1)) * error
    t = away / error if found.varied else None
    return BiasResult(
        reference,
        found.n,
        found.mean,
        s,
        away - half,
        away + half,
        t,
        None if t is None else float(2 * stats.t.sf(abs(t), found.n - 1)),
    )


def linearity(
    values: Sequence[float] | Array, references: Sequence[float] | Array, confidence: float = 0.95
) -> LinearityResult:
    """Fit the line to (N,) values of masters with (N,) certified values.

    Raises
    ------
    DegenerateInputError
        For fewer than two masters, or a master measured only once.
    """
    y, x = as_values(values), as_values(references)
    if len(y) != len(x):
        raise DegenerateInputError(expected=f"{len(y)} reference values", seen=str(len(x)))
    levels = np.unique(x)
    if len(levels) < 2:
        raise DegenerateInputError(
            expected="masters of at least 2 certified values", seen=str(len(levels)), cure="5 are usual"
        )
    biases = tuple(bias(y[x == level], float(level), confidence) for level in levels)
    error = y - x
    n = len(y)
    mean, middle = moments(x).mean, moments(error).mean
    dx, dy = x - mean, error - middle
    sxx = math.fsum(np.square(dx))
    slope = math.fsum(dx * dy) / sxx
    intercept = middle - slope * mean
    rest = math.fsum(np.square(dy - slope * dx))
    total = math.fsum(np.square(dy))
    s = math.sqrt(rest / (n - 2))
    # Without repetitions that differ, s is what the line leaves over, or rounding: no test stands on it.
    seen = s > 0.0 and any(each.deviation > 0.0 for each in biases)
    slope_t = slope / (s / math.sqrt(sxx)) if seen else None
    intercept_t = intercept / (s * math.sqrt(1.0 / n + mean**2 / sxx)) if seen else None
    return LinearityResult(
        biases,
        slope,
        intercept,
        s,
        1.0 - rest / total if total > 0.0 else None,
        slope_t,
        _p(slope_t, n - 2),
        intercept_t,
        _p(intercept_t, n - 2),
        confidence,
        n,
        mean,
        sxx,
    )


def _p(t: float | None, df: int) -> float | None:
    return None if t is None else float(2 * stats.t.sf(abs(t), df))
