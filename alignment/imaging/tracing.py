"""Compiled kernel that follows known lines from row to row, where a scan of some rows has found them.

Between two scanned rows a line hardly leaves the straight connection, so that a few responses around it say
where its ridge is: the same zero of the same response as a scan of the whole row would find, for a fraction
of the work.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from alignment.arrays import Array, Index, Singles
from alignment.imaging.ridges import LEVEL, STRENGTH, WIDTH2, X, Y, row_of, zero_of_cubic
from alignment.kernels import njit

_ASIDE = 2  # pixels that the ridge may lie off the expected place, besides the pixel itself
_FEWEST = 0.5  # of the rows of a line must show a ridge, else it is none
LANES = 16  # a whole number of vector registers
_BLOCK = 64  # rows


@njit(cache=True, nogil=True, error_model="numpy")
def whole_kernel(weights: Singles) -> Singles:
    """(K,) the odd kernel whose right half the weights are, filled up to whole registers with zeros."""
    half = weights.size
    length = 2 * half + 1
    kernel = np.zeros((length + LANES - 1) // LANES * LANES, np.float32)
    for k in range(half):
        kernel[half + 1 + k] = weights[k]
        kernel[half - 1 - k] = -weights[k]
    return kernel


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def response_at(grey: Singles, first: int, kernel: Singles) -> float:
    """Response whose kernel begins at entry `first`."""
    source = grey[first : first + kernel.size]
    total = np.float32(0.0)
    for k in range(kernel.size):
        total += kernel[k] * source[k]
    return float(total)


@njit(cache=True, nogil=True, error_model="numpy")
def _expect(table: Array, first: int, last: int, top: int, margin: int, width: int, places: Index) -> int:
    """Pixel in each row from `top` on where a chain's ridge is expected, −1 too near to the border.

    `first` is a point of the chain at or above `top`, or its first one, `last` its last; returns the point to
    go on from.
    """
    i = first
    k = 0
    while k < places.size:
        while i < last - 1 and table[i + 1, Y] <= top + k:
            i += 1
        lean = (table[i + 1, X] - table[i, X]) / (table[i + 1, Y] - table[i, Y])
        begin = table[i, X] - lean * (table[i, Y] - top)
        end = min(int(table[i + 1, Y]) - top, places.size) if i < last - 1 else places.size
        for row in range(k, end):
            x = np.int64(np.floor(begin + lean * row))
            places[row] = x if (x >= margin) & (x + margin < width) else -1
        k = end
    return i


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _load(image: Any, view: Index, top: int, corners: Index, count: int, windows: Singles) -> None:
    """Pixels of successive rows, from a corner on in each, into the first columns of `windows`."""
    for k in range(corners.size):
        source = row_of(image, view, top + k)[corners[k] : corners[k] + count]
        out = windows[k][:count]
        for x in range(count):
            out[x] = np.float32(source[x])


@njit(cache=True, nogil=True, error_model="numpy")
def follow(
    image: Any,
    view: Index,
    box: int,
    weights: Singles,
    contrast: float,
    step: int,
    table: Array,
    starts: Index,
) -> tuple[Array, Index]:
    """Ridge points of every row along the given chains, and of half a step of rows beyond their ends.

    Parameters
    ----------
    image, view, box, weights, contrast
        As for `scan_rows`.
    step
        Rows between the scanned rows.
    table, starts
        Ridge points in chain order and the first row of each chain.

    Returns
    -------
    table, starts
        The same chains, every row; a chain whose ridge is seldom seen between the scanned rows is left out.
        Columns as of `scan_rows`, but for the width, which the scanned rows have told.
    """
    width, height = view[2] - view[0], view[3] - view[1]
    kernel = whole_kernel(weights)
    half, flank = weights.size, 2 * box
    reach = max(half, flank + 1)  # on either side of a response
    margin = reach + 2 + _ASIDE
    # Whole registers; what lies behind the last pixel meets only the zeros of the kernel.
    count = (2 * margin + LANES) // LANES * LANES
    windows = np.zeros((_BLOCK, count + kernel.size), np.float32)
    every_place, every_corner = np.empty(_BLOCK, np.int64), np.empty(_BLOCK, np.int64)
    room = 0
    for c in range(starts.size - 1):
        room += int(table[starts[c + 1] - 1, Y] - table[starts[c], Y]) + step + 1
    out, responses = np.empty((room, WIDTH2)), np.empty((4, room))
    out_starts = np.zeros(starts.size, np.int64)
    n = chains = 0
    for c in range(starts.size - 1) if width >= count else range(0):
        first, last = starts[c], starts[c + 1] - 1
        top = max(0, int(table[first, Y]) - (step - 1) // 2)
        bottom = min(height - 1, int(table[last, Y]) + step // 2)
        i = first
        begin = n
        # By blocks, whose pixels are fetched before any is looked at: the processor waits for them once.
        for y in range(top, bottom + 1, _BLOCK):
            rows = min(_BLOCK, bottom + 1 - y)
            places, corners = every_place[:rows], every_corner[:rows]
            i = _expect(table, i, last, y, margin, width, places)
            for k in range(rows):
                corners[k] = max(min(places[k] - margin, width - count), 0)
            _load(image, view, y, corners, count, windows)
            for k in range(rows):
                if places[k] < 0:
                    continue
                grey = windows[k]
                # The response falls through zero between m and m + 1: walk there.
                m = places[k] - corners[k]
                b, c1 = response_at(grey, m - half, kernel), response_at(grey, m + 1 - half, kernel)
                for _ in range(_ASIDE):
                    if c1 > 0.0:
                        m += 1
                        b, c1 = c1, response_at(grey, m + 1 - half, kernel)
                    elif b <= 0.0:
                        m -= 1
                        b, c1 = response_at(grey, m - half, kernel), b
                if not (b > 0.0 and c1 <= 0.0):
                    continue
                centre = 0.25 * float(grey[m - 1] + grey[m] + grey[m + 1] + grey[m + 2])
                left = float(grey[m - flank - 1] + grey[m - flank] + grey[m - flank + 1])
                right = float(grey[m + flank] + grey[m + flank + 1] + grey[m + flank + 2])
                if 3.0 * (centre - contrast) < max(left, right):
                    continue
                responses[0, n], responses[1, n] = response_at(grey, m - 1 - half, kernel), b
                responses[2, n], responses[3, n] = c1, response_at(grey, m + 2 - half, kernel)
                point = out[n]
                point[X] = corners[k] + m
                point[Y] = y + k
                point[STRENGTH] = b - c1
                point[LEVEL] = centre
                n += 1
        if n - begin < _FEWEST * (table[last, Y] - table[first, Y]):
            n = begin
        else:
            chains += 1
            out_starts[chains] = n
    # All at once: a loop that compilers turn into vector instructions.
    zero = np.empty(n)
    for i in range(n):
        zero[i] = zero_of_cubic(responses[0, i], responses[1, i], responses[2, i], responses[3, i])
    for i in range(n):
        out[i, X] += zero[i]
    return out[:n], out_starts[: chains + 1]
