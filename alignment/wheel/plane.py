"""A robust plane: the simple alternative to the surface of revolution, biased where a sidewall is uneven."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index
from alignment.errors import DegenerateInputError
from alignment.geometry.projective import require_finite
from alignment.robust import BIWEIGHT, deviation_of

_LEAST_INFORMATION = 0.3  # of the weights; less is no fit


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


def fit_plane(points: Array, cluster: Index, normal: Array, *, iterations: int = 30) -> PlaneFit:
    """Fit a plane to points (N, 3), millimetres, by iterated total least squares with Tukey's weights.

    Parameters
    ----------
    points
        (N, 3) rig frame, millimetres.
    cluster
        (N,) numbers from 0; residuals inside one may be correlated (see `fit_revolution`).
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
    clusters = int(cluster.max()) + 1
    gradients = np.column_stack(
        [np.bincount(cluster, weights * residuals * along[:, k], clusters) for k in range(2)]
    )
    # The biweight's influence falls before its weight does: its slope, not the weight, is the information.
    root = np.sqrt(weights)
    information = float((root * (5.0 * root - 4.0)).sum() / weights.sum())
    half = gradients @ inverse / max(information, _LEAST_INFORMATION)
    return PlaneFit(axes[2], centroid, weights, residuals, half.T @ half, axes[:2])
