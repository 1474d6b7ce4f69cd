"""Projection of a camera with its derivatives by every parameter: compiled kernels."""

from __future__ import annotations

import math

from alignment.arrays import Array
from alignment.geometry.distortion import DIVISION, brown_distort
from alignment.kernels import njit

COEFFICIENTS = 14
INTRINSICS = 4 + COEFFICIENTS
# Tuples: arrays would be taken from the heap for every point.
_Row = tuple[float, float, float]
_Matrix = tuple[_Row, _Row, _Row]


@njit(cache=True, nogil=True, error_model="numpy")
def _rotations(tau_x: float, tau_y: float) -> tuple[_Matrix, _Matrix, _Matrix]:
    """R(τ) of the tilted sensor and its derivatives by τx and τy."""
    ct, st, cs, ss = math.cos(tau_x), math.sin(tau_x), math.cos(tau_y), math.sin(tau_y)
    r = (cs, ss * st, -ss * ct), (0.0, ct, st), (ss, -cs * st, cs * ct)
    by_x = (0.0, ss * ct, ss * st), (0.0, -st, ct), (0.0, -cs * ct, -cs * st)
    by_y = (-ss, cs * st, -cs * ct), (0.0, 0.0, 0.0), (cs, ss * st, -ss * ct)
    return r, by_x, by_y


@njit(cache=True, nogil=True, error_model="numpy")
def brown_by_coefficients(x: float, y: float, c: Array, out: Array) -> None:
    """Derivatives (2, 14) of the distorted point by k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 τx τy, into `out`."""
    r2 = x * x + y * y
    r4 = r2 * r2
    num = 1.0 + r2 * (c[0] + r2 * (c[1] + r2 * c[4]))
    den = 1.0 + r2 * (c[5] + r2 * (c[6] + r2 * c[7]))
    g = num / den
    power = r2
    for up, down in ((0, 5), (1, 6), (4, 7)):
        out[0, up], out[1, up] = x * power / den, y * power / den
        out[0, down], out[1, down] = -x * g * power / den, -y * g * power / den
        power *= r2
    out[0, 2], out[1, 2] = 2.0 * x * y, r2 + 2.0 * y * y
    out[0, 3], out[1, 3] = r2 + 2.0 * x * x, 2.0 * x * y
    for k in range(8, 12):
        out[0, k], out[1, k] = 0.0, 0.0
    out[0, 8], out[0, 9], out[1, 10], out[1, 11] = r2, r4, r2, r4
    xd = x * g + 2.0 * c[2] * x * y + c[3] * (r2 + 2.0 * x * x) + r2 * (c[8] + c[9] * r2)
    yd = y * g + c[2] * (r2 + 2.0 * y * y) + 2.0 * c[3] * x * y + r2 * (c[10] + c[11] * r2)
    r, by_x, by_y = _rotations(c[12], c[13])
    u = r[0][0] * xd + r[0][1] * yd + r[0][2]
    v = r[1][0] * xd + r[1][1] * yd + r[1][2]
    w = r[2][0] * xd + r[2][1] * yd + r[2][2]
    # The tilt comes after the distortion: what the others did to the plane point goes through its Jacobian.
    if c[12] != 0.0 or c[13] != 0.0:
        a00 = (r[2][2] * (r[0][0] - u * r[2][0] / w)) / w
        a01 = (r[2][2] * (r[0][1] - u * r[2][1] / w)) / w
        a10 = (r[2][2] * (r[1][0] - v * r[2][0] / w)) / w
        a11 = (r[2][2] * (r[1][1] - v * r[2][1] / w)) / w
        for k in range(12):
            dx, dy = out[0, k], out[1, k]
            out[0, k] = a00 * dx + a01 * dy
            out[1, k] = a10 * dx + a11 * dy
    for k, d in ((12, by_x), (13, by_y)):
        du = d[0][0] * xd + d[0][1] * yd + d[0][2]
        dv = d[1][0] * xd + d[1][1] * yd + d[1][2]
        dw = d[2][0] * xd + d[2][1] * yd + d[2][2]
        out[0, k] = d[2][2] * u / w + r[2][2] * (du - u * dw / w) / w - d[0][2]
        out[1, k] = d[2][2] * v / w + r[2][2] * (dv - v * dw / w) / w - d[1][2]


@njit(cache=True, nogil=True, error_model="numpy")
def project_with_derivatives(
    x: float, y: float, z: float, p: Array, by_point: Array, by_intrinsics: Array
) -> tuple[float, float, bool]:
    """Pixel of a point in the camera frame; derivatives into the given arrays.

    Parameters
    ----------
    x, y, z
        Millimetres.
    p
        Packed camera (`CameraModel.packed`).
    by_point
        (2, 3) derivatives by x, y, z.
    by_intrinsics
        (2, 18) derivatives by fx, fy, cx, cy and the coefficients; of ``division`` only the first one.

    Returns
    -------
    u, v, ok
        False behind the camera and beyond the fold of the lens model.
    """
    if not z > 1e-9:
        return 0.0, 0.0, False
    a, b = x / z, y / z
    fx, fy, skew = p[0], p[1], p[4]
    coefficients = by_intrinsics[:, 4:]
    if p[5] == DIVISION:
        r2 = a * a + b * b
        root2 = 1.0 - 4.0 * p[6] * r2
        if not root2 > 0.0:
            return 0.0, 0.0, False
        root = math.sqrt(root2)
        s = 2.0 / (1.0 + root)
        ds = s * s / root  # of s by d·ρ²
        xd, yd = s * a, s * b
        slope = 2.0 * ds * p[6]
        jxx, jxy, jyx, jyy = s + slope * a * a, slope * a * b, slope * a * b, s + slope * b * b
        coefficients[0, 0], coefficients[1, 0] = a * ds * r2, b * ds * r2
    else:
        xd, yd, jxx, jxy, jyx, jyy = brown_distort(a, b, p[6:])
        if not jxx * jyy - jxy * jyx > 1e-6:
            return 0.0, 0.0, False
        brown_by_coefficients(a, b, p[6:], coefficients)
    for k in range(COEFFICIENTS):
        coefficients[0, k] = fx * coefficients[0, k] + skew * coefficients[1, k]
        coefficients[1, k] = fy * coefficients[1, k]
    by_intrinsics[0, 0], by_intrinsics[1, 0] = xd, 0.0
    by_intrinsics[0, 1], by_intrinsics[1, 1] = 0.0, yd
    by_intrinsics[0, 2], by_intrinsics[1, 2] = 1.0, 0.0
    by_intrinsics[0, 3], by_intrinsics[1, 3] = 0.0, 1.0
    uxx, uxy = fx * jxx + skew * jyx, fx * jxy + skew * jyy
    uyx, uyy = fy * jyx, fy * jyy
    by_point[0, 0], by_point[0, 1], by_point[0, 2] = uxx / z, uxy / z, -(uxx * a + uxy * b) / z
    by_point[1, 0], by_point[1, 1], by_point[1, 2] = uyx / z, uyy / z, -(uyx * a + uyy * b) / z
    return fx * xd + skew * yd + p[2], fy * yd + p[3], True
