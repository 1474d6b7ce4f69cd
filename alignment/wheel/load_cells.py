"""Residuals of a wheel's points condensed to cells: a ring, a head, a few degrees.

What a load does to a sidewall is smooth, so that a cell's mean says as much as its points; a thousand cells
in place of ten thousand points make every hypothesis about the load cheap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from alignment import robust
from alignment.arrays import Array, Index, Mask
from alignment.stereo.pool import PointPool
from alignment.wheel.agreement import MOVES
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.revolution_kernels import pieces_of

_RING, _ANGLE = 3.0, np.radians(2.0)  # mm and radians
_AROUND = np.radians(4.0)  # of a neighbourhood
_FEWEST = 3.0  # weight of a cell
_MOST_NOISE = 2.0  # of what the images state; more is a profile that does not fit yet
_FEWEST_DIFFERENCES, _CLIP = 30, 3.0  # robust deviations


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells with weight, ring after ring.

    Attributes
    ----------
    number
        (C,) growing; of neighbours on a ring before one head it differs by 1.
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
    bends
        (C, 3) mean of what shifts of the axis do in second order, by δx², δx δy and δy², millimetres.
    noise
        Standard deviation of a height of weight 1, millimetres: what neighbours on a ring differ by beside
        what bends smoothly, so that a load does not count as noise.
    image_noise
        As the points state it, millimetres.
    heads
        How many heads there are, with cells or without.
    """

    number: Index
    ring: Index
    head: Index
    weight: Array
    height: Array
    places: Array
    moves: Array
    bends: Array
    noise: float
    image_noise: float
    heads: int

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
        weight, total, of_ring, root = self._by_ring
        mean = np.add.reduceat(columns * weight, self.ring_starts) / total
        out: Array = (columns - mean[of_ring]) * root
        return out

    @cached_property
    def _by_ring(self) -> tuple[Array, Array, Index, Array]:
        """Weights (C, 1), their sums by ring (R, 1), each cell's ring (C,), roots of the weights (C, 1)."""
        starts = self.ring_starts
        total = np.add.reduceat(self.weight, starts)
        of_ring = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(self.ring)))
        return self.weight[:, None], total[:, None], of_ring, np.sqrt(self.weight)[:, None]

    def weighed(self, share: Array) -> Cells:
        """The cells, each with a share (C,) of its weight."""
        return replace(self, weight=self.weight * share)

    def where(self, kept: Mask) -> Cells:
        """The cells that are marked."""
        number, weight, height = self.number[kept], self.weight[kept], self.height[kept]
        noise = min(_noise(number, weight, height), _MOST_NOISE * self.image_noise)
        return replace(
            self, number=number, ring=self.ring[kept], head=self.head[kept], weight=weight, height=height,
            places=self.places[kept], moves=self.moves[kept], bends=self.bends[kept], noise=noise,
        )  # fmt: skip

    def points(self, fit: RevolutionFit) -> Array:
        """(C, 3) places in the rig frame, on the plane of the fit's centre."""
        out: Array = fit.centre + self.places @ fit.tilt_axes
        return out

    def by_head(self) -> Array:
        """(C, 5 H) moves, each head's in columns of its own."""
        heads = self.heads
        out = np.zeros((len(self.head), heads, MOVES))
        out[np.arange(len(self.head)), self.head] = self.moves
        return out.reshape(len(self.head), heads * MOVES)


def angle_from(places: Array, direction: Array) -> Array:
    """(n,) angle of places (n, 2) from a direction (2,), −π to π, radians."""
    along = places @ direction
    across = places[:, 1] * direction[0] - places[:, 0] * direction[1]
    out: Array = np.arctan2(across, along)
    return out


def condense(pool: PointPool, weights: Array, residuals: Array, fit: RevolutionFit, heads: int) -> Cells:
    """Condense points (N) of heads by their weights (N,) and residuals (N,), millimetres."""
    used = weights > 0.0
    w, r, h = weights[used], residuals[used], pool.head[used]
    x, y = ((pool.points[used] - fit.centre) @ fit.tilt_axes.T).T
    radius = np.hypot(x, y)
    slope, bend = _slopes(fit, radius)
    around = np.maximum(radius, 1.0)
    slope, across = slope / around, 0.5 * slope / around
    ring = ((radius - fit.knots_start) / _RING).astype(np.int64)
    turn = np.floor((np.arctan2(y, x) + np.pi) / _ANGLE).astype(np.int64)
    key = (ring * heads + h) * 200 + turn
    number, inverse = np.unique(key, return_inverse=True)
    weight: Array = np.bincount(inverse, w).astype(np.float64)
    ex, ey = x / around, y / around
    along = 0.5 * bend
    curved = (
        along * ex**2 + across * ey**2,
        2.0 * (along - across) * ex * ey,
        along * ey**2 + across * ex**2,
    )
    mean = [np.bincount(inverse, w * v) / weight for v in (r, x, y, slope * x, slope * y, *curved)]
    of_ring, of_head = np.divmod(number // 200, heads)
    kept = weight >= _FEWEST
    cells = np.column_stack(mean)[kept]
    moves = np.column_stack([np.ones(len(cells)), cells[:, 1:5]])
    stated = float(np.median(pool.sigma[used]))
    noise = min(_noise(number[kept], weight[kept], cells[:, 0]), _MOST_NOISE * stated)
    return Cells(
        number[kept], of_ring[kept], of_head[kept], weight[kept], cells[:, 0], cells[:, 1:3], moves,
        cells[:, 5:], noise, stated, heads,
    )  # fmt: skip


def local_weights(pool: PointPool, residuals: Array, fit: RevolutionFit, heads: int) -> Array:
    """(N,) weights by Tukey's biweight about the median of a neighbourhood: what a load, or a surface that is
    not found yet, does to all points of a place makes none of them an outlier."""
    x, y = ((pool.points - fit.centre) @ fit.tilt_axes.T).T
    ring = np.floor((np.hypot(x, y) - fit.knots_start) / _RING).astype(np.int64)
    turn = np.floor((np.arctan2(y, x) + np.pi) / _AROUND).astype(np.int64)
    _, inverse = np.unique((ring * heads + pool.head) * 200 + turn, return_inverse=True)
    order = np.lexsort((residuals, inverse))
    counts = np.bincount(inverse)
    first = np.cumsum(counts) - counts
    middle = residuals[order[first + counts // 2]]
    off = np.abs(residuals - middle[inverse])
    scale = robust.BIWEIGHT * robust.DEVIATION_OF_MEDIAN * float(np.median(off)) + 1e-6
    out: Array = np.square(1.0 - np.minimum(np.square(off / scale), 1.0))
    return out


def _noise(number: Index, weight: Array, height: Array) -> float:
    """Noise of a height of weight 1 from second differences of neighbours, of numbers in a row."""
    middle = np.flatnonzero((np.diff(number[:-1]) == 1) & (np.diff(number[1:]) == 1)) + 1
    if len(middle) < _FEWEST_DIFFERENCES:
        return float(np.sqrt((weight * height**2).sum() / max(len(height), 1)))
    bend = height[middle - 1] - 2.0 * height[middle] + height[middle + 1]
    each = 1.0 / weight[middle - 1] + 4.0 / weight[middle] + 1.0 / weight[middle + 1]
    square = bend**2 / each
    # Edges of rings and letters are no noise of the rest.
    most = (_CLIP * robust.DEVIATION_OF_MEDIAN) ** 2 * float(np.median(square))
    return float(np.sqrt(np.minimum(square, most).mean()))


def _slopes(fit: RevolutionFit, radius: Array) -> tuple[Array, Array]:
    """(n,) slope and second derivative of the profile at each radius."""
    pieces = pieces_of(fit.profile)
    place = (radius - fit.knots_start) / fit.knots_step
    k = np.clip(np.floor(place).astype(np.int64), 0, len(pieces) - 1)
    t = np.clip(place - k, 0.0, 1.0)
    slope: Array = (pieces[k, 1] + t * (2.0 * pieces[k, 2] + 3.0 * t * pieces[k, 3])) / fit.knots_step
    bend: Array = (2.0 * pieces[k, 2] + 6.0 * t * pieces[k, 3]) / fit.knots_step**2
    return slope, bend
