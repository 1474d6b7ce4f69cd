"""What ordinary wheels tell of a moved camera: the points of all heads lie on one surface of revolution.

Axis and profile of each wheel come from the heads that did not move. How the points of all heads stand off
that surface, axis and profile left free to follow, is linear in the errors of the cameras; what is free is
eliminated, so that of thousands of points a few equations in the cameras remain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index
from alignment.calibration.crosses import SeenWheel
from alignment.calibration.dense import products
from alignment.calibration.prediction import line_sensitivity, profile_basis
from alignment.calibration.row_equations import Equations, camera_rows, compressed
from alignment.errors import DegenerateInputError
from alignment.robust import deviation_of
from alignment.stereo.correspondence import Candidates, StereoGeometry, match_heads, match_lines
from alignment.stereo.surface import nearest_candidates, plane_hypotheses
from alignment.values import MeasureSettings, RigCalibration
from alignment.wheel.revolution import RevolutionFit, fit_revolution

_PLANE_GATE = 30.0  # mm; relief of a sidewall about its mean plane
_GATE, _MOVED_GATE = 2.0, 25.0  # mm from the surface; farther lie the ghosts of wrong matches
_GOOD_SCALE = 6.0  # residuals in units of the noise below which no other hypothesis needs a look
_HYPOTHESES = 3
_STRETCH = 25  # line points that count as one cluster
_PER_HEAD = 600  # points; more tell nothing new
_FEWEST = 50  # points of the moved head
_TUKEY = 3.5  # in robust standard deviations
_ROUNDS = 6
_NEAR_MM = 0.5  # at first a point that far off has half its weight
_CENTRE_PRIOR = 30.0  # mm
_WEAK = 1e-3  # pull of profile and moved pose, relative to a point's weight


@dataclass(frozen=True, eq=False)
class _Rows:
    """Points as linear equations in axis (4), profile and cameras; each array by point (N).

    Attributes
    ----------
    height, sigma
        Above the surface, and its standard deviation, millimetres.
    axis
        (N, 4) derivatives by two tilts and two shifts of the axis.
    radius
        Distance from the axis.
    cameras
        (N, P) derivatives by all parameters of the calibration.
    cluster
        Stretch of one line, whose points share errors.
    """

    height: Array
    sigma: Array
    axis: Array
    radius: Array
    cameras: Array
    cluster: Index


@dataclass(frozen=True, eq=False)
class WheelBase:
    """A wheel as the heads see it that did not move.

    Attributes
    ----------
    wheel
        Its light lines.
    moved
        Number of the head with the moved camera.
    depth_range_mm
        Where the surface may be.
    fit
        The surface, of the other heads' points.
    others
        Their rows.
    """

    wheel: SeenWheel
    moved: int
    depth_range_mm: tuple[float, float]
    fit: RevolutionFit
    others: _Rows


def wheel_base(
    wheel: SeenWheel, calibration: RigCalibration, moved: int, settings: MeasureSettings
) -> WheelBase | None:
    """Fit the surface of a wheel to the heads that did not move; None where it is not found.

    Parameters
    ----------
    wheel
        Light lines of one shot.
    calibration
        As in force; right for all heads but one.
    moved
        Number of that head.
    settings
        Depth range and largest angle count.
    """
    lines = [pair for pair in wheel if pair is not None]
    if len(lines) < len(wheel) or len(wheel) < 3:
        return None
    others = [k for k in range(len(wheel)) if k != moved]
    geometry = StereoGeometry.of([calibration.heads[k] for k in others])
    matched = match_heads([lines[k] for k in others], geometry, settings.depth_range_mm)
    if min(len(candidates.points) for candidates in matched) < settings.minimum_points:
        return None
    fit = _surface(matched, settings)
    if fit is None:
        return None
    rows = [
        _rows(calibration, k, candidates, fit, _GATE) for k, candidates in zip(others, matched, strict=True)
    ]
    return WheelBase(wheel, moved, settings.depth_range_mm, fit, _joined(rows))


def _surface(matched: Sequence[Candidates], settings: MeasureSettings) -> RevolutionFit | None:
    """Fit hypotheses of the wheel's mean plane in turn; the first that fits to its noise, else the best."""
    first = np.cumsum([0, *(int(c.left_point.max()) + 1 for c in matched)])
    group = np.concatenate([c.left_point + n for c, n in zip(matched, first, strict=False)])
    points = np.concatenate([c.points for c in matched])
    sigma, rays, spread = (
        np.concatenate([getattr(c, name) for c in matched]) for name in ("sigma", "rays", "spread")
    )
    slope = math.tan(settings.maximum_angle) + 0.05
    best: RevolutionFit | None = None
    for hypothesis in plane_hypotheses(points, group, settings.depth_range_mm, slope)[:_HYPOTHESES]:
        c = hypothesis.coefficients
        heights = points[:, 2] - (c[0] + points[:, :2] @ c[1:])
        chosen = nearest_candidates(heights, group, _PLANE_GATE)
        cluster = group[chosen] // _STRETCH
        try:
            fit = fit_revolution(
                points[chosen],
                sigma[chosen],
                rays[chosen],
                cluster,
                np.array([-c[1], -c[2], 1.0]),
                np.array([0.0, 0.0, c[0]]),
                spread=spread[chosen],
            )
        except DegenerateInputError:
            continue
        if best is None or fit.scale < best.scale:
            best = fit
        if best.scale < _GOOD_SCALE:
            return best
    return best


def wheel_equations(bases: Sequence[WheelBase], calibration: RigCalibration) -> Equations:
    """Equations in the cameras' parameters that several wheels give.

    Parameters
    ----------
    bases
        The wheels, all with the same moved head.
    calibration
        With the present estimate of the moved camera; the other heads as they were for `bases`.

    Raises
    ------
    DegenerateInputError
        When no wheel is given, or on none the moved head has points near the surface of the others.
    """
    wheels: list[tuple[Array, Array, Array]] = []
    for base in bases:
        pair = base.wheel[base.moved]
        assert pair is not None
        matched = match_lines(*pair, calibration.heads[base.moved], base.depth_range_mm)
        mine = _rows(calibration, base.moved, matched, base.fit, _MOVED_GATE)
        if len(mine.height) < _FEWEST:
            continue
        wheels.append(_eliminated(base, mine, calibration))
    if not wheels:
        raise DegenerateInputError(
            field="shots", expected="wheels that all heads see", seen="none", cure="Take other shots."
        )
    normals, rights, scatters = (np.array(each) for each in zip(*wheels, strict=True))
    equations, mixing = compressed(normals.sum(axis=0), rights.sum(axis=0))
    # Neighbouring points share errors, and no tyre is quite a body of revolution: where stretches of lines,
    # or whole wheels, scatter more than their points promise, that is the noise.
    of_stretches = np.einsum("ra,ra->r", mixing, products(scatters.sum(axis=0), mixing.T).T)
    shares = np.array([products(mixing.T, products(normal, mixing.T)) for normal in normals])
    apart = rights @ mixing.T - np.einsum("nrs,s->nr", shares, equations.values)
    count = len(wheels)
    of_wheels = np.square(apart).sum(axis=0) * count / max(count - 1, 1)
    noise = np.sqrt(np.maximum(np.maximum(of_stretches, of_wheels), 1.0))
    return Equations(equations.values / noise, equations.derivatives / noise[:, None])


def _rows(
    calibration: RigCalibration, head: int, matched: Candidates, fit: RevolutionFit, gate: float
) -> _Rows:
    """Rows of the points of one head that lie near the surface."""
    heights = np.nan_to_num(fit.height(matched.points), nan=np.inf)
    chosen = np.flatnonzero(nearest_candidates(heights, matched.left_point, gate))
    chosen = chosen[:: max(1, len(chosen) // _PER_HEAD)]
    points = matched.points[chosen]
    e1, e2 = fit.tilt_axes
    arm = points - fit.centre
    x, y, above = arm @ e1, arm @ e2, arm @ fit.normal
    radius = np.maximum(np.hypot(x, y), 1.0)
    # Spline coefficient k stands at knot k − 1; their differences are slopes halfway between.
    knots = fit.knots_start + fit.knots_step * (np.arange(len(fit.profile) - 1) - 0.5)
    slope = np.interp(radius, knots, np.diff(fit.profile) / fit.knots_step)
    outward = (x / radius)[:, None] * e1 + (y / radius)[:, None] * e2
    upward = fit.normal - slope[:, None] * outward
    rows = camera_rows(calibration)
    mine = slice(rows[2 * head].start, rows[2 * head + 1].stop)
    cameras = np.zeros((len(points), len(calibration.parameter_names)))
    if len(points):
        moves = line_sensitivity(calibration.heads[head], points)
        cameras[:, mine] = np.einsum("na,nap->np", upward, moves)
    # Along its ray a point is uncertain; what counts is how that lifts it off the surface.
    gain = np.maximum(np.abs(np.einsum("na,na->n", upward, matched.rays[chosen])), 0.1)
    lean = 1.0 + slope * above / radius
    return _Rows(
        height=heights[chosen],
        sigma=matched.sigma[chosen] * gain,
        axis=np.column_stack([x * lean, y * lean, slope * x / radius, slope * y / radius]),
        radius=radius,
        cameras=cameras,
        cluster=(head * 4096 + matched.left_line[chosen]) * 65536 + matched.left_point[chosen] // _STRETCH,
    )


def _joined(rows: Sequence[_Rows]) -> _Rows:
    names = ("height", "sigma", "axis", "radius", "cameras", "cluster")
    return _Rows(*(np.concatenate([getattr(each, name) for each in rows]) for name in names))


def _eliminated(base: WheelBase, moved: _Rows, calibration: RigCalibration) -> tuple[Array, Array, Array]:
    """Normal equations (P, P), (P,) of one wheel in the cameras alone, and their scatter over clusters."""
    rows = _joined([base.others, moved])
    free = np.column_stack([rows.axis, -profile_basis(rows.radius)])
    pull = np.full(free.shape[1], _WEAK)
    pull[:4] = [0.0, 0.0, _CENTRE_PRIOR**-2, _CENTRE_PRIOR**-2]
    # For the weights alone the moved head's left camera may go anywhere, which takes its patch anywhere.
    pose = rows.cameras[:, camera_rows(calibration)[2 * base.moved]][:, :6]
    pose = pose / np.maximum(np.abs(pose).max(axis=0), 1e-30)
    design = np.column_stack([free, pose])
    weight = 1.0 / (_NEAR_MM + np.abs(rows.height))
    for number in range(_ROUNDS):
        normal = products(design * weight[:, None], design)
        mean = float(weight.mean())
        normal[range(len(normal)), range(len(normal))] += mean * np.append(pull, np.full(6, _WEAK**2))
        step = np.linalg.solve(normal, np.einsum("na,n->a", design, weight * rows.height))
        rest = rows.height - np.einsum("na,a->n", design, step)
        scale = max(deviation_of(rest / rows.sigma), 0.3)
        cut = _TUKEY * scale * (2.0 if number < 2 else 1.0)
        tukey = np.clip(1.0 - (rest / (cut * rows.sigma)) ** 2, 0.0, None) ** 2
        weight = tukey / (scale * rows.sigma) ** 2
    root = np.sqrt(weight)[:, None]
    free, known = free * root, np.column_stack([rows.cameras, rows.height]) * root
    normal = products(free, free)
    normal[range(len(normal)), range(len(normal))] += pull * float(weight.mean())
    known = known - free @ np.linalg.solve(normal, products(free, known))
    _, cluster = np.unique(rows.cluster, return_inverse=True)
    pulls = np.zeros((int(cluster.max()) + 1, known.shape[1] - 1))
    np.add.at(pulls, cluster, known[:, :-1] * (root[:, 0] * rest)[:, None])
    reduced = products(known, known)
    return reduced[:-1, :-1], reduced[:-1, -1], products(pulls, pulls)
