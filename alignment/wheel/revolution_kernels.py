"""Compiled kernels of the surface of revolution: cubic B-spline, residuals, normal equations, weights."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from alignment.kernels import njit

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AXIS = 4  # unknowns of the axis: two tilts, two shifts; the profile's coefficients follow
FEWEST = 50  # points within the profile for a fit
ACROSS = 0.035  # mm; where the surface bends and shines, light and shape shift a point's place on the slope
_SIXTH = 1.0 / 6.0
_MEDIAN_POINTS = 1000  # make a start profile


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _basis(t: float) -> tuple[float, float, float, float]:
    s = 1.0 - t
    t2, t3 = t * t, t * t * t
    return (
        s * s * s * _SIXTH,
        (3.0 * t3 - 6.0 * t2 + 4.0) * _SIXTH,
        (-3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0) * _SIXTH,
        t3 * _SIXTH,
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _basis_slope(t: float) -> tuple[float, float, float, float]:
    s = 1.0 - t
    return -0.5 * s * s, 0.5 * (3.0 * t * t - 4.0 * t), 0.5 * (-3.0 * t * t + 2.0 * t + 1.0), 0.5 * t * t


@njit(cache=True, nogil=True, error_model="numpy")
def slope_of_profile(radius: float, start: float, step: float, profile: Array) -> float:
    """Slope of the profile at a radius, that of its end beyond it."""
    g = (radius - start) / step
    k = min(max(int(np.floor(g)), 0), profile.size - 4)
    s0, s1, s2, s3 = _basis_slope(min(max(g - k, 0.0), 1.0))
    rise = s0 * profile[k] + s1 * profile[k + 1] + s2 * profile[k + 2] + s3 * profile[k + 3]
    return float(rise / step)


@njit(cache=True, nogil=True, error_model="numpy")
def heights(points: Array, centre: Array, frame: Array, start: float, step: float, profile: Array) -> Array:
    """Height (N,) of points (N, 3) above the profile, millimetres; NaN beyond its radii."""
    out = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        qx, qy, qz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        x = frame[0, 0] * qx + frame[0, 1] * qy + frame[0, 2] * qz
        y = frame[1, 0] * qx + frame[1, 1] * qy + frame[1, 2] * qz
        h = frame[2, 0] * qx + frame[2, 1] * qy + frame[2, 2] * qz
        g = (np.sqrt(x * x + y * y) - start) / step
        k = int(np.floor(g))
        if k < 0 or k + 3 >= profile.size:
            out[i] = np.nan
            continue
        b0, b1, b2, b3 = _basis(g - k)
        out[i] = h - (b0 * profile[k] + b1 * profile[k + 1] + b2 * profile[k + 2] + b3 * profile[k + 3])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def rows(
    points: Array,
    sigma: Array,
    rays: Array,
    centre: Array,
    frame: Array,
    start: float,
    step: float,
    profile: Array,
    values: Array,
    deviation: Array,
    jacobian: Array,
    first: Index,
) -> None:
    """Residual, its deviation, derivatives (4 axis, 4 spline), first spline index of each point.

    A point errs along its ray, by `sigma`, and a little across the slope.
    """
    per_step = 1.0 / step
    for i in range(points.shape[0]):
        qx, qy, qz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        x = frame[0, 0] * qx + frame[0, 1] * qy + frame[0, 2] * qz
        y = frame[1, 0] * qx + frame[1, 1] * qy + frame[1, 2] * qz
        h = frame[2, 0] * qx + frame[2, 1] * qy + frame[2, 2] * qz
        rho = np.sqrt(x * x + y * y)
        g = (rho - start) * per_step
        k = int(np.floor(g))
        if k < 0 or k + 3 >= profile.size or rho < 1.0:
            first[i] = -1
            continue
        first[i] = k
        b0, b1, b2, b3 = _basis(g - k)
        s0, s1, s2, s3 = _basis_slope(g - k)
        f = b0 * profile[k] + b1 * profile[k + 1] + b2 * profile[k + 2] + b3 * profile[k + 3]
        df = (s0 * profile[k] + s1 * profile[k + 1] + s2 * profile[k + 2] + s3 * profile[k + 3]) * per_step
        values[i] = h - f
        rx = frame[0, 0] * rays[i, 0] + frame[0, 1] * rays[i, 1] + frame[0, 2] * rays[i, 2]
        ry = frame[1, 0] * rays[i, 0] + frame[1, 1] * rays[i, 1] + frame[1, 2] * rays[i, 2]
        rh = frame[2, 0] * rays[i, 0] + frame[2, 1] * rays[i, 1] + frame[2, 2] * rays[i, 2]
        outward = df / rho
        along = sigma[i] * max(abs(rh - outward * (x * rx + y * ry)), 0.1)
        deviation[i] = np.sqrt(along * along + (ACROSS * df) ** 2)
        tilt = 1.0 + outward * h
        row = jacobian[i]
        row[0] = x * tilt
        row[1] = y * tilt
        row[2] = outward * x
        row[3] = outward * y
        row[4], row[5], row[6], row[7] = -b0, -b1, -b2, -b3


@njit(cache=True, nogil=True, error_model="numpy")
def normal_equations(
    values: Array, weight: Array, jacobian: Array, first: Index, knots: int
) -> tuple[Array, Array, Array, Array]:
    """Axis block (4, 4), profile–axis block (K, 4), lower band (K, 4) of the profile block, right side."""
    corner, side = np.zeros((AXIS, AXIS)), np.zeros((knots, AXIS))
    band, right = np.zeros((knots, 4)), np.zeros(AXIS + knots)
    for i in range(values.size):
        w = weight[i]
        if w <= 0.0:
            continue
        k, row = first[i], jacobian[i]
        for a in range(AXIS):
            wa = w * row[a]
            right[a] -= wa * values[i]
            for b in range(a + 1):
                corner[a, b] += wa * row[b]
        for a in range(4):
            wa = w * row[AXIS + a]
            right[AXIS + k + a] -= wa * values[i]
            for b in range(AXIS):
                side[k + a, b] += wa * row[b]
            for b in range(a + 1):
                band[k + b, a - b] += wa * row[AXIS + b]
    for a in range(AXIS):
        for b in range(a):
            corner[b, a] = corner[a, b]
    return corner, side, band, right


@njit(cache=True, nogil=True, error_model="numpy")
def cluster_pulls(
    values: Array,
    weight: Array,
    jacobian: Array,
    first: Index,
    cluster: Index,
    clusters: int,
    solution: Array,
) -> tuple[Array, int]:
    """Sum of the squared pulls (m, m) of the clusters' residuals, by columns (4 + K, m) of the inverse.

    Also the number of clusters with weight.
    """
    columns = solution.shape[1]
    pull = np.zeros((clusters, columns))
    used = np.zeros(clusters, np.bool_)
    for i in range(values.size):
        w = weight[i] * values[i]
        if weight[i] <= 0.0:
            continue
        c, k = cluster[i], AXIS + first[i]
        used[c] = True
        for m in range(columns):
            total = 0.0
            for a in range(AXIS):
                total += jacobian[i, a] * solution[a, m] + jacobian[i, a + AXIS] * solution[k + a, m]
            pull[c, m] += w * total
    out = np.zeros((columns, columns))
    count = 0
    for c in range(clusters):
        count += used[c]
        for m in range(columns):
            for n in range(columns):
                out[m, n] += pull[c, m] * pull[c, n]
    return out, count


@njit(cache=True, nogil=True, error_model="numpy")
def local_medians(
    points: Array, tukey: Array, centre: Array, frame: Array, step: float
) -> tuple[float, Array]:
    """First knot, and the median height around each; a knot without points takes that of the one before."""
    n = points.shape[0]
    thin = max(1, n // _MEDIAN_POINTS)
    radius, height = np.empty(n), np.empty(n)
    m = 0
    for i in range(0, n, thin):
        if tukey[i] > 0.0:
            qx, qy, qz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
            x = frame[0, 0] * qx + frame[0, 1] * qy + frame[0, 2] * qz
            y = frame[1, 0] * qx + frame[1, 1] * qy + frame[1, 2] * qz
            height[m] = frame[2, 0] * qx + frame[2, 1] * qy + frame[2, 2] * qz
            radius[m] = math.sqrt(x * x + y * y)
            m += 1
    order = np.argsort(radius[:m])
    lo, hi = radius[order[m // 1000]], radius[order[m - 1 - m // 1000]]
    count = max(4, math.ceil((hi - lo) / step) + 3)
    profile = np.empty(count)
    first = last = 0
    value = height[order[m // 1000]]
    for k in range(count):
        # Knot k stands one step below the first for k = 0: the spline needs one beyond each end.
        below, above = lo + step * (k - 1.5), lo + step * (k - 0.5)
        while first < m and radius[order[first]] < below:
            first += 1
        last = max(last, first)
        while last < m and radius[order[last]] < above:
            last += 1
        if last > first:
            value = np.median(height[order[first:last]])
        profile[k] = value
    return lo, profile


@njit(cache=True, nogil=True, error_model="numpy")
def weigh(
    values: Array, deviation: Array, first: Index, cut: float, floor: float, tukey: Array, weight: Array
) -> float:
    """Tukey's weights and the weights of the normal equations; returns the scale, −1 for too few points."""
    n = values.size
    ratio = np.empty(n)
    inside = 0
    for i in range(n):
        if first[i] >= 0:
            ratio[inside] = abs(values[i]) / deviation[i]
            inside += 1
    if inside < FEWEST:
        return -1.0
    thin = max(1, inside // 4000)
    scale = max(1.4826 * np.median(ratio[:inside:thin]), floor)
    for i in range(n):
        tukey[i] = weight[i] = 0.0
        if first[i] >= 0:
            u = values[i] / (deviation[i] * cut * scale)
            if abs(u) < 1.0:
                tukey[i] = (1.0 - u * u) ** 2
                weight[i] = tukey[i] / (scale * deviation[i]) ** 2
    return scale
