"""How gloss moves light lines apart in the two images of a head, and back again.

The top of a light line's profile stands where profile times reflected light is greatest: where the light
grows across the line, that is σ² · d ln A/dx beside its middle. As far as both cameras see the same light
they take the same neighbouring place of the surface, and its depth is right. But a glossy skin sends more
light to one camera than to the other, and their ratio changes over the surface: by what the two shifts differ
the disparity errs, which makes some micrometres of depth over whole parts of a sidewall.

The ratio is seen along every line. A tyre is a body of revolution of one material, so along a circle the
ratio changes slowly: each ring of a millimetre and a half takes a parabola over the tangent of the angle,
neighbours smooth each other, and the derivatives of that model over radius and angle give the shifts.
"""

from __future__ import annotations

import math

import numpy as np

from alignment import robust
from alignment.arrays import Array, Index
from alignment.geometry.symmetric import solve
from alignment.kernels import njit
from alignment.stereo.correspondence import GAIN, LEAN, RATIO
from alignment.stereo.pool import PointPool

_RING = 1.5  # mm
_NEIGHBOURS = 2  # rings on either side that smooth one
_TERMS = 3  # of the parabola over the angle
_FEWEST = 12.0  # points in a ring and its neighbours
_UNDETERMINED = 1e-9  # left of a term's own information, below which points do not tell it
_CUT = 4.0  # robust deviations; letters and dirt reflect otherwise
_ROUNDS = 3
_SOME = 1500  # points of a head, or up to twice as many, that make its model
_LEAST_COSINE = 0.2  # of a point's angle from the middle of its head's points
_FARTHEST = 0.05  # mm; no gloss shifts a point more
_HOLD = (0.0, 1e-4, 1e-5)  # weak pull of the angle's terms to zero, relative to the weight


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,); numpy's takes seconds to compile."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True, nogil=True, error_model="numpy")
def _parabolas(ring: Index, angle: Array, ratio: Array, weight: Array, rings: int) -> Array:
    """Coefficients (R, 3) of the smoothed log ratio over the angle in each ring; NaN with too few points."""
    moments, right = np.zeros((rings, 2 * _TERMS - 1)), np.zeros((rings, _TERMS))
    for i in range(ring.size):
        w, a, k = weight[i], angle[i], ring[i]
        wr = w * ratio[i]
        for m in range(_TERMS):
            moments[k, m] += w
            right[k, m] += wr
            w, wr = w * a, wr * a
        moments[k, _TERMS] += w
        moments[k, _TERMS + 1] += w * a
    out = np.full((rings, _TERMS), np.nan)
    matrix, pull = np.empty((_TERMS, _TERMS)), np.empty((_TERMS, 1))
    for k in range(rings):
        matrix[:], pull[:] = 0.0, 0.0
        for j in range(max(0, k - _NEIGHBOURS), min(rings, k + _NEIGHBOURS + 1)):
            share = 1.0 - ((k - j) / (_NEIGHBOURS + 1.0)) ** 2
            for a in range(_TERMS):
                pull[a, 0] += share * right[j, a]
                for b in range(_TERMS):
                    matrix[a, b] += share * moments[j, a + b]
        total = matrix[0, 0]
        for a in range(_TERMS):
            matrix[a, a] += _HOLD[a] * total
        if total >= _FEWEST and solve(matrix, pull, _UNDETERMINED):
            for a in range(_TERMS):
                out[k, a] = pull[a, 0]
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _polar(points: Array, normal: Array, centre: Array) -> tuple[Array, Array, Array]:
    """Distance from the axis (N,), tangent of the angle from the points' middle (N,), outward unit (3, N)."""
    n = points.shape[0]
    radius, angle, outward = np.empty(n), np.empty(n), np.empty((3, n))
    nx, ny, nz = normal[0], normal[1], normal[2]
    cx, cy, cz = centre[0], centre[1], centre[2]
    out_x, out_y, out_z = outward[0], outward[1], outward[2]
    mean = np.zeros(3)
    for i in range(n):
        x, y, z = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
        height = x * nx + y * ny + z * nz
        x, y, z = x - height * nx, y - height * ny, z - height * nz
        radius[i] = math.sqrt(x * x + y * y + z * z)
        unit = 1.0 / max(radius[i], 1.0)
        out_x[i], out_y[i], out_z[i] = x * unit, y * unit, z * unit
        mean[0] += x * unit
        mean[1] += y * unit
        mean[2] += z * unit
    mean /= max(math.sqrt(mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2), 1e-9)
    side = _cross(normal, mean)
    for i in range(n):
        across = out_x[i] * side[0] + out_y[i] * side[1] + out_z[i] * side[2]
        ahead = out_x[i] * mean[0] + out_y[i] * mean[1] + out_z[i] * mean[2]
        angle[i] = across / max(ahead, _LEAST_COSINE)
    return radius, angle, outward


@njit(cache=True, nogil=True, error_model="numpy")
def _shifts(points: Array, light: Array, axes: Array, normal: Array, centre: Array, out: Array) -> None:
    """Write the way (N,) of one head's points along their rays, millimetres, into `out`."""
    n = points.shape[0]
    radius, angle, outward = _polar(points, normal, centre)
    start = radius.min()
    rings = int((radius.max() - start) / _RING) + 1
    stride = max(1, n // _SOME)
    some = (n + stride - 1) // stride
    ring, turn, ratio = np.empty(some, np.int64), np.empty(some), np.empty(some)
    for i in range(some):
        k = i * stride
        ring[i], turn[i] = int((radius[k] - start) / _RING), angle[k]
        ratio[i] = math.log(max(light[k, RATIO], 1e-6))
    weight, misfit, rest = np.ones(some), np.empty(some), np.empty(some)
    model = np.empty((0, 0))
    for _ in range(_ROUNDS):
        model = _parabolas(ring, turn, ratio, weight, rings)
        found = 0
        for i in range(some):
            c = model[ring[i]]
            misfit[i] = ratio[i] - (c[0] + turn[i] * (c[1] + turn[i] * c[2]))
            if not np.isnan(misfit[i]):
                rest[found] = abs(misfit[i])
                found += 1
        if found == 0:
            return
        limit = max(_CUT * robust.DEVIATION_OF_MEDIAN * np.median(rest[:found]), 1e-9)
        for i in range(some):
            u = misfit[i] / limit
            weight[i] = (1.0 - u * u) ** 2 if abs(u) < 1.0 else 0.0
    if rings < 4:
        return
    # Of each inner ring: what the coefficients rise per millimetre, and those of the slope over the angle.
    local = np.zeros((rings, 2 * _TERMS - 1))
    for k in range(1, rings - 1):
        for a in range(_TERMS):
            local[k, a] = (model[k + 1, a] - model[k - 1, a]) / (2.0 * _RING)
            if a > 0:
                local[k, _TERMS + a - 1] = a * model[k, a]
    # Steep lines were located along the rows, flat ones along the columns; what a direction meets of the
    # outward and of the tangential one is a product with these.
    along, around = np.empty((2, 3)), np.empty((2, 3))
    for line in range(2):
        along[line], around[line] = axes[:, line], _cross(axes[:, line], normal)
    for i in range(n):
        g = (radius[i] - start) / _RING - 0.5
        k = min(max(int(g), 1), rings - 3)
        t = min(max(g - k, 0.0), 1.0)
        low, high, turn = local[k], local[k + 1], angle[i]
        by_radius = (1.0 - t) * (low[0] + turn * (low[1] + turn * low[2]))
        by_radius += t * (high[0] + turn * (high[1] + turn * high[2]))
        by_angle = (1.0 - t) * (low[3] + turn * low[4]) + t * (high[3] + turn * high[4])
        by_arc = by_angle * (1.0 + turn * turn) / max(radius[i], 1.0)
        lean = light[i, LEAN]
        line = 0 if abs(lean) <= 1.0 else 1
        x, y, z = outward[0, i], outward[1, i], outward[2, i]
        slope = by_radius * (along[line, 0] * x + along[line, 1] * y + along[line, 2] * z)
        slope += by_arc * (around[line, 0] * x + around[line, 1] * y + around[line, 2] * z)
        # A shift by δ along the column is one by −δ · lean along the row.
        spread = 1.0 + lean * lean if line == 0 else -(lean + 1.0 / lean)
        shift = light[i, GAIN] * spread * slope
        if not np.isnan(shift):
            out[i] = min(max(shift, -_FARTHEST), _FARTHEST)


@njit(cache=True, nogil=True, error_model="numpy")
def gloss_shifts(
    points: Array, head: Index, light: Array, axes: Array, normal: Array, centre: Array
) -> Array:
    """Way (N,) along its ray, millimetres, that brings each point back to where gloss moved it from.

    Parameters
    ----------
    points
        (N, 3) rig frame, millimetres, head after head.
    head
        (N,) number of each point's head.
    light
        (N, 3) of `PointPool`.
    axes
        (H, 3, 2) directions of the left images' rows and columns, rig frame.
    normal, centre
        Unit direction and a point of the wheel's axis; a degree and some millimetres are near enough.
    """
    out = np.zeros(points.shape[0])
    for k in range(axes.shape[0]):
        first, last = np.searchsorted(head, k), np.searchsorted(head, k + 1)
        if last > first:
            _shifts(points[first:last], light[first:last], axes[k], normal, centre, out[first:last])
    return out


def without_gloss(pool: PointPool, axes: Array, normal: Array, centre: Array) -> PointPool:
    """Points as they would be without gloss; see `gloss_shifts`."""
    unit = normal / math.sqrt(float(normal @ normal))
    return pool.moved(gloss_shifts(pool.points, pool.head, pool.light, axes, unit, centre))
