"""A robust plane: the simple alternative to the surface of revolution, biased where a sidewall is uneven."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry.projective import require_finite
from alignment.robust import BIWEIGHT, deviation_of

_LEAST_INFORMATION = 0.3  # of the weights; less is no fit
_RING = 1.0  # mm; width of the rings whose points count as one
_ALIKE = 4  # rings; farther apart the heights of two rings of a sidewall tell nothing of each other


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """A plane with its unit normal (3,), its centroid (3,), weights (N,) and residuals (N,), millimetres.

    `covariance` (2, 2) is that of the tilts of the normal along `tilt_axes` (2, 3), radians².
    """

    normal: Array
    centroid: Array
    weights: Array
    residuals: Array
    covariance: Array
    tilt_axes: Array


def fit_plane(points: Array, radius: Array, normal: Array, *, iterations: int = 30) -> PlaneFit:
    """Fit a plane to points (N, 3), millimetres, by iterated total least squares with Tukey's weights.

    A sidewall is no plane. What stands above the plane at one radius stands above it all around the wheel and
    in all heads, so that the points of a ring count as one, and rings next to each other nearly: the
    covariance is the sandwich of the M-estimator (Huber 1981, 6.3) with the residuals summed by rings, whose
    correlation ends a few millimetres apart (Newey, West 1987).

    Parameters
    ----------
    points
        (N, 3) rig frame, millimetres.
    radius
        (N,) distances from the wheel's axis, millimetres.
    normal
        (3,) which side is outboard.

    Raises
    ------
    DegenerateInputError
        When the points lie on a line, are fewer than three, or are not finite.
    """
    points = np.asarray(points, dtype=np.float64)
    require_finite(points, 3)
    weights = np.ones(len(points))
    axes, centroid, residuals = np.eye(3), np.zeros(3), np.zeros(len(points))
    for iteration in range(iterations):
        if np.count_nonzero(weights) < 3:
            raise DegenerateInputError(field="points", expected="three points of a plane", seen="fewer")
        centroid = weights @ points / weights.sum()
        centred = points - centroid
        spread, vectors = np.linalg.eigh((weights[:, None] * centred).T @ centred / weights.sum())
        if spread[1] < 1e-9 * max(spread[2], 1e-12):
            raise DegenerateInputError(field="points", expected="points that span a plane", seen="a line")
        n = vectors[:, 0] * (1.0 if vectors[:, 0] @ normal > 0 else -1.0)
        settled = iteration > 0 and np.abs(n - axes[2]).max() < 1e-10
        axes = np.array([vectors[:, 2], np.cross(n, vectors[:, 2]), n])
        residuals = centred @ n
        scale = max(deviation_of(residuals), 1e-9)
        u = np.minimum(np.abs(residuals) / (BIWEIGHT * scale), 1.0)
        weights = (1.0 - u * u) ** 2
        if settled:
            break
    # A tilt along e moves the residual of a point by its coordinate along e.
    along = (points - centroid) @ axes[:2].T
    inverse = np.linalg.inv((weights[:, None] * along).T @ along)
    ring = ((radius - radius.min()) / _RING).astype(np.int64)
    pulls = [np.bincount(ring, weights * residuals * along[:, k]) for k in range(2)]
    gradients: Array = np.column_stack(pulls).astype(np.float64)
    square: Array = gradients.T @ gradients
    for lag in range(1, min(_ALIKE, len(gradients))):
        shared = gradients[lag:].T @ gradients[:-lag]
        square = square + (1.0 - lag / _ALIKE) * (shared + shared.T)
    # The biweight's influence falls before its weight does: its slope, not the weight, is the information.
    root = np.sqrt(weights)
    information = float((root * (5.0 * root - 4.0)).sum() / weights.sum())
    inverse /= max(information, _LEAST_INFORMATION)
    return PlaneFit(axes[2], centroid, weights, residuals, inverse @ square @ inverse, axes[:2])
