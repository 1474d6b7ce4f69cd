"""Control charts: mean with range, mean with standard deviation, single values with moving range.

Sources: ISO 7870-2; AIAG, Statistical Process Control, 2nd edition; constants in `constants`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.statistics.choices import ChartKind, RuleSet
from alignment.statistics.constants import chart_constants
from alignment.statistics.rules import Signal, signals
from alignment.statistics.summary import as_values


@dataclass(frozen=True, eq=False)
class Track:
    """One line of points with its limits.

    Attributes
    ----------
    name
        ``mean``, ``range``, ``standard deviation``, ``value`` or ``moving range``.
    points, lower, upper
        (N,) float64.
    centre
        The line in the middle.
    signals
        In the order of the points.
    """

    name: str
    points: Array
    centre: float
    lower: float
    upper: float
    signals: tuple[Signal, ...]


@dataclass(frozen=True, eq=False)
class ControlChart:
    """A chart of place and one of spread.

    Attributes
    ----------
    kind, rules
        What was asked for.
    size
        Values per subgroup; 1 for single values.
    sigma
        Standard deviation within subgroups, from which all limits follow.
    location, spread
        The spread of single values, the moving range, has one point less than the values.
    """

    kind: ChartKind
    rules: RuleSet
    size: int
    sigma: float
    location: Track
    spread: Track

    @property
    def in_control(self) -> bool | None:
        """Whether neither track has a signal; None without a spread, whose limits have no width."""
        if not self.sigma > 0.0:
            return None
        return not self.location.signals and not self.spread.signals


@dataclass(frozen=True)
class Baseline:
    """Centre and sigma of a process that was judged before; limits are then not computed from the points."""

    centre: float
    sigma: float


def subgroups(values: ArrayLike, size: int) -> Array:
    """(K, size) array of consecutive (N,) values; a last incomplete subgroup is left out.

    Raises
    ------
    DegenerateInputError
        When there is not one complete subgroup.
    """
    found = as_values(values)
    count = len(found) // size if size > 0 else 0
    if not count:
        raise DegenerateInputError(expected=f"at least {max(size, 1)} values", seen=str(len(found)))
    return found[: count * size].reshape(count, size)


def control_chart(
    kind: ChartKind,
    values: ArrayLike,
    rules: RuleSet = RuleSet.THREE_SIGMA,
    *,
    size: int = 5,
    baseline: Baseline | None = None,
) -> ControlChart:
    """Chart of (N,) values in the order in which they came.

    Parameters
    ----------
    kind
        Single values ignore `size`.
    rules
        For the track of place. The spread is judged by its limits alone: its points are not symmetric
        and, for moving ranges, not independent, so runs mean nothing there.
    size
        Values per subgroup, at least 2.
    baseline
        Known centre and sigma; without, both come from the values.

    Raises
    ------
    DegenerateInputError
        For fewer than two subgroups, or two single values.
    """
    if kind is ChartKind.INDIVIDUALS:
        return _individuals(as_values(values), rules, baseline)
    if size < 2:
        raise DegenerateInputError(expected="subgroups of at least 2 values", seen=str(size))
    groups = subgroups(values, size)
    if len(groups) < 2:
        raise DegenerateInputError(expected=f"at least 2 subgroups of {size} values", seen=str(len(groups)))
    constants = chart_constants(size)
    if kind is ChartKind.XBAR_R:
        spreads, unit, name = np.ptp(groups, axis=1), constants.d2, "range"
        lower, upper = constants.D3, constants.D4
    else:
        # From the first value of each, so that equal ones have no deviation, whatever is rounded.
        spreads = (groups - groups[:, :1]).std(axis=1, ddof=1)
        unit, name = constants.c4, "standard deviation"
        lower, upper = constants.B3, constants.B4
    sigma = float(spreads.mean()) / unit if baseline is None else baseline.sigma
    means = groups.mean(axis=1)
    centre = float(means.mean()) if baseline is None else baseline.centre
    middle = sigma * unit
    return ControlChart(
        kind,
        rules,
        size,
        sigma,
        _track("mean", means, centre, sigma / math.sqrt(size), rules),
        _spread(name, spreads, middle, lower * middle, upper * middle),
    )


def _individuals(values: Array, rules: RuleSet, baseline: Baseline | None) -> ControlChart:
    if len(values) < 2:
        raise DegenerateInputError(expected="at least 2 values", seen=str(len(values)))
    constants = chart_constants(2)
    ranges = np.abs(np.diff(values))
    sigma = float(ranges.mean()) / constants.d2 if baseline is None else baseline.sigma
    centre = float(values.mean()) if baseline is None else baseline.centre
    middle = sigma * constants.d2
    return ControlChart(
        ChartKind.INDIVIDUALS,
        rules,
        1,
        sigma,
        _track("value", values, centre, sigma, rules),
        _spread("moving range", ranges, middle, constants.D3 * middle, constants.D4 * middle),
    )


def _track(name: str, points: Array, centre: float, sigma: float, rules: RuleSet) -> Track:
    # Without a spread nothing can be judged, neither points on the centre nor those beside it.
    found = signals((points - centre) / sigma, rules) if sigma > 0.0 else ()
    return Track(name, points, centre, centre - 3.0 * sigma, centre + 3.0 * sigma, found)


def _spread(name: str, points: Array, centre: float, lower: float, upper: float) -> Track:
    outside = np.flatnonzero(((points > upper) | (points < lower)) & (centre > 0.0))
    found: Sequence[Signal] = [Signal(int(index), 1, "one point beyond its limits") for index in outside]
    return Track(name, points, centre, lower, upper, tuple(found))
