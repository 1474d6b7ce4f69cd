"""A head in the normal case of stereo: both images seen along one virtual axis, rows along epipolar lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.distortion import unproject_near
from alignment.kernels import njit
from alignment.values import RigCalibration

Array = NDArray[np.float64]

_TOLERANCE = 1e-4  # of Newton's step, radians; what is left is a hundred-thousandth of a pixel
_STRIDE = 8  # points that start from the same neighbour, so that they need not wait for each other


@dataclass(frozen=True, eq=False)
class Rectification:
    """The rectified frame of a head: origin in the left camera's centre, x towards the right camera's.

    A point (x, y, z) of it appears at u = x/z, v = y/z on the left and u = (x − baseline)/z, same v, on the
    right, so its depth is baseline / (u_left − u_right).

    Attributes
    ----------
    rectified_from_rig
        (3, 3) rotation.
    origin
        (3,) centre of the left camera, rig frame, millimetres.
    baseline
        Distance of the cameras' centres, millimetres.
    """

    rectified_from_rig: Array
    origin: Array
    baseline: float

    @classmethod
    def of(cls, left: PosedCamera, right: PosedCamera) -> Rectification:
        """Build from the two posed cameras of a head.

        Raises
        ------
        DegenerateInputError
            When the centres coincide or the cameras look along the baseline.
        """
        base = right.rig_from_camera.translation - left.rig_from_camera.translation
        length = float(np.linalg.norm(base))
        axis = left.rig_from_camera.rotation[:, 2] + right.rig_from_camera.rotation[:, 2]
        if length < 1e-6 or np.linalg.norm(np.cross(base / max(length, 1e-6), axis)) < 0.2:
            raise DegenerateInputError(
                field="rig_from_camera",
                expected="two cameras side by side that look the same way",
                seen=f"a baseline of {length:.3f} mm",
            )
        x = base / length
        y = np.cross(axis, x)
        y /= np.linalg.norm(y)
        return cls(np.array([x, y, np.cross(x, y)]), left.rig_from_camera.translation, length)

    def coordinates(self, camera: PosedCamera, pixels: Array) -> tuple[Array, int]:
        """Rectified (u, v) of pixels (N, 2), and how many pixels the lens model cannot invert."""
        turn = self.rectified_from_rig @ camera.rig_from_camera.rotation
        uv = np.empty((len(pixels), 2))
        bad = rectify(np.ascontiguousarray(pixels), camera.model.packed(), turn, uv)
        return uv, int(bad)


@njit(cache=True, nogil=True, error_model="numpy")
def rectify(pixels: Array, packed: Array, turn: Array, out: Array) -> int:
    """Rectified (u, v) of pixels (N, 2) of a packed camera into the first rows of `out`.

    `turn` rotates camera to rectified axes. Returns how many pixels the lens model cannot invert. Quick where
    neighbours in the list are neighbours in the image: the distortion of one starts the next.
    """
    bad = 0
    aside_x = aside_y = 0.0
    for i in range(pixels.shape[0]):
        x, y, ok, dx, dy = unproject_near(pixels[i, 0], pixels[i, 1], packed, aside_x, aside_y, _TOLERANCE)
        if i % _STRIDE == 0:
            aside_x, aside_y = dx, dy
        z = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2]
        scale = 1.0 / z
        out[i, 0] = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2]) * scale
        out[i, 1] = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2]) * scale
        bad += not (ok and z > 0.0)
    return bad


@lru_cache(maxsize=32)
def epipolar_directions(calibration: RigCalibration) -> Array:
    """Unit directions (2 × heads, 2) of the epipolar lines in the middle of each image, left before right."""
    out = []
    for head in calibration.heads:
        base = head.right.rig_from_camera.translation - head.left.rig_from_camera.translation
        for camera in head.cameras:
            # The image of a step along the baseline from the point on the optical axis.
            step = camera.rig_from_camera.rotation.T @ base
            direction = np.array([step[0] * camera.model.fx, step[1] * camera.model.fy])
            out.append(direction / max(float(np.linalg.norm(direction)), 1e-12))
    return np.array(out)
