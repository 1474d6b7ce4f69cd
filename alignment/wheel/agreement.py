"""Do the heads see the same wheel? What is left over once each head's points may move as a body.

Where a head moved since its calibration, its patch of the tyre stands in the wrong place. The common surface
leans to meet it, and the little that remains looks like noise; but it is not: one small shift and turn of
the patch explains it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index
from alignment.geometry.symmetric import pseudo_inverse
from alignment.kernels import njit
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.revolution_kernels import pieces_of, slope_of_profile

_RING = 2.0  # mm; width of the rings whose mean height is left free, which stands for the profile
MOVES = 5  # a patch may rise, lean two ways, and shift two ways along the slope of the sidewall


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _sums(
    points: Array,
    weights: Array,
    residuals: Array,
    bounds: Index,
    centre: Array,
    frame: Array,
    start: float,
    step: float,
    profile: Array,
) -> tuple[Array, Array, Array, Array]:
    """Weighted sums of the moves m and residuals r; head h has the points bounds[h] to bounds[h + 1] − 1.

    Per head Σ w m mᵀ (H, 5, 5) and Σ w m r (H, 5); per ring and head Σ w m (R, H, 5), whose first entry is
    Σ w, and Σ w r (R, H).
    """
    heads, rings = bounds.size - 1, int(step * profile.size / _RING) + 2
    square, right = np.zeros((heads, MOVES, MOVES)), np.zeros((heads, MOVES))
    ring_moves, ring_right = np.zeros((rings, heads, MOVES)), np.zeros((rings, heads))
    pieces, per_ring = pieces_of(profile), 1.0 / _RING
    cx, cy, cz = centre[0], centre[1], centre[2]
    f00, f01, f02 = frame[0, 0], frame[0, 1], frame[0, 2]
    f10, f11, f12 = frame[1, 0], frame[1, 1], frame[1, 2]
    longest = 0
    for h in range(heads):
        longest = max(longest, bounds[h + 1] - bounds[h])
    move, every_rest, ring = np.ones((MOVES, longest)), np.empty(longest), np.empty(longest, np.int64)
    for h in range(heads):
        n = bounds[h + 1] - bounds[h]
        weight, rest = weights[bounds[h] : bounds[h + 1]], every_rest[:n]
        across, up, out_x, out_y = move[1][:n], move[2][:n], move[3][:n], move[4][:n]
        for k in range(n):
            i = bounds[h] + k
            qx, qy, qz = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
            x = f00 * qx + f01 * qy + f02 * qz
            y = f10 * qx + f11 * qy + f12 * qz
            rho = math.sqrt(x * x + y * y)
            outward = slope_of_profile(rho, start, step, pieces) / max(rho, 1.0)
            across[k], up[k], out_x[k], out_y[k] = x, y, outward * x, outward * y
            ring[k] = int((rho - start) * per_ring)
            rest[k] = residuals[i] if weight[k] > 0.0 else 0.0
        # Sum by sum: loops that compilers turn into vector instructions.
        for a in range(MOVES):
            one = move[a][:n]
            total = 0.0
            for k in range(n):
                total += weight[k] * one[k] * rest[k]
            right[h, a] = total
            for b in range(a + 1):
                other = move[b][:n]
                total = 0.0
                for k in range(n):
                    total += weight[k] * one[k] * other[k]
                square[h, a, b] = square[h, b, a] = total
        for k in range(n):
            w = weight[k]
            if w > 0.0:
                ring_right[ring[k], h] += w * rest[k]
                of_ring = ring_moves[ring[k], h]
                of_ring[0] += w
                of_ring[1] += w * across[k]
                of_ring[2] += w * up[k]
                of_ring[3] += w * out_x[k]
                of_ring[4] += w * out_y[k]
    return square, right, ring_moves, ring_right


@njit(cache=True, nogil=True, error_model="numpy")
def head_sums(head: Index, heads: int, weights: Array, residuals: Array) -> tuple[Array, Array, Array]:
    """Of each head: points with weight, their weight, and weighted sum of squared residuals, (H,) each."""
    numbers, total, squares = np.zeros(heads), np.zeros(heads), np.zeros(heads)
    for i in range(head.size):
        w = weights[i]
        if w > 0.0:
            numbers[head[i]] += 1.0
            total[head[i]] += w
            squares[head[i]] += w * residuals[i] ** 2
    return numbers, total, squares


@njit(cache=True, nogil=True, error_model="numpy")
def _condensed(
    points: Array,
    head: Index,
    heads: int,
    weights: Array,
    residuals: Array,
    centre: Array,
    frame: Array,
    start: float,
    step: float,
    profile: Array,
) -> tuple[Array, Array, Array, Array, Array]:
    """Sums and normal equations of all amounts, see `HeadMoves`."""
    bounds = np.zeros(heads + 1, np.int64)
    for i in range(head.size):
        bounds[head[i] + 1] = i + 1
    for h in range(heads):
        bounds[h + 1] = max(bounds[h], bounds[h + 1])
    square, right, rings, ring_right = _sums(
        points, weights, residuals, bounds, centre, frame, start, step, profile
    )
    size = heads * MOVES
    normal, target = np.zeros((size, size)), np.zeros(size)
    # The mean of each ring is free: take its part off the sums.
    of_ring = rings.reshape((rings.shape[0], size))
    for r in range(rings.shape[0]):
        total = pull = 0.0
        for h in range(heads):
            total += rings[r, h, 0]
            pull += ring_right[r, h]
        total = max(total, 1e-12)
        row = of_ring[r]
        for i in range(size):
            share, mine = row[i] / total, normal[i]
            target[i] -= share * pull
            for j in range(size):
                mine[j] -= share * row[j]
    for h in range(heads):
        for a in range(MOVES):
            target[h * MOVES + a] += right[h, a]
            for b in range(MOVES):
                normal[h * MOVES + a, h * MOVES + b] += square[h, a, b]
    return square, rings, ring_right, normal, target


@njit(cache=True, nogil=True, error_model="numpy")
def _explained(square: Array, rings: Array, normal: Array, target: Array) -> Array:
    """Part of the residuals that the movements explain (H,), see `HeadMoves.misfits`."""
    heads, size = square.shape[0], target.size
    unit, scaled, inner = np.empty(size), np.empty((size, size)), np.empty((size, size))
    for i in range(size):
        unit[i] = math.sqrt(max(square[i // MOVES, i % MOVES, i % MOVES], 1e-30))
    for i in range(size):
        for j in range(size):
            scaled[i, j] = normal[i, j] / (unit[i] * unit[j])
    # What all heads do together is the axis, which the fit has found already: it has no value here.
    pseudo_inverse(scaled, 1e-6, inner)
    amounts = np.zeros((heads, MOVES))
    for i in range(size):
        for j in range(size):
            amounts[i // MOVES, i % MOVES] += inner[i, j] * target[j] / (unit[i] * unit[j])
    explained, weight = np.zeros(heads), np.zeros(heads)
    for h in range(heads):
        for a in range(MOVES):
            for b in range(MOVES):
                explained[h] += square[h, a, b] * amounts[h, a] * amounts[h, b]
    for r in range(rings.shape[0]):
        total = mean = 0.0
        for h in range(heads):
            total += rings[r, h, 0]
            for a in range(MOVES):
                mean += rings[r, h, a] * amounts[h, a]
        mean /= max(total, 1e-12)
        for h in range(heads):
            weight[h] += rings[r, h, 0]
            explained[h] += rings[r, h, 0] * mean * mean
            for a in range(MOVES):
                explained[h] -= 2.0 * rings[r, h, a] * amounts[h, a] * mean
    for h in range(heads):
        explained[h] = math.sqrt(max(explained[h], 0.0) / max(weight[h], 1e-12))
    return explained


@dataclass(frozen=True, eq=False)
class HeadMoves:
    """What the residuals say of movements of the heads, condensed to sums.

    A head's patch may rise (1), lean (x, y) and shift along the slope of the sidewall (slope · x/ρ,
    slope · y/ρ): five amounts, millimetres and radians, in axes of the wheel that lie near the rig's. The
    mean height of each ring is left free, as the profile is.

    Attributes
    ----------
    square
        (H, 5, 5) sums of products of the moves over each head's points, by their weights.
    rings, ring_right
        (R, H, 5) and (R, H) sums of the moves and of the residuals over each ring.
    normal, target
        (5 H, 5 H) and (5 H,) normal equations of all amounts, the means of the rings eliminated.
    """

    square: Array
    rings: Array
    ring_right: Array
    normal: Array
    target: Array

    def misfits(self) -> Array:
        """(H,) part of the residuals that the movements explain, RMS over each head's points, millimetres."""
        return _explained(self.square, self.rings, self.normal, self.target)


def head_moves(points: Array, head: Index, heads: int, fit: RevolutionFit) -> HeadMoves:
    """Condense the residuals of a fit to what they say of movements of the heads.

    Parameters
    ----------
    points
        (N, 3) as they were given to `fit_revolution`.
    head
        (N,) whose they are, head after head, numbers from 0; each must have points with weight.
    heads
        How many there are.
    fit
        The result.
    """
    return HeadMoves(
        *_condensed(
            points, head, heads, fit.weights, fit.residuals, fit.centre, fit.tilt_axes, fit.knots_start,
            fit.knots_step, fit.profile,
        )
    )  # fmt: skip


def head_misfits(points: Array, head: Index, heads: int, fit: RevolutionFit) -> Array:
    """Part of the residuals that a movement of each head explains, RMS over its points, (H,) millimetres.

    A few thousandths where calibration and heads are as they should be. It does not see a turn about the
    wheel's axis, which changes no height, nor a common movement of all heads. Parameters as for `head_moves`.
    """
    return head_moves(points, head, heads, fit).misfits()
