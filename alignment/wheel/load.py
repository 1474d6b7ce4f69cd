"""The wheel under load: what the contact patch does to the sidewall is told from the axis, and taken off.

Surface of revolution and load are found in turn: the heights that the surface leaves, and the load so far,
tell the load and the turn of the axis together (`load_model`); without that load the surface is fitted again.
Both settle where the joint problem has its solution.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from alignment import robust
from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.stereo.pool import PointPool
from alignment.stereo.surface import nearest_candidates
from alignment.wheel.agreement import MOVES, HeadMoves, head_moves
from alignment.wheel.load_cells import Cells, condense, local_weights
from alignment.wheel.load_hypothesis import KNOTS_MM, spline_basis
from alignment.wheel.load_model import LoadModel, fit_load, gain_from, side_force_seen
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.revolution_steps import frame_of
from alignment.wheel.search import SURFACE_GATE, WheelSurface, fit_chosen

_ROUNDS = 7
_KNOWN = 2  # round from which the likeliest hypothesis alone is followed
_AXIS_ROUNDS, _LOOK_ELSEWHERE = 8, 2
_FAR_MM = 4.0  # by which the axis of a surface without load may be off
_PROFILE_STEP, _PROFILE_ROUNDS = 4.0, 4  # mm; smooth, for its slope tells the place of the axis
_STIFF, _FEWEST_OF_PROFILE = 1e-3, 100  # of second differences, beside points; and points
_NEAR = 1e-4  # radians, 0.3′; an axis that turns by less is where its surface can be fitted
_MOST_TURN, _MOST_DOUBT = 0.017, 1.5e-3  # radians, 60′ and 5′: more is no wheel on a road
_MOST_UNEVEN, _LEAST_CARRIED = 3.0, 0.6
_MOST_LIFT_MM = 5.0  # before heads 60° from the patch; a side force of 8 mm shows 4
_SETTLED = 3e-6  # radians, 0.01′, by which the axis still turns; the joint solution takes that off, too
_WIDE = 8.0  # robust deviations; before the load is known, what it lifts is no outlier
_CLEARLY = 1.3  # times what a knock explains; real loads explain 1.6 times as much and more
_LEAD = 5.0  # logarithm of the evidence by which side force must be likelier than a knock beside a bulge
_SURELY_LOADED_MM = 1.0  # a lift that nothing but a road makes
_WHERE_NO_ROAD_IS = np.radians([120.0, 180.0, -120.0])  # from the contact
_SHARE_ELSEWHERE = 0.93  # of the logarithm of the evidence; loads before heads 75° from it: to 0.89
_LEFT_BY_KNOCK = 0.5  # logarithm of evidence per cell, one chi squared: what no knock would leave
_FIRST_GATE = 8.0  # mm; by so much a head may be off a surface that others fit; a ghost is farther
_FEWEST_CELLS = 20  # of each head
_UNDETERMINED = 1e-6  # of a head's own movements, below which load and axis leave nothing of one


@dataclass(frozen=True, eq=False)
class LoadedWheel:
    """A wheel whose load was taken off.

    Attributes
    ----------
    surface
        The wheel and its points, as if there were no load; the normal is that of the joint solution.
    model
        The load.
    moves
        What the heights say of movements of the heads, once the load is free to explain them.
    noise
        As `LoadModel.noise`.
    lift_mm
        Most by which the load lifts or lowers the sidewall where the heads see it, millimetres.
    covariance
        (2, 2) what the load adds to that of the tilts of `surface.fit`, radians².
    knock_gain
        Best difference of the logarithm of the evidence, to that of intact heads without load, of a
        movement of a head that would explain the heights in place of a load.
    """

    surface: WheelSurface
    model: LoadModel
    moves: HeadMoves
    noise: float
    lift_mm: float
    covariance: Array
    knock_gain: float

    @property
    def lead(self) -> float:
        """Natural logarithm of how much likelier a load is than intact heads without, or moved ones.

        A free profile follows part of whatever a knock leaves, so that a load must explain clearly more.
        """
        gain, knock = self.model.gain, max(self.knock_gain, 0.0)
        beyond_noise = _LEFT_BY_KNOCK * len(self.model.cells.weight)
        return max(gain - _CLEARLY * knock, gain - knock - beyond_noise)

    def misfits(self) -> Array:
        """(H,) part of the residuals that a movement of each head alone explains, with load and axis free to
        explain it, RMS over its points, millimetres; as `HeadMoves.misfits` of a wheel without load."""
        moves = self.moves
        heads = moves.square.shape[0]
        together = np.tile(np.eye(MOVES)[:, 1:], (heads, 1))
        by_axis = moves.normal @ together
        inner = np.linalg.pinv(together.T @ by_axis, hermitian=True) @ by_axis.T
        normal, target = moves.normal - by_axis @ inner, moves.target - inner.T @ (together.T @ moves.target)
        unit = np.sqrt(np.maximum(np.diag(moves.square.reshape(heads, MOVES, MOVES).sum(axis=0)), 1e-30))
        explained = np.zeros(heads)
        for head in range(heads):
            mine = slice(MOVES * head, MOVES * (head + 1))
            scaled = normal[mine, mine] / np.outer(unit, unit)
            pull = target[mine] / unit
            explained[head] = pull @ np.linalg.pinv(scaled, rcond=_UNDETERMINED, hermitian=True) @ pull
        weight: Array = moves.rings[:, :, 0].sum(axis=0)
        out: Array = np.sqrt(np.maximum(explained, 0.0) / np.maximum(weight, 1e-12))
        return out


def carry(
    pool: PointPool,
    surface: WheelSurface,
    axes: Array,
    down: Array,
    amounts: Array | None,
    knocks: Sequence[Array],
) -> LoadedWheel | None:
    """Find the load of a wheel.

    Parameters
    ----------
    pool
        Candidates of all heads.
    surface
        Fitted without load.
    axes
        As for `find_surface`.
    down
        (3,) direction to the road, rig frame.
    amounts
        (5 H, 5 H) covariance of the heads' moves (`HeadMoves`) by the errors of the calibration; None: not
        known, taken for nothing.
    knocks
        (5 H, 6) each: moves by a knock of one standard deviation, for the alternative that a head moved.

    Returns
    -------
    LoadedWheel or None
        None where too little is seen to tell a load.
    """
    heads = int(pool.head.max()) + 1
    seen = _Seen(pool, axes, down, amounts, heads)
    found = _settled(seen, surface.fit, None)
    if found is None or found.pushed(seen, knocks):
        found = _pushed(seen, surface.fit)
    if found is None or not believable(found, surface.fit) or not found.on_a_road(seen):
        return None
    model, fit, points = found.model, found.surface.fit, found.surface.points
    moves = head_moves(points.points, points.head, heads, fit)
    normal, target = model.freed_moves()
    return LoadedWheel(
        surface=replace(found.surface, fit=leaned(fit, model.turn)),
        model=model,
        moves=replace(moves, normal=normal, target=target),
        noise=model.noise,
        lift_mm=found.lift_mm,
        covariance=_positive(model.covariance - model.unloaded),
        knock_gain=max((model.knock_gain(amounts, knock) for knock in knocks), default=0.0),
    )


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a load is looked for in: arguments of `carry`, and how many heads there are."""

    pool: PointPool
    axes: Array
    down: Array
    amounts: Array | None
    heads: int

    def fitted(self, cells: Cells, fit: RevolutionFit, start: LoadModel | None, **how: Any) -> LoadModel:
        """The load of cells about an axis."""
        return fit_load(cells, self.contact(fit), self.amounts, start, **how)

    def contact(self, fit: RevolutionFit) -> Array:
        """(2,) unit direction to the contact patch along the tilt axes."""
        along = fit.tilt_axes @ self.down
        out: Array = along / np.linalg.norm(along)
        return out


@dataclass(frozen=True, eq=False)
class FoundLoad:
    """A surface, its load, and the most by which that lifts it."""

    surface: WheelSurface
    model: LoadModel
    lift_mm: float

    def pushed(self, seen: _Seen, knocks: Sequence[Array]) -> bool:
        """Tell whether side force is to be looked for: where it says more of the heights than a bulge alone,
        or one beside a head that moved."""
        side, moved = side_force_seen(self.model, seen.amounts, knocks)
        return side > _LEAD + max(moved, 0.0)

    def on_a_road(self, seen: _Seen) -> bool:
        """Tell whether a small load is the road's: one that pressed elsewhere would not explain as much.

        Whatever is smooth around a wheel, such as the light of two wheels in one exposure, a small load may
        follow; but then so it may from any side.
        """
        if self.lift_mm > _SURELY_LOADED_MM:
            return True
        elsewhere = max(gain_from(self.model, seen.amounts, turn) for turn in _WHERE_NO_ROAD_IS)
        return elsewhere < _SHARE_ELSEWHERE * self.model.gain


def _settled(seen: _Seen, before: RevolutionFit, start: LoadModel | None) -> FoundLoad | None:
    """Find surface and load in turn; bulges alone, or what the start knows."""
    model = every = start
    surface: WheelSurface | None = None
    lift = np.zeros(1)
    cells = None if start is not None else _first_cells(seen.pool, before, seen.heads)
    for number in range(_ROUNDS):
        if cells is not None:
            if not _enough(cells):
                return None
            model = seen.fitted(cells, before, model, best_alone=start is not None or number > _KNOWN)
            every = model if start is None and number <= _KNOWN else every
        assert model is not None
        try:
            surface = _unloaded(seen.pool, before, model, seen.axes)
        except DegenerateInputError:
            return None
        cells, lift = _cells(surface, model, before, seen.heads)
        moved = np.abs(surface.fit.normal - before.normal).max()
        before = surface.fit
        if moved < _SETTLED:
            break
    if surface is None or cells is None or not _enough(cells):
        return None
    return FoundLoad(surface, seen.fitted(cells, before, every), float(np.abs(lift).max()))


def _pushed(seen: _Seen, fit: RevolutionFit) -> FoundLoad | None:
    """The same with side force."""
    found = []
    for by_one_head in (True, False):
        with contextlib.suppress(DegenerateInputError):
            each = _foreseen(seen, _by_one_head(seen, fit) if by_one_head else fit)
            found += [] if each is None else [each]
    if not found:
        return None
    # A fit may end in a wrong place, where much of the wheel passes for letters.
    return _settled(seen, *max(found, key=lambda each: each[1].explained))


def believable(found: FoundLoad, before: RevolutionFit) -> bool:
    """Tell whether a wheel under load is one: what hides a part of it must not be explained by a load."""
    model, weights = found.model, found.surface.fit.weights
    turned = np.abs(leaned(found.surface.fit, model.turn).normal - before.normal).max()
    return bool(
        turned < _MOST_TURN
        and found.lift_mm < _MOST_LIFT_MM
        and np.trace(model.covariance) < _MOST_DOUBT**2
        and model.unevenness < _MOST_UNEVEN
        and np.count_nonzero(weights) > _LEAST_CARRIED * len(weights)
    )


def _foreseen(seen: _Seen, fit: RevolutionFit) -> tuple[RevolutionFit, LoadModel] | None:
    """Find the load, and an axis whose surface the points need not yet lie on.

    The axis goes where the joint solution puts it, and the profile is but a smooth one about that axis: a
    surface that were fitted to a load that is not right yet would take the other points for outliers.
    """
    pool = seen.pool
    lift = np.zeros(len(pool.points))
    gate, shift = _FIRST_GATE, _FAR_MM
    model: LoadModel | None = None
    for number in range(_AXIS_ROUNDS):
        still = pool.points - lift[:, None] * fit.normal
        chosen = nearest_candidates(fit.height(still), pool.group, gate)
        cells = _condensed(pool.where(chosen), fit, seen.heads)
        if not _enough(cells):
            return None
        model = seen.fitted(cells, fit, None, elsewhere=number < _LOOK_ELSEWHERE, shift_mm=shift)
        before, fit = fit, _moved_axis(pool, fit, model)
        lift = model.height((pool.points - fit.centre) @ fit.tilt_axes.T)
        if np.abs(fit.normal - before.normal).max() < _NEAR:
            break
        gate, shift = SURFACE_GATE, float(np.abs(model.shift).max())
    assert model is not None
    return fit, model


def _by_one_head(seen: _Seen, fit: RevolutionFit) -> RevolutionFit:
    """The surface with the profile that the head farthest from the contact sees, where a load does least."""
    pool = seen.pool
    chosen = nearest_candidates(fit.height(pool.points), pool.group, _FIRST_GATE)
    points, head = pool.points[chosen], pool.head[chosen]
    along = (points - fit.centre) @ fit.tilt_axes.T @ seen.contact(fit)
    mean = [along[head == k].mean() if (head == k).any() else np.inf for k in range(seen.heads)]
    mine = head == int(np.argmin(mean))
    return about(fit, fit.normal, fit.centre, points[mine])


def about(fit: RevolutionFit, normal: Array, centre: Array, points: Array) -> RevolutionFit:
    """Return the surface about another axis, with the profile of points (n, 3) on it, letters left out.

    Raises
    ------
    DegenerateInputError
        When there are hardly any points.
    """
    frame = frame_of(normal)
    x, y, z = frame @ (points[np.isfinite(points).all(axis=1)] - centre).T
    if len(z) < _FEWEST_OF_PROFILE:
        raise DegenerateInputError(
            field="points", expected=f"at least {_FEWEST_OF_PROFILE} of a profile", seen=str(len(z))
        )
    radius = np.hypot(x, y)
    start = float(radius.min())
    count = math.ceil((float(radius.max()) - start) / _PROFILE_STEP + 1e-6) + 3
    middles: Array = start + _PROFILE_STEP * np.arange(-1.0, count - 1.0)
    basis = spline_basis(radius, middles)
    # Where no line lies the profile goes on as straight as it can.
    bend = np.diff(np.eye(count), n=2, axis=0)
    weight = np.ones(len(z))
    profile = np.zeros(count)
    for _ in range(_PROFILE_ROUNDS):
        weighted = weight * basis.T
        normal_matrix = weighted @ basis + _STIFF * bend.T @ bend
        profile = np.asarray(np.linalg.solve(normal_matrix, weighted @ z), dtype=np.float64)
        off = np.abs(z - basis @ profile)
        scale = robust.BIWEIGHT * max(robust.DEVIATION_OF_MEDIAN * float(np.median(off)), 1e-6)
        weight = np.square(1.0 - np.minimum(np.square(off / scale), 1.0))
    return replace(
        fit, normal=frame[2], centre=centre, tilt_axes=frame[:2], knots_start=start,
        knots_step=_PROFILE_STEP, profile=profile,
    )  # fmt: skip


def _moved_axis(pool: PointPool, fit: RevolutionFit, model: LoadModel) -> RevolutionFit:
    """Put the axis where the joint solution has it."""
    lift = model.height((pool.points - fit.centre) @ fit.tilt_axes.T)
    still = pool.points - lift[:, None] * fit.normal
    chosen = nearest_candidates(fit.height(still), pool.group, _FIRST_GATE)
    normal = fit.normal - model.turn @ fit.tilt_axes
    return about(fit, normal, fit.centre + model.shift @ fit.tilt_axes, still[chosen])


def _unloaded(pool: PointPool, fit: RevolutionFit, model: LoadModel, axes: Array) -> WheelSurface:
    """Choose the candidates and fit the wheel as it would be without the load."""
    lift = model.height((pool.points - fit.centre) @ fit.tilt_axes.T)
    still = replace(pool, points=pool.points - lift[:, None] * fit.normal)
    fit = replace(leaned(fit, model.turn), centre=fit.centre + model.shift @ fit.tilt_axes)
    chosen = nearest_candidates(fit.height(still.points), pool.group, SURFACE_GATE)
    return fit_chosen(still, chosen, fit.normal, fit.centre, axes)


def _enough(cells: Cells) -> bool:
    """Tell whether every head sees enough to tell a load, and all of them more than a ring."""
    if np.bincount(cells.head, minlength=cells.heads).min() < _FEWEST_CELLS:
        return False
    return float(np.ptp(cells.radius)) > KNOTS_MM


def _first_cells(pool: PointPool, fit: RevolutionFit, heads: int) -> Cells:
    """Cells of a fit that knew of no load: its weights were wrong, and a whole head may be off."""
    heights = fit.height(pool.points)
    points = pool.where(nearest_candidates(heights, pool.group, _FIRST_GATE))
    rest = fit.height(points.points)
    weights = np.zeros(len(rest))
    for head in range(heads):
        mine = np.flatnonzero(points.head == head)
        if len(mine):
            off = np.abs(rest[mine] - np.median(rest[mine]))
            scale = _WIDE * robust.DEVIATION_OF_MEDIAN * float(np.median(off)) + 1e-6
            weights[mine] = np.square(1.0 - np.minimum(np.square(off / scale), 1.0))
    return condense(points, weights, rest, fit, heads)


def _condensed(points: PointPool, fit: RevolutionFit, heads: int) -> Cells:
    rest = fit.height(points.points)
    seen = np.isfinite(rest)
    points, rest = points.where(seen), rest[seen]
    return condense(points, local_weights(points, rest, fit, heads), rest, fit, heads)


def _cells(surface: WheelSurface, model: LoadModel, before: RevolutionFit, heads: int) -> tuple[Cells, Array]:
    """Cells of heights with the load put back on, and the load at the cells."""
    fit, points = surface.fit, surface.points
    cells = condense(points, fit.weights, np.where(fit.weights > 0.0, fit.residuals, 0.0), fit, heads)
    places = (cells.points(fit) - before.centre) @ before.tilt_axes.T
    lift = model.height(places)
    return replace(cells, height=cells.height + lift), lift


def leaned(fit: RevolutionFit, turn: Array) -> RevolutionFit:
    """Lean the wheel as the joint solution says: heights that rise along an axis lean the normal away."""
    normal = fit.normal - turn @ fit.tilt_axes
    return replace(fit, normal=normal / np.linalg.norm(normal))


def _positive(matrix: Array) -> Array:
    """The nearest covariance."""
    values, vectors = np.linalg.eigh(matrix)
    out: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return out
