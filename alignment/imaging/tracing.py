"""Compiled kernel that follows known lines from row to row, where a scan of some rows has found them.

Between two scanned rows a line hardly leaves the straight connection, so that a few responses around it say
where its ridge is: the same zero of the same response as a scan of the whole row would find, for a fraction
of the work.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.imaging.ridges import COLUMNS, LEVEL, STRENGTH, WIDTH2, X, Y, zero_of_cubic
from alignment.kernels import njit

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ASIDE = 2  # pixels that the ridge may lie off the expected place, besides the pixel itself
_FEWEST = 0.5  # of the rows of a line must show a ridge, else it is none
_LANES = 16  # a whole number of vector registers


@njit(cache=True, nogil=True, error_model="numpy")
def _whole_kernels(weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """(2, K) the odd kernel whose right half the weights are, filled up to whole registers with zeros.

    The zeros stand behind it in the first row and before it in the second, for either border of an image.
    """
    half = weights.size
    length = 2 * half + 1
    kernels = np.zeros((2, (length + _LANES - 1) // _LANES * _LANES), np.float32)
    for side in range(2):
        middle = half + side * (kernels.shape[1] - length)
        for k in range(half):
            kernels[side, middle + 1 + k] = weights[k]
            kernels[side, middle - 1 - k] = -weights[k]
    return kernels


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _response(row: Any, first: int, kernel: NDArray[np.float32]) -> float:
    """Response whose kernel begins at pixel `first`."""
    source = row[first : first + kernel.size]
    total = np.float32(0.0)
    for k in range(kernel.size):
        total += kernel[k] * np.float32(source[k])
    return float(total)


@njit(cache=True, nogil=True, error_model="numpy")
def follow(
    image: Any,
    box: int,
    weights: NDArray[np.float32],
    contrast: float,
    step: int,
    table: Array,
    starts: Index,
) -> tuple[Array, Index]:
    """Ridge points of every row along the given chains, and of half a step of rows beyond their ends.

    Parameters
    ----------
    image, box, weights, contrast
        As for `scan_rows`.
    step
        Rows between the scanned rows.
    table, starts
        Ridge points in chain order and the first row of each chain.

    Returns
    -------
    table, starts
        The same chains, every row; a chain whose ridge is seldom seen between the scanned rows is left out.
    """
    height, width = image.shape
    kernels = _whole_kernels(weights)
    flank = 2 * box
    margin = max(weights.size, flank + 2) + 1 + _ASIDE
    if width < 2 * kernels.shape[1]:
        return np.empty((0, COLUMNS)), np.zeros(1, np.int64)
    room = 0
    for c in range(starts.size - 1):
        room += int(table[starts[c + 1] - 1, Y] - table[starts[c], Y]) + step + 1
    out = np.empty((room, COLUMNS))
    out_starts = np.zeros(starts.size, np.int64)
    n = chains = 0
    for c in range(starts.size - 1):
        first, last = starts[c], starts[c + 1] - 1
        top = max(0, int(table[first, Y]) - (step - 1) // 2)
        bottom = min(height - 1, int(table[last, Y]) + step // 2)
        i = first
        begin = n
        for y in range(top, bottom + 1):
            while i < last - 1 and table[i + 1, Y] <= y:
                i += 1
            lean = (table[i + 1, X] - table[i, X]) / (table[i + 1, Y] - table[i, Y])
            expected = table[i, X] + lean * (y - table[i, Y])
            x = int(np.floor(expected))
            if x < margin or x + 1 >= width - margin:
                continue
            row = image[y]
            side = 0 if 2 * x < width else 1
            kernel = kernels[side]
            half = weights.size + side * (kernel.size - 2 * weights.size - 1)
            # The response falls through zero between x and x + 1: walk there.
            b, c1 = _response(row, x - half, kernel), _response(row, x + 1 - half, kernel)
            for _ in range(_ASIDE):
                if c1 > 0.0:
                    x += 1
                    b, c1 = c1, _response(row, x + 1 - half, kernel)
                elif b <= 0.0:
                    x -= 1
                    b, c1 = _response(row, x - half, kernel), b
            if not (b > 0.0 and c1 <= 0.0):
                continue
            centre = 0.25 * (float(row[x - 1]) + float(row[x]) + float(row[x + 1]) + float(row[x + 2]))
            left = (float(row[x - flank - 1]) + float(row[x - flank]) + float(row[x - flank + 1])) / 3.0
            right = (float(row[x + flank]) + float(row[x + flank + 1]) + float(row[x + flank + 2])) / 3.0
            if centre - max(left, right) < contrast:
                continue
            a, d = _response(row, x - 1 - half, kernel), _response(row, x + 2 - half, kernel)
            point = out[n]
            point[X] = x + zero_of_cubic(a, b, c1, d)
            point[Y] = y
            point[STRENGTH] = b - c1
            point[LEVEL] = centre
            point[WIDTH2] = (centre - min(left, right)) / (b - c1)
            n += 1
        if n - begin < _FEWEST * (table[last, Y] - table[first, Y]):
            n = begin
        else:
            chains += 1
            out_starts[chains] = n
    return out[:n], out_starts[: chains + 1]
