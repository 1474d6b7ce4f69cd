"""Fits a blurred ellipse to the grey levels of each mark: the centre, and its covariance from the residuals.

The model of a full mark is I(p) = L(p) (G + (M − G) Φ(−z)) with the levels of ground G and mark M, the light
L(p) = 1 + l·p that changes linearly over both, and z = (d + ½ κ σ²)/σ with d the distance of p from the
ellipse, outward positive, σ the blur and κ the ellipse's curvature there: a blurred convex edge moves inward
by ½ κ σ². A ring mark has a second, similar ellipse with its own centre, within which the ground shows. All
parameters are fitted by Gauss–Newton with damping to all pixels around the outline, those far from the model
weighted down (Huber).

Distances are those of first order, (ρ² − ρ)/|Uᵀ U p| with ρ = |U p|: exact for circles, and even about the
centre for ellipses, so that they do not move it. Integration over the pixel's square is part of the blur: it
has the variance 1/12 pixel² in every direction.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from alignment.arrays import Array, Mask
from alignment.geometry.symmetric import solve, solve_factored
from alignment.kernels import njit

#: Parameters: centre, factor U (u11, u12, u22), blur, mark, ground, light's change per radius; middle: ratio,
#: offset.
CX, CY, A, B, C, BLUR, MARK, GROUND, SLOPE_X, SLOPE_Y, RATIO, OFFSET_X, OFFSET_Y = range(13)
FULL, RING = 10, 13
#: Columns of the answer after the parameters: variances xx, xy, yy; RMS residual; pixels; steps (0 = failed).
VXX, VXY, VYY, RMS, PIXELS, STEPS = range(13, 19)
_COLUMNS = 19

_HALF = math.sqrt(0.5)
_DENSITY = 1.0 / math.sqrt(2.0 * math.pi)
_UNDETERMINED = 1e-12  # left of a parameter's own information, below which the pixels do not tell it
_STEPS = 25
_CONVERGED = 5e-3  # pixels that the centre still moves; the axes and the blur ten times as much
_HUBER = 4.0  # residuals beyond this many RMS weigh less
_SETTLED = 3  # steps after which the clipping of residuals no longer changes
_FAR = 3.8  # blurs from the edge where its share is 0 or 1 to 1e-4
_INSIDE = 4.0  # pixels of the mark's own area that are used


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _edge(px: float, py: float, a: float, b: float, c: float, blur: float, out: Array) -> tuple[float, float]:
    """Share of the ellipse's inside at a place relative to its centre, and the share's derivative by z.

    `out` takes the derivatives of z by the centre (x, y), a, b, c and the blur; zeros where the edge is far.
    """
    u0, u1 = a * px + b * py, c * py
    s = u0 * u0 + u1 * u1
    w0, w1 = a * u0, b * u0 + c * u1
    h2 = w0 * w0 + w1 * w1
    if s < 0.0025 or h2 < 1e-24:
        out[:] = 0.0
        return 1.0, 0.0
    rho = math.sqrt(s)
    ih = 1.0 / math.sqrt(h2)
    ib = 1.0 / blur
    d = (s - rho) * ih
    bent = a * c * ih
    half_curvature = 0.5 * bent * bent * ih * s * rho
    z = d * ib + half_curvature * blur
    if abs(z) > _FAR:
        out[:] = 0.0
        return (0.0 if z > 0.0 else 1.0), 0.0
    inside = 0.5 * math.erfc(z * _HALF)
    density = _DENSITY * math.exp(-0.5 * z * z)
    # z = (ρ² − ρ)/(h σ) + …: dz = f u·du − g w·dw with w = Uᵀ u.
    f = (2.0 - rho / s) * ih * ib
    g = d * ib * ih * ih
    fu0, fu1, gw0, gw1 = f * u0, f * u1, g * w0, g * w1
    v0 = fu0 - gw0 * a - gw1 * b
    v1 = fu1 - gw1 * c
    out[0] = -a * v0
    out[1] = -b * v0 - c * v1
    out[2] = px * v0 - gw0 * u0
    out[3] = py * v0 - gw1 * u0
    out[4] = py * v1 - gw1 * u1
    out[5] = half_curvature - d * ib * ib
    return inside, -density


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _row(px: float, py: float, p: Array, ring: bool, scale: float, j: Array, dz: Array) -> float:
    """Model at a place relative to the centre, and its derivatives by all parameters in `j`."""
    light = 1.0 + (p[SLOPE_X] * px + p[SLOPE_Y] * py) * scale
    step = light * (p[MARK] - p[GROUND])
    share, change = _edge(px, py, p[A], p[B], p[C], p[BLUR], dz)
    weight = step * change
    for k in range(6):
        j[k] = weight * dz[k]
    if ring:
        ratio = p[RATIO]
        middle, change = _edge(
            px - p[OFFSET_X], py - p[OFFSET_Y], p[A] / ratio, p[B] / ratio, p[C] / ratio, p[BLUR], dz
        )
        share -= middle
        weight = -step * change
        j[CX] += weight * dz[0]
        j[CY] += weight * dz[1]
        j[A] += weight * dz[2] / ratio
        j[B] += weight * dz[3] / ratio
        j[C] += weight * dz[4] / ratio
        j[BLUR] += weight * dz[5]
        j[RATIO] = -weight * (dz[2] * p[A] + dz[3] * p[B] + dz[4] * p[C]) / (ratio * ratio)
        j[OFFSET_X] = weight * dz[0]
        j[OFFSET_Y] = weight * dz[1]
    level = p[GROUND] + (p[MARK] - p[GROUND]) * share
    change = level * scale
    j[CX] -= change * p[SLOPE_X]
    j[CY] -= change * p[SLOPE_Y]
    j[MARK] = light * share
    j[GROUND] = light * (1.0 - share)
    j[SLOPE_X] = change * px
    j[SLOPE_Y] = change * py
    return float(light * level)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _normal_equations(
    image: Any,
    p: Array,
    size: int,
    window: tuple[int, int, int, int],
    band: tuple[float, float, float, float],
    clip: float,
    n: Array,
    g: Array,
) -> tuple[float, float, int]:
    """Fill normal matrix (its lower half) and gradient; weighted cost, sum of squares, pixels used."""
    j, dz = np.zeros(RING), np.zeros(6)
    n[:] = 0.0
    g[:] = 0.0
    cost = squares = 0.0
    used = 0
    a, b, c = p[A], p[B], p[C]
    scale = math.sqrt(abs(a * c))
    ring = size == RING
    x0, x1, y0, y1 = window
    for y in range(y0, y1):
        py = y - p[CY]
        for x in range(x0, x1):
            px = x - p[CX]
            u0, u1 = a * px + b * py, c * py
            s = u0 * u0 + u1 * u1
            if s > band[3] or (s < band[0] and not ring):
                continue
            edge = not (s > band[2] or (s < band[1] and not ring))
            flat = MARK if s < 1.0 else GROUND
            light = 1.0 + (p[SLOPE_X] * px + p[SLOPE_Y] * py) * scale
            model = _row(px, py, p, ring, scale, j, dz) if edge else p[flat] * light
            r = float(image[y, x]) - model
            far = abs(r)
            weight = 1.0
            if far > clip:
                weight = clip / far
                cost += clip * (2.0 * far - clip)
            else:
                cost += r * r
            squares += weight * r * r
            used += 1
            if not edge:
                jx, jy = p[flat] * scale * px, p[flat] * scale * py
                wl, wx, wy = weight * light, weight * jx, weight * jy
                g[flat] += wl * r
                g[SLOPE_X] += wx * r
                g[SLOPE_Y] += wy * r
                n[flat, flat] += wl * light
                n[SLOPE_X, flat] += wx * light
                n[SLOPE_Y, flat] += wy * light
                n[SLOPE_X, SLOPE_X] += wx * jx
                n[SLOPE_Y, SLOPE_X] += wy * jx
                n[SLOPE_Y, SLOPE_Y] += wy * jy
            elif ring:
                for k in range(RING):
                    wj = weight * j[k]
                    g[k] += wj * r
                    for m in range(RING):
                        n[k, m] += wj * j[m]
            else:  # constant bounds: twice the speed
                for k in range(FULL):
                    wj = weight * j[k]
                    g[k] += wj * r
                    for m in range(FULL):
                        n[k, m] += wj * j[m]
    return cost, squares, used


@njit(cache=True, nogil=True, error_model="numpy")
def solve_damped(n: Array, g: Array, size: int, damping: float, low: Array, step: Array) -> bool:
    """Solve damped normal equations by Cholesky; False when they have no solution.

    `n` needs its lower half; `low` takes the factor and `step` the solution, both of at least `size`.
    """
    for k in range(size):
        for m in range(k):
            low[k, m] = n[k, m]
        low[k, k] = (1.0 + damping) * n[k, k]
        step[k] = g[k]
    return solve(low[:size, :size], step[:size].reshape((size, 1)), _UNDETERMINED)


@njit(cache=True, nogil=True, error_model="numpy")
def _centre_covariance(
    image: Any,
    p: Array,
    size: int,
    window: tuple[int, int, int, int],
    band: tuple[float, float, float, float],
    clip: float,
    low: Array,
    answer: Array,
) -> None:
    """Covariance of the centre from the residual of every pixel and what the centre owes to it (sandwich)."""
    rows, unit = np.zeros((2, RING)), np.zeros(RING)
    for k in range(2):
        unit[:] = 0.0
        unit[k] = 1.0
        solve_factored(low, unit[:size].reshape((size, 1)))
        rows[k, :size] = unit[:size]
    j, dz = np.zeros(RING), np.zeros(6)
    a, b, c = p[A], p[B], p[C]
    scale = math.sqrt(abs(a * c))
    ring = size == RING
    xx = xy = yy = 0.0
    x0, x1, y0, y1 = window
    for y in range(y0, y1):
        py = y - p[CY]
        for x in range(x0, x1):
            px = x - p[CX]
            u0, u1 = a * px + b * py, c * py
            s = u0 * u0 + u1 * u1
            if s > band[3] or (s < band[0] and not ring):
                continue
            if s > band[2] or (s < band[1] and not ring):
                flat = MARK if s < 1.0 else GROUND
                light = 1.0 + (p[SLOPE_X] * px + p[SLOPE_Y] * py) * scale
                jx, jy = p[flat] * scale * px, p[flat] * scale * py
                model = p[flat] * light
                ex = rows[0, flat] * light + rows[0, SLOPE_X] * jx + rows[0, SLOPE_Y] * jy
                ey = rows[1, flat] * light + rows[1, SLOPE_X] * jx + rows[1, SLOPE_Y] * jy
            else:
                model = _row(px, py, p, ring, scale, j, dz)
                ex = ey = 0.0
                for k in range(size):
                    ex += rows[0, k] * j[k]
                    ey += rows[1, k] * j[k]
            r = min(max(float(image[y, x]) - model, -clip), clip)
            xx += ex * ex * r * r
            xy += ex * ey * r * r
            yy += ey * ey * r * r
    answer[VXX], answer[VXY], answer[VYY] = xx, xy, yy


@njit(cache=True, nogil=True, error_model="numpy")
def _sensible(p: Array, start: Array, size: int) -> bool:
    """Tell whether parameters still describe the mark that the fit began with."""
    if not (p[BLUR] > 0.05 and p[A] > 0.0 and p[C] > 0.0):
        return False
    grown = (start[A] * start[C]) / (p[A] * p[C])
    if not 0.4 < grown < 2.5:
        return False
    limit = 0.6 / math.sqrt(start[A] * start[C])
    if math.hypot(p[CX] - start[CX], p[CY] - start[CY]) > limit:
        return False
    return size == FULL or 0.02 < p[RATIO] < 0.98


@njit(cache=True, nogil=True, error_model="numpy")
def _bands(core: float, reach: float, blur: float, minor: float) -> tuple[float, float, float, float]:
    """Squares of ρ: pixels in between are used, and between the middle two the edge is near."""
    away = (_FAR * blur + 0.5) / minor
    return core, max(1.0 - away, 0.0) ** 2, (1.0 + away) ** 2, reach


@njit(cache=True, nogil=True, error_model="numpy")
def _surroundings(
    p: Array, radius: float, width: int, height: int
) -> tuple[tuple[int, int, int, int], float, float, float]:
    """Window of the pixels that may count, squares of ρ between which they do, and the smaller half axis."""
    outside = max(min(max(0.4 * radius, 4.0), 8.0), 3.0 * p[BLUR])
    inside = max(_INSIDE, 3.0 * p[BLUR])
    # Half axes: eigenvalues of UᵀU.
    trace, det = p[A] ** 2 + p[B] ** 2 + p[C] ** 2, (p[A] * p[C]) ** 2
    root = math.sqrt(max(trace * trace - 4.0 * det, 0.0))
    minor, major = math.sqrt(2.0 / (trace + root)), math.sqrt(2.0 / max(trace - root, 1e-12))
    half = math.ceil(major * (1.0 + outside / minor)) + 1
    x0, x1 = max(int(p[CX]) - half, 0), min(int(p[CX]) + half + 2, width)
    y0, y1 = max(int(p[CY]) - half, 0), min(int(p[CY]) + half + 2, height)
    core, reach = max(1.0 - inside / minor, 0.0) ** 2, (1.0 + outside / minor) ** 2
    return (x0, x1, y0, y1), core, reach, minor


@njit(cache=True, nogil=True, error_model="numpy")
def fit_ellipses(image: Any, start: Array, ring: Mask, noise: float) -> Array:
    """Fit the model to each mark.

    Parameters
    ----------
    image
        (height, width), 8 or 16 bit.
    start
        (N, 13) parameters to begin with; the last three matter for ring marks only.
    ring
        (N,) True for ring marks.
    noise
        Standard deviation of the image's noise, grey levels: the least residual that counts as far.

    Returns
    -------
    (N, 19) parameters, variances of the centre (xx, xy, yy; pixels²), RMS residual (grey levels), pixels
    used, steps. No steps: the fit did not converge.
    """
    height, width = image.shape
    count = start.shape[0]
    answer = np.zeros((count, _COLUMNS))
    n, low = np.zeros((RING, RING)), np.zeros((RING, RING))
    g, step = np.zeros(RING), np.zeros(RING)
    for i in range(count):
        size = RING if ring[i] else FULL
        p = start[i].copy()
        radius = 1.0 / math.sqrt(p[A] * p[C])
        window, core, reach, minor = _surroundings(p, radius, width, height)
        clip = 1e30
        damping = 1e-6
        band = _bands(core, reach, p[BLUR], minor)
        cost, squares, used = _normal_equations(image, p, size, window, band, clip, n, g)
        steps = 0
        done = False
        for _ in range(_STEPS):
            if used < 3 * size or not solve_damped(n, g, size, damping, low, step):
                break
            trial = p.copy()
            for k in range(size):
                trial[k] += step[k]
            moved = math.hypot(step[CX], step[CY])
            grown = radius * (abs(step[A]) / p[A] + abs(step[C]) / p[C] + abs(step[B]) * radius)
            ok = _sensible(trial, start[i], size)
            if ok and moved < _CONVERGED and grown + abs(step[BLUR]) < 10.0 * _CONVERGED:
                p = trial
                done = True
                steps += 1
                break
            if ok:
                before = cost
                # The clip follows the residuals down, so that a dirty spot stops pulling; then it must stay,
                # or the fit would chase it.
                if steps < _SETTLED:
                    band = _bands(core, reach, trial[BLUR], minor)
                    clip = _HUBER * max(math.sqrt(squares / used), noise)
                    before = math.inf
                cost, squares, used = _normal_equations(image, trial, size, window, band, clip, n, g)
                ok = cost <= before * (1.0 + 1e-6)
            if ok:
                p = trial
                steps += 1
                damping = max(damping * 0.1, 1e-9)
            else:
                damping = max(damping * 10.0, 1e-3)
                cost, squares, used = _normal_equations(image, p, size, window, band, clip, n, g)
        answer[i, :RING] = p
        if done:
            _centre_covariance(image, p, size, window, band, clip, low, answer[i])
            answer[i, RMS] = math.sqrt(squares / max(used - size, 1))
            answer[i, PIXELS] = used
            answer[i, STEPS] = steps
    return answer


@njit(cache=True, nogil=True, error_model="numpy")
def _at(image: Any, x: float, y: float) -> float:
    """Grey level between pixels, bilinear; the border's level beyond it."""
    height, width = image.shape
    x, y = min(max(x, 0.0), width - 1.001), min(max(y, 0.0), height - 1.001)
    i, j = int(x), int(y)
    s, t = x - i, y - j
    return float(
        (1.0 - t) * ((1.0 - s) * image[j, i] + s * image[j, i + 1])
        + t * ((1.0 - s) * image[j + 1, i] + s * image[j + 1, i + 1])
    )


@njit(cache=True, nogil=True, error_model="numpy")
def start_values(image: Any, points: Array, factor: Array, hole: Array) -> Array:
    """Start parameters (N, 13) from rough centres (N, 2), factors U (N, 2, 2) and holes (N,).

    Levels are read well inside and outside of the outline, the blur from the steepest step on eight rays.
    """
    count = points.shape[0]
    start = np.zeros((count, RING))
    for i in range(count):
        a, b, c = factor[i, 0, 0], factor[i, 0, 1], factor[i, 1, 1]
        cx, cy = points[i, 0], points[i, 1]
        radius = 1.0 / math.sqrt(a * c)
        # The middle of the dark part: between hole and outline.
        place = 0.5 * (1.0 + hole[i]) if hole[i] > 0.0 else 0.4
        mark = ground = steepest = 0.0
        for k in range(8):
            angle = 2.0 * math.pi * k / 8.0
            # U⁻¹ (cos, sin): a point of the outline relative to the centre.
            vy = math.sin(angle) / c
            vx = (math.cos(angle) - b * vy) / a
            length = math.hypot(vx, vy)
            ex, ey = vx / length, vy / length
            mark += _at(image, cx + place * vx, cy + place * vy) / 8.0
            ground += _at(image, cx + vx + 4.0 * ex, cy + vy + 4.0 * ey) / 8.0
            best = 0.0
            for m in range(-6, 7):
                t = 0.5 * m
                before = _at(image, cx + vx + (t - 0.5) * ex, cy + vy + (t - 0.5) * ey)
                after = _at(image, cx + vx + (t + 0.5) * ex, cy + vy + (t + 0.5) * ey)
                best = max(best, abs(after - before))
            steepest += best / 8.0
        # The difference over one pixel and the interpolation have blurred the step themselves.
        seen = _DENSITY * abs(ground - mark) / max(steepest, 1e-9)
        blur = math.sqrt(max(seen * seen - 1.0 / 6.0, 0.1))
        start[i, CX], start[i, CY] = cx, cy
        start[i, A], start[i, B], start[i, C] = a, b, c
        start[i, BLUR] = min(blur, 0.3 * radius + 0.4)
        start[i, MARK], start[i, GROUND] = mark, ground
        start[i, RATIO] = hole[i] if hole[i] > 0.0 else 0.5
    return start
