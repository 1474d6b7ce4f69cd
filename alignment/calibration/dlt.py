"""Linear calibration: the 3 × 4 camera matrix from points in space, and the camera in it."""

from __future__ import annotations

import numpy as np
from scipy.linalg import rq

from alignment.arrays import Array
from alignment.calibration.one_camera import (
    CalibratedCamera,
    Known,
    camera_model,
    checked,
    nearest_rotation,
    posed,
    require_spread,
)
from alignment.errors import DegenerateInputError
from alignment.geometry.projective import conditioning, homogeneous, linear_rows, null_vector


def fit_projection(points: Array, pixels: Array) -> Array:
    """Camera matrix P (3, 4) of least algebraic error: λ (u, v, 1) = P (x, y, z, 1).

    Scaled so that the first three of its last row have length 1 and the points have positive depth.
    Conditioned as Hartley (1997) advises.

    Parameters
    ----------
    points
        (N, 3), N ≥ 6, not in one plane, millimetres.
    pixels
        (N, 2).

    Raises
    ------
    DegenerateInputError
        For too few points, or points in one plane.
    """
    points, pixels = checked(points, pixels, 6)
    require_spread(points, 3)
    of_points, of_pixels = conditioning(points), conditioning(pixels)
    x = homogeneous(points) @ of_points.T
    uv = (homogeneous(pixels) @ of_pixels.T)[:, :2]
    solution, uniqueness = null_vector(linear_rows(x, uv))
    if uniqueness < 1e-9:
        raise DegenerateInputError(
            field="points",
            expected="points that fix the eleven parameters of a camera",
            seen="a family of cameras that see them alike",
            cure="Add positions of the plate.",
        )
    matrix = np.linalg.inv(of_pixels) @ solution.reshape(3, 4) @ of_points
    matrix /= np.linalg.norm(matrix[2, :3])
    return np.asarray(matrix * np.sign((homogeneous(points) @ matrix[2]).sum()))


def decompose(matrix: Array) -> tuple[Array, Array, Array]:
    """K (3, 3) with K₃₃ = 1, R (3, 3) and t (3,) of a camera matrix P (3, 4) ~ K [R | t].

    Positive focal lengths; the skew is K₁₂.

    Raises
    ------
    DegenerateInputError
        When the camera is at infinity, or mirrored.
    """
    k, rotation = rq(matrix[:, :3])
    if np.abs(np.diag(k)).min() < 1e-12 * np.abs(k).max():
        raise DegenerateInputError(field="P", expected="a camera at a finite place", seen="one at infinity")
    signs = np.diag(np.sign(np.diag(k)))
    k, rotation = k @ signs, signs @ rotation
    translation = np.linalg.solve(k, matrix[:, 3])
    if np.linalg.det(rotation) < 0:
        raise DegenerateInputError(
            field="P",
            expected="a camera that sees the points as they are",
            seen="a mirrored view",
            cure="Check the handedness of the points' frame, and that images are not flipped.",
        )
    return np.asarray(k / k[2, 2]), np.asarray(rotation), translation


def calibrate_dlt(
    points: Array, pixels: Array, size: tuple[int, int], known: Known | None = None
) -> CalibratedCamera:
    """Find camera with skew and without distortion, from the linear camera matrix (Hall; DLT).

    See `OneCameraMethod`; nothing needs to be known.
    """
    del known
    k, rotation, translation = decompose(fit_projection(points, pixels))
    return posed(camera_model(size, k), nearest_rotation(rotation), translation, points, pixels)
