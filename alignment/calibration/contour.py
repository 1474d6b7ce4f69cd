"""Where a round mark's imaged contour has its centre, against the projection of the mark's own centre."""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array
from alignment.geometry.distortion import project_normalised
from alignment.kernels import njit

_STEPS = 12
_TURNS = 2.0 * math.pi * np.arange(_STEPS) / _STEPS
_COS, _SIN = np.cos(_TURNS), np.sin(_TURNS)


@njit(cache=True, nogil=True, error_model="numpy")
def contour_shift(
    centre: Array, along_x: Array, along_y: Array, radius: float, packed: Array
) -> tuple[float, float, bool]:
    """Shift (du, dv), pixels, from the image of a circle's centre to the centre of its imaged contour.

    The contour is projected point by point, brought back by the inverse of its linear part, and the centre of
    the near-circle that results is the first harmonic of its radius: what a fitted ellipse has for a centre,
    up to the third order of radius over distance.

    Parameters
    ----------
    centre
        (3,) of the circle, camera frame, millimetres.
    along_x, along_y
        (3,) unit directions of its plane, camera frame.
    radius
        Millimetres.
    packed
        Camera (`CameraModel.packed`).

    Returns
    -------
    du, dv, ok
        False where the camera does not see the whole contour.
    """
    if not centre[2] > 1e-9:
        return 0.0, 0.0, False
    u0, v0, ok = project_normalised(centre[0] / centre[2], centre[1] / centre[2], packed)
    u, v = np.empty(_STEPS), np.empty(_STEPS)
    a00 = a01 = a10 = a11 = 0.0
    for k in range(_STEPS):
        c, s = _COS[k], _SIN[k]
        x = centre[0] + radius * (c * along_x[0] + s * along_y[0])
        y = centre[1] + radius * (c * along_x[1] + s * along_y[1])
        z = centre[2] + radius * (c * along_x[2] + s * along_y[2])
        if not z > 1e-9:
            return 0.0, 0.0, False
        pu, pv, seen = project_normalised(x / z, y / z, packed)
        ok = ok and seen
        u[k], v[k] = pu - u0, pv - v0
        a00 += u[k] * c
        a01 += u[k] * s
        a10 += v[k] * c
        a11 += v[k] * s
    det = a00 * a11 - a01 * a10
    if not ok or det == 0.0:
        return 0.0, 0.0, False
    # (a/half) maps the unit circle to the contour's first harmonic.
    half = _STEPS / 2.0
    scale = half / det
    sx = sy = 0.0
    for k in range(_STEPS):
        c, s = _COS[k], _SIN[k]
        px = scale * (a11 * u[k] - a01 * v[k])
        py = scale * (a00 * v[k] - a10 * u[k])
        excess = math.sqrt(px * px + py * py) - 1.0
        sx += excess * c
        sy += excess * s
    sx, sy = sx / half, sy / half
    return (a00 * sx + a01 * sy) / half, (a10 * sx + a11 * sy) / half, True
