"""A surface of revolution with a free profile: axis direction, axis position and profile fitted together.

The height of a point along the axis is compared with a cubic B-spline of its distance from the axis. Nothing
is assumed of the profile; what is not of revolution (lettering, valve, dirt, the edge of the rim) loses its
weight (Tukey's biweight, scale from the median absolute deviation).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from alignment.errors import DegenerateInputError
from alignment.kernels import njit

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AXIS = 4  # unknowns of the axis: two tilts, two shifts; the profile's coefficients follow
_TUKEY = 3.5  # in robust standard deviations; small, because letters and ring edges are not noise
_CENTRE_PRIOR = 30.0  # mm; keeps the axis position finite on a flat sidewall
_STIFFNESS = 1e-4  # of the profile, relative to the points' weight
_ROUGH_STEP = 8.0  # mm; knots of the first profile
_FEWEST = 50
_SETTLED = 2e-7  # radians, 0.0007′; the next step would be several times smaller


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
    values: Array, weight: Array, jacobian: Array, first: Index, knots: int
) -> tuple[Array, Array, Array, Array]:
    """Axis block (4, 4), axis–profile block (4, K), lower band (4, K) of the profile block, right side."""
    corner = np.zeros((AXIS, AXIS))
    side = np.zeros((knots, AXIS))
    band = np.zeros((knots, 4))
    right = np.zeros(AXIS + knots)
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
    return corner, side.T.copy(), band.T.copy(), right


@njit(cache=True, nogil=True, error_model="numpy")
def _cluster_pulls(
    values: Array,
    weight: Array,
    jacobian: Array,
    first: Index,
    cluster: Index,
    clusters: int,
    solution: Array,
) -> Array:
    """Pull (clusters, m) of each cluster's residuals, by columns (4 + K, m) of the inverse."""
    columns = solution.shape[1]
    out = np.zeros((clusters, columns))
    for i in range(values.size):
        w = weight[i] * values[i]
        if weight[i] <= 0.0:
            continue
        c, k = cluster[i], AXIS + first[i]
        for m in range(columns):
            total = 0.0
            for a in range(AXIS):
                total += jacobian[i, a] * solution[a, m] + jacobian[i, a + AXIS] * solution[k + a, m]
            out[c, m] += w * total
    return out


def _frame_of(normal: Array) -> Array:
    """(3, 3) rows e1, e2, normal: right-handed, e1 as near to x as can be."""
    n = normal / np.linalg.norm(normal)
    e1 = np.array([1.0, 0.0, 0.0]) - n[0] * n
    e1 /= np.linalg.norm(e1)
    e2 = (n[1] * e1[2] - n[2] * e1[1], n[2] * e1[0] - n[0] * e1[2], n[0] * e1[1] - n[1] * e1[0])
    return np.array([e1, e2, n])


@dataclass(eq=False)
class _State:
    """The working point of the iteration."""

    frame: Array
    centre: Array
    start: float = 0.0
    step: float = 1.0
    profile: Array = field(default_factory=lambda: np.zeros(4))


@njit(cache=True, nogil=True, error_model="numpy")
def _local_medians(
    points: Array, tukey: Array, centre: Array, frame: Array, step: float
) -> tuple[float, Array]:
    """First knot, and the median height around each; a knot without points takes that of the one before."""
    n = points.shape[0]
    thin = max(1, n // 4000)
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


def _respline(state: _State, data: _Data, step: float) -> None:
    """Give the profile new knots over the radii that carry weight; its coefficients from local medians."""
    state.step = step
    state.start, state.profile = _local_medians(data.points, data.tukey, state.centre, state.frame, step)


def fit_revolution(
    points: Array,
    sigma: Array,
    rays: Array,
    cluster: Index,
    normal: Array,
    centre: Array,
    *,
    knot_step: float = 1.0,
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
    knot_step
        Knot distance of the profile, millimetres.
    scale_floor
        Least scale of the biweight in units of sigma.

    Raises
    ------
    DegenerateInputError
        When the points do not determine an axis.
    """
    n = len(points)
    if n < _FEWEST:
        raise DegenerateInputError(field="points", expected=f"at least {_FEWEST} points", seen=str(n))
    state = _State(_frame_of(np.asarray(normal, dtype=np.float64)), np.array(centre, dtype=np.float64))
    # A rough profile on few points first, then the fine one, at last on all points.
    for thin, step, first_cut, iterations, settled in (
        (max(1, n // 2000), _ROUGH_STEP, 2.0, 5, 1e3 * _SETTLED),
        (max(1, n // 4000), 2.0 * knot_step, 1.0, 6, 20.0 * _SETTLED),
        (1, knot_step, 1.0, 6, _SETTLED),
    ):
        data = _Data.of(points[::thin], sigma[::thin], rays[::thin])
        _respline(state, data, step)
        before = np.inf
        for iteration in range(iterations):
            scale = data.weigh(state, _TUKEY * (first_cut if iteration < 3 else 1.0), scale_floor)
            delta = _step(state, data)
            if np.abs(delta[:2]).max() < settled and abs(scale - before) < 0.01 * scale:
                break
            before = scale
    scale = data.weigh(state, _TUKEY, scale_floor)
    return RevolutionFit(
        normal=state.frame[2],
        centre=state.centre,
        knots_start=state.start,
        knots_step=state.step,
        profile=state.profile,
        weights=data.tukey,
        residuals=np.where(data.first >= 0, data.values, np.nan),
        scale=scale,
        covariance=_tilt_covariance(state, data, cluster),
        tilt_axes=state.frame[:2],
    )


def _tilt_covariance(state: _State, data: _Data, cluster: Index) -> Array:
    """(2, 2) covariance of the two tilts, by the sandwich over clusters."""
    system = _system(state, data)
    size = len(system.right)
    inverse = np.ascontiguousarray(system.solve(np.eye(size, 2)))
    half = _cluster_pulls(
        data.values, data.weight, data.jacobian, data.first, cluster, int(cluster.max()) + 1, inverse
    )
    used = len(np.unique(cluster[data.weight > 0]))
    # The biweight's influence falls before its weight does: its slope, not the weight, is the information.
    root = np.sqrt(data.tukey)
    information = float((root * (5.0 * root - 4.0))[root > 0].sum() / data.tukey.sum())
    # Neighbours of one stretch count as one observation, which the profile's freedom also consumes.
    freedom = used / max(used - size, 0.2 * used)
    covariance: Array = half.T @ half * freedom / max(information, 0.3) ** 2
    return covariance


@dataclass(eq=False)
class _Data:
    """Points of one stage and what the working point makes of them: residuals, derivatives, weights."""

    points: Array
    sigma: Array
    rays: Array
    values: Array
    gain: Array
    first: Index
    jacobian: Array
    tukey: Array
    weight: Array

    @classmethod
    def of(cls, points: Array, sigma: Array, rays: Array) -> _Data:
        n = len(points)
        return cls(
            np.ascontiguousarray(points),
            np.ascontiguousarray(sigma),
            np.ascontiguousarray(rays),
            np.zeros(n),
            np.ones(n),
            np.zeros(n, np.int64),
            np.zeros((n, 8)),
            np.ones(n),
            np.ones(n),
        )

    def weigh(self, state: _State, cut: float, floor: float) -> float:
        """Residuals, derivatives and weights at the working point; returns the robust scale."""
        _rows(
            self.points, self.rays, state.centre, state.frame, state.start, state.step, state.profile,
            self.values, self.gain, self.jacobian, self.first,
        )  # fmt: skip
        scale = _weigh(self.values, self.sigma, self.gain, self.first, cut, floor, self.tukey, self.weight)
        if scale < 0.0:
            raise DegenerateInputError(
                field="points",
                expected="points around one axis",
                seen=f"fewer than {_FEWEST} within the profile",
            )
        return float(scale)


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(
    values: Array,
    sigma: Array,
    gain: Array,
    first: Index,
    cut: float,
    floor: float,
    tukey: Array,
    weight: Array,
) -> float:
    """Tukey's weights and the weights of the normal equations; returns the scale, −1 for too few points."""
    n = values.size
    ratio = np.empty(n)
    inside = 0
    for i in range(n):
        if first[i] >= 0:
            weight[i] = sigma[i] * max(gain[i], 0.1)
            ratio[inside] = abs(values[i]) / weight[i]
            inside += 1
    if inside < _FEWEST:
        return -1.0
    thin = max(1, inside // 4000)
    scale = max(1.4826 * np.median(ratio[:inside:thin]), floor)
    for i in range(n):
        tukey[i] = 0.0
        deviation, weight[i] = weight[i], 0.0
        if first[i] >= 0:
            u = values[i] / (deviation * cut * scale)
            if abs(u) < 1.0:
                tukey[i] = (1.0 - u * u) ** 2
                weight[i] = tukey[i] / (scale * deviation) ** 2
    return scale


@dataclass(frozen=True, eq=False)
class _Arrow:
    """Normal equations with the shape of an arrow: a full block of the axis, a band of the profile."""

    corner: Array
    side: Array
    band: Array
    right: Array

    def solve(self, right: Array) -> Array:
        """Solve for right sides (4 + K, m), by the Schur complement of the profile."""
        both = np.concatenate([self.side.T, right[AXIS:]], axis=1)
        try:
            folded = solveh_banded(self.band, both, lower=True, check_finite=False)
            schur = self.corner - self.side @ folded[:, :AXIS]
            axis = np.linalg.solve(schur, right[:AXIS] - self.side @ folded[:, AXIS:])
        except np.linalg.LinAlgError as error:
            raise DegenerateInputError(
                field="points", expected="points that determine an axis", seen="a singular fit"
            ) from error
        return np.concatenate([axis, folded[:, AXIS:] - folded[:, :AXIS] @ axis])


def _system(state: _State, data: _Data) -> _Arrow:
    """Normal equations with a weak prior on the axis position and a weak pull to a smooth profile."""
    knots = len(state.profile)
    corner, side, band, right = _normal_equations(data.values, data.weight, data.jacobian, data.first, knots)
    corner[2, 2] += _CENTRE_PRIOR**-2
    corner[3, 3] += _CENTRE_PRIOR**-2
    stiffness = _STIFFNESS * float(band[0].mean()) + 1e-12
    # The band of DᵀD, D the second difference: 1 −2 1 along each row.
    band[0, :-2] += stiffness
    band[0, 1:-1] += 4.0 * stiffness
    band[0, 2:] += stiffness
    band[1, :-2] -= 2.0 * stiffness
    band[1, 1:-1] -= 2.0 * stiffness
    band[2, :-2] += stiffness
    second = np.diff(state.profile, 2)
    pull = right[AXIS:]
    pull[:-2] -= stiffness * second
    pull[1:-1] += 2.0 * stiffness * second
    pull[2:] -= stiffness * second
    return _Arrow(corner, side, band, right)


def _step(state: _State, data: _Data) -> Array:
    """One Gauss–Newton step of the working point; returns the change of the unknowns."""
    system = _system(state, data)
    delta: Array = system.solve(system.right[:, None])[:, 0]
    delta[:2] = np.clip(delta[:2], -0.1, 0.1)
    delta[2:4] = np.clip(delta[2:4], -20.0, 20.0)
    e1, e2, normal = state.frame
    state.centre = state.centre + delta[2] * e1 + delta[3] * e2
    state.frame = _frame_of(normal + delta[0] * e1 + delta[1] * e2)
    state.profile = state.profile + delta[AXIS:]
    return delta
