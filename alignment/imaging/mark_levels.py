"""The thesis's levels of locating a mark (5.2), and an ellipse through the points of an edge operator.

They are kept as methods to compare with and for marks that are no ellipses; `alignment.imaging.mark_ellipse`
is more exact than any of them. Each works in a window around one rough mark and gives the centre and its
covariance, pixels and pixels².
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import ndimage

from alignment.arrays import Array, Mask
from alignment.errors import DegenerateInputError
from alignment.imaging.edges import find_edges
from alignment.imaging.ellipses import fit_ellipse, refine_ellipse
from alignment.imaging.mark_ellipse import solve_damped
from alignment.imaging.thresholds import Threshold, p_tile
from alignment.kernels import njit
from alignment.values import Image

Located = tuple[Array, Array, Array]
"""Centre (2,), covariance (2, 2), shape (2, 2)."""

FULL_FRACTION = math.pi / 16.0  # dark part of a window four radii wide
_SEARCH = 5  # rows and columns around the rough centre in which the radius is looked for
_PARTS = 10  # rays per pixel of the outline
_SAMPLES = 51
_RAY = 5.0  # pixels
_LM_STEPS = 40
_ROUNDS = 8
_STAYS = 0.008  # pixels
_THIN = 8


def window_of(image: Image, centre: Array, half: float) -> tuple[Image, Array] | None:
    """Square window around a place and the coordinates of its first pixel; None where it leaves the image."""
    x0, y0 = (round(float(v) - half) for v in centre)
    side = round(2.0 * half) + 1
    if x0 < 0 or y0 < 0 or x0 + side > image.shape[1] or y0 + side > image.shape[0]:
        return None
    return image[y0 : y0 + side, x0 : x0 + side], np.array([x0, y0], dtype=np.float64)


def mean_radius(image: Image, centre: Array, largest: float) -> float:
    """Half the mean distance of the steepest falling and rising grey levels in rows and columns.

    Within five pixels of the centre, rows and columns are searched out to `largest`; of each direction the
    largest distance counts, as in the thesis, whose printed formula forgets the half.
    """
    x, y = (round(float(v)) for v in centre)
    reach = round(largest)
    diameters = []
    for view, along, across in ((image, x, y), (image.T, y, x)):
        rows = view[max(across - _SEARCH, 0) : across + _SEARCH + 1].astype(np.float64)
        first = max(along - reach, 0)
        steps = np.diff(rows[:, first : along + reach + 1], axis=1)
        middle = along - first
        fall = np.argmin(steps[:, :middle], axis=1)
        rise = middle + np.argmax(steps[:, middle:], axis=1)
        diameters.append(float((rise - fall).max()))
    return 0.25 * sum(diameters)


def plain_centroid(
    image: Image, centre: Array, shape: Array, threshold: Threshold, noise: float
) -> Located | None:
    """Middle of all pixels in the window that are below a threshold of its histogram: a plain recogniser."""
    reach = 1.5 * math.sqrt(float(np.linalg.eigvalsh(shape)[1]))
    cut = window_of(image, centre, reach)
    if cut is None:
        return None
    window, corner = cut
    return _centroid(window, corner, window < threshold(window), centre, noise)


def weight_point(image: Image, centre: Array, shape: Array, hole: float, noise: float) -> Located | None:
    """Middle of the dark pixels of a window four radii wide, their share known beforehand (thesis, 5.2).

    The share is π/16 = 0.196 for a full mark, less by the square of the middle's relative radius for a ring
    mark: the thesis's 0.13 belongs to a middle of 0.58 radii.
    """
    major = math.sqrt(float(np.linalg.eigvalsh(shape)[1]))
    radius = mean_radius(image, centre, 1.6 * major)
    cut = window_of(image, centre, 2.0 * radius)
    if cut is None:
        return None
    window, corner = cut
    level = p_tile(window, FULL_FRACTION * (1.0 - hole**2))
    return _centroid(window, corner, window < level, centre, noise)


def _centroid(window: Image, corner: Array, dark: Mask, centre: Array, noise: float) -> Located | None:
    # Corners of neighbouring marks in the window would pull the middle: only what hangs together with the
    # mark.
    x, y = (round(float(v)) for v in centre - corner)
    connected = _connected(dark, x, y)
    rows, columns = np.nonzero(connected)
    if len(rows) < 8:
        return None
    offset = np.column_stack([columns, rows]).astype(np.float64)
    middle = offset.mean(axis=0)
    moments = np.cov((offset - middle).T, bias=True)
    shape = 4.0 * moments
    # Each pixel of the outline errs by its noise over the slope and by the pixel grid, along the normal.
    slope = np.hypot(*np.gradient(window.astype(np.float64)))
    on_edge = connected & ~_eroded(connected)
    steep = max(float(np.median(slope[on_edge])), 1e-6)
    variance = (noise / steep) ** 2 + 1.0 / 12.0
    radius = math.sqrt(math.sqrt(max(float(np.linalg.det(shape)), 1e-6)))
    # Middle = ∮ p δ ds / area, with δ independent from pixel to pixel along the outline: δ²/(π R) for a
    # circle.
    covariance = variance / (math.pi * radius) * shape / radius**2
    return middle + corner, covariance, shape


def _connected(dark: Mask, x: int, y: int) -> Mask:
    """Part of a mask that is connected to the dark pixel nearest to a place."""
    labels, count = ndimage.label(dark)
    if not count:
        return dark
    rows, columns = np.nonzero(dark)
    nearest = int(np.argmin((rows - y) ** 2 + (columns - x) ** 2))
    result: Mask = labels == labels[rows[nearest], columns[nearest]]
    return result


def _eroded(mask: Mask) -> Mask:
    inner = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    return inner


def arctan_rays(image: Image, centre: Array, shape: Array) -> Located | None:
    """Mean of the edge points on rays, each from a fit of G₀ + K_G arctan(K_D (D − D₀)) (thesis, 5.2).

    2πRn rays with n = 10 start at the centre; on each, 51 grey levels over 5 pixels around the outline are
    interpolated bilinearly. The rays follow the rough outline, so that a tilted mark's edge lies on them.
    Half the error of the place where the rays start remains in the mean of points at even angles: they start
    anew from there until it stays.
    """
    factor = np.linalg.cholesky(np.linalg.inv(shape)).T
    radius = math.sqrt(math.sqrt(float(np.linalg.det(shape))))
    count = max(16, round(2.0 * math.pi * radius * _PARTS))
    middle = np.asarray(centre, dtype=np.float64)
    # A few rays find the place, all of them the mean.
    rays = max(16, count // _THIN)
    for n in range(_ROUNDS):
        rays = count if n == _ROUNDS - 1 else rays
        points, good = _edge_points_on_rays(image, middle, factor, rays)
        points = points[good]
        if len(points) < rays // 2:
            return None
        before, middle = middle, points.mean(axis=0)
        if rays == count:
            break
        if math.hypot(*(middle - before)) < _STAYS:
            rays = count
    try:
        start, outline = fit_ellipse(points)
        start, outline, covariance, rms = refine_ellipse(points, start, outline)
    except DegenerateInputError:
        return None
    return middle, covariance * _sharing(points, start, outline, rms), outline


@njit(cache=True, nogil=True, error_model="numpy")
def _edge_points_on_rays(image: Any, centre: Array, factor: Array, count: int) -> tuple[Array, Mask]:
    """Edge point of each ray (count, 2), and whether its fit converged on the ray."""
    height, width = image.shape
    points = np.zeros((count, 2))
    good = np.zeros(count, np.bool_)
    grey = np.empty(_SAMPLES)
    spacing = _RAY / (_SAMPLES - 1)
    for k in range(count):
        angle = 2.0 * math.pi * k / count
        ex, ey = math.cos(angle), math.sin(angle)
        u0, u1 = factor[0, 0] * ex + factor[0, 1] * ey, factor[1, 1] * ey
        start = 1.0 / math.hypot(u0, u1) - 0.5 * _RAY
        inside = True
        for m in range(_SAMPLES):
            x = centre[0] + (start + m * spacing) * ex
            y = centre[1] + (start + m * spacing) * ey
            if not (0.0 <= x < width - 1.0 and 0.0 <= y < height - 1.0):
                inside = False
                break
            i, j = int(x), int(y)
            s, t = x - i, y - j
            grey[m] = (1.0 - t) * ((1.0 - s) * image[j, i] + s * image[j, i + 1]) + t * (
                (1.0 - s) * image[j + 1, i] + s * image[j + 1, i + 1]
            )
        if not inside:
            continue
        place, converged = _fit_arctan(grey, spacing)
        if converged and 0.0 < place < _RAY:
            points[k, 0] = centre[0] + (start + place) * ex
            points[k, 1] = centre[1] + (start + place) * ey
            good[k] = True
    return points, good


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_arctan(grey: Array, spacing: float) -> tuple[float, bool]:
    """Place D₀ of the steepest point of an arctangent through grey levels, by Levenberg–Marquardt."""
    size = grey.size
    best = 0.0
    place = 0.5 * spacing * (size - 1)
    lag = 10  # a pixel: the largest difference over it
    for m in range(size - lag):
        step = abs(grey[m + lag] - grey[m])
        if step > best:
            best = step
            place = (m + 0.5 * lag) * spacing
    level = 0.5 * (grey[0] + grey[size - 1])
    height = (grey[size - 1] - grey[0]) / math.pi
    if height == 0.0 or best == 0.0:
        return place, False
    # The slope in the middle is K_G K_D.
    p0, p1, p2, p3 = level, height, best / (lag * spacing) / abs(height), place
    q0, q1, q2, q3 = p0, p1, p2, p3
    damping, cost = 1e-3, math.inf
    n, g, low, step = np.empty((4, 4)), np.empty(4), np.empty((4, 4)), np.empty(4)
    kept, pull = np.empty((4, 4)), np.empty(4)
    for _ in range(_LM_STEPS):
        n[:] = 0.0
        g[:] = 0.0
        total = 0.0
        for m in range(size):
            t = m * spacing - q3
            bend = math.atan(q2 * t)
            slope = q1 / (1.0 + (q2 * t) ** 2)
            r = grey[m] - q0 - q1 * bend
            total += r * r
            j2, j3 = slope * t, -slope * q2
            g[0] += r
            g[1] += bend * r
            g[2] += j2 * r
            g[3] += j3 * r
            n[1, 0] += bend
            n[1, 1] += bend * bend
            n[2, 0] += j2
            n[2, 1] += j2 * bend
            n[2, 2] += j2 * j2
            n[3, 0] += j3
            n[3, 1] += j3 * bend
            n[3, 2] += j3 * j2
            n[3, 3] += j3 * j3
        n[0, 0] = size
        if total <= cost:
            close = cost < math.inf and abs(q3 - p3) < 1e-3
            p0, p1, p2, p3, cost = q0, q1, q2, q3, total
            if close:
                return p3, True
            kept[:] = n
            pull[:] = g
            damping = max(damping * 0.1, 1e-9)
        else:
            damping *= 10.0
            if damping > 1e8:
                break
        if not solve_damped(kept, pull, 4, damping, low, step):
            break
        q0, q1, q2, q3 = p0 + step[0], p1 + step[1], p2 + step[2], p3 + step[3]
    return p3, False


def _sharing(points: Array, centre: Array, shape: Array, rms: float) -> float:
    """How many times the variance of a centre is that of independent points.

    Neighbouring edge points share pixels, and so errors. An error of the centre goes once around the outline;
    what goes around three to eight times is left in the residuals and shows how large such slow errors are.
    """
    factor = np.linalg.cholesky(np.linalg.inv(shape)).T
    u = (points - centre) @ factor.T
    rho = np.hypot(*u.T)
    w = u @ factor
    distance = (rho - 1.0) * rho / np.hypot(*w.T)
    angle = np.arctan2(u[:, 1], u[:, 0])
    waves = angle[:, None] * np.arange(3, 9)
    # Sums, not products of matrices: for so few numbers the library's threads cost more than they save.
    squares = sum((distance[:, None] * wave).sum(axis=0) ** 2 for wave in (np.cos(waves), np.sin(waves)))
    power = float(np.mean(squares)) / len(points)
    return max(1.0, power / max(rms**2, 1e-18))


def edge_ellipse(image: Image, centre: Array, shape: Array, operator: str) -> Located | None:
    """Ellipse by least distances through the points of an edge operator near the rough outline."""
    values = np.linalg.eigvalsh(shape)
    margin = 5.0
    cut = window_of(image, centre, math.sqrt(float(values[1])) + margin)
    if cut is None:
        return None
    window, corner = cut
    edges = find_edges(window, operator)
    offset = edges.points + corner - centre
    factor = np.linalg.cholesky(np.linalg.inv(shape)).T
    rho = np.hypot(*(factor @ offset.T))
    away = np.abs(rho - 1.0) * math.sqrt(float(values[0]))
    points = edges.points[away < 3.0]
    if len(points) < 12:
        return None
    try:
        middle, outline = fit_ellipse(points)
        middle, outline, covariance, rms = refine_ellipse(points, middle, outline)
    except (DegenerateInputError, np.linalg.LinAlgError):
        return None
    return middle + corner, covariance * _sharing(points, middle, outline, rms), outline
