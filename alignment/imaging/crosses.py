"""Crosses of light lines: the meeting of two fitted lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index
from alignment.kernels import njit


@dataclass(frozen=True, eq=False)
class Crosses:
    """Crosses of one image.

    Attributes
    ----------
    points
        (M, 2) pixels.
    lines
        (M, 2) number of the steep and of the flat line that meet there.
    directions
        (M, 2) slope dx/dy of the steep line and slope dy/dx of the flat one.
    """

    points: Array
    lines: Index
    directions: Array


@njit(cache=True, nogil=True, error_model="numpy")
def _reaches(table: Array, first: int, last: int, at: float) -> int:
    """First row of a chain, which runs along column 1, that is not before `at`."""
    lo, hi = first, last
    while lo < hi:
        middle = (lo + hi) // 2
        if table[middle, 1] < at:
            lo = middle + 1
        else:
            hi = middle
    return lo


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_side(
    table: Array, first: int, last: int, at: float, inner: float, outer: float
) -> tuple[float, float, int]:
    """Straight line x = a + b (y − at) through chain points with inner ≤ |y − at| ≤ outer: a, b, points."""
    n = 0
    sy = sx = syy = sxy = 0.0
    for i in range(_reaches(table, first, last, at - outer), last):
        dy = table[i, 1] - at
        if dy > outer:
            break
        if abs(dy) < inner:
            continue
        n += 1
        sy += dy
        sx += table[i, 0]
        syy += dy * dy
        sxy += dy * table[i, 0]
    det = n * syy - sy * sy
    if n < 4 or not det > 0.0:
        return 0.0, 0.0, 0
    b = (n * sxy - sy * sx) / det
    return (sx - b * sy) / n, b, n


@njit(cache=True, nogil=True, error_model="numpy")
def _extents(table: Array, starts: Index) -> Array:
    """(chains, 2) least and largest x of the points of each chain."""
    out = np.empty((starts.size - 1, 2))
    for c in range(starts.size - 1):
        out[c, 0], out[c, 1] = np.inf, -np.inf
        for i in range(starts[c], starts[c + 1]):
            out[c, 0], out[c, 1] = min(out[c, 0], table[i, 0]), max(out[c, 1], table[i, 0])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _halve(table: Array) -> int:
    """Keep every second row of a full table, the first among them; returns how many there are then."""
    kept = 0
    for i in range(0, table.shape[0], 2):
        for k in range(table.shape[1]):
            table[kept, k] = table[i, k]
        kept += 1
    return kept


@njit(cache=True, nogil=True, error_model="numpy")
def find_crosses(
    steep: Array,
    steep_starts: Index,
    flat: Array,
    flat_starts: Index,
    inner: float,
    steep_reach: float,
    flat_reach: float,
    out: Array,
) -> int:
    """Crosses of steep chains with flat ones; returns how many were written to `out`.

    Each cross is the meeting of two straight lines fitted to the points on both sides of it; the nearest
    ones, where either line disturbs the other, take no part. Of more crosses than there is room for every
    second, fourth, … is kept, all over the image.

    Parameters
    ----------
    steep, steep_starts
        Ridge table of the steep chains (x, y, …) in chain order, and the first row of each.
    flat, flat_starts
        The same of the flat chains, found in the transposed image: (y, x, …).
    inner
        Distance along a line within which the other one disturbs it, pixels.
    steep_reach, flat_reach
        How far from the cross the points of the lines of each direction count, pixels.
    out
        (capacity, 6): x, y, steep chain, flat chain, slope dx/dy of the steep one, dy/dx of the flat one.
    """
    found = met = 0
    every = 1
    ends, steep_ends = _extents(flat, flat_starts), _extents(steep, steep_starts)
    for a in range(steep_starts.size - 1):
        a0, a1 = steep_starts[a], steep_starts[a + 1]
        if a1 - a0 < 2:
            continue
        xmin, xmax = steep_ends[a, 0], steep_ends[a, 1]
        for b in range(flat_starts.size - 1):
            b0, b1 = flat_starts[b], flat_starts[b + 1]
            # In the flat table the roles are swapped: column 1 is the image's x, column 0 its y.
            if b1 - b0 < 2 or flat[b1 - 1, 1] < xmin - flat_reach or flat[b0, 1] > xmax + flat_reach:
                continue
            before = 0.0
            # Where the steep chain passes the flat one, of which it needs one point more on either side.
            begin = max(_reaches(steep, a0, a1, ends[b, 0]) - 2, a0)
            j = _reaches(flat, b0, b1, steep[min(begin, a1 - 1), 0])
            j = min(max(j - 1, b0), b1 - 2)
            for i in range(begin, a1):
                x = steep[i, 0]
                if before < 0.0 and steep[i - 1, 1] > ends[b, 1]:
                    break
                while j < b1 - 2 and flat[j + 1, 1] < x:
                    j += 1
                while j > b0 and flat[j, 1] > x:
                    j -= 1
                if abs(flat[j, 1] - x) > flat_reach:
                    before = 0.0
                    continue
                here = steep[i, 1] - flat[j, 0]
                if before < 0.0 <= here:
                    if found == out.shape[0]:
                        found, every = _halve(out), 2 * every
                    if _meet(
                        steep,
                        a0,
                        a1,
                        flat,
                        b0,
                        b1,
                        steep[i, 0],
                        steep[i, 1],
                        inner,
                        steep_reach,
                        flat_reach,
                        out[found],
                    ):
                        out[found, 2], out[found, 3] = a, b
                        found += met % every == 0
                        met += 1
                    break
                before = here if here != 0.0 else -1e-9
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _meet(
    steep: Array,
    a0: int,
    a1: int,
    flat: Array,
    b0: int,
    b1: int,
    x: float,
    y: float,
    inner: float,
    steep_reach: float,
    flat_reach: float,
    out: Array,
) -> bool:
    """Meeting of the straight lines fitted around (x, y); place and slopes into `out`."""
    sa = sb = 0.0
    for _ in range(3):
        xa, sa, na = _fit_side(steep, a0, a1, y, inner, steep_reach)
        yb, sb, nb = _fit_side(flat, b0, b1, x, inner, flat_reach)
        det = 1.0 - sa * sb
        if na == 0 or nb == 0 or abs(det) < 0.2:
            return False
        # x = xa + sa (Y − y), Y = yb + sb (X − x)
        nx = (xa + sa * (yb - y - sb * x)) / det
        y = yb + sb * (nx - x)
        x = nx
    out[0], out[1], out[4], out[5] = x, y, sa, sb
    return True
