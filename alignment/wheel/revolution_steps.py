"""Compiled Gauss–Newton steps of the surface of revolution: weights, normal equations, their solution.

The normal equations have the shape of an arrow: a full block of the axis, a band of the profile.
"""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array, Index
from alignment.geometry.symmetric import LEAST_PIVOT, solve
from alignment.kernels import njit
from alignment.wheel.revolution_kernels import AXIS, gradient, normal_matrix, rows, weigh

CENTRE_PRIOR = 30.0  # mm; keeps the axis position finite on a flat sidewall
STIFFNESS = 1e-4  # of the profile, relative to the points' weight
_BAND = 4
_MOST_TILT, _MOST_SHIFT = 0.1, 20.0  # of one step, radians and mm
_LOOSE = 3  # first iterations, with the wide cut

#: Outcome of `iterate`.
SETTLED, UNSETTLED, TOO_FEW, SINGULAR = range(4)


@njit(cache=True, nogil=True, error_model="numpy")
def frame_of(normal: Array) -> Array:
    """(3, 3) rows e1, e2, normal: right-handed, e1 as near to x as can be."""
    n = normal / np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    frame = np.empty((3, 3))
    frame[0] = -n[0] * n
    frame[0, 0] += 1.0
    frame[0] /= np.sqrt(frame[0, 0] ** 2 + frame[0, 1] ** 2 + frame[0, 2] ** 2)
    e1 = frame[0]
    frame[1, 0] = n[1] * e1[2] - n[2] * e1[1]
    frame[1, 1] = n[2] * e1[0] - n[0] * e1[2]
    frame[1, 2] = n[0] * e1[1] - n[1] * e1[0]
    frame[2] = n
    return frame


@njit(cache=True, nogil=True, error_model="numpy")
def matrix_of(table: Array, first: Index, knots: int) -> tuple[Array, Array, Array, float]:
    """Normal matrix with a weak prior on the axis position and a weak pull to a smooth profile.

    Axis block (4, 4), profile–axis block (K, 4), lower band (K, 4) of the profile block, stiffness.
    """
    corner, side, band = normal_matrix(table, first, knots)
    corner[2, 2] += CENTRE_PRIOR**-2
    corner[3, 3] += CENTRE_PRIOR**-2
    stiffness = 1e-12
    for k in range(knots):
        stiffness += STIFFNESS * band[k, 0] / knots
    # DᵀD, D the second difference: 1 −2 1 along each row.
    for k in range(knots - 2):
        for a in range(3):
            row = -2.0 if a == 1 else 1.0
            for b in range(a + 1):
                column = -2.0 if b == 1 else 1.0
                band[k + b, a - b] += stiffness * row * column
    return corner, side, band, stiffness


@njit(cache=True, nogil=True, error_model="numpy")
def _right_side(table: Array, first: Index, profile: Array, stiffness: float) -> Array:
    """Right side (4 + K, 1) of the normal equations, with the pull to a smooth profile."""
    right = -gradient(table, first, profile.size)
    for k in range(profile.size - 2):
        second = stiffness * (profile[k] - 2.0 * profile[k + 1] + profile[k + 2])
        right[AXIS + k] -= second
        right[AXIS + k + 1] += 2.0 * second
        right[AXIS + k + 2] -= second
    return right.reshape(-1, 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _factor_band(band: Array) -> bool:
    """Cholesky factor of a lower band (K, 4), in place; False where the matrix is not positive."""
    n = band.shape[0]
    for k in range(n):
        for j in range(max(0, k - _BAND + 1), k):
            # Column j reaches row k: take its part off column k.
            factor = band[j, k - j]
            for i in range(k, min(n, j + _BAND)):
                band[k, i - k] -= factor * band[j, i - j]
        if not band[k, 0] > 0.0:
            return False
        root = math.sqrt(band[k, 0])
        for i in range(_BAND):
            band[k, i] /= root
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _solve_band(factor: Array, right: Array) -> None:
    """Solve L Lᵀ x = right (K, m) in place."""
    n, m = right.shape
    for k in range(n):
        for j in range(max(0, k - _BAND + 1), k):
            for c in range(m):
                right[k, c] -= factor[j, k - j] * right[j, c]
        for c in range(m):
            right[k, c] /= factor[k, 0]
    for k in range(n - 1, -1, -1):
        for i in range(k + 1, min(n, k + _BAND)):
            for c in range(m):
                right[k, c] -= factor[k, i - k] * right[i, c]
        for c in range(m):
            right[k, c] /= factor[k, 0]


@njit(cache=True, nogil=True, error_model="numpy")
def solve_arrow(corner: Array, side: Array, band: Array, right: Array) -> bool:
    """Solve for right sides (4 + K, m) in place, by the Schur complement of the profile.

    `corner` and `band` are overwritten. False where the points do not determine the unknowns.
    """
    knots, m = side.shape[0], right.shape[1]
    if not _factor_band(band):
        return False
    both = np.empty((knots, AXIS + m))
    # Number by number: an assignment of a slice brings numba's whole text of its error message with it.
    for k in range(knots):
        for a in range(AXIS):
            both[k, a] = side[k, a]
        for c in range(m):
            both[k, AXIS + c] = right[AXIS + k, c]
    _solve_band(band, both)
    for k in range(knots):
        for a in range(AXIS):
            for b in range(AXIS):
                corner[a, b] -= side[k, a] * both[k, b]
            for c in range(m):
                right[a, c] -= side[k, a] * both[k, AXIS + c]
    if not solve(corner, right[:AXIS], LEAST_PIVOT):
        return False
    for k in range(knots):
        for c in range(m):
            total = both[k, AXIS + c]
            for a in range(AXIS):
                total -= both[k, a] * right[a, c]
            right[AXIS + k, c] = total
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def iterate(
    points: Array,
    sigma: Array,
    rays: Array,
    spread: Array,
    centre: Array,
    frame: Array,
    start: float,
    step: float,
    profile: Array,
    cut: float,
    first_cut: float,
    floor: float,
    iterations: int,
    settled: float,
    renew: bool,
    table: Array,
    first: Index,
) -> tuple[int, float]:
    """Gauss–Newton steps with new weights each, until the axis turns by less than `settled` radians.

    Changes `centre` (3,), `frame` (3, 3) and `profile` (K,) in place. Residuals and weights are left in
    `table` (9, N) and `first` (N,), see `revolution_kernels.rows`, as they were before the last step, which
    hardly matters where it settled. Returns the outcome and the scale.

    Parameters
    ----------
    points, sigma, rays, spread
        As for `fit_revolution`.
    start, step
        First knot and knot distance, millimetres.
    cut, first_cut
        Tukey's constant, and its factor in the first iterations.
    floor
        Least scale.
    iterations
        Largest number of steps; 0 only weighs.
    renew
        Whether every step has a normal matrix of its own. Near the solution that of the first step serves
        all: right is the step whose right side vanishes, and that is always new.
    """
    before = np.inf
    scale = stiffness = 0.0
    corner = side = band = np.empty((0, 0))
    for iteration in range(max(iterations, 1)):
        rows(points, sigma, rays, spread, centre, frame, start, step, profile, table, first)
        wide = first_cut if iteration < min(_LOOSE, iterations) else 1.0
        scale = weigh(table, first, cut * wide, floor)
        if scale < 0.0:
            return TOO_FEW, scale
        if iterations == 0:
            break
        if renew or iteration == 0:
            corner, side, band, stiffness = matrix_of(table, first, profile.size)
        delta = _right_side(table, first, profile, stiffness)
        if not solve_arrow(corner.copy(), side, band.copy(), delta):
            return SINGULAR, scale
        tilt, shift = np.empty(2), np.empty(2)
        for a in range(2):
            tilt[a] = min(max(delta[a, 0], -_MOST_TILT), _MOST_TILT)
            shift[a] = min(max(delta[2 + a, 0], -_MOST_SHIFT), _MOST_SHIFT)
        for k in range(3):
            centre[k] += shift[0] * frame[0, k] + shift[1] * frame[1, k]
        frame[:] = frame_of(frame[2] + tilt[0] * frame[0] + tilt[1] * frame[1])
        for k in range(profile.size):
            profile[k] += delta[AXIS + k, 0]
        if max(abs(tilt[0]), abs(tilt[1])) < settled and abs(scale - before) < 0.01 * scale:
            return SETTLED, scale
        before = scale
    return UNSETTLED, scale
