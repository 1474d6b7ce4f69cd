"""Analysis of variance: one factor, balanced or not; two crossed factors, balanced.

Sums are correctly rounded and taken about the means, so that common leading digits of the values cost
nothing: certified results of NIST's StRD data sets to at least nine digits (their hardest sets read with
`moments.deviations`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.statistics.summary import as_values, mean_of, merged, moments


@dataclass(frozen=True)
class Source:
    """One line of the table.

    Attributes
    ----------
    name
        Of the factor.
    df, squares
        Degrees of freedom and sum of squares.
    f, p
        F statistic and the probability of a larger one by chance; None for residual and total, and where
        nothing is compared with nothing. Something over nothing is an infinite F: no F, probability 0.
    """

    name: str
    df: int
    squares: float
    f: float | None = None
    p: float | None = None

    @property
    def mean_square(self) -> float:
        """Sum of squares over degrees of freedom; 0 without any."""
        return self.squares / self.df if self.df else 0.0


@dataclass(frozen=True)
class OneWay:
    """Analysis of one factor; `n0` is the effective number of values per group (their common number)."""

    between: Source
    within: Source
    n0: float

    @property
    def r_squared(self) -> float | None:
        """Share of the sum of squares that the factor explains; None where there is nothing to explain."""
        total = self.between.squares + self.within.squares
        return self.between.squares / total if total > 0.0 else None

    @property
    def residual_deviation(self) -> float:
        """Standard deviation within groups."""
        return math.sqrt(self.within.mean_square)


@dataclass(frozen=True)
class TwoWay:
    """Analysis of two crossed factors with repetitions."""

    first: Source
    second: Source
    interaction: Source
    residual: Source

    @property
    def total(self) -> Source:
        """Sum of all lines."""
        parts = (self.first, self.second, self.interaction, self.residual)
        return Source("total", sum(part.df for part in parts), math.fsum(part.squares for part in parts))


def one_way(groups: Sequence[ArrayLike], name: str = "between", residual: str = "within") -> OneWay:
    """Analyse groups of (n_i,) values.

    Raises
    ------
    DegenerateInputError
        For fewer than two groups, an empty one, or not a single repetition.
    """
    if len(groups) < 2:
        raise DegenerateInputError(expected="at least 2 groups", seen=str(len(groups)))
    parts = [moments(group) for group in groups]
    n = sum(part.n for part in parts)
    if n == len(parts):
        raise DegenerateInputError(expected="a group with a repeated value", seen="one value in each")
    within = math.fsum(part.squares for part in parts)
    # From the means alone, and not as total less within, which loses digits where the factor explains little.
    between = merged([replace(part, squares=0.0) for part in parts]).squares
    df = len(parts) - 1
    n0 = (n - sum(part.n**2 for part in parts) / n) / df
    rest = Source(residual, n - len(parts), within)
    return OneWay(_tested(name, df, between, rest), rest, n0)


def two_way(cube: ArrayLike, first: str = "first", second: str = "second") -> TwoWay:
    """Analyse (A, B, R) values: A levels of one factor, B of the other, R repetitions of each pair.

    The factors are tested against the interaction (random effects), the interaction against the residual.

    Raises
    ------
    DegenerateInputError
        Unless A, B and R are at least 2 and all values finite.
    """
    values = np.asarray(cube, dtype=np.float64)
    if values.ndim != 3 or min(values.shape) < 2:
        raise DegenerateInputError(
            expected="at least 2 levels of both factors and 2 repetitions", seen=f"shape {values.shape}"
        )
    as_values(values.ravel())
    levels, others, repeats = values.shape
    # About the mean of everything, so that the effects below are differences of small numbers.
    values = values - moments(values.ravel()).mean
    cells = _means(values, 2)
    rows, columns = _means(cells, 1), _means(cells, 0)
    grand = math.fsum(rows) / levels
    residual = Source(
        "repeatability", levels * others * (repeats - 1), _sum_of_squares(values - cells[..., None])
    )
    left = cells - rows[:, None] - columns + grand
    interaction = _tested(
        f"{first} x {second}", (levels - 1) * (others - 1), repeats * _sum_of_squares(left), residual
    )
    return TwoWay(
        _tested(first, levels - 1, others * repeats * _sum_of_squares(rows - grand), interaction),
        _tested(second, others - 1, levels * repeats * _sum_of_squares(columns - grand), interaction),
        interaction,
        residual,
    )


def tested_against(source: Source, denominator: Source) -> Source:
    """The same line of the table, tested against another denominator."""
    return _tested(source.name, source.df, source.squares, denominator)


def _tested(name: str, df: int, squares: float, denominator: Source) -> Source:
    line = Source(name, df, squares)
    if denominator.mean_square <= 0.0:
        return replace(line, p=0.0) if line.mean_square > 0.0 else line
    f = line.mean_square / denominator.mean_square
    return Source(name, df, squares, f, float(stats.f.sf(f, df, denominator.df)))


def _means(values: Array, axis: int) -> Array:
    return np.apply_along_axis(mean_of, axis, values)


def _sum_of_squares(values: Array) -> float:
    return math.fsum(np.square(values).ravel())
