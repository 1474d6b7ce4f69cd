"""Do the heads see the same wheel? What is left over once each head's points may move as a body.

Where a head moved since its calibration, its patch of the tyre stands in the wrong place. The common surface
leans to meet it, and the little that remains looks like noise; but it is not: one small shift and turn of
the patch explains it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from alignment.kernels import njit
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.revolution_kernels import pieces_of, slope_of_profile

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_RING = 2.0  # mm; width of the rings whose mean height is left free, which stands for the profile
_MOVES = 5  # a patch may rise, lean two ways, and shift two ways along the slope of the sidewall


@njit(cache=True, nogil=True, error_model="numpy")
def _sums(
    points: Array,
    weights: Array,
    residuals: Array,
    head: Index,
    heads: int,
    centre: Array,
    frame: Array,
    start: float,
    step: float,
    profile: Array,
) -> tuple[Array, Array, Array, Array]:
    """Weighted sums of the moves m and residuals r.

    Per head Σ w m mᵀ (H, 5, 5) and Σ w m r (H, 5); per ring and head Σ w m (R, H, 5), whose first entry is
    Σ w, and Σ w r (R, H).
    """
    rings = int(step * profile.size / _RING) + 2
    square, right = np.zeros((heads, _MOVES, _MOVES)), np.zeros((heads, _MOVES))
    ring_moves, ring_right = np.zeros((rings, heads, _MOVES)), np.zeros((rings, heads))
    move, pieces = np.ones(_MOVES), pieces_of(profile)
    for i in range(points.shape[0]):
        w = weights[i]
        if w <= 0.0:
            continue
        qx, qy, qz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        x = frame[0, 0] * qx + frame[0, 1] * qy + frame[0, 2] * qz
        y = frame[1, 0] * qx + frame[1, 1] * qy + frame[1, 2] * qz
        rho = math.sqrt(x * x + y * y)
        outward = slope_of_profile(rho, start, step, pieces) / rho
        move[1], move[2], move[3], move[4] = x, y, outward * x, outward * y
        h, ring = head[i], int((rho - start) / _RING)
        ring_right[ring, h] += w * residuals[i]
        of_ring, of_head = ring_moves[ring, h], square[h]
        for a in range(_MOVES):
            wa = w * move[a]
            of_ring[a] += wa
            right[h, a] += wa * residuals[i]
            for b in range(a + 1):
                of_head[a, b] += wa * move[b]
    for a in range(_MOVES):
        for b in range(a):
            square[:, b, a] = square[:, a, b]
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


def head_misfits(points: Array, head: Index, heads: int, fit: RevolutionFit) -> Array:
    """Part of the residuals that a movement of each head explains, RMS over its points, (H,) millimetres.

    A few thousandths where calibration and heads are as they should be. It does not see a turn about the
    wheel's axis, which changes no height, nor a common movement of all heads.

    Parameters
    ----------
    points
        (N, 3) as they were given to `fit_revolution`.
    head
        (N,) whose they are, numbers from 0; each must have points with weight.
    heads
        How many there are.
    fit
        The result.
    """
    square, right, ring_moves, ring_right = _sums(
        points, fit.weights, fit.residuals, head, heads, fit.centre, fit.tilt_axes, fit.knots_start,
        fit.knots_step, fit.profile,
    )  # fmt: skip
    weight = ring_moves[:, :, 0]
    total = np.maximum(weight.sum(axis=1), 1e-12)
    # The mean of each ring is free: take its part off the sums. Small sums without BLAS, whose threads would
    # spin on and take the cores from the next images.
    size = heads * _MOVES
    of_ring = ring_moves.reshape(len(total), size)
    normal = -np.einsum("ri,rj->ij", of_ring / total[:, None], of_ring)
    target = right.reshape(size) - np.einsum("ri,r->i", of_ring, ring_right.sum(axis=1) / total)
    for k in range(heads):
        mine = slice(k * _MOVES, (k + 1) * _MOVES)
        normal[mine, mine] += square[k]
    unit = np.sqrt(np.maximum(np.einsum("kaa->ka", square).reshape(size), 1e-30))
    # What all heads do together is the axis, which the fit has found already: it has no value here.
    inverse = np.linalg.pinv(normal / np.outer(unit, unit), rcond=1e-6, hermitian=True)
    amounts = (np.einsum("ij,j->i", inverse, target / unit) / unit).reshape(heads, _MOVES)
    mean = np.einsum("rka,ka->r", ring_moves, amounts) / total
    explained = (
        np.einsum("kab,ka,kb->k", square, amounts, amounts)
        - 2.0 * np.einsum("rka,ka,r->k", ring_moves, amounts, mean)
        + np.einsum("rk,r->k", weight, mean**2)
    )
    out: Array = np.sqrt(np.maximum(explained, 0.0) / np.maximum(weight.sum(axis=0), 1e-12))
    return out
