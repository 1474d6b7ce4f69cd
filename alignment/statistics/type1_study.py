"""Type 1 study: one master, measured again and again by one gauge: Cg and Cgk.

Sources: the capability booklets of the car makers, and ISO 22514-7. The share of the tolerance (20 %) and the
width of the spread (6 sigma, some ask for 4) differ between plants, so both are arguments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike
from scipy import stats

from alignment.errors import DegenerateInputError
from alignment.statistics.summary import moments

LEAST_CG = 1.33
"""What plants ask of Cg and Cgk."""
LEAST_VALUES, USUAL_VALUES = 10, 50
"""Repetitions without which nothing is said, and those of a complete study."""
LARGEST_RESOLUTION_PERCENT = 5.0
"""What the resolution may be of the tolerance."""


@dataclass(frozen=True)
class Type1Result:
    """What a type 1 study says.

    Attributes
    ----------
    n, mean, deviation
        Repetitions, their mean and standard deviation.
    reference
        Certified value of the master.
    tolerance
        Width of the tolerance.
    cg, cgk
        Spread alone, and spread with bias; None when nothing varied, which means too coarse a resolution.
    bias_p
        Chance probability of such a bias of an unbiased gauge (t test); None when nothing varied.
    least_tolerance
        Narrowest tolerance for which Cgk reaches the limit; None when nothing varied.
    resolution_percent
        Resolution over tolerance; at most 5 % is asked. None where not given.
    """

    n: int
    mean: float
    deviation: float
    reference: float
    tolerance: float
    share: float
    spread: float
    cg: float | None
    cgk: float | None
    bias_p: float | None
    least_tolerance: float | None
    resolution_percent: float | None

    @property
    def bias(self) -> float:
        """Mean less reference."""
        return self.mean - self.reference


def type1(
    values: ArrayLike,
    reference: float,
    tolerance: float,
    *,
    share: float = 0.2,
    spread: float = 6.0,
    least: float = LEAST_CG,
    resolution: float | None = None,
) -> Type1Result:
    """Capability of a gauge on one master.

    Parameters
    ----------
    values
        (N,) repetitions, at least 10.
    reference
        Certified value, in the same unit.
    tolerance
        Width of the tolerance of what will be measured.
    share
        Part of the tolerance that the gauge may use: Cg = share · tolerance / (spread · s),
        Cgk = (share / 2 · tolerance − |bias|) / (spread / 2 · s).
    spread
        Width of the gauge's spread in standard deviations.
    least
        Limit of Cgk, for the narrowest tolerance.
    resolution
        Of the gauge.

    Raises
    ------
    DegenerateInputError
        For fewer than 10 values, or a width that is not greater than 0.
    """
    for name, width in (("tolerance", tolerance), ("share", share), ("spread", spread)):
        if not width > 0.0:
            raise DegenerateInputError(field=name, expected="a number greater than 0", seen=str(width))
    found = moments(values)
    if found.n < LEAST_VALUES:
        raise DegenerateInputError(
            expected=f"at least {LEAST_VALUES} repetitions",
            seen=str(found.n),
            cure=f"{USUAL_VALUES} are usual",
        )
    s, bias = found.deviation, abs(found.mean - reference)
    varied = found.varied
    return Type1Result(
        n=found.n,
        mean=found.mean,
        deviation=s,
        reference=reference,
        tolerance=tolerance,
        share=share,
        spread=spread,
        cg=share * tolerance / (spread * s) if varied else None,
        cgk=(share / 2 * tolerance - bias) / (spread / 2 * s) if varied else None,
        bias_p=float(2 * stats.t.sf(bias / (s / math.sqrt(found.n)), found.n - 1)) if varied else None,
        least_tolerance=(least * spread / 2 * s + bias) * 2 / share if varied else None,
        resolution_percent=None if resolution is None else 100.0 * resolution / tolerance,
    )
