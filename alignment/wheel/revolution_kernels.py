"""Compiled kernels of the surface of revolution: cubic B-spline, residuals, normal equations, weights."""

from __future__ import annotations

import math

import numpy as np

from alignment import robust
from alignment.arrays import Array, Index
from alignment.kernels import njit

AXIS = 4  # unknowns of the axis: two tilts, two shifts; the profile's coefficients follow
FEWEST_POINTS = 50  # points within the profile for a fit
ACROSS = 0.035  # mm; where the surface bends and shines, light and shape shift a point's place on the slope
BEND = 0.3  # of a line's spread; a bend within it moves the two cameras' middles apart, by a height like that
_SIXTH = 1.0 / 6.0
_MEDIAN_POINTS = 1000  # make a start profile
_BLOCK = 256  # points

#: Rows of a table (9, N) of points: residual and its deviation, millimetres; derivatives by two tilts and by
#: two shifts of the axis; place between two knots, 0 to 1; Tukey's weight, weight of the normal equations.
VALUE, DEVIATION, TILT, SHIFT, PLACE, TUKEY, WEIGHT = 0, 1, 2, 4, 6, 7, 8
ROWS = 9
#: Coefficients of t⁰ … t³ of the four basis functions.
BASIS = (
    np.array([[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]])
    / 6.0
)


@njit(cache=True, nogil=True, error_model="numpy")
def pieces_of(profile: Array) -> Array:
    """Coefficients (K − 3, 4) of the profile's cubics in t, 0 to 1 from knot to knot, constant first."""
    out = np.empty((profile.size - 3, 4))
    for k in range(profile.size - 3):
        p0, p1, p2, p3 = profile[k], profile[k + 1], profile[k + 2], profile[k + 3]
        out[k, 0] = (p0 + 4.0 * p1 + p2) * _SIXTH
        out[k, 1] = 0.5 * (p2 - p0)
        out[k, 2] = 0.5 * (p0 - 2.0 * p1 + p2)
        out[k, 3] = (p3 - p0 + 3.0 * (p1 - p2)) * _SIXTH
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def slope_of_profile(radius: float, start: float, step: float, pieces: Array) -> float:
    """Slope at a radius of a profile's `pieces_of`, that of its end beyond it."""
    g = (radius - start) / step
    k = min(max(int(np.floor(g)), 0), pieces.shape[0] - 1)
    t = min(max(g - k, 0.0), 1.0)
    return float((pieces[k, 1] + t * (2.0 * pieces[k, 2] + 3.0 * t * pieces[k, 3])) / step)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def heights(points: Array, centre: Array, frame: Array, start: float, step: float, profile: Array) -> Array:
    """Height (N,) of points (N, 3) above the profile, millimetres; NaN beyond its radii."""
    out = np.empty(points.shape[0])
    pieces = pieces_of(profile)
    per_step, end = 1.0 / step, float(pieces.shape[0] - 1)
    cx, cy, cz = centre[0], centre[1], centre[2]
    f00, f01, f02 = frame[0, 0], frame[0, 1], frame[0, 2]
    f10, f11, f12 = frame[1, 0], frame[1, 1], frame[1, 2]
    f20, f21, f22 = frame[2, 0], frame[2, 1], frame[2, 2]
    for i in range(points.shape[0]):
        qx, qy, qz = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
        x = f00 * qx + f01 * qy + f02 * qz
        y = f10 * qx + f11 * qy + f12 * qz
        g = (math.sqrt(x * x + y * y) - start) * per_step
        inside = (g >= 0.0) & (g < end + 1.0)
        k = np.int64(g if inside else 0.0)
        t = g - k
        below = pieces[k, 0] + t * (pieces[k, 1] + t * (pieces[k, 2] + t * pieces[k, 3]))
        out[i] = f20 * qx + f21 * qy + f22 * qz - below if inside else np.nan
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def rows(
    points: Array,
    sigma: Array,
    rays: Array,
    spread: Array,
    centre: Array,
    frame: Array,
    start: float,
    step: float,
    profile: Array,
    table: Array,
    first: Index,
) -> None:
    """Residual, its deviation, derivatives and place in the spline of each point, into `table` and `first`.

    A point errs along its ray, by `sigma`, a little across the slope, and where the surface bends within the
    light line, whose middle is then no longer where its light is brightest. `first` is the first of the four
    coefficients that a point depends on, −1 for a point beyond the profile, whose row of the table says
    nothing.
    """
    # By blocks that stay in the nearest cache, each step a loop without branches over a table of its own:
    # compilers make vector instructions of that, several times faster than point after point.
    block, interval = np.ones((13, _BLOCK)), np.zeros(_BLOCK, np.int64)
    pieces = pieces_of(profile)
    per_step, end = 1.0 / step, float(pieces.shape[0] - 1)
    cx, cy, cz = centre[0], centre[1], centre[2]
    f00, f01, f02 = frame[0, 0], frame[0, 1], frame[0, 2]
    f10, f11, f12 = frame[1, 0], frame[1, 1], frame[1, 2]
    f20, f21, f22 = frame[2, 0], frame[2, 1], frame[2, 2]
    for begin in range(0, points.shape[0], _BLOCK):
        count = min(_BLOCK, points.shape[0] - begin)
        for i in range(count):
            for a in range(3):
                block[a, i] = points[begin + i, a]
                block[3 + a, i] = rays[begin + i, a]
            block[6, i], block[12, i] = sigma[begin + i], spread[begin + i]
        for i in range(_BLOCK):
            qx, qy, qz = block[0, i] - cx, block[1, i] - cy, block[2, i] - cz
            x = f00 * qx + f01 * qy + f02 * qz
            y = f10 * qx + f11 * qy + f12 * qz
            rho = math.sqrt(x * x + y * y)
            rx, ry, rz = block[3, i], block[4, i], block[5, i]
            block[0, i], block[1, i], block[2, i] = x, y, f20 * qx + f21 * qy + f22 * qz
            block[3, i] = x * (f00 * rx + f01 * ry + f02 * rz) + y * (f10 * rx + f11 * ry + f12 * rz)
            block[4, i] = f20 * rx + f21 * ry + f22 * rz
            block[5, i] = 1.0 / max(rho, 1.0)
            g = (rho - start) * per_step
            floor = np.floor(g)
            block[7, i] = g - floor
            interval[i] = np.int64(floor if (floor >= 0.0) & (floor <= end) & (rho >= 1.0) else -1.0)
        for i in range(_BLOCK):
            piece = pieces[max(interval[i], 0)]
            block[8, i], block[9, i], block[10, i], block[11, i] = piece[0], piece[1], piece[2], piece[3]
        for i in range(_BLOCK):
            t, c1, c2, c3 = block[7, i], block[9, i], block[10, i], block[11, i]
            slope = (c1 + t * (2.0 * c2 + 3.0 * t * c3)) * per_step
            x, y, h, outward = block[0, i], block[1, i], block[2, i], slope * block[5, i]
            along = block[6, i] * max(abs(block[4, i] - outward * block[3, i]), 0.1)
            tilt = 1.0 + outward * h
            block[0, i] = h - (block[8, i] + t * (c1 + t * (c2 + t * c3)))
            aside = ACROSS * slope
            bend = abs(2.0 * c2 + 6.0 * c3 * t) * per_step * per_step
            # No more than the noise: a surface that bends to meet an obstacle must not excuse itself by that.
            bent = min(BEND * block[12, i] * bend, along)
            block[1, i] = math.sqrt(along * along + aside * aside + bent * bent)
            block[2, i], block[3, i] = x * tilt, y * tilt
            block[4, i], block[5, i] = outward * x, outward * y
        for a in range(PLACE):
            source, target = block[a], table[a, begin : begin + count]
            for i in range(count):
                target[i] = source[i]
        place = table[PLACE, begin : begin + count]
        for i in range(count):
            place[i] = block[7, i]
            first[begin + i] = interval[i]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def gradient(table: Array, first: Index, knots: int) -> Array:
    """Σ w r ∂r of all unknowns (4 + K,): the right side of the normal equations but for its sign."""
    values, place, weight = table[VALUE], table[PLACE], table[WEIGHT]
    j0, j1, j2, j3 = table[TILT], table[TILT + 1], table[SHIFT], table[SHIFT + 1]
    out = np.zeros(AXIS + knots)
    a0 = a1 = a2 = a3 = 0.0
    for i in range(first.size):
        wv = weight[i] * values[i]
        a0 += wv * j0[i]
        a1 += wv * j1[i]
        a2 += wv * j2[i]
        a3 += wv * j3[i]
    out[0], out[1], out[2], out[3] = a0, a1, a2, a3
    # Moments of the place in each interval first: a short stretch of memory and few steps for each point.
    moments = np.zeros((knots - 3, 4))
    for i in range(first.size):
        if weight[i] > 0.0:
            moment = moments[first[i]]
            t, m = place[i], weight[i] * values[i]
            moment[0] += m
            moment[1] += t * m
            moment[2] += t * t * m
            moment[3] += t * t * t * m
    for k in range(knots - 3):
        for a in range(4):
            for m in range(4):
                out[AXIS + k + a] -= BASIS[a, m] * moments[k, m]
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def normal_matrix(table: Array, first: Index, knots: int) -> tuple[Array, Array, Array]:
    """Axis block (4, 4), profile–axis block (K, 4), lower band (K, 4) of the profile block."""
    place, weight = table[PLACE], table[WEIGHT]
    j0, j1, j2, j3 = table[TILT], table[TILT + 1], table[SHIFT], table[SHIFT + 1]
    s00 = s10 = s11 = s20 = s21 = s22 = s30 = s31 = s32 = s33 = 0.0
    for i in range(first.size):
        w = weight[i]
        w0, w1, w2, w3 = w * j0[i], w * j1[i], w * j2[i], w * j3[i]
        s00 += w0 * j0[i]
        s10 += w1 * j0[i]
        s11 += w1 * j1[i]
        s20 += w2 * j0[i]
        s21 += w2 * j1[i]
        s22 += w2 * j2[i]
        s30 += w3 * j0[i]
        s31 += w3 * j1[i]
        s32 += w3 * j2[i]
        s33 += w3 * j3[i]
    corner = np.array(
        [[s00, s10, s20, s30], [s10, s11, s21, s31], [s20, s21, s22, s32], [s30, s31, s32, s33]]
    )
    # Moments of the place in each interval, as in `gradient`: Σ w tᵐ ∂r and Σ w tᵐ.
    mixed, pure = np.zeros((knots - 3, 16)), np.zeros((knots - 3, 7))
    for i in range(first.size):
        w = weight[i]
        if w > 0.0:
            of_mixed, of_pure, t = mixed[first[i]], pure[first[i]], place[i]
            w0, w1, w2, w3 = w * j0[i], w * j1[i], w * j2[i], w * j3[i]
            for m in range(4):
                of_mixed[4 * m] += w0
                of_mixed[4 * m + 1] += w1
                of_mixed[4 * m + 2] += w2
                of_mixed[4 * m + 3] += w3
                of_pure[m] += w
                w0, w1, w2, w3, w = w0 * t, w1 * t, w2 * t, w3 * t, w * t
            of_pure[4] += w
            of_pure[5] += w * t
            of_pure[6] += w * t * t
    side, band = np.zeros((knots, AXIS)), np.zeros((knots, 4))
    for k in range(knots - 3):
        for a in range(4):
            for m in range(4):
                for c in range(AXIS):
                    side[k + a, c] -= BASIS[a, m] * mixed[k, 4 * m + c]
                for b in range(a + 1):
                    for n in range(4):
                        band[k + b, a - b] += BASIS[a, m] * BASIS[b, n] * pure[k, m + n]
    return corner, side, band


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def cluster_pulls(
    table: Array, first: Index, cluster: Index, clusters: int, solution: Array
) -> tuple[Array, int]:
    """Sum of the squared pulls (2, 2) of the clusters' residuals, by two columns (4 + K, 2) of the inverse.

    Also the number of clusters with weight.
    """
    values, place, weight = table[VALUE], table[PLACE], table[WEIGHT]
    j0, j1, j2, j3 = table[TILT], table[TILT + 1], table[SHIFT], table[SHIFT + 1]
    pull, used = np.zeros((clusters, 2)), np.zeros(clusters, np.bool_)
    influence = np.empty(first.size)
    for m in range(2):
        pieces = pieces_of(solution[AXIS:, m].copy())
        s0, s1, s2, s3 = solution[0, m], solution[1, m], solution[2, m], solution[3, m]
        for i in range(first.size):
            k, t = max(first[i], 0), place[i]
            along = pieces[k, 0] + t * (pieces[k, 1] + t * (pieces[k, 2] + t * pieces[k, 3]))
            of_axis = j0[i] * s0 + j1[i] * s1 + j2[i] * s2 + j3[i] * s3
            influence[i] = weight[i] * values[i] * (of_axis - along)
        for i in range(first.size):
            if weight[i] > 0.0:
                pull[cluster[i], m] += influence[i]
                used[cluster[i]] = True
    out = np.zeros((2, 2))
    count = 0
    for c in range(clusters):
        count += used[c]
        for m in range(2):
            for n in range(2):
                out[m, n] += pull[c, m] * pull[c, n]
    return out, count


@njit(cache=True, nogil=True, error_model="numpy")
def local_medians(points: Array, centre: Array, frame: Array, step: float) -> tuple[float, Array]:
    """First knot, and the median height around each; a knot without points takes that of the one before."""
    n = points.shape[0]
    thin = max(1, n // _MEDIAN_POINTS)
    radius, height = np.empty(n), np.empty(n)
    m = 0
    for i in range(0, n, thin):
        qx, qy, qz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        x = frame[0, 0] * qx + frame[0, 1] * qy + frame[0, 2] * qz
        y = frame[1, 0] * qx + frame[1, 1] * qy + frame[1, 2] * qz
        height[m] = frame[2, 0] * qx + frame[2, 1] * qy + frame[2, 2] * qz
        radius[m] = math.sqrt(x * x + y * y)
        m += 1
    radius, height = radius[:m], height[:m]
    spare = m // _MEDIAN_POINTS  # at either end, as one may stand alone
    lo = np.partition(radius, spare)[spare]
    hi = np.partition(radius, m - 1 - spare)[m - 1 - spare]
    count = max(4, math.ceil((hi - lo) / step) + 3)
    # Knot k stands one step below the first for k = 0: the spline needs one beyond each end.
    knot = np.empty(m, np.int64)
    begin = np.zeros(count + 1, np.int64)
    for i in range(m):
        knot[i] = min(max(math.floor((radius[i] - lo) / step + 1.5), 0), count - 1)
        begin[knot[i] + 1] += 1
    for k in range(count):
        begin[k + 1] += begin[k]
    by_knot, filled = np.empty(m), begin[:-1].copy()
    for i in range(m):
        by_knot[filled[knot[i]]] = height[i]
        filled[knot[i]] += 1
    profile = np.empty(count)
    value = np.nan
    for k in range(count - 1, -1, -1):
        if begin[k + 1] > begin[k]:
            mine = by_knot[begin[k] : begin[k + 1]]
            mine.sort()  # in place; the median function would copy each
            value = 0.5 * (mine[(mine.size - 1) // 2] + mine[mine.size // 2])
        profile[k] = value
    for k in range(count):
        if begin[k + 1] > begin[k]:
            value = profile[k]
        profile[k] = value
    return lo, profile


@njit(cache=True, nogil=True, error_model="numpy")
def weigh(table: Array, first: Index, cut: float, floor: float) -> float:
    """Tukey's weights and the weights of the normal equations; returns the scale, −1 for too few points."""
    values, deviation, tukey, weight = table[VALUE], table[DEVIATION], table[TUKEY], table[WEIGHT]
    inside = 0
    for i in range(first.size):
        inside += first[i] >= 0
    if inside < FEWEST_POINTS:
        return -1.0
    thin = max(1, inside // 4000)
    ratio = np.empty(inside // thin + 1)
    seen = found = 0
    for i in range(first.size):
        if first[i] >= 0:
            if seen % thin == 0:
                ratio[found] = abs(values[i]) / deviation[i]
                found += 1
            seen += 1
    scale = max(robust.DEVIATION_OF_MEDIAN * np.median(ratio[:found]), floor)
    for i in range(first.size):
        u = values[i] / (deviation[i] * cut * scale)
        rest = (1.0 - u * u) if (first[i] >= 0) & (abs(u) < 1.0) else 0.0
        tukey[i] = rest * rest
        weight[i] = rest * rest / ((scale * deviation[i]) * (scale * deviation[i]))
    return scale
