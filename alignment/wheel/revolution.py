"""A surface of revolution with a free profile: axis direction, axis position and profile fitted together.

The height of a point along the axis is compared with a cubic B-spline of its distance from the axis. Nothing
is assumed of the profile; what is not of revolution (lettering, valve, dirt, the edge of the rim) loses its
weight (Tukey's biweight, scale from the median absolute deviation).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from alignment.arrays import Array, Index
from alignment.errors import DegenerateInputError
from alignment.stereo.pool import take_points
from alignment.wheel import revolution_kernels as kernels
from alignment.wheel.disturbance import undisturbed
from alignment.wheel.revolution_kernels import AXIS, DEVIATION, FEWEST_POINTS, TUKEY, VALUE, WEIGHT
from alignment.wheel.revolution_steps import (
    SETTLED,
    SINGULAR,
    TOO_FEW,
    frame_of,
    iterate,
    matrix_of,
    solve_arrow,
)

_TUKEY = 4.0  # in robust standard deviations; small, because letters and ring edges are not noise
_ROUGH_STEP = 8.0  # mm; knots of the first profile
_CLEANINGS = (1, 4)  # most iterations after each look for disturbed stretches
_SOME, _WIDE_CUT, _NEAR_STEPS = 1000, 2.0, 3  # points that bring a near start nearer, and how
_SETTLED = 4e-7  # radians, 0.0014′; the next step would be several times smaller


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
        (N,) height above the fitted surface, millimetres; NaN for points that were left out.
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

    def radii(self, points: Array) -> Array:
        """Distances (N,) of points (N, 3) from the axis, millimetres."""
        out: Array = np.hypot(*(self.tilt_axes @ (points - self.centre).T))
        return out


@dataclass(eq=False)
class _State:
    """The working point of the iteration."""

    frame: Array
    centre: Array
    start: float = 0.0
    step: float = 1.0
    profile: Array = field(default_factory=lambda: np.zeros(4))


def fit_revolution(
    points: Array,
    sigma: Array,
    rays: Array,
    cluster: Index,
    normal: Array,
    centre: Array,
    *,
    line: Index | None = None,
    spread: Array | None = None,
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
    line
        (N,) number of each point's line, points in their order along it: stretches that leave the surface
        together are left out. None: no order is known.
    spread
        (N,) variance of each point's light line on the surface, millimetres squared; where the surface bends
        within the line, the point counts less. None: lines without width.
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
    spread = np.zeros(n) if spread is None else spread
    if n < FEWEST_POINTS:
        raise DegenerateInputError(field="points", expected=f"at least {FEWEST_POINTS} points", seen=str(n))
    state = _State(frame_of(np.asarray(normal, dtype=np.float64)), np.array(centre, dtype=np.float64))
    settled = _settled(state, (points, sigma, rays, spread), line, knot_step, scale_floor)
    return _as_fit(state, cluster, *settled)


def fit_near(
    points: Array,
    sigma: Array,
    rays: Array,
    cluster: Index,
    near: RevolutionFit,
    *,
    line: Index,
    spread: Array,
    scale_floor: float = 0.3,
) -> RevolutionFit:
    """As `fit_revolution`, of a wheel that hardly moved since another fit, from its axis and profile on.

    Raises
    ------
    DegenerateInputError
        When the points do not determine an axis.
    """
    n = len(points)
    if n < FEWEST_POINTS:
        raise DegenerateInputError(field="points", expected=f"at least {FEWEST_POINTS} points", seen=str(n))
    state = _State(
        frame_of(near.normal), near.centre.copy(), near.knots_start, near.knots_step, near.profile.copy()
    )
    every = (points, sigma, rays, spread)
    # What the wheel moved by shows on some points; then all of them as at the end of the whole fit.
    thin = max(1, n // _SOME)
    _Data.of(*(each[::thin] for each in every)).iterate(
        state, _WIDE_CUT, scale_floor, _NEAR_STEPS, 20.0 * _SETTLED, renew=True
    )
    data = _Data.of(*every)
    _, scale = data.iterate(state, 1.0, scale_floor, 0, 0.0)
    keep = undisturbed(data.ratio, data.first >= 0, line, scale)
    data = _Data.of(*take_points(keep, *every))
    settles, scale = data.iterate(state, 1.0, scale_floor, _CLEANINGS[-1], _SETTLED)
    if not settles:
        _, scale = data.iterate(state, 1.0, scale_floor, 0, 0.0)
    return _as_fit(state, cluster, np.flatnonzero(keep), data, scale)


def _as_fit(state: _State, cluster: Index, kept: Index, data: _Data, scale: float) -> RevolutionFit:
    """Result of a working point at its end."""
    n = len(cluster)
    weights, residuals = np.zeros(n), np.full(n, np.nan)
    weights[kept] = data.table[TUKEY]
    residuals[kept] = np.where(data.first >= 0, data.table[VALUE], np.nan)
    return RevolutionFit(
        normal=state.frame[2],
        centre=state.centre,
        knots_start=state.start,
        knots_step=state.step,
        profile=state.profile,
        weights=weights,
        residuals=residuals,
        scale=scale,
        covariance=_tilt_covariance(state, data, cluster[kept]),
        tilt_axes=state.frame[:2],
    )


def _settled(
    state: _State, every: tuple[Array, ...], line: Index | None, knot_step: float, scale_floor: float
) -> tuple[Index, _Data, float]:
    """Iterate the state to its end: which points were kept, their residuals and weights, and the scale.

    `every` are points, sigma, rays and spread of `fit_revolution`, whose other arguments these are.
    """
    n = len(every[0])
    # A rough profile on few points first, then the fine one, at last on all points.
    for thin, step, first_cut, iterations, settled in (
        (max(1, n // 1000), _ROUGH_STEP, 2.0, 5, 1e3 * _SETTLED),
        (max(1, n // 2000), 2.0 * knot_step, 1.0, 2, 20.0 * _SETTLED),
        (1, knot_step, 1.0, 2 if line is not None else 5, _SETTLED),
    ):
        data = _Data.of(*(each[::thin] for each in every))
        state.step = step
        state.start, state.profile = kernels.local_medians(data.points, state.centre, state.frame, step)
        settles, scale = data.iterate(state, first_cut, scale_floor, iterations, settled, renew=True)
    kept = np.arange(n)
    if line is not None:
        for iterations in _CLEANINGS:
            keep = undisturbed(data.ratio, data.first >= 0, line[kept], scale)
            kept = kept[keep]
            data = _Data.of(*take_points(keep, data.points, data.sigma, data.rays, data.spread))
            settles, scale = data.iterate(state, 1.0, scale_floor, iterations, _SETTLED)
    if not settles:
        _, scale = data.iterate(state, 1.0, scale_floor, 0, 0.0)
    return kept, data, scale


def _tilt_covariance(state: _State, data: _Data, cluster: Index) -> Array:
    """(2, 2) covariance of the two tilts, by the sandwich over clusters."""
    corner, side, band, _ = matrix_of(data.table, data.first, len(state.profile))
    size = AXIS + len(state.profile)
    inverse = np.eye(size, 2)
    if not solve_arrow(corner, side, band, inverse):
        raise _undetermined()
    square, used = kernels.cluster_pulls(data.table, data.first, cluster, int(cluster.max()) + 1, inverse)
    # The biweight's influence falls before its weight does: its slope, not the weight, is the information.
    tukey = data.table[TUKEY]
    root = np.sqrt(tukey)
    information = float((root * (5.0 * root - 4.0)).sum() / tukey.sum())
    # Neighbours of one stretch count as one observation, which the profile's freedom also consumes.
    freedom = used / max(used - size, 0.2 * used)
    covariance: Array = square * freedom / max(information, 0.3) ** 2
    return covariance


def least_covariance(points: Array, sigma: Array, rays: Array, fit: RevolutionFit) -> Array:
    """(2, 2) Cramér–Rao bound of the tilts along `fit.tilt_axes`, radians².

    No unbiased estimate from these points has less, if they err along their rays by `sigma` and by nothing
    else, and neither profile nor axis are known. Parameters as for `fit_revolution`.

    Raises
    ------
    DegenerateInputError
        When the points do not determine an axis.
    """
    frame = np.vstack([fit.tilt_axes, fit.normal])
    none = np.zeros(len(points))
    data, still = _Data.of(points, sigma, rays, none), _Data.of(points, none, rays, none)
    for each in (data, still):
        kernels.rows(
            each.points, each.sigma, each.rays, each.spread, fit.centre, frame, fit.knots_start,
            fit.knots_step, fit.profile, each.table, each.first,
        )  # fmt: skip
    variance = data.table[DEVIATION] ** 2 - still.table[DEVIATION] ** 2
    data.table[WEIGHT] = np.where(
        (data.first >= 0) & (variance > 0.0), 1.0 / np.maximum(variance, 1e-30), 0.0
    )
    corner, side, band, _ = matrix_of(data.table, data.first, len(fit.profile))
    inverse = np.eye(AXIS + len(fit.profile), 2)
    if not solve_arrow(corner, side, band, inverse):
        raise _undetermined()
    return inverse[:2]


def _undetermined() -> DegenerateInputError:
    return DegenerateInputError(
        field="points", expected="points that determine an axis", seen="a singular fit"
    )


@dataclass(eq=False)
class _Data:
    """Points of one stage and what the working point makes of them: residuals, derivatives, weights."""

    points: Array
    sigma: Array
    rays: Array
    spread: Array
    table: Array
    first: Index

    @classmethod
    def of(cls, points: Array, sigma: Array, rays: Array, spread: Array) -> _Data:
        n = len(points)
        return cls(
            np.ascontiguousarray(points),
            np.ascontiguousarray(sigma),
            np.ascontiguousarray(rays),
            np.ascontiguousarray(spread),
            np.empty((kernels.ROWS, n)),
            np.empty(n, np.int64),
        )

    @property
    def ratio(self) -> Array:
        """(N,) residual over its deviation."""
        ratio: Array = self.table[VALUE] / self.table[DEVIATION]
        return ratio

    def iterate(
        self,
        state: _State,
        first_cut: float,
        floor: float,
        iterations: int,
        settled: float,
        *,
        renew: bool = False,
    ) -> tuple[bool, float]:
        """Move the working point by Gauss–Newton steps, or only weigh for none; settled?, and the scale."""
        outcome, scale = iterate(
            self.points, self.sigma, self.rays, self.spread, state.centre, state.frame, state.start,
            state.step, state.profile, _TUKEY, first_cut, floor, iterations, settled, renew,
            self.table, self.first,
        )  # fmt: skip
        if outcome == TOO_FEW:
            raise DegenerateInputError(
                field="points",
                expected="points around one axis",
                seen=f"fewer than {FEWEST_POINTS} within the profile",
            )
        if outcome == SINGULAR:
            raise _undetermined()
        return outcome == SETTLED, float(scale)
