"""Tsai: one camera from points in space, with the uncertainty of the x scale factor (thesis 3.3.3)."""

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
from alignment.geometry.projective import null_vector


def calibrate_tsai(
    points: Array, pixels: Array, size: tuple[int, int], known: Known | None = None
) -> CalibratedCamera:
    """Find focal lengths and pose from points in space; see `OneCameraMethod`.

    `known.centre` is believed, `known.aspect` is only a start: the factor u by which it is wrong is found,
    and the result does not depend on it at all. Distortion is not estimated, but radial distortion about the
    believed centre leaves the rotation, t_x, t_y and u untouched (radial alignment).

    Raises
    ------
    DegenerateInputError
        For fewer than 7 points, points in one plane, or points that fit no camera.
    """
    known = known or Known()
    points, pixels = checked(points, pixels, 7)
    require_spread(points, 3)
    cx, cy = known.centre_in(size)
    xi, eta = (pixels[:, 0] - cx) / known.aspect, pixels[:, 1] - cy
    x1 = np.column_stack([points, np.ones(len(points))])

    solution, uniqueness = null_vector(np.column_stack([eta[:, None] * x1, -xi[:, None] * x1]))
    if uniqueness < 1e-9:
        raise DegenerateInputError(
            field="points", expected="points that fix the camera's direction", seen="several solutions"
        )
    scale_x, scale_y = np.linalg.norm(solution[:3]), np.linalg.norm(solution[4:7])
    u = scale_x / scale_y
    first, second = solution[:4] / scale_x, solution[4:] / scale_y
    # The point farthest from the centre tells the common sign: camera and image coordinates agree in it.
    far = np.argmax(np.hypot(xi, eta))
    if (x1[far] @ first) * xi[far] + (x1[far] @ second) * eta[far] < 0:
        first, second = -first, -second
    rotation = nearest_rotation(np.array([first[:3], second[:3], np.cross(first[:3], second[:3])]))

    xi = xi / u
    in_camera = points @ rotation.T
    xc, yc, depth = in_camera[:, 0] + first[3], in_camera[:, 1] + second[3], in_camera[:, 2]
    system = np.column_stack([np.concatenate([xc, yc]), -np.concatenate([xi, eta])])
    f, tz = np.linalg.lstsq(system, np.concatenate([xi, eta]) * np.tile(depth, 2), rcond=None)[0]
    if not f > 0:
        raise DegenerateInputError(
            field="points, pixels",
            expected="a view of the points as they are",
            seen="one that only a mirrored camera has",
            cure="Check the handedness of the points' frame, and that images are not flipped.",
        )
    model = camera_model(size, calibration_matrix(known.aspect * u * f, f, cx, cy))
    return posed(model, rotation, np.array([first[3], second[3], tz]), points, pixels)
