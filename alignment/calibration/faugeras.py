"""Faugeras and Toscani: the linear camera matrix under a norm that rigid motions keep, taken apart."""

from __future__ import annotations

import numpy as np

from alignment.arrays import Array
from alignment.calibration.one_camera import (
    CalibratedCamera,
    Known,
    calibration_matrix,
    camera_model,
    checked,
    nearest_rotation,
    posed,
    require_spread,
)
from alignment.errors import DegenerateInputError
from alignment.geometry.projective import conditioning, homogeneous, linear_rows


def fit_projection_unit_axis(points: Array, pixels: Array) -> Array:
    """Camera matrix (3, 4) of least algebraic error under ‖m₃‖ = 1, m₃ the direction of the optical axis.

    This norm, unlike the unit norm of all entries, does not depend on where the frame of the points lies
    (Faugeras and Toscani, 1986). The other entries follow linearly, m₃ is the smallest eigenvector of what
    is left.

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
    # A similarity of the points' frame keeps the norm's meaning; so does a shift and scale of the pixels.
    of_points, of_pixels = conditioning(points), conditioning(pixels)
    rows = linear_rows(homogeneous(points) @ of_points.T, (homogeneous(pixels) @ of_pixels.T)[:, :2])
    axis_columns = rows[:, 8:11]
    q, _ = np.linalg.qr(np.delete(rows, (8, 9, 10), axis=1))
    rest = axis_columns - q @ (q.T @ axis_columns)
    axis = np.linalg.svd(rest, full_matrices=False)[2][-1]
    others = np.linalg.lstsq(np.delete(rows, (8, 9, 10), axis=1), -axis_columns @ axis, rcond=None)[0]
    matrix = np.concatenate([others[:8], axis, others[8:]]).reshape(3, 4)
    matrix = np.linalg.inv(of_pixels) @ matrix @ of_points
    matrix /= np.linalg.norm(matrix[2, :3])
    return np.asarray(matrix * np.sign((homogeneous(points) @ matrix[2]).sum()))


def decompose_closed(matrix: Array) -> tuple[Array, Array, Array]:
    """K (3, 3), R (3, 3), t (3,) of a camera matrix (3, 4) with ‖m₃‖ = 1, by closed formulas, no skew.

    C_x = m₁·m₃, C_y = m₂·m₃, p_x = |m₁ × m₃|, p_y = |m₂ × m₃|; r₁ = (m₁ − C_x m₃)/p_x and so on.

    Raises
    ------
    DegenerateInputError
        When the matrix is that of a mirrored view or of a camera at infinity.
    """
    m1, m2, m3 = matrix[:, :3]
    cx, cy = m1 @ m3, m2 @ m3
    px, py = (float(np.linalg.norm(np.cross(m, m3))) for m in (m1, m2))
    if min(px, py) < 1e-12 * max(px, py, abs(cx), abs(cy)):
        raise DegenerateInputError(field="P", expected="a camera at a finite place", seen="one at infinity")
    rotation = np.array([(m1 - cx * m3) / px, (m2 - cy * m3) / py, m3])
    if np.linalg.det(rotation) < 0:
        raise DegenerateInputError(
            field="P",
            expected="a camera that sees the points as they are",
            seen="a mirrored view",
            cure="Check the handedness of the points' frame, and that images are not flipped.",
        )
    k = calibration_matrix(px, py, cx, cy)
    translation = np.linalg.solve(k, matrix[:, 3]).astype(np.float64)
    return k, nearest_rotation(rotation), translation


def calibrate_faugeras(
    points: Array, pixels: Array, size: tuple[int, int], known: Known | None = None
) -> CalibratedCamera:
    """Find a camera without skew and distortion; see `OneCameraMethod`, nothing needs to be known."""
    del known
    k, rotation, translation = decompose_closed(fit_projection_unit_axis(points, pixels))
    return posed(camera_model(size, k), rotation, translation, points, pixels)
