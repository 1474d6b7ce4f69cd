"""Crosses of light lines: the meeting of two fitted lines."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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

    def numbered_after(self, steep: int) -> Crosses:
        """Return the same with flat lines numbered after `steep` lines."""
        return replace(self, lines=self.lines + np.array([0, steep]))


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_side(
    table: Array, first: int, last: int, at: float, inner: float, outer: float
) -> tuple[float, float, int]:
    """Straight line x = a + b (y − at) through chain points with inner ≤ |y − at| ≤ outer: a, b, points."""
    n = 0
    sy = sx = syy = sxy = 0.0
    for i in range(first, last):
        dy = table[i, 1] - at
        if dy > outer:
            break
        if abs(dy) < inner or dy < -outer:
            continue
        n += 1
        sy += dy
        sx += table[i, 0]
        syy += dy * dy
        sxy += dy * table[i, 0]
    det = n * syy - sy * sy
    if n < 6 or not det > 0.0:
        return 0.0, 0.0, 0
    b = (n * sxy - sy * sx) / det
    return (sx - b * sy) / n, b, n


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(
    steep: Array, steep_starts: Index, flat: Array, flat_starts: Index, width: float
) -> tuple[Array, Index, Array, int]:
    capacity = 4096
    points = np.empty((capacity, 2))
    lines = np.empty((capacity, 2), np.int64)
    directions = np.empty((capacity, 2))
    found = 0
    for a in range(steep_starts.size - 1):
        a0, a1 = steep_starts[a], steep_starts[a + 1]
        ymin, ymax = steep[a0, 1], steep[a1 - 1, 1]
        xmin, xmax = np.inf, -np.inf
        for i in range(a0, a1):
            xmin, xmax = min(xmin, steep[i, 0]), max(xmax, steep[i, 0])
        for b in range(flat_starts.size - 1):
            b0, b1 = flat_starts[b], flat_starts[b + 1]
            # In the flat table the roles are swapped: column 1 is the image's x, column 0 its y.
            if flat[b1 - 1, 1] < xmin - 2 or flat[b0, 1] > xmax + 2 or found == capacity:
                continue
            j = b0
            before = 0.0
            for i in range(a0, a1):
                x = steep[i, 0]
                while j < b1 - 2 and flat[j + 1, 1] < x:
                    j += 1
                while j > b0 and flat[j, 1] > x:
                    j -= 1
                if abs(flat[j, 1] - x) > 8.0 * width + 4.0:
                    before = 0.0
                    continue
                here = steep[i, 1] - flat[j, 0]
                if before < 0.0 <= here and ymin <= steep[i, 1] <= ymax:
                    y, ok = steep[i, 1], True
                    sa = sb = 0.0
                    for _ in range(3):
                        xa, sa, na = _fit_side(steep, a0, a1, y, 2.5 * width, 8.0 * width)
                        yb, sb, nb = _fit_side(flat, b0, b1, x, 2.5 * width, 8.0 * width)
                        if na == 0 or nb == 0:
                            ok = False
                            break
                        # x = xa + sa (Y − y), Y = yb + sb (X − x)
                        det = 1.0 - sa * sb
                        nx = (xa + sa * (yb - y - sb * x)) / det
                        ny = yb + sb * (nx - x)
                        x, y = nx, ny
                    if ok and abs(1.0 - sa * sb) > 0.2:
                        points[found, 0], points[found, 1] = x, y
                        lines[found, 0], lines[found, 1] = a, b
                        directions[found, 0], directions[found, 1] = sa, sb
                        found += 1
                    break
                before = here if here != 0.0 else -1e-9
    return points, lines, directions, found


def cross_lines(steep: Array, steep_starts: Index, flat: Array, flat_starts: Index, width: float) -> Crosses:
    """Crosses of steep chains with flat ones.

    Each cross is the meeting of two straight lines fitted to the points on both sides of it; the points
    nearer than 2.5 line widths, where either line disturbs the other, take no part.

    Parameters
    ----------
    steep, steep_starts
        Ridge table of the steep chains (x, y, …) in chain order, and the first row of each.
    flat, flat_starts
        The same of the flat chains, found in the transposed image: (y, x, …).
    width
        Standard deviation of the lines' profile, pixels.
    """
    points, lines, directions, found = _cross(steep, steep_starts, flat, flat_starts, width)
    return Crosses(points[:found].copy(), lines[:found].copy(), directions[:found].copy())
