"""Lens distortion in normalised coordinates (x/z, y/z): compiled kernels, one layout for all models.

Models and the coefficients they carry:

``division`` (d)
    The thesis's model (3.33, 4.1): undistorted = distorted / (1 + d ρ²), ρ the distorted radius.
    Its inverse is closed.
``brown`` (k1, k2, p1, p2, k3 [, k4, k5, k6 [, s1, s2, s3, s4 [, tau_x, tau_y]]])
    Brown–Conrady with, in order of length 5, 8, 12, 14: radial and decentering terms, a rational radial
    part, thin prism, a tilted sensor. Same definition and order as OpenCV's ``distCoeffs``.

A packed camera is a float64 vector: fx, fy, cx, cy, skew, kind (0 division, 1 brown), 14 coefficients.
"""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array
from alignment.kernels import njit

PACKED_SIZE = 20
DIVISION, BROWN = 0.0, 1.0
COEFFICIENT_NAMES = {
    "division": (("d",),),
    "brown": tuple(
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")[:n]
        for n in (5, 8, 12, 14)
    ),
}
FOLDED = 1e-6  # determinant of the Jacobian at which a polynomial folds: no inverse there
_NEWTON_STEPS = 30
_NEWTON_TOLERANCE = 1e-9  # of a step; the next, quadratically smaller, would be below rounding


@njit(cache=True, nogil=True, error_model="numpy")
def _tilt(
    c: Array,
) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
    """Rows of R(tau) = Ry(tau_y) Rx(tau_x) as OpenCV orders them."""
    ct, st = math.cos(c[12]), math.sin(c[12])
    cs, ss = math.cos(c[13]), math.sin(c[13])
    return (cs, ss * st, -ss * ct), (0.0, ct, st), (ss, -cs * st, cs * ct)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def lens_distort(x: float, y: float, c: Array) -> tuple[float, float, float, float, float, float]:
    """`brown_distort` without the tilt of the sensor."""
    k1, k2, p1, p2, k3 = c[0], c[1], c[2], c[3], c[4]
    r2 = x * x + y * y
    num = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    dnum = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)
    den = 1.0 + r2 * (c[5] + r2 * (c[6] + r2 * c[7]))
    dden = c[5] + r2 * (2.0 * c[6] + r2 * 3.0 * c[7])
    share = 1.0 / den
    g = num * share
    dg = (dnum - g * dden) * share
    gx, gy = 2.0 * x * dg, 2.0 * y * dg
    xd = x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (c[8] + c[9] * r2)
    yd = y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (c[10] + c[11] * r2)
    px = c[8] + 2.0 * c[9] * r2
    py = c[10] + 2.0 * c[11] * r2
    jxx = g + x * gx + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * x * px
    jxy = x * gy + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * y * px
    jyx = y * gx + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * x * py
    jyy = g + y * gy + 6.0 * p1 * y + 2.0 * p2 * x + 2.0 * y * py
    return xd, yd, jxx, jxy, jyx, jyy


@njit(cache=True, nogil=True, error_model="numpy")
def brown_distort(x: float, y: float, c: Array) -> tuple[float, float, float, float, float, float]:
    """Distort one undistorted point; also its 2 × 2 Jacobian, as (xd, yd, dxd/dx, dxd/dy, dyd/dx, dyd/dy)."""
    xd, yd, jxx, jxy, jyx, jyy = lens_distort(x, y, c)
    if c[12] == 0.0 and c[13] == 0.0:
        return xd, yd, jxx, jxy, jyx, jyy
    # Sensor tilted by tau_x, tau_y (Louhichi et al. 2007): a homography after the distortion.
    (r11, r12, r13), (r21, r22, r23), (r31, r32, r33) = _tilt(c)
    u = r11 * xd + r12 * yd + r13
    v = r21 * xd + r22 * yd + r23
    w = r31 * xd + r32 * yd + r33
    # Projection back onto the untilted plane: diag(r33, r33, 1) with the shift that keeps the origin.
    xt = (r33 * u - r13 * w) / w
    yt = (r33 * v - r23 * w) / w
    a11 = (r33 * r11 - (xt + r13) * r31) / w
    a12 = (r33 * r12 - (xt + r13) * r32) / w
    a21 = (r33 * r21 - (yt + r23) * r31) / w
    a22 = (r33 * r22 - (yt + r23) * r32) / w
    return (
        xt,
        yt,
        a11 * jxx + a12 * jyx,
        a11 * jxy + a12 * jyy,
        a21 * jxx + a22 * jyx,
        a21 * jxy + a22 * jyy,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def brown_undistort(xd: float, yd: float, c: Array) -> tuple[float, float, bool]:
    """Undistort (xd, yd) by Newton's method; converged?"""
    x, y = xd, yd
    scale = 1.0 + abs(xd) + abs(yd)
    for _ in range(_NEWTON_STEPS):
        fx, fy, jxx, jxy, jyx, jyy = brown_distort(x, y, c)
        det = jxx * jyy - jxy * jyx
        if not det > FOLDED:  # the polynomial has folded: no inverse here
            return x, y, False
        ex, ey = fx - xd, fy - yd
        share = 1.0 / det
        dx = (jyy * ex - jxy * ey) * share
        dy = (jxx * ey - jyx * ex) * share
        x -= dx
        y -= dy
        if abs(dx) + abs(dy) < _NEWTON_TOLERANCE * scale:
            return x, y, True
    return x, y, abs(dx) + abs(dy) < 1e-11 * scale


@njit(cache=True, nogil=True, error_model="numpy")
def division_distort(x: float, y: float, d: float) -> tuple[float, float, bool]:
    """Distort one point of the division model; False where the lens images no such ray."""
    disc = 1.0 - 4.0 * d * (x * x + y * y)
    if not disc > 0.0:
        return x, y, False
    s = 2.0 / (1.0 + math.sqrt(disc))
    return x * s, y * s, True


@njit(cache=True, nogil=True, error_model="numpy")
def lens_from_pixel(p: Array) -> Array:
    """(3, 3) homography from pixels of a packed camera to what its lens makes of (x/z, y/z), without tilt."""
    out = np.zeros((3, 3))
    out[0, 0], out[0, 1] = 1.0 / p[0], -p[4] / (p[0] * p[1])
    out[0, 2] = -(p[2] - p[4] * p[3] / p[1]) / p[0]
    out[1, 1], out[1, 2], out[2, 2] = 1.0 / p[1], -p[3] / p[1], 1.0
    if p[5] == DIVISION or (p[18] == 0.0 and p[19] == 0.0):
        return out
    # The inverse of the projection in `brown_distort`: back onto the tilted plane, then turned back.
    rows = _tilt(p[6:])
    plane = np.zeros((3, 3))
    for a in range(2):
        plane[a, a] = 1.0 / rows[2][2]
    plane[0, 2], plane[1, 2], plane[2, 2] = rows[0][2] / rows[2][2], rows[1][2] / rows[2][2], 1.0
    turned = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for m in range(3):
                turned[a, b] += rows[m][a] * plane[m, b]
    whole = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for m in range(3):
                whole[a, b] += turned[a, m] * out[m, b]
    return whole


@njit(cache=True, nogil=True, error_model="numpy")
def unproject_pixel(u: float, v: float, p: Array) -> tuple[float, float, bool]:
    """Normalised undistorted coordinates (x/z, y/z) of one pixel of a packed camera."""
    yd = (v - p[3]) / p[1]
    xd = (u - p[2] - p[4] * yd) / p[0]
    if p[5] == DIVISION:
        g = 1.0 + p[6] * (xd * xd + yd * yd)
        return xd / g, yd / g, g > 0.0
    return brown_undistort(xd, yd, p[6:])


@njit(cache=True, nogil=True, error_model="numpy")
def project_normalised(x: float, y: float, p: Array) -> tuple[float, float, bool]:
    """Pixel of normalised undistorted coordinates of one packed camera."""
    ok = True
    if p[5] == DIVISION:
        xd, yd, ok = division_distort(x, y, p[6])
    else:
        xd, yd, jxx, jxy, jyx, jyy = brown_distort(x, y, p[6:])
        ok = jxx * jyy - jxy * jyx > FOLDED
    return p[0] * xd + p[4] * yd + p[2], p[1] * yd + p[3], ok


@njit(cache=True, nogil=True, error_model="numpy")
def unproject_many(pixels: Array, p: Array) -> tuple[Array, int]:
    """Normalised coordinates (N, 2) of pixels (N, 2), and how many have no ray."""
    out = np.empty_like(pixels)
    bad = 0
    for i in range(pixels.shape[0]):
        x, y, ok = unproject_pixel(pixels[i, 0], pixels[i, 1], p)
        out[i, 0], out[i, 1] = x, y
        bad += not ok
    return out, bad


@njit(cache=True, nogil=True, error_model="numpy")
def project_many(xy: Array, p: Array) -> tuple[Array, int]:
    """Pixels (N, 2) of normalised coordinates (N, 2), and how many the lens does not image."""
    out = np.empty_like(xy)
    bad = 0
    for i in range(xy.shape[0]):
        u, v, ok = project_normalised(xy[i, 0], xy[i, 1], p)
        out[i, 0], out[i, 1] = u, v
        bad += not ok
    return out, bad
