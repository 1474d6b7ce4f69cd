"""Compiled kernels on chains of ridge points: slopes and disturbed places."""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array, Index, Mask
from alignment.imaging.ridges import X, Y
from alignment.kernels import njit

_SPAN = 5  # points on either side of the difference that gives a slope
_CELL = 2  # pixels of a shadow's cells


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
def shadow(
    table: Array, starts: Index, slope: Array, steepest: float, radius: float, size: tuple[int, int]
) -> Mask:
    """Cells that a line disturbs: near it, and beyond its ends where it may go on unseen.

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
        Indexed [row // 2, column // 2] of the scanned image.
    """
    rows, columns = (size[0] + _CELL - 1) // _CELL, (size[1] + _CELL - 1) // _CELL
    out = np.zeros((rows, columns), np.bool_)
    for c in range(starts.size - 1):
        first, last = starts[c], starts[c + 1] - 1
        for i in range(first, last + 1):
            if abs(slope[i]) > steepest:
                continue
            reach = radius if i in (first, last) else 0.0
            top = table[i, Y] - (reach if i == first else 0.0)
            bottom = table[i, Y] + reach if i == last else table[i + 1, Y]
            half = radius * math.sqrt(1.0 + slope[i] * slope[i])
            for row in range(max(0, int(top / _CELL)), min(rows - 1, int(bottom / _CELL)) + 1):
                x = table[i, X] + slope[i] * (_CELL * (row + 0.5) - table[i, Y])
                lo = max(0, int((x - half) / _CELL))
                hi = min(columns - 1, int((x + half) / _CELL))
                out[row, lo : hi + 1] = True
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def undisturbed(
    table: Array, slope: Array, steepest: float, others: Mask, size: tuple[int, int], border: float
) -> Mask:
    """Points that belong to this direction, lie off the shadow of the others, and off the image's border.

    `others` is the shadow of the lines of the other direction, in the transposed image; `size` are the rows
    and columns of this one.
    """
    height, width = size
    keep = np.zeros(table.shape[0], np.bool_)
    for i in range(table.shape[0]):
        x, y = table[i, X], table[i, Y]
        inside = border <= y < height - border and border <= x < width - border
        keep[i] = (
            inside
            and abs(slope[i]) <= steepest
            and not others[int((x + 0.5) / _CELL), int((y + 0.5) / _CELL)]
        )
    return keep
