"""Compiled kernels on chains of ridge points: slopes, shifts by changing light, disturbed places."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from alignment.imaging.ridges import STRENGTH, X, Y
from alignment.kernels import njit

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_SPAN = 5  # points on either side of the difference that gives a slope
_SMOOTH = 3  # points on either side of the mean that gives the light


@njit(cache=True, nogil=True, error_model="numpy")
def chain_slopes(table: Array, starts: Index) -> Array:
    """Slope dx/dy of every point, by a wide difference along its chain, one-sided at the ends."""
    slope = np.zeros(table.shape[0])
    for c in range(starts.size - 1):
        first, last = starts[c], starts[c + 1] - 1
        for i in range(first, last + 1):
            lo, hi = max(i - _SPAN, first), min(i + _SPAN, last)
            dy = table[hi, Y] - table[lo, Y]
            if dy > 0.0:
                slope[i] = (table[hi, X] - table[lo, X]) / dy
    return slope


@njit(cache=True, nogil=True, error_model="numpy")
def take_off_light_shift(table: Array, starts: Index, slope: Array, width: float) -> None:
    """Move each point, in place, from the top along its row to the top across its line.

    Where light A changes along a line of slope s = dx/dy and cross deviation σ, the top of the profile along
    the row lies σ² · d ln A/dy · s beside the centre. The strength's own noise would enter, so it is averaged
    along the line first; the shift is bounded by half the width.
    """
    light = np.zeros(table.shape[0])
    for c in range(starts.size - 1):
        first, last = starts[c], starts[c + 1] - 1
        for i in range(first, last + 1):
            total = 0.0
            lo, hi = max(i - _SMOOTH, first), min(i + _SMOOTH, last)
            for k in range(lo, hi + 1):
                total += table[k, STRENGTH]
            light[i] = total / (hi - lo + 1)
        for i in range(first, last + 1):
            lo, hi = max(i - _SPAN, first), min(i + _SPAN, last)
            dy = table[hi, Y] - table[lo, Y]
            both = light[hi] + light[lo]
            if dy > 0.0 and both > 0.0:
                # ln(a/b) is 2 (a − b)/(a + b) to the third order.
                shift = width * width * 2.0 * (light[hi] - light[lo]) / (both * dy) * slope[i]
                table[i, X] -= min(max(shift, -0.5 * width), 0.5 * width)


@njit(cache=True, nogil=True, error_model="numpy")
def shadow(
    table: Array, starts: Index, slope: Array, steepest: float, radius: float, size: tuple[int, int]
) -> Mask:
    """Pixels that a line disturbs: within `radius` of it, and beyond its ends where it may go on unseen.

    Parameters
    ----------
    table, starts, slope
        Chains of one scan direction.
    steepest
        Points of a larger slope belong to the other direction and cast none.
    radius
        Pixels, across the line.
    size
        Rows and columns of the scanned image.

    Returns
    -------
    shadow
        Indexed [row, column] of the scanned image.
    """
    out = np.zeros((size[0], size[1]), np.bool_)
    for c in range(starts.size - 1):
        first, last = starts[c], starts[c + 1] - 1
        for i in range(first, last + 1):
            if abs(slope[i]) > steepest:
                continue
            rows = 1 if i == last else int(table[i + 1, Y] - table[i, Y])
            reach = math.ceil(radius) if i in (first, last) else 0
            before = reach if i == first else 0
            after = reach if i == last else rows - 1
            half = radius * math.sqrt(1.0 + slope[i] * slope[i])
            for step in range(-before, after + 1):
                y = int(table[i, Y]) + step
                if y < 0 or y >= size[0]:
                    continue
                x = table[i, X] + slope[i] * step
                lo = max(0, math.floor(x - half))
                hi = min(size[1] - 1, math.ceil(x + half))
                for k in range(lo, hi + 1):
                    out[y, k] = True
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def undisturbed(table: Array, slope: Array, steepest: float, others: Mask, border: float) -> Mask:
    """Points that belong to this direction, lie off the shadow of the others, and off the image's border.

    `others` is the shadow of the lines found in the transposed image, indexed [x, y] of this table.
    """
    width, height = others.shape
    keep = np.zeros(table.shape[0], np.bool_)
    for i in range(table.shape[0]):
        x, y = round(table[i, X]), int(table[i, Y])
        inside = border <= y < height - border and border <= x < width - border
        keep[i] = inside and abs(slope[i]) <= steepest and not others[x, y]
    return keep
