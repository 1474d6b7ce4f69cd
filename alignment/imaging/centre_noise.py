"""Noise of the centres of light lines, which the lines themselves show."""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array, Index
from alignment.imaging.ridges import LEVEL, STRENGTH, X, Y
from alignment.kernels import njit

SECOND_DIFFERENCE = math.sqrt(6.0)  # standard deviation of a − 2b + c for unit noise
_MEAN_OF_MODULUS = math.sqrt(2.0 / math.pi)
_UNKNOWN_SIGMA = 0.1  # pixels, where there are too few points to tell
_LEAST_SIGMA = 0.005
_CLASSES = 8
_SHOWN = 3000  # second differences, or up to twice as many, that show the noise of an image


@njit(cache=True, nogil=True, error_model="numpy")
def centre_deviation(table: Array, starts: Index) -> Array:
    """Standard deviation of each centre along its row, pixels.

    Second differences along the lines show the noise itself. The variance of a centre is
    (a + b·level)/strength², with read noise in a and shot noise in b: both come from the means of a few
    classes of brightness, with outliers cut off.
    """
    n = table.shape[0]
    out = np.full(n, _UNKNOWN_SIGMA)
    residual, shown = np.empty(n), np.empty(n)
    count, thin = 0, max(1, n // _SHOWN)
    for c in range(starts.size - 1):
        for i in range(starts[c] + 1, starts[c + 1] - 1, thin):
            if table[i + 1, Y] - table[i - 1, Y] == 2.0:
                second = table[i + 1, X] - 2.0 * table[i, X] + table[i - 1, X]
                residual[count] = abs(second) / SECOND_DIFFERENCE * table[i, STRENGTH]
                shown[count] = table[i, LEVEL]
                count += 1
    if count < 64:
        return out
    residual, shown = residual[:count], shown[:count]
    lo = shown.min()
    per_level = _CLASSES / max(shown.max() - lo, 1e-9)
    # Two passes: the mean modulus of each class, then again without what exceeds four times it.
    limit = np.full(_CLASSES, np.inf)
    number = np.zeros(_CLASSES)
    modulus = np.zeros(_CLASSES)
    level = np.zeros(_CLASSES)
    for _ in range(2):
        number[:] = 0.0
        modulus[:] = 0.0
        level[:] = 0.0
        for i in range(count):
            k = min(_CLASSES - 1, int(per_level * (shown[i] - lo)))
            if residual[i] < limit[k]:
                number[k] += 1.0
                modulus[k] += residual[i]
                level[k] += shown[i]
        for k in range(_CLASSES):
            limit[k] = 4.0 * modulus[k] / max(number[k], 1.0) + 1e-12
    # Weighted line through the classes' variances; neither noise source is negative.
    total = sx = sy = 0.0
    for k in range(_CLASSES):
        if number[k] > 0.0:
            level[k] /= number[k]
            modulus[k] = (modulus[k] / number[k] / _MEAN_OF_MODULUS) ** 2
            total += number[k]
            sx += number[k] * level[k]
            sy += number[k] * modulus[k]
    mean_level, mean_variance = sx / total, sy / total
    sxx = sxy = 0.0
    for k in range(_CLASSES):
        sxx += number[k] * (level[k] - mean_level) ** 2
        sxy += number[k] * (level[k] - mean_level) * modulus[k]
    b = sxy / sxx if sxx > 1e-9 else 0.0
    b = min(max(b, 0.0), mean_variance / max(mean_level, 1e-9))
    a = mean_variance - b * mean_level
    for i in range(n):
        variance = max(a + b * table[i, LEVEL], 0.0)
        out[i] = max(math.sqrt(variance) / max(table[i, STRENGTH], 1e-9), _LEAST_SIGMA)
    return out
