"""Number, mean and spread of values, without losing digits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from numpy.typing import ArrayLike

from alignment.arrays import Array
from alignment.errors import DegenerateInputError


@dataclass(frozen=True)
class Moments:
    """What is needed of values for mean, standard deviation and range.

    Attributes
    ----------
    n
        How many.
    mean
        Arithmetic mean; 0 when there are none.
    squares
        Sum of squared deviations from the mean.
    low, high
        Least and largest value.
    """

    n: int
    mean: float
    squares: float
    low: float
    high: float

    @property
    def varied(self) -> bool:
        """Whether two values differ; squares alone may be what rounding left of nothing."""
        return self.high > self.low

    @property
    def variance(self) -> float:
        """Sample variance, n − 1 in the denominator.

        Raises
        ------
        DegenerateInputError
            For fewer than two values.
        """
        if self.n < 2:
            raise DegenerateInputError(expected="at least 2 values", seen=str(self.n))
        return self.squares / (self.n - 1)

    @property
    def deviation(self) -> float:
        """Sample standard deviation; errors as `variance`."""
        return math.sqrt(self.variance)


def moments(values: ArrayLike) -> Moments:
    """Moments of (N,) finite values, correctly rounded sums in two passes.

    Raises
    ------
    DegenerateInputError
        For no values or values that are not finite.
    """
    found = as_values(values)
    if not len(found):
        raise DegenerateInputError(expected="at least 1 value", seen="none")
    # A correctly rounded mean of numbers with many common digits still has an error of half a unit of its
    # last place; the second term takes that out of the squares (Chan, Golub, LeVeque 1983).
    mean = mean_of(found)
    away = found - mean
    rest = math.fsum(away)
    squares = math.fsum(np.square(away)) - rest * rest / len(found)
    return Moments(
        len(found), mean + rest / len(found), max(squares, 0.0), float(found.min()), float(found.max())
    )


def mean_of(values: Iterable[float]) -> float:
    """Mean of (N,) finite values, at least one; of equal values it is that value, to the last bit."""
    found = list(values)
    if min(found) == max(found):
        return found[0]
    return math.fsum(found) / len(found)


def merged(parts: Iterable[Moments]) -> Moments:
    """Moments of all values together from those of disjoint parts.

    Raises
    ------
    DegenerateInputError
        When all parts are empty.
    """
    filled = [part for part in parts if part.n]
    if not filled:
        raise DegenerateInputError(expected="at least 1 value", seen="none")
    n = sum(part.n for part in filled)
    # Means are combined as differences from one of them, so that common leading digits cost nothing.
    origin = filled[0].mean
    shift = math.fsum(part.n * (part.mean - origin) for part in filled) / n
    mean = origin + shift
    squares = math.fsum(part.squares for part in filled) + math.fsum(
        part.n * (part.mean - origin - shift) ** 2 for part in filled
    )
    return Moments(n, mean, squares, min(part.low for part in filled), max(part.high for part in filled))


def as_values(values: ArrayLike) -> Array:
    """(N,) float64 array of finite values.

    Raises
    ------
    DegenerateInputError
        For another shape, or values that are not finite.
    """
    found = np.asarray(values, dtype=np.float64)
    if found.ndim != 1:
        raise DegenerateInputError(expected="values in one row", seen=f"an array of shape {found.shape}")
    if not np.isfinite(found).all():
        row = int(np.flatnonzero(~np.isfinite(found))[0])
        raise DegenerateInputError(expected="finite values", seen=f"{found[row]} at position {row}")
    return found


def deviations(values: Sequence[Decimal]) -> tuple[float, Array]:
    """Split decimal numbers, as they stand in a file, into a common reference and (N,) deviations from it.

    Deviations are exact before they are rounded to float64, so numbers with a dozen common leading digits
    keep the digits that differ. Variances, ranges and sums of squares of the deviations are those of the
    values.

    Raises
    ------
    DegenerateInputError
        For no values.
    """
    if not values:
        raise DegenerateInputError(expected="at least 1 value", seen="none")
    reference = min(values)
    return float(reference), np.array([float(value - reference) for value in values])
