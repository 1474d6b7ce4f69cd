"""A surface of revolution with a free profile: axis direction, axis position and profile fitted together.

The height of a point along the axis is compared with a cubic B-spline of its distance from the axis. Nothing
is assumed of the profile; what is not of revolution (lettering, valve, dirt, the edge of the rim) loses its
weight (Tukey's biweight, scale from the median absolute deviation).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from alignment.errors import DegenerateInputError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AXIS = 4  # unknowns of the axis: two tilts, two shifts; the profile's coefficients follow
_TUKEY = 4.685
_CENTRE_PRIOR = 30.0  # mm; keeps the axis position finite on a flat sidewall


@dataclass(frozen=True, eq=False)
class RevolutionFit:
    """The fitted surface.

    Attributes
    ----------
    normal
        (3,) unit axis direction, outboard.
    centre
        (3,) point of the axis; heights count from it.
    knots_start, knots_step
        First knot and knot distance of the uniform cubic B-spline over the radius, millimetres.
    profile
        (K,) its coefficients, millimetres of height.
    weights
        (N,) robust weight of each point, 0 to 1; 0 outside the profile.
    residuals
        (N,) height above the fitted surface, millimetres.
    scale
        Robust standard deviation of residual / sigma; 1 when the stated noise is all there is.
    covariance
        (2, 2) of the two tilts of `normal` along `tilt_axes`, radians².
    tilt_axes
        (2, 3) unit vectors; normal + α·tilt_axes[0] + β·tilt_axes[1] is the tilted normal.
    """

    normal: Array
    centre: Array
    knots_start: float
    knots_step: float
    profile: Array
    weights: Array
    residuals: Array
    scale: float
    covariance: Array
    tilt_axes: Array

    def height(self, points: Array) -> Array:
        """Height of points (N, 3) above the surface, millimetres; NaN beyond the profile's radii."""
        frame = np.vstack([self.tilt_axes, self.normal])
        return _heights(
            np.ascontiguousarray(points), self.centre, frame, self.knots_start, self.knots_step, self.profile
        )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _basis(t: float) -> tuple[float, float, float, float]:
    s = 1.0 - t
    t2, t3 = t * t, t * t * t
    return (
        s * s * s / 6.0,
        (3.0 * t3 - 6.0 * t2 + 4.0) / 6.0,
        (-3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0) / 6.0,
        t3 / 6.0,
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _basis_slope(t: float) -> tuple[float, float, float, float]:
    s = 1.0 - t
    return -0.5 * s * s, 0.5 * (3.0 * t * t - 4.0 * t), 0.5 * (-3.0 * t * t + 2.0 * t + 1.0), 0.5 * t * t


@njit(cache=True, nogil=True, error_model="numpy")
def _heights(points: Array, centre: Array, frame: Array, start: float, step: float, profile: Array) -> Array:
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
def _rows(
    points: Array,
    rays: Array,
    centre: Array,
    frame: Array,
    start: float,
    step: float,
    profile: Array,
    values: Array,
    gain: Array,
    jacobian: Array,
    first: Index,
) -> None:
    """Residual, change along the ray, derivatives (4 axis, 4 spline), first spline index of each point."""
    for i in range(points.shape[0]):
        qx, qy, qz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        x = frame[0, 0] * qx + frame[0, 1] * qy + frame[0, 2] * qz
        y = frame[1, 0] * qx + frame[1, 1] * qy + frame[1, 2] * qz
        h = frame[2, 0] * qx + frame[2, 1] * qy + frame[2, 2] * qz
        rho = np.sqrt(x * x + y * y)
        g = (rho - start) / step
        k = int(np.floor(g))
        if k < 0 or k + 3 >= profile.size or rho < 1.0:
            first[i] = -1
            continue
        first[i] = k
        b0, b1, b2, b3 = _basis(g - k)
        s0, s1, s2, s3 = _basis_slope(g - k)
        f = b0 * profile[k] + b1 * profile[k + 1] + b2 * profile[k + 2] + b3 * profile[k + 3]
        df = (s0 * profile[k] + s1 * profile[k + 1] + s2 * profile[k + 2] + s3 * profile[k + 3]) / step
        values[i] = h - f
        rx = frame[0, 0] * rays[i, 0] + frame[0, 1] * rays[i, 1] + frame[0, 2] * rays[i, 2]
        ry = frame[1, 0] * rays[i, 0] + frame[1, 1] * rays[i, 1] + frame[1, 2] * rays[i, 2]
        rh = frame[2, 0] * rays[i, 0] + frame[2, 1] * rays[i, 1] + frame[2, 2] * rays[i, 2]
        gain[i] = abs(rh - df * (x * rx + y * ry) / rho)
        tilt = 1.0 + df * h / rho
        jacobian[i, 0] = x * tilt
        jacobian[i, 1] = y * tilt
        jacobian[i, 2] = df * x / rho
        jacobian[i, 3] = df * y / rho
        jacobian[i, 4], jacobian[i, 5], jacobian[i, 6], jacobian[i, 7] = -b0, -b1, -b2, -b3


@njit(cache=True, nogil=True, error_model="numpy")
def _normal_equations(
    values: Array, weight: Array, jacobian: Array, first: Index, size: int
) -> tuple[Array, Array]:
    matrix = np.zeros((size, size))
    vector = np.zeros(size)
    for i in range(values.size):
        w = weight[i]
        if w <= 0.0:
            continue
        k = 4 + first[i]
        for a in range(8):
            ja = w * jacobian[i, a]
            row = a if a < 4 else k + a - 4
            vector[row] -= ja * values[i]
            for b in range(a, 8):
                matrix[row, b if b < 4 else k + b - 4] += ja * jacobian[i, b]
    for a in range(size):
        for b in range(a):
            matrix[a, b] = matrix[b, a]
    return matrix, vector


@njit(cache=True, nogil=True, error_model="numpy")
def _cluster_gradients(
    values: Array, weight: Array, jacobian: Array, first: Index, cluster: Index, clusters: int, size: int
) -> Array:
    out = np.zeros((clusters, size))
    for i in range(values.size):
        w = weight[i] * values[i]
        if weight[i] <= 0.0:
            continue
        c, k = cluster[i], 4 + first[i]
        for a in range(4):
            out[c, a] += w * jacobian[i, a]
            out[c, k + a] += w * jacobian[i, a + 4]
    return out


def _frame_of(normal: Array) -> Array:
    """(3, 3) rows e1, e2, normal: right-handed, e1 as near to x as can be."""
    n = normal / np.linalg.norm(normal)
    e1 = np.array([1.0, 0.0, 0.0]) - n[0] * n
    e1 /= np.linalg.norm(e1)
    return np.array([e1, np.cross(n, e1), n])


@dataclass(eq=False)
class _State:
    """The working point of the iteration."""

    frame: Array
    centre: Array
    start: float
    step: float
    profile: Array


def _respline(state: _State, radii: Array, heights: Array, weight: Array, step: float) -> None:
    """Give the profile new knots over the radii that carry weight; its coefficients from local means."""
    good = weight > 0
    lo, hi = np.percentile(radii[good], [0.1, 99.9])
    count = max(4, int(np.ceil((hi - lo) / step)) + 3)
    state.start, state.step = float(lo), step
    edges = lo + step * (np.arange(count + 1) - 1.5)
    which = np.clip(np.searchsorted(edges, radii[good]) - 1, 0, count - 1)
    order = np.argsort(which, kind="stable")
    bounds = np.searchsorted(which[order], np.arange(count + 1))
    sorted_heights = heights[good][order]
    centres = np.array([np.median(sorted_heights[a:b]) if b > a else np.nan for a, b in pairwise(bounds)])
    known = np.isfinite(centres)
    state.profile = np.interp(np.arange(count), np.flatnonzero(known), centres[known])


def fit_revolution(
    points: Array,
    sigma: Array,
    rays: Array,
    cluster: Index,
    normal: Array,
    centre: Array,
    *,
    knot_steps: tuple[float, ...] = (8.0, 2.0),
    iterations: int = 8,
    scale_floor: float = 0.3,
) -> RevolutionFit:
    """Fit axis and profile to points on a wheel.

    Parameters
    ----------
    points
        (N, 3) rig frame, millimetres.
    sigma
        (N,) standard deviation of each point along its ray, millimetres.
    rays
        (N, 3) unit directions of the rays.
    cluster
        (N,) numbers from 0; residuals inside a cluster (a stretch of one line) may be correlated, so the
        covariance is estimated between clusters (the sandwich of Liang and Zeger 1986).
    normal, centre
        Start values: outboard direction (3,) and a point near the axis (3,).
    knot_steps
        Knot distances of the profile, millimetres, coarse to fine.
    iterations
        Most Gauss–Newton steps at each knot distance.
    scale_floor
        Least scale of the biweight in units of sigma.

    Raises
    ------
    DegenerateInputError
        When the points do not determine an axis.
    """
    points = np.ascontiguousarray(points)
    n = len(points)
    if n < 50:
        raise DegenerateInputError(field="points", expected="at least 50 points", seen=str(n))
    frame = _frame_of(np.asarray(normal, dtype=np.float64))
    state = _State(frame, np.asarray(centre, dtype=np.float64).copy(), 0.0, 1.0, np.zeros(4))
    values, gain, first = np.zeros(n), np.ones(n), np.zeros(n, np.int64)
    jacobian = np.zeros((n, 8))
    tukey = np.ones(n)
    for stage, step in enumerate(knot_steps):
        local = (points - state.centre) @ state.frame.T
        _respline(state, np.hypot(local[:, 0], local[:, 1]), local[:, 2], tukey, step)
        before = np.inf
        for iteration in range(iterations):
            weight, scale = _weigh(
                points, rays, sigma, state, values, gain, jacobian, first, tukey,
                _TUKEY if stage or iteration > 2 else 2.0 * _TUKEY, scale_floor,
            )  # fmt: skip
            delta = _step(state, values, weight, jacobian, first)
            if np.abs(delta[:2]).max() < 2e-8 and abs(scale - before) < 1e-3 * scale:
                break
            before = scale
    weight, scale = _weigh(
        points, rays, sigma, state, values, gain, jacobian, first, tukey, _TUKEY, scale_floor
    )
    matrix, _ = _system(state, values, weight, jacobian, first)
    inverse = np.linalg.inv(matrix)
    clusters = int(cluster.max()) + 1
    gradients = _cluster_gradients(values, weight, jacobian, first, cluster, clusters, len(matrix))
    half = gradients @ inverse[:, :2]
    used = len(np.unique(cluster[weight > 0]))
    # The biweight's influence falls before its weight does: its slope, not the weight, is the information.
    u2 = np.where(tukey > 0.0, 1.0 - np.sqrt(tukey), 1.0)
    information = float((np.sqrt(tukey) * (1.0 - 5.0 * u2)).sum() / tukey.sum())
    # Neighbours of one stretch count as one observation, which the profile's freedom also consumes.
    freedom = used / max(used - len(matrix), 0.2 * used)
    covariance = half.T @ half * freedom / max(information, 0.3) ** 2
    residuals = np.where(first >= 0, values, np.nan)
    return RevolutionFit(
        normal=state.frame[2],
        centre=state.centre,
        knots_start=state.start,
        knots_step=state.step,
        profile=state.profile,
        weights=np.where(first >= 0, tukey, 0.0),
        residuals=residuals,
        scale=scale,
        covariance=covariance,
        tilt_axes=state.frame[:2],
    )


def _weigh(
    points: Array,
    rays: Array,
    sigma: Array,
    state: _State,
    values: Array,
    gain: Array,
    jacobian: Array,
    first: Index,
    tukey: Array,
    cut: float,
    floor: float,
) -> tuple[Array, float]:
    """Residuals and derivatives at the working point, into the given arrays; weights and robust scale."""
    _rows(
        points, rays, state.centre, state.frame, state.start, state.step, state.profile,
        values, gain, jacobian, first,
    )  # fmt: skip
    inside = first >= 0
    if inside.sum() < 50:
        raise DegenerateInputError(
            field="points", expected="points around one axis", seen="fewer than 50 within the profile"
        )
    deviation = sigma * np.maximum(gain, 0.1)
    ratio = values / deviation
    scale = max(1.4826 * float(np.median(np.abs(ratio[inside]))), floor)
    u = np.minimum(np.abs(ratio) / (cut * scale), 1.0)
    tukey[:] = np.where(inside, (1.0 - u * u) ** 2, 0.0)
    return tukey / (scale * deviation) ** 2, scale


def _system(
    state: _State, values: Array, weight: Array, jacobian: Array, first: Index
) -> tuple[Array, Array]:
    """Normal equations with a weak prior on the axis position and a weak pull to a smooth profile."""
    size = AXIS + len(state.profile)
    matrix, vector = _normal_equations(values, weight, jacobian, first, size)
    matrix[2, 2] += _CENTRE_PRIOR**-2
    matrix[3, 3] += _CENTRE_PRIOR**-2
    profile = slice(AXIS, size)
    second = np.diff(np.eye(len(state.profile)), 2, axis=0)
    stiffness = 1e-4 * float(np.trace(matrix[profile, profile])) / len(state.profile) + 1e-12
    matrix[profile, profile] += stiffness * second.T @ second
    vector[profile] -= stiffness * second.T @ (second @ state.profile)
    return matrix, vector


def _step(state: _State, values: Array, weight: Array, jacobian: Array, first: Index) -> Array:
    """One Gauss–Newton step of the working point; returns the change of the unknowns."""
    matrix, vector = _system(state, values, weight, jacobian, first)
    try:
        delta: Array = cho_solve(cho_factor(matrix), vector)
    except np.linalg.LinAlgError as error:
        raise DegenerateInputError(
            field="points", expected="points that determine an axis", seen="a singular fit"
        ) from error
    delta[:2] = np.clip(delta[:2], -0.1, 0.1)
    delta[2:4] = np.clip(delta[2:4], -20.0, 20.0)
    e1, e2, normal = state.frame
    state.centre = state.centre + delta[2] * e1 + delta[3] * e2
    state.frame = _frame_of(normal + delta[0] * e1 + delta[1] * e2)
    state.profile = state.profile + delta[AXIS:]
    return delta
