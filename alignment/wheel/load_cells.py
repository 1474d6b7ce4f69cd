"""Residuals of a wheel's points condensed to cells: a ring, a head, a few degrees.

What a load does to a sidewall is smooth, so that a cell's mean says as much as its points; a thousand cells
in place of ten thousand points make every hypothesis about the load cheap.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from alignment.arrays import Array, Index
from alignment.wheel.agreement import MOVES
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.revolution_kernels import pieces_of

_RING, _ANGLE = 3.0, np.radians(2.0)  # mm and radians
_FEWEST = 3.0  # weight of a cell


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells with weight, ring after ring.

    Attributes
    ----------
    ring, head
        (C,) numbers from 0.
    weight
        (C,) sum of the points' weights.
    height
        (C,) mean height above the profile that is fitted, millimetres.
    places
        (C, 2) mean place along the fit's tilt axes, from its centre, millimetres.
    moves
        (C, 5) mean of the moves of `HeadMoves`.
    """

    ring: Index
    head: Index
    weight: Array
    height: Array
    places: Array
    moves: Array

    @cached_property
    def radius(self) -> Array:
        """(C,) distance from the axis, millimetres."""
        return np.hypot(self.places[:, 0], self.places[:, 1])

    @cached_property
    def ring_starts(self) -> Index:
        """First cell of each ring."""
        return np.flatnonzero(np.diff(self.ring, prepend=-1))

    def angle_from(self, direction: Array) -> Array:
        """(C,) angle from a direction (2,) along the tilt axes, −π to π, radians."""
        return angle_from(self.places, direction)

    def freed(self, columns: Array) -> Array:
        """Columns (C, m) without the mean of each ring, which the profile follows, times √weight."""
        starts = self.ring_starts
        total = np.add.reduceat(self.weight, starts)
        mean = np.add.reduceat(columns * self.weight[:, None], starts) / total[:, None]
        counts = np.diff(starts, append=len(self.ring))
        out: Array = (columns - np.repeat(mean, counts, axis=0)) * np.sqrt(self.weight)[:, None]
        return out

    def points(self, fit: RevolutionFit) -> Array:
        """(C, 3) places in the rig frame, on the plane of the fit's centre."""
        out: Array = fit.centre + self.places @ fit.tilt_axes
        return out

    def by_head(self) -> Array:
        """(C, 5 H) moves, each head's in columns of its own."""
        heads = int(self.head.max()) + 1
        out = np.zeros((len(self.head), heads, MOVES))
        out[np.arange(len(self.head)), self.head] = self.moves
        return out.reshape(len(self.head), heads * MOVES)


def angle_from(places: Array, direction: Array) -> Array:
    """(n,) angle of places (n, 2) from a direction (2,), −π to π, radians."""
    along = places @ direction
    across = places[:, 1] * direction[0] - places[:, 0] * direction[1]
    out: Array = np.arctan2(across, along)
    return out


def condense(points: Array, head: Index, weights: Array, residuals: Array, fit: RevolutionFit) -> Cells:
    """Condense points (N, 3) of heads (N,) by their weights (N,) and residuals (N,), millimetres."""
    used = weights > 0.0
    w, r, h = weights[used], residuals[used], head[used]
    x, y = ((points[used] - fit.centre) @ fit.tilt_axes.T).T
    radius = np.hypot(x, y)
    slope = _slopes(fit, radius) / np.maximum(radius, 1.0)
    ring = ((radius - fit.knots_start) / _RING).astype(np.int64)
    turn = np.floor((np.arctan2(y, x) + np.pi) / _ANGLE).astype(np.int64)
    key = (ring * (int(h.max()) + 1) + h) * 200 + turn
    number, inverse = np.unique(key, return_inverse=True)
    weight: Array = np.bincount(inverse, w).astype(np.float64)
    mean = [np.bincount(inverse, w * v) / weight for v in (r, x, y, slope * x, slope * y)]
    of_ring, of_head = np.divmod(number // 200, int(h.max()) + 1)
    kept = weight >= _FEWEST
    cells = np.column_stack(mean)[kept]
    moves = np.column_stack([np.ones(len(cells)), cells[:, 1:]])
    return Cells(of_ring[kept], of_head[kept], weight[kept], cells[:, 0], cells[:, 1:3], moves)


def _slopes(fit: RevolutionFit, radius: Array) -> Array:
    """(n,) slope of the profile at each radius."""
    pieces = pieces_of(fit.profile)
    place = (radius - fit.knots_start) / fit.knots_step
    k = np.clip(np.floor(place).astype(np.int64), 0, len(pieces) - 1)
    t = np.clip(place - k, 0.0, 1.0)
    out: Array = (pieces[k, 1] + t * (2.0 * pieces[k, 2] + 3.0 * t * pieces[k, 3])) / fit.knots_step
    return out
