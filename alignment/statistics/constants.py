"""Constants of control charts, computed for any subgroup size of normal values.

Sources: Tippett (1925) for the moments of the range; ISO 7870-2 and ASTM MNL 7 for names and formulas of
the chart factors; Duncan for d2*, the constant of the mean of a few ranges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import gammaln, ndtr

from alignment.errors import DegenerateInputError

# Normal values stay within nine sigma, ranges within twice that, for every purpose of float64. The inner
# integrand dies out smoothly on both sides, so equal steps converge as fast as any rule.
_REACH = 9.0
_STEPS = 361
_NODES = 160


@dataclass(frozen=True)
class ChartConstants:
    """Factors for subgroups of `n` normal values; names as in the published tables.

    Attributes
    ----------
    d2, d3
        Mean and standard deviation of the range over sigma.
    c4
        Mean of the standard deviation over sigma.
    A2, A3
        Half width of the limits of the mean over mean range, over mean standard deviation.
    D3, D4, B3, B4
        Lower and upper limit of the range over its mean; of the standard deviation over its mean.
    """

    n: int
    d2: float
    d3: float
    c4: float
    A2: float
    A3: float
    D3: float
    D4: float
    B3: float
    B4: float


@cache
def chart_constants(n: int) -> ChartConstants:
    """Factors for subgroups of `n` ≥ 2 values.

    Raises
    ------
    DegenerateInputError
        For subgroups of less than two, or more than 1000.
    """
    if not 2 <= n <= 1000:
        raise DegenerateInputError(expected="subgroups of 2 to 1000 values", seen=str(n))
    d2, d3 = _range_moments(n)
    c4 = math.sqrt(2.0 / (n - 1)) * math.exp(gammaln(n / 2.0) - gammaln((n - 1) / 2.0))
    spread = 3.0 * d3 / d2
    deviation = 3.0 * math.sqrt(1.0 - c4 * c4) / c4
    return ChartConstants(
        n=n,
        d2=d2,
        d3=d3,
        c4=c4,
        A2=3.0 / (d2 * math.sqrt(n)),
        A3=3.0 / (c4 * math.sqrt(n)),
        D3=max(0.0, 1.0 - spread),
        D4=1.0 + spread,
        B3=max(0.0, 1.0 - deviation),
        B4=1.0 + deviation,
    )


def d2_star(n: int, groups: int) -> float:
    """Constant that makes (mean of `groups` ranges of `n` values / d2*)² an unbiased variance (Duncan).

    Errors as `chart_constants`.
    """
    constants = chart_constants(n)
    return math.sqrt(constants.d2**2 + constants.d3**2 / groups)


def _range_moments(n: int) -> tuple[float, float]:
    """Mean and standard deviation of the range of `n` standard normal values."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    width, weight = _REACH * (nodes + 1.0), _REACH * weights
    x = np.linspace(-_REACH, _REACH, _STEPS)
    density = np.exp(-0.5 * x * x) * (n / math.sqrt(2.0 * math.pi) * (x[1] - x[0]))
    # P(range ≤ w) = n ∫ φ(x) (Φ(x + w) − Φ(x))^(n−1) dx; moments follow from P(range > w).
    beyond = 1.0 - (ndtr(x + width[:, None]) - ndtr(x)) ** (n - 1) @ density
    mean = float(weight @ beyond)
    return mean, math.sqrt(2.0 * float(weight @ (width * beyond)) - mean * mean)
