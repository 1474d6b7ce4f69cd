"""A surface of revolution with a free profile: axis direction, axis position and profile fitted together.

The height of a point along the axis is compared with a cubic B-spline of its distance from the axis. Nothing
is assumed of the profile; what is not of revolution (lettering, valve, dirt, the edge of the rim) loses its
weight (Tukey's biweight, scale from the median absolute deviation).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from alignment.errors import DegenerateInputError
from alignment.wheel import revolution_kernels as kernels
from alignment.wheel.revolution_kernels import AXIS, FEWEST

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_TUKEY = 3.5  # in robust standard deviations; small, because letters and ring edges are not noise
_CENTRE_PRIOR = 30.0  # mm; keeps the axis position finite on a flat sidewall
_STIFFNESS = 1e-4  # of the profile, relative to the points' weight
_ROUGH_STEP = 8.0  # mm; knots of the first profile
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
        return kernels.heights(
            np.ascontiguousarray(points), self.centre, frame, self.knots_start, self.knots_step, self.profile
        )


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


def _respline(state: _State, data: _Data, step: float) -> None:
    """Give the profile new knots over the radii that carry weight; its coefficients from local medians."""
    state.step = step
    state.start, state.profile = kernels.local_medians(
        data.points, data.tukey, state.centre, state.frame, step
    )


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
    if n < FEWEST:
        raise DegenerateInputError(field="points", expected=f"at least {FEWEST} points", seen=str(n))
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
    half = kernels.cluster_pulls(
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
        kernels.rows(
            self.points, self.rays, state.centre, state.frame, state.start, state.step, state.profile,
            self.values, self.gain, self.jacobian, self.first,
        )  # fmt: skip
        scale = kernels.weigh(
            self.values, self.sigma, self.gain, self.first, cut, floor, self.tukey, self.weight
        )
        if scale < 0.0:
            raise DegenerateInputError(
                field="points",
                expected="points around one axis",
                seen=f"fewer than {FEWEST} within the profile",
            )
        return float(scale)


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
    corner, side, band, right = kernels.normal_equations(
        data.values, data.weight, data.jacobian, data.first, knots
    )
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
