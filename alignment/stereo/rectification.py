"""A head in the normal case of stereo: both images seen along one virtual axis, rows along epipolar lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.distortion import DIVISION, FOLDED, lens_distort, lens_from_pixel
from alignment.kernels import njit
from alignment.values import RigCalibration

_TOLERANCE = 1e-4  # of Newton's steps, radians; what is left is a hundred-thousandth of a pixel
_MOST_STEPS = 30
_BLOCK = 128  # pixels


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


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def rectify(pixels: Array, packed: Array, turn: Array, out: Array) -> int:
    """Rectified (u, v) of pixels (N, 2) of a packed camera into the first rows of `out`.

    `turn` rotates camera to rectified axes. Returns how many pixels the lens model cannot invert. Quick where
    neighbours in the list are neighbours in the image: the distortion of one starts the next.
    """
    lens, c, division = lens_from_pixel(packed), packed[6:].copy(), packed[5] == DIVISION
    # By blocks, each step a loop without branches, which compilers turn into vector instructions.
    block = np.zeros((5, _BLOCK))
    given_x, given_y, x, y, det = block[0], block[1], block[2], block[3], block[4]
    aside_x = aside_y = 0.0
    bad = 0
    for begin in range(0, pixels.shape[0], _BLOCK):
        count = min(_BLOCK, pixels.shape[0] - begin)
        for i in range(count):
            x[i], y[i] = pixels[begin + i, 0], pixels[begin + i, 1]
        for i in range(count, _BLOCK):
            x[i], y[i] = x[count - 1], y[count - 1]
        for i in range(_BLOCK):
            w = 1.0 / (lens[2, 0] * x[i] + lens[2, 1] * y[i] + lens[2, 2])
            given_x[i] = (lens[0, 0] * x[i] + lens[0, 1] * y[i] + lens[0, 2]) * w
            given_y[i] = (lens[1, 0] * x[i] + lens[1, 1] * y[i] + lens[1, 2]) * w
            x[i], y[i] = given_x[i] + aside_x, given_y[i] + aside_y
        if division:
            for i in range(_BLOCK):
                det[i] = 1.0 + c[0] * (given_x[i] * given_x[i] + given_y[i] * given_y[i])
                x[i], y[i] = given_x[i] / det[i], given_y[i] / det[i]
        else:
            for _ in range(_MOST_STEPS):
                moved = 0.0
                for i in range(_BLOCK):
                    fx, fy, jxx, jxy, jyx, jyy = lens_distort(x[i], y[i], c)
                    det[i] = jxx * jyy - jxy * jyx
                    ex, ey = fx - given_x[i], fy - given_y[i]
                    # Where the polynomial has folded there is no inverse: such a point stays.
                    share = 1.0 / det[i] if det[i] > FOLDED else 0.0
                    dx, dy = (jyy * ex - jxy * ey) * share, (jxx * ey - jyx * ex) * share
                    x[i] -= dx
                    y[i] -= dy
                    moved += dx * dx + dy * dy
                if moved < _TOLERANCE**2:
                    break
            else:
                for i in range(_BLOCK):
                    fx, fy, _, _, _, _ = lens_distort(x[i], y[i], c)
                    det[i] = det[i] if abs(fx - given_x[i]) + abs(fy - given_y[i]) < _TOLERANCE else 0.0
            last = count - 1
            # What the next block starts from; not from a point without an inverse.
            aside_x = x[last] - given_x[last] if det[last] > FOLDED else 0.0
            aside_y = y[last] - given_y[last] if det[last] > FOLDED else 0.0
        for i in range(_BLOCK):
            z = turn[2, 0] * x[i] + turn[2, 1] * y[i] + turn[2, 2]
            given_x[i] = (turn[0, 0] * x[i] + turn[0, 1] * y[i] + turn[0, 2]) / z
            given_y[i] = (turn[1, 0] * x[i] + turn[1, 1] * y[i] + turn[1, 2]) / z
            det[i] = min(det[i], z)
        for i in range(count):
            out[begin + i, 0], out[begin + i, 1] = given_x[i], given_y[i]
            bad += not det[i] > FOLDED
    return bad


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
