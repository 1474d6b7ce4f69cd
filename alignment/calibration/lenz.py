"""Lenz: one camera from marks of one plane; scale factors and centre from the data sheet (thesis 3.3.2)."""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array
from alignment.calibration.one_camera import (
    CalibratedCamera,
    Known,
    calibration_matrix,
    camera_model,
    checked,
    posed,
    require_spread,
)
from alignment.errors import DegenerateInputError
from alignment.geometry.projective import null_vector

_SMALLEST_SLANT = 1e-3


def calibrate_lenz(
    points: Array, pixels: Array, size: tuple[int, int], known: Known | None = None
) -> CalibratedCamera:
    """Find focal length and pose from points of one plane z = const; see `OneCameraMethod`.

    The radial alignment x̂ (r₄x + r₅y + t_y) = ŷ (r₁x + r₂y + t_x) is linear in the six unknowns up to their
    scale. The upper left 2 × 2 block of a rotation has largest singular value 1, which gives the scale (the
    closed formula of the thesis for t_y is that singular value written out). Rows 7 and 8 follow from the
    unit length of the columns, f and t_z from a linear system.

    Its weakness is of its kind: f and t_z separate only by the plate's slant to the image, and an error of
    `known.aspect` reads as slant.

    Raises
    ------
    DegenerateInputError
        For fewer than 5 points, points on a line or of several heights, or a plate parallel to the image.
    """
    known = known or Known()
    points, pixels = checked(points, pixels, 5)
    require_spread(points, 2)
    height = points[:, 2].mean()
    if np.ptp(points[:, 2]) > 1e-3 * np.ptp(points[:, :2], axis=0).max():
        raise DegenerateInputError(
            field="points",
            expected="points of one height z",
            seen=f"heights that differ by {np.ptp(points[:, 2]):.3g} mm",
            cure="Give the marks of one plate position, or take the method 'tsai'.",
        )
    x, y = points[:, 0], points[:, 1]
    cx, cy = known.centre_in(size)
    xi, eta = (pixels[:, 0] - cx) / known.aspect, pixels[:, 1] - cy

    rows = np.column_stack([eta * x, eta * y, eta, -xi * x, -xi * y, -xi])
    aligned, uniqueness = null_vector(rows)
    if uniqueness < 1e-9:
        raise DegenerateInputError(
            field="points", expected="points that fix the plate's direction", seen="several solutions"
        )
    r1, r2, tx, r4, r5, ty = aligned / np.linalg.norm(aligned[[[0, 1], [3, 4]]], 2)
    r7 = math.sqrt(max(0.0, 1.0 - r1**2 - r4**2))
    r8 = math.sqrt(max(0.0, 1.0 - r2**2 - r5**2)) * (-1.0 if r1 * r2 + r4 * r5 > 0 else 1.0)
    if math.hypot(r7, r8) < _SMALLEST_SLANT:
        raise DegenerateInputError(
            field="points",
            expected="a plate that is slanted to the image",
            seen="one parallel to it, which leaves focal length and distance open",
            cure="Tilt the plate by 30°, or use several heights and the method 'tsai'.",
        )

    depth = r7 * x + r8 * y
    xc, yc = r1 * x + r2 * y + tx, r4 * x + r5 * y + ty
    system = np.column_stack([np.concatenate([xc, yc]), -np.concatenate([xi, eta])])
    f, tz = np.linalg.lstsq(system, np.concatenate([xi, eta]) * np.tile(depth, 2), rcond=None)[0]
    # (r7, r8) and the other six are each known up to their sign: t_z > 0 and f > 0 decide.
    if tz < 0:
        r7, r8, f, tz = -r7, -r8, -f, -tz
    if f < 0:
        r1, r2, tx, r4, r5, ty, f = -r1, -r2, -tx, -r4, -r5, -ty, -f
    first, second = np.array([r1, r4, r7]), np.array([r2, r5, r8])
    rotation = np.column_stack([first, second, np.cross(first, second)])
    translation = np.array([tx, ty, tz]) - height * rotation[:, 2]
    model = camera_model(size, calibration_matrix(known.aspect * f, f, cx, cy))
    return posed(model, rotation, translation, points, pixels)
