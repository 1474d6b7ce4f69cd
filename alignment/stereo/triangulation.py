"""One point from two rays, with covariance."""

from __future__ import annotations

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera


def triangulate(
    left: PosedCamera, right: PosedCamera, left_pixels: Array, right_pixels: Array
) -> tuple[Array, Array]:
    """Points nearest to both rays, and how far the rays pass each other.

    Solves the 3 × 2 least-squares problem of the thesis's 6.1 for the distances along the rays and takes the
    midpoint of the shortest connection.

    Parameters
    ----------
    left, right
        Posed cameras of the head.
    left_pixels, right_pixels
        (N, 2) corresponding pixels.

    Returns
    -------
    points
        (N, 3) rig frame, millimetres.
    gap
        (N,) distance of the two rays there, millimetres.

    Raises
    ------
    DegenerateInputError
        When rays are parallel to less than a microradian, or as `CameraModel.normalise`.
    """
    a, b = left.rig_from_camera.translation, right.rig_from_camera.translation
    da, db = left.rays(left_pixels), right.rays(right_pixels)
    base = b - a
    cos = np.einsum("ij,ij->i", da, db)
    sin2 = 1.0 - cos**2
    if (sin2 < 1e-12).any():
        raise DegenerateInputError(
            field="pixels", expected="rays that meet", seen=f"{int((sin2 < 1e-12).sum())} parallel pairs"
        )
    along_a, along_b = da @ base, db @ base
    ta = (along_a - cos * along_b) / sin2
    tb = (cos * along_a - along_b) / sin2
    pa, pb = a + ta[:, None] * da, b + tb[:, None] * db
    points: Array = 0.5 * (pa + pb)
    gap: Array = np.linalg.norm(pa - pb, axis=1)
    return points, gap


def noise_covariance(left: PosedCamera, right: PosedCamera, points: Array, sigma_px: float) -> Array:
    """(N, 3, 3) covariance, millimetres², of points (N, 3) seen with isotropic pixel noise in both cameras.

    First order: the inverse of Σ Jᵀ J / σ² over the two projections. It covers image noise alone, not the
    calibration.
    """
    points = np.asarray(points, dtype=np.float64)
    step = 1e-3
    jacobians = []
    for camera in (left, right):
        columns = [
            (camera.project(points + step * axis) - camera.project(points - step * axis)) / (2 * step)
            for axis in np.eye(3)
        ]
        jacobians.append(np.stack(columns, axis=2))
    j = np.concatenate(jacobians, axis=1)
    covariance: Array = np.linalg.inv(np.einsum("nij,nik->njk", j, j)) * sigma_px**2
    return covariance
