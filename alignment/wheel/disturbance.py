"""Stretches of a light line that lie off the sidewall although each of their points might be noise.

On the flank of a letter, at the edge of a wet spot, behind a valve, the line leaves the surface of revolution
little by little: the first points pass any test of their own and pull the wheel to one side. Neighbours on a
line share such a shift but not the noise, so a mean along the line shows it several times clearer.
"""

from __future__ import annotations

import numpy as np

from alignment import robust
from alignment.arrays import Array, Index, Mask
from alignment.kernels import njit

_GROSS = 5.0  # robust deviations: not of the surface at all
_BESIDE_GROSS = 2  # points next to a gross one that its edge may have drawn along
_CLIP = 8.0  # robust deviations; more counts no more in a mean
_HALF_WINDOW = 8  # points on either side in a mean along the line
_SHARED = 4.5  # robust deviations of such means: more is a shift
_BESIDE_SHARED = 4
_SAMPLE = 2000  # means that show their scatter


@njit(cache=True, nogil=True, error_model="numpy")
def _clear_around(bad: Mask, line: Index, reach: int, keep: Mask) -> None:
    """Take off `keep`, in place, the bad points and `reach` points on either side of each, in its line."""
    for i in range(bad.size):
        if bad[i]:
            for k in range(max(0, i - reach), min(bad.size, i + reach + 1)):
                if line[k] == line[i]:
                    keep[k] = False


@njit(cache=True, nogil=True, error_model="numpy")
def undisturbed(ratio: Array, inside: Mask, line: Index, scale: float) -> Mask:
    """Points (N,) that lie on the surface and share no shift with their neighbours.

    Parameters
    ----------
    ratio
        (N,) residual over its standard deviation, points in their order along the lines.
    inside
        (N,) whether a point lies within the profile at all; else it counts as gross.
    line
        (N,) number of each point's line.
    scale
        Robust standard deviation of `ratio`.
    """
    n = ratio.size
    keep, bad = np.ones(n, np.bool_), np.zeros(n, np.bool_)
    total, count = np.zeros(n + 1), np.zeros(n + 1, np.int64)
    gross, clip = _GROSS * scale, _CLIP * scale
    value = np.empty(n)
    for i in range(n):
        bad[i] = (not inside[i]) | (abs(ratio[i]) > gross)
        value[i] = min(max(ratio[i], -clip), clip) if inside[i] else 0.0
    for i in range(n):
        total[i + 1] = total[i] + value[i]
        count[i + 1] = count[i] + inside[i]
    _clear_around(bad, line, _BESIDE_GROSS, keep)
    mean, sample = np.zeros(n), np.empty(n)
    per_root = np.ones(2 * _HALF_WINDOW + 2)
    for k in range(1, per_root.size):
        per_root[k] = 1.0 / np.sqrt(k)
    found = first = 0
    while first < n:
        last = first + 1
        while last < n and line[last] == line[first]:
            last += 1
        for i in range(first, last):
            lo, hi = max(first, i - _HALF_WINDOW), min(last, i + _HALF_WINDOW + 1)
            mean[i] = abs(total[hi] - total[lo]) * per_root[count[hi] - count[lo]]
            if not bad[i]:
                sample[found] = mean[i]
                found += 1
        first = last
    if found == 0:
        return keep
    limit = _SHARED * robust.DEVIATION_OF_MEDIAN * np.median(sample[: found : max(1, found // _SAMPLE)])
    for i in range(n):
        bad[i] = mean[i] > limit
    _clear_around(bad, line, _BESIDE_SHARED, keep)
    return keep
