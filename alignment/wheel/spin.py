"""The spin axis of a wheel from tyre planes measured while it turned.

A tyre seldom sits square on its hub, so the normal of the tyre plane runs around the spin axis on a cone
whose half-angle is the run-out. Nothing is known of how far the wheel had turned at each shot: the cone is
fitted to the normals alone, and the spin angles follow from it. Wheel centres do not turn and say nothing of
the axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal

import numpy as np

from alignment.arrays import Array, Mask
from alignment.values import Refusal, RefusalCode, Side, WheelMeasurement
from alignment.vehicle.angles import camber_toe, camber_toe_jacobian
from alignment.wheel.normals import Scatter, frame_about, normals_of, tilt_and_azimuth

FEWEST_SHOTS = 8
SHORTEST_TURN = math.radians(120.0)
"""Of the shots that were used; a shorter arc says too little of where its centre is."""

_LARGEST_RUN_OUT = math.radians(5.0)
_LARGEST_SCATTER = math.radians(1.0 / 60.0)
_OUTLIER = 4.0  # in robust standard deviations
_CLEAR = 3.5  # run-out in units of its uncertainty and of one shot's noise, above which it is real
_UNDERSTATED = (
    4.0  # scatter of a steady wheel in stated noise; letters turn with the wheel and are not in that
)
_ELONGATED = 5.0  # length over width of a scatter that is an arc and no noise
_STARTS = 24  # shots of which triples are drawn: 2024 of them
_ITERATIONS = 30
_SETTLED = 1e-12


@dataclass(frozen=True, eq=False)
class SpinMeasurement:
    """The spin axis of a wheel, free of run-out.

    Attributes
    ----------
    camber, toe
        Of the spin axis, radians, signs as the conventions say.
    angle_covariance
        (2, 2) of (camber, toe), radians². Covers the scatter of the shots and what is common to them (the
        calibration, where its covariance is known); for a short arc its centre is uncertain, which is in here
        too. Not covered: the pose of the rig in the vehicle, and a steering or axle that moved between shots.
    run_out
        Angle between tyre plane and spin axis, radians; None when it cannot be told from noise. The mean of
        the normals then counts as the axis, and how far the wheel turned stays unknown: a wheel that stood
        still looks the same, so such a result counts only for a wheel that is known to have turned fully.
    run_out_u
        Standard uncertainty of the run-out, radians; of the largest one that noise may hide, when `run_out`
        is None.
    phases
        For each shot the direction to which the tyre plane's normal leans from the axis, radians from −π to
        π, 0 towards the top and growing counter-clockwise seen from outboard: the turn of the wheel but for a
        constant. None when the run-out is.
    covered_turn
        A full turn less the largest gap between the phases of the shots that were used, radians; None when
        the phases are.
    used
        For each shot whether it was used; the others do not lie on the cone.
    coverage_factor
        k of `camber_u95` and `toe_u95`.
    degraded
        True when a shot that was used had lost a head.
    phases_u
        Standard uncertainty of each phase, radians; None when the phases are.
    wander
        Largest angle of the axis from its mean over the shots, radians; None where it was taken to stand.
    turned
        Turn from the first shot to the last, radians, counted as the phases, were it less than half a turn
        from each to the next; None when the phases are, or where nothing is known of the order.
    scatter
        Root mean square of what is neither cone nor wander, along one direction, radians.
    twice
        Largest angle by which the tyre plane leans twice per turn, by a second harmonic of its run-out; None
        where none was told.
    """

    camber: float
    toe: float
    angle_covariance: Array
    run_out: float | None
    run_out_u: float
    phases: tuple[float, ...] | None
    covered_turn: float | None
    used: tuple[bool, ...]
    coverage_factor: float = 2.0
    degraded: bool = False
    phases_u: tuple[float, ...] | None = None
    wander: float | None = None
    turned: float | None = None
    scatter: float | None = None
    twice: float | None = None
    method: Literal["spin_axis"] = field(default="spin_axis", init=False)
    outcome: Literal["measured"] = field(default="measured", init=False)

    @property
    def shots_used(self) -> int:
        """How many shots were used."""
        return sum(self.used)

    @property
    def camber_u(self) -> float:
        """Standard uncertainty of camber, radians."""
        return math.sqrt(self.angle_covariance[0, 0])

    @property
    def toe_u(self) -> float:
        """Standard uncertainty of toe, radians."""
        return math.sqrt(self.angle_covariance[1, 1])

    @property
    def camber_u95(self) -> float:
        """Expanded uncertainty of camber, radians."""
        return self.coverage_factor * self.camber_u

    @property
    def toe_u95(self) -> float:
        """Expanded uncertainty of toe, radians."""
        return self.coverage_factor * self.toe_u

    @property
    def high_spot(self) -> float | None:
        """Where the tyre stood out farthest at the last shot, counted as the phases; None when those are."""
        return None if self.phases is None else math.remainder(self.phases[-1] + math.pi, 2.0 * math.pi)

    @property
    def high_spot_u(self) -> float | None:
        """Standard uncertainty of `high_spot`, radians."""
        return None if self.phases_u is None else self.phases_u[-1]

    def run_out_mm(self, radius_mm: float) -> float | None:
        """Axial run-out at a radius, peak to peak, millimetres; None when the run-out is."""
        return None if self.run_out is None else run_out_mm(self.run_out, radius_mm)


def run_out_mm(run_out: float, radius_mm: float) -> float:
    """Axial run-out at a radius, peak to peak, millimetres, of a tilt against the spin axis, radians."""
    return 2.0 * radius_mm * math.sin(run_out)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A centre (2,), radius (0 for a steady wheel), used shots, scatter in units of the noise, covariance."""

    centre: Array
    radius: float
    used: Mask
    scale: float
    covariance: Array


def fit_spin_axis(
    measurements: Sequence[WheelMeasurement], side: Side, common_covariance: Array | None = None
) -> SpinMeasurement | Refusal:
    """Fit the spin axis of one wheel to tyre planes measured at different, unknown turns of it.

    Weighted least squares of the angles between normals and axis, started from the triple of shots whose
    circle leaves the others least (least quantile of squares), so that a quarter of the shots may be wrong.

    Parameters
    ----------
    measurements
        At least eight tyre planes of one rig.
    side
        Side of the vehicle.
    common_covariance
        (2, 2) part of every shot's `angle_covariance` that all shots share, radians², such as that of the
        calibration: it does not average out.

    Returns
    -------
    SpinMeasurement or Refusal
        A refusal when there are too few shots, when the wheel has a run-out and turned less than 120°, or
        when the normals lie on no cone.
    """
    shots = len(measurements)
    if shots < FEWEST_SHOTS:
        return Refusal(
            RefusalCode.TOO_FEW_SHOTS,
            f"{shots} shots of the turning wheel, at least {FEWEST_SHOTS} are needed; take more, spread "
            "over a full turn",
        )
    common = np.zeros((2, 2)) if common_covariance is None else common_covariance
    scatter = Scatter.of(measurements, side, common)
    most_outliers = shots // 4
    steady, cone = _fit_steady(scatter), _fit_cone(scatter)
    if cone is not None and _is_clear(cone, scatter):
        if shots - cone.used.sum() > most_outliers or cone.scale * scatter.sigma > _LARGEST_SCATTER:
            return _inconsistent(cone, scatter)
        return _on_cone(cone, scatter, side, common, measurements)
    if steady.scale > _UNDERSTATED or shots - steady.used.sum() > most_outliers:
        return _short_turn(None) if _is_arc(scatter, steady) else _inconsistent(steady, scatter)
    return _without_run_out(steady, scatter, side, common, measurements)


def _fit_steady(scatter: Scatter) -> _Fit:
    """Weighted mean of the points without outliers."""
    information = np.linalg.inv(scatter.noise)
    centre, used = np.median(scatter.points, axis=0), np.ones(len(scatter.points), dtype=bool)
    for _ in range(_ITERATIONS):
        before = used
        square = np.einsum("na,nab,nb->n", scatter.points - centre, information, scatter.points - centre)
        # The median of a squared distance in two dimensions is 2 ln 2 of the variance.
        used = square <= _OUTLIER**2 * max(1.0, float(np.median(square)) / math.log(4.0))
        covariance = np.linalg.inv(information[used].sum(axis=0))
        centre = covariance @ np.einsum("nab,nb->a", information[used], scatter.points[used])
        if (used == before).all():
            break
    off = scatter.points[used] - centre
    chi2 = float(np.einsum("na,nab,nb->", off, information[used], off))
    scale = math.sqrt(chi2 / (2 * used.sum() - 2))
    return _Fit(centre, 0.0, used, scale, max(1.0, scale) ** 2 * covariance)


def _fit_cone(scatter: Scatter) -> _Fit | None:
    """Circle of the points, exact on the sphere; None when no circle of a believable run-out is near them."""
    start = _start_of_cone(scatter)
    if start is None:
        return None
    axis, radius, cut = start
    frame = frame_about(axis)
    normals = normals_of(scatter.points, scatter.frame)
    used = np.ones(len(normals), dtype=bool)
    for _ in range(_ITERATIONS):
        angle, azimuth = tilt_and_azimuth(normals, frame)
        radial = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
        sigma = np.sqrt(np.einsum("na,nab,nb->n", radial, scatter.noise, radial))
        residual = (angle - radius) / sigma
        used = np.abs(residual) <= cut
        if used.sum() <= 3:
            return None
        rows = np.column_stack([radial, np.ones(len(radial))])[used] / sigma[used, None]
        inverse = np.linalg.pinv(rows.T @ rows)
        step = inverse @ rows.T @ residual[used]
        radius += float(step[2])
        frame = frame_about(frame[2] + step[:2] @ frame[:2])
        if not 0.0 < radius <= _LARGEST_RUN_OUT:
            return None
        if np.abs(step).max() < _SETTLED:
            break
    scale = math.sqrt(float(residual[used] @ residual[used]) / (used.sum() - 3))
    return _Fit(frame[2], radius, used, scale, max(1.0, scale) ** 2 * inverse)


def _start_of_cone(scatter: Scatter) -> tuple[Array, float, float] | None:
    """Axis, radius and outlier limit (in stated noise) of the best circle through three points."""
    points, shots = scatter.points, len(scatter.points)
    chosen = np.unique(np.linspace(0, shots - 1, min(shots, _STARTS)).round().astype(np.intp))
    a, b, c = points[np.array(list(combinations(chosen, 3)))].transpose(1, 0, 2)
    ab, ac = b - a, c - a
    twice_area = 2.0 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    lengths = np.column_stack([(ab**2).sum(axis=1), (ac**2).sum(axis=1)])
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.column_stack(
            [
                (ac[:, 1] * lengths[:, 0] - ab[:, 1] * lengths[:, 1]) / twice_area,
                (ab[:, 0] * lengths[:, 1] - ac[:, 0] * lengths[:, 0]) / twice_area,
            ]
        )
        radius = np.linalg.norm(centre, axis=1)
        possible = radius <= _LARGEST_RUN_OUT
    if not possible.any():
        return None
    centre, radius = centre[possible] + a[possible], radius[possible]
    distance = np.linalg.norm(points[None] - centre[:, None], axis=2)
    kept = shots - shots // 4
    quantile = np.partition(np.abs(distance - radius[:, None]), kept - 1, axis=1)[:, kept - 1]
    best = int(quantile.argmin())
    # Three quarters of a normal distribution lie within 1.15 σ; three parameters make few points look better.
    spread = quantile[best] / 1.15 * (1.0 + 5.0 / (shots - 3)) / scatter.sigma
    cut = _OUTLIER * max(1.0, float(spread))
    return normals_of(centre[best], scatter.frame), float(radius[best]), cut


def _is_clear(cone: _Fit, scatter: Scatter) -> bool:
    """Whether the run-out stands clear of the noise, so that the cone is one."""
    noise = scatter.sigma * max(1.0, cone.scale)
    return cone.radius > _CLEAR * max(noise, math.sqrt(cone.covariance[2, 2]))


def _is_arc(scatter: Scatter, steady: _Fit) -> bool:
    width, length = np.sqrt(np.linalg.eigvalsh(np.cov(scatter.points[steady.used].T)))
    return bool(length > _ELONGATED * width)


def _on_cone(
    cone: _Fit, scatter: Scatter, side: Side, common: Array, measurements: Sequence[WheelMeasurement]
) -> SpinMeasurement | Refusal:
    frame = frame_about(cone.centre)
    _, azimuth = tilt_and_azimuth(normals_of(scatter.points, scatter.frame), frame)
    covered = covered_by(azimuth[cone.used])
    if covered < SHORTEST_TURN:
        return _short_turn(covered)
    turn = camber_toe_jacobian(frame[2], side) @ frame[:2].T
    camber, toe = camber_toe(frame[2], side)
    return SpinMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=turn @ cone.covariance[:2, :2] @ turn.T + common,
        run_out=cone.radius,
        run_out_u=math.sqrt(cone.covariance[2, 2]),
        phases=tuple(map(float, azimuth)),
        covered_turn=covered,
        used=tuple(map(bool, cone.used)),
        coverage_factor=measurements[0].coverage_factor,
        degraded=any(m.degraded for m, used in zip(measurements, cone.used, strict=True) if used),
        phases_u=(
            math.hypot(scatter.sigma, math.sqrt(0.5 * np.trace(cone.covariance[:2, :2]))) / cone.radius,
        )
        * len(measurements),
        scatter=cone.scale * scatter.sigma,
    )


def covered_by(phases: Array) -> float:
    """A full turn less the largest gap between phases, radians."""
    seen = np.sort(np.mod(phases, 2.0 * math.pi))
    return 2.0 * math.pi - float(np.diff(seen, append=seen[0] + 2.0 * math.pi).max())


def _without_run_out(
    steady: _Fit, scatter: Scatter, side: Side, common: Array, measurements: Sequence[WheelMeasurement]
) -> SpinMeasurement:
    frame = frame_about(normals_of(steady.centre, scatter.frame))
    # A run-out as large as the noise would not be seen, and over part of a turn it shifts the mean.
    hidden = scatter.sigma * max(1.0, steady.scale)
    turn = camber_toe_jacobian(frame[2], side) @ frame[:2].T
    covariance = steady.covariance + 0.5 * hidden**2 * np.eye(2)
    camber, toe = camber_toe(frame[2], side)
    return SpinMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=turn @ covariance @ turn.T + common,
        run_out=None,
        run_out_u=hidden,
        phases=None,
        covered_turn=None,
        used=tuple(map(bool, steady.used)),
        coverage_factor=measurements[0].coverage_factor,
        degraded=any(m.degraded for m, used in zip(measurements, steady.used, strict=True) if used),
        scatter=steady.scale * scatter.sigma,
    )


def _short_turn(covered: float | None) -> Refusal:
    seen = "only a small part of a turn" if covered is None else f"{math.degrees(covered):.0f}°"
    return Refusal(
        RefusalCode.TURN_TOO_SHORT,
        f"the wheel has run-out, and its shots cover {seen}, at least {math.degrees(SHORTEST_TURN):.0f}° are "
        "needed; turn it further between the shots, best over a full turn",
    )


def _inconsistent(fit: _Fit, scatter: Scatter) -> Refusal:
    outside = int((~fit.used).sum())
    scatter_arcmin = 60.0 * math.degrees(fit.scale * scatter.sigma)
    return Refusal(
        RefusalCode.INCONSISTENT_SHOTS,
        f"the tyre planes of the shots do not lie on a cone about one axis: {outside} of {len(fit.used)} do "
        f"not fit, the others scatter by {scatter_arcmin:.2f}′; check that all shots are of one wheel, that "
        "the steering and the vehicle stood still, and the rig's calibration",
    )
