"""What drifts with time and what follows temperature, and when a limit will be reached.

A straight line in both, by least squares: value = level + slope · time + coefficient · (temperature − mean).
Values that follow each other hold less than their number says; the uncertainty counts them as
n · (1 − r) / (1 + r) of the lag-1 correlation r of what is left (Santer et al., Journal of Geophysical
Research 105, 2000, equation 6). The moment of a limit has Fieller's confidence limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats

from alignment.arrays import Array
from alignment.errors import DegenerateInputError

LEAST_TIMES = 6
"""Fewer values tell a line in time and temperature from their own noise too seldom to say anything."""
# A direction with less of the whole than this is rounding.
_RANK = 1e-9


@dataclass(frozen=True)
class Crossing:
    """When a limit is reached, in the unit and from the origin of the fit's times.

    Attributes
    ----------
    at
        Where the line meets the limit.
    earliest, latest
        Confidence limits of it.
    """

    at: float
    earliest: float
    latest: float


@dataclass(frozen=True)
class DriftFit:
    """A line in time and temperature.

    Attributes
    ----------
    level
        At time 0 and the mean temperature.
    slope, slope_deviation
        Per unit of time at constant temperature, and its standard deviation.
    per_kelvin, per_kelvin_deviation
        At constant time; None where the temperature was not known or never changed.
    temperature
        Mean of the temperatures; None where they were not known.
    residual_deviation
        Standard deviation of what is left.
    n, independent
        Values, and as how many independent ones they count.
    covariance
        (3, 3) of level, slope and coefficient; zeros in the last where there is none.
    """

    level: float
    slope: float
    slope_deviation: float
    per_kelvin: float | None
    per_kelvin_deviation: float | None
    temperature: float | None
    residual_deviation: float
    n: int
    independent: float
    covariance: Array

    def crossing(self, limit: float, kelvin: float = 0.0, confidence: float = 0.95) -> Crossing | None:
        """Return when the line meets a limit; None when nobody can say.

        That is so where the slope cannot be told from none at this confidence.

        Parameters
        ----------
        limit
            In the unit of the values.
        kelvin
            Temperature to forecast for, less the mean one.
        confidence
            Of the limits of the moment, two-sided, between 0 and 1.
        """
        parameters = 2 if self.per_kelvin is None else 3
        t = float(stats.t.ppf(0.5 + confidence / 2, self.independent - parameters))
        start = np.array([1.0, 0.0, kelvin])
        away = self.level + (self.per_kelvin or 0.0) * kelvin - limit
        squares = self.slope**2 - t**2 * self.covariance[1, 1]
        if not squares > 0.0:
            return None
        mixed = away * self.slope - t**2 * float(start @ self.covariance[1])
        rest = away**2 - t**2 * float(start @ self.covariance @ start)
        # Where the slope is certain the roots are real but for rounding.
        root = math.sqrt(max(mixed**2 - squares * rest, 0.0))
        return Crossing(-away / self.slope, (-mixed - root) / squares, (-mixed + root) / squares)


def fit_drift(times: Array, values: Array, temperatures: Array | None = None) -> DriftFit:
    """Fit a line in time and temperature.

    Parameters
    ----------
    times
        (N,) rising, in any unit, at least `LEAST_TIMES`.
    values
        (N,) of one figure.
    temperatures
        (N,) at the same times, K or °C; None where they are not known.

    Raises
    ------
    DegenerateInputError
        For too few values, values that are not finite, times that do not rise, temperatures that only follow
        the time, so that nobody can tell the two apart, and values each so near the one before that they
        count as too few.
    """
    _check(times, values, temperatures)
    n = len(times)
    mean = None if temperatures is None else float(temperatures.mean())
    columns = [np.ones(n), times]
    if temperatures is not None and np.ptp(temperatures) > 0.0:
        columns.append(temperatures - temperatures.mean())
    # Scaled, so that the unit of time decides nothing.
    middle, width = float(times.mean()), float(np.ptp(times))
    scaled = np.column_stack([columns[0], (times - middle) / width, *columns[2:]])
    scale = np.sqrt(np.square(scaled).sum(axis=0))
    u, singular, vt = np.linalg.svd(scaled / scale, full_matrices=False)
    if singular[-1] < _RANK * singular[0]:
        raise DegenerateInputError(
            expected="temperatures that do not only follow the time",
            seen="a straight line: drift and temperature cannot be told apart",
        )
    found = (vt.T / singular @ (u.T @ values)) / scale
    left = values - scaled @ found
    parameters = scaled.shape[1]
    # What rounding leaves follows nothing.
    exact = float(np.abs(left).max()) <= 1e-12 * float(np.abs(values).max())
    independent = float(n) if exact else n * _independent_share(left)
    if independent <= parameters + 1:
        raise DegenerateInputError(
            expected=f"at least {parameters + 2} independent values",
            seen=f"{n} that count as {independent:.1f}, as each is nearly the one before",
        )
    variance = float(left @ left) / (independent - parameters)
    covariance = np.zeros((3, 3))
    covariance[:parameters, :parameters] = variance * ((vt.T / singular**2) @ vt) / np.outer(scale, scale)
    # Back to the caller's time: level at its origin, slope in its unit.
    back = np.array([[1.0, -middle / width, 0.0], [0.0, 1.0 / width, 0.0], [0.0, 0.0, 1.0]])
    level, slope, coefficient = back @ np.append(found, 0.0)[:3]
    covariance = back @ covariance @ back.T
    known = parameters == 3
    return DriftFit(
        float(level),
        float(slope),
        math.sqrt(covariance[1, 1]),
        float(coefficient) if known else None,
        math.sqrt(covariance[2, 2]) if known else None,
        mean,
        math.sqrt(float(left @ left) / (n - parameters)),
        n,
        independent,
        covariance,
    )


def _independent_share(left: Array) -> float:
    """Return as which share of their number values count by their lag-1 correlation; never more than all."""
    r = min(max(float(left[1:] @ left[:-1]) / float(left @ left), 0.0), 1.0)
    return (1.0 - r) / (1.0 + r)


def _check(times: Array, values: Array, temperatures: Array | None) -> None:
    arrays = [times, values] if temperatures is None else [times, values, temperatures]
    if len({each.shape for each in arrays}) != 1 or times.ndim != 1 or len(times) < LEAST_TIMES:
        raise DegenerateInputError(
            expected=f"at least {LEAST_TIMES} times with a value each, and as many temperatures or none",
            seen=" and ".join(str(len(each)) for each in arrays),
        )
    if not all(np.isfinite(each).all() for each in arrays):
        raise DegenerateInputError(expected="finite times, values and temperatures", seen="one that is not")
    if not (np.diff(times) > 0.0).all():
        raise DegenerateInputError(expected="times that rise", seen="one that does not")
