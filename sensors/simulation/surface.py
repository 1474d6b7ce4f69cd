"""The analytic sidewall: a spline of revolution, a relief and a deformation on it, and where a ray meets it.

In the tyre frame (z outboard along the axis of revolution) the surface is the height field

    z(r, θ) = P(r) + B(r, θ) + D(r, θ)

with P a uniform cubic B-spline; B, the lettering, and D, what load and run-out do to the tyre, uniform
bicubic B-splines that are periodic in θ. The control values *are* the definition, so heights, gradients and
ray intersections are exact to rounding. Without D the kernels are compiled without a trace of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from alignment.arrays import Array, Mask, Singles
from alignment.kernels import njit

# A quotient may become a product, a product and a sum one operation: rounding errors stay far below 1e-9 mm.
kernel = njit(cache=True, nogil=True, error_model="numpy", fastmath={"arcp", "contract"})
"""Decorator of the compiled functions that Python calls."""

part = njit(cache=True, nogil=True, error_model="numpy", fastmath={"arcp", "contract"}, forceinline=True)
"""Decorator of what they call for every sample; without forced inlining the calls take half the time."""

BLOCK = 8
_MAX_STEPS = 16
_CLOSE_MM = 1e-3
_LARGEST_STEP_MM = 3.0


class Surface(NamedTuple):
    """What the compiled kernels read of a tyre; lengths in millimetres.

    Attributes
    ----------
    scales
        (6,) radius of the first control value of P and their spacing; the same of the rows of B and of D.
    profile
        (N,) control values of P.
    relief
        (rows over r, columns over θ from −π) control values of B.
    occupied
        Which blocks of `BLOCK` × `BLOCK` spline cells of B are not flat.
    deformation
        (rows over r, columns over θ from −π) control values of D; None for a tyre that is not deformed.
    """

    scales: Array
    profile: Array
    relief: Singles
    occupied: Mask
    deformation: Array | None = None


def occupied_blocks(relief: Singles) -> Mask:
    """Tell which blocks of spline cells feel a control value other than zero; columns are periodic."""
    rows, columns = relief.shape
    used = relief != 0.0
    felt = np.zeros((-(-rows // BLOCK) * BLOCK, -(-columns // BLOCK) * BLOCK), dtype=np.bool_)
    for dr in range(-1, 3):
        for dc in range(-1, 3):
            shifted = np.roll(used, (-dr, -dc), axis=(0, 1))
            felt[:rows, :columns] |= shifted
    blocks = felt.reshape(felt.shape[0] // BLOCK, BLOCK, felt.shape[1] // BLOCK, BLOCK)
    return np.asarray(blocks.any(axis=(1, 3)))


@part
def _weights(f: float) -> tuple[float, float, float, float]:
    g = 1.0 - f
    return (
        g * g * g / 6.0,
        (4.0 - 6.0 * f * f + 3.0 * f * f * f) / 6.0,
        (4.0 - 6.0 * g * g + 3.0 * g * g * g) / 6.0,
        f * f * f / 6.0,
    )


@part
def _slopes(f: float) -> tuple[float, float, float, float]:
    g = 1.0 - f
    return -0.5 * g * g, f * (1.5 * f - 2.0), g * (2.0 - 1.5 * g), 0.5 * f * f


@part
def _relief(row: float, column: float, relief: Singles | Array) -> tuple[float, float, float]:
    """B or D and its derivatives along row and column, in units of the grid."""
    i, j = int(row), int(column)
    w0, w1, w2, w3 = _weights(column - j)
    s0, s1, s2, s3 = _slopes(column - j)
    n = relief.shape[1]
    j0, j1, j2, j3 = (j + n - 1) % n, j % n, (j + 1) % n, (j + 2) % n
    wr, sr = _weights(row - i), _slopes(row - i)
    value, along_row, along_column = 0.0, 0.0, 0.0
    for a in range(4):
        k = i - 1 + a
        c0, c1, c2, c3 = relief[k, j0], relief[k, j1], relief[k, j2], relief[k, j3]
        line = w0 * c0 + w1 * c1 + w2 * c2 + w3 * c3
        value += wr[a] * line
        along_row += sr[a] * line
        along_column += wr[a] * (s0 * c0 + s1 * c1 + s2 * c2 + s3 * c3)
    return value, along_row, along_column


# The kernels below take a surface's arrays one by one: a tuple of arrays costs reference counting in every
# call, which is slower than the arithmetic.


@kernel
def relief_near(x: float, y: float, reach: float, scales: Array, relief: Singles, occupied: Mask) -> bool:
    """Tell whether the relief may differ from zero within `reach` (under a block's size) of (x, y)."""
    rows, columns = occupied.shape
    row = (math.sqrt(x * x + y * y) - scales[2]) / scales[3]
    column = (math.atan2(y, x) / (2.0 * math.pi) + 0.5) * relief.shape[1]
    step = reach / scales[3]
    first, last = math.floor((row - step) / BLOCK), math.floor((row + step) / BLOCK)
    left, right = math.floor((column - step) / BLOCK), math.floor((column + step) / BLOCK)
    for i in range(max(first, 0), min(last + 1, rows)):
        # The last block of a turn may be short: look one further across the seam.
        for j in range(left - (left < 0), right + 1 + (right >= columns - 1)):
            if occupied[i, j % columns]:
                return True
    return False


@part
def height(
    x: float, y: float, scales: Array, profile: Array, relief: Singles, deformation: Array | None,
    with_relief: bool,
) -> tuple[float, float, float, float, bool]:  # fmt: skip
    """Height z, its derivatives along x and y, the relief's share of z, and whether (x, y) is on the tyre.

    `with_relief` false leaves out the relief, where `relief_near` knows of none.
    """
    r2 = x * x + y * y
    r = math.sqrt(r2)
    u = (r - scales[0]) / scales[1]
    k = int(u)
    if not (u >= 1.0 and k + 2 < profile.shape[0]):
        return 0.0, 0.0, 0.0, 0.0, False
    w, d = _weights(u - k), _slopes(u - k)
    p0, p1, p2, p3 = profile[k - 1], profile[k], profile[k + 1], profile[k + 2]
    z = w[0] * p0 + w[1] * p1 + w[2] * p2 + w[3] * p3
    zr = (d[0] * p0 + d[1] * p1 + d[2] * p2 + d[3] * p3) / scales[1]
    zx, zy = zr * x / r, zr * y / r
    bump = 0.0
    if with_relief:
        row = (r - scales[2]) / scales[3]
        if row >= 1.0 and row < relief.shape[0] - 2:
            n = relief.shape[1]
            bump, br, bc = _relief(row, (math.atan2(y, x) / (2.0 * math.pi) + 0.5) * n, relief)
            br /= scales[3]
            bt = bc * n / (2.0 * math.pi)
            z += bump
            zx += br * x / r - bt * y / r2
            zy += br * y / r + bt * x / r2
    if deformation is not None:
        row = (r - scales[4]) / scales[5]
        if row >= 1.0 and row < deformation.shape[0] - 2:
            n = deformation.shape[1]
            lift, dr, dc = _relief(row, (math.atan2(y, x) / (2.0 * math.pi) + 0.5) * n, deformation)
            dr /= scales[5]
            dt = dc * n / (2.0 * math.pi)
            z += lift
            zx += dr * x / r - dt * y / r2
            zy += dr * y / r + dt * x / r2
    return z, zx, zy, bump, True


@part
def meet_surface(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, t: float,
    scales: Array, profile: Array, relief: Singles, deformation: Array | None, with_relief: bool,
) -> tuple[float, float, float, float, bool]:  # fmt: skip
    """Where the ray o + t d meets the surface, by Newton's method from a nearby t.

    Returns t, the derivatives of the height along x and y there, the relief, and whether it converged. The
    last step is below a micrometre, and the error of a Newton iterate is the square of the step before times
    half the curvature, so the point is right to nanometres; the gradient is taken one step earlier.
    """
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    limit = _LARGEST_STEP_MM / length
    zx, zy, bump = 0.0, 0.0, 0.0
    for _ in range(_MAX_STEPS):
        z, zx, zy, bump, inside = height(
            ox + t * dx, oy + t * dy, scales, profile, relief, deformation, with_relief
        )
        if not inside:
            return t, zx, zy, bump, False
        rate = dz - zx * dx - zy * dy
        if rate > -0.02 * length:  # seen from behind, or grazing: no trustworthy crossing
            return t, zx, zy, bump, False
        step = min(max((z - oz - t * dz) / rate, -limit), limit)
        t += step
        if abs(step) * length < _CLOSE_MM:
            return t, zx, zy, bump, True
    return t, zx, zy, bump, False


@kernel
def heights(
    xy: Array, scales: Array, profile: Array, relief: Singles, deformation: Array | None = None
) -> tuple[Array, Mask]:
    """Rows (z, dz/dx, dz/dy, relief) of points (N, 2), and which lie on the tyre."""
    out = np.empty((xy.shape[0], 4))
    inside = np.empty(xy.shape[0], dtype=np.bool_)
    for i in range(xy.shape[0]):
        z, zx, zy, bump, on = height(xy[i, 0], xy[i, 1], scales, profile, relief, deformation, True)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = z, zx, zy, bump
        inside[i] = on
    return out, inside
