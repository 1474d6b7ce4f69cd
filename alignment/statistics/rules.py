"""Run rules of control charts, on values in units of sigma from the centre.

Sources: Western Electric, Statistical Quality Control Handbook (1956), with a run of eight on one side;
Nelson, Journal of Quality Technology 16 (1984), eight tests with a run of nine. A pattern signals at the
point that completes it, at the start of a series too: two of two points beyond 2 sigma are two of three.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from alignment.arrays import Array, Mask
from alignment.statistics.choices import RuleSet
from alignment.statistics.summary import as_values


@dataclass(frozen=True)
class Signal:
    """A point that completes a pattern.

    Attributes
    ----------
    index
        Of the last point of the pattern.
    rule
        Number of the rule in its set.
    text
        What happened.
    """

    index: int
    rule: int
    text: str


def signals(z: ArrayLike, rules: RuleSet) -> tuple[Signal, ...]:
    """Signals of a set in (N,) standardised values, in the order of the points, then of the rules."""
    values = as_values(z)
    found = [
        Signal(int(index), number, text)
        for number, (text, test) in enumerate(_SETS[rules], start=1)
        for index in np.flatnonzero(test(values))
    ]
    return tuple(sorted(found, key=lambda signal: (signal.index, signal.rule)))


def rule_source(rules: RuleSet) -> str:
    """Who set these rules up."""
    return _SOURCES[rules]


def rule_texts(rules: RuleSet) -> tuple[str, ...]:
    """What each rule of a set looks for; the first is rule 1."""
    return tuple(text for text, _ in _SETS[rules])


def _of_last(flags: Mask, least: int, window: int) -> Mask:
    """Points at which at least `least` of the last `window` flags are set, or of those that there are."""
    counts = np.cumsum(np.concatenate([np.zeros(window), flags]))
    enough: Mask = counts[window:] - counts[:-window] >= least
    return enough


def _same_side(beyond: float, least: int, window: int) -> Callable[[Array], Mask]:
    # The last point is one of those: otherwise one pattern would signal again at the next point.
    def test(z: Array) -> Mask:
        above, below = z > beyond, z < -beyond
        high = _of_last(above, least, window) & above
        low = _of_last(below, least, window) & below
        return high | low

    return test


def _outside(z: Array) -> Mask:
    return np.abs(z) > 3.0


def _trend(z: Array) -> Mask:
    steps = np.diff(z, prepend=np.nan)
    return _of_last(steps > 0, 5, 5) | _of_last(steps < 0, 5, 5)


def _alternating(z: Array) -> Mask:
    steps = np.diff(z, prepend=np.nan)
    turns = np.concatenate([[False], steps[1:] * steps[:-1] < 0])
    return _of_last(turns, 12, 12)


def _quiet(z: Array) -> Mask:
    return _of_last(np.abs(z) < 1.0, 15, 15)


def _mixture(z: Array) -> Mask:
    # On one side alone four of five beyond 1 sigma tell it already, as a shift, which it then is.
    return _of_last(np.abs(z) > 1.0, 8, 8) & _of_last(z > 1.0, 1, 8) & _of_last(z < -1.0, 1, 8)


_Rule = tuple[str, Callable[[Array], Mask]]
_FIRST: _Rule = ("one point beyond 3 sigma", _outside)
_TWO_OF_THREE: _Rule = ("two of three points beyond 2 sigma on one side", _same_side(2.0, 2, 3))
_FOUR_OF_FIVE: _Rule = ("four of five points beyond 1 sigma on one side", _same_side(1.0, 4, 5))
_SOURCES = {
    RuleSet.THREE_SIGMA: "Shewhart 1931",
    RuleSet.WESTERN_ELECTRIC: "Western Electric, Statistical Quality Control Handbook, 1956",
    RuleSet.NELSON: "Nelson, Journal of Quality Technology 16, 1984",
}
_SETS: dict[RuleSet, tuple[_Rule, ...]] = {
    RuleSet.THREE_SIGMA: (_FIRST,),
    RuleSet.WESTERN_ELECTRIC: (
        _FIRST,
        _TWO_OF_THREE,
        _FOUR_OF_FIVE,
        ("eight points on one side of the centre", _same_side(0.0, 8, 8)),
    ),
    RuleSet.NELSON: (
        _FIRST,
        ("nine points on one side of the centre", _same_side(0.0, 9, 9)),
        ("six points rising or falling", _trend),
        ("fourteen points alternating up and down", _alternating),
        _TWO_OF_THREE,
        _FOUR_OF_FIVE,
        ("fifteen points within 1 sigma", _quiet),
        ("eight points beyond 1 sigma on both sides", _mixture),
    ),
}
