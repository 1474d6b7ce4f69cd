"""The wheel under load: what the contact patch does to the sidewall is told from the axis, and taken off.

Surface of revolution and load are found in turn: the heights that the surface leaves, and the load so far,
tell the load and the turn of the axis together (`load_model`); without that load the surface is fitted again.
Both settle where the joint problem has its solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment import robust
from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.stereo.pool import PointPool
from alignment.stereo.surface import nearest_candidates
from alignment.wheel.agreement import MOVES, HeadMoves, head_moves
from alignment.wheel.load_cells import Cells, condense
from alignment.wheel.load_model import LoadModel, fit_load
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.search import SURFACE_GATE, WheelSurface, fit_chosen

_ROUNDS = 7
_KNOWN = 2  # round in which the noise is known, so that what is left over shows whether there is side force
_SETTLED = 3e-6  # radians, 0.01′, by which the axis still turns; the joint solution takes that off, too
_WIDE = 8.0  # robust deviations; before the load is known, what it lifts is no outlier
_CLEARLY = 1.3  # times what a knock explains; real loads explain 1.6 times as much and more
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
        return self.model.gain - _CLEARLY * max(self.knock_gain, 0.0)

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
    model: LoadModel | None = None
    every: LoadModel | None = None
    cells, lift = _first_cells(pool, surface.fit, heads), np.zeros(1)
    for number in range(_ROUNDS):
        if not _enough(cells):
            return None
        before = surface.fit
        model = fit_load(
            cells, _contact(before, down), amounts, model,
            best_alone=number > _KNOWN, side_force=number >= _KNOWN,
        )  # fmt: skip
        every = model if number <= _KNOWN else every
        try:
            surface = _unloaded(pool, before, model, axes)
        except DegenerateInputError:
            return None
        cells, lift = _cells(surface, model, before, heads)
        if np.abs(surface.fit.normal - before.normal).max() < _SETTLED:
            break
    assert model is not None
    if not _enough(cells):
        return None
    model = fit_load(cells, _contact(surface.fit, down), amounts, every)
    fit = _turned(surface.fit, model.turn)
    moves = head_moves(surface.points.points, surface.points.head, heads, surface.fit)
    normal, target = model.freed_moves(cells)
    return LoadedWheel(
        surface=replace(surface, fit=fit),
        model=model,
        moves=replace(moves, normal=normal, target=target),
        noise=model.noise,
        lift_mm=float(np.abs(lift).max()),
        covariance=_positive(model.covariance - model.unloaded),
        knock_gain=max((model.knock_gain(cells, amounts, knock) for knock in knocks), default=0.0),
    )


def _contact(fit: RevolutionFit, down: Array) -> Array:
    """(2,) unit direction to the contact patch along the tilt axes."""
    along = fit.tilt_axes @ down
    out: Array = along / np.linalg.norm(along)
    return out


def _unloaded(pool: PointPool, fit: RevolutionFit, model: LoadModel, axes: Array) -> WheelSurface:
    """Choose the candidates and fit the wheel as it would be without the load."""
    lift = model.height((pool.points - fit.centre) @ fit.tilt_axes.T)
    still = replace(pool, points=pool.points - lift[:, None] * fit.normal)
    fit = _turned(fit, model.turn)
    chosen = nearest_candidates(fit.height(still.points), pool.group, SURFACE_GATE)
    return fit_chosen(still, chosen, fit.normal, fit.centre, axes)


def _enough(cells: Cells) -> bool:
    """Tell whether every head sees enough to tell a load."""
    return bool(np.bincount(cells.head, minlength=cells.heads).min() >= _FEWEST_CELLS)


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


def _cells(surface: WheelSurface, model: LoadModel, before: RevolutionFit, heads: int) -> tuple[Cells, Array]:
    """Cells of heights with the load put back on, and the load at the cells."""
    fit, points = surface.fit, surface.points
    rest = np.where(fit.weights > 0.0, fit.residuals, 0.0)
    cells = condense(points, fit.weights, rest, fit, heads)
    places = (cells.points(fit) - before.centre) @ before.tilt_axes.T
    lift = model.height(places)
    return replace(cells, height=cells.height + lift), lift


def _turned(fit: RevolutionFit, turn: Array) -> RevolutionFit:
    """Lean the wheel as the joint solution says: heights that rise along an axis lean the normal away."""
    normal = fit.normal - turn @ fit.tilt_axes
    return replace(fit, normal=normal / np.linalg.norm(normal))


def _positive(matrix: Array) -> Array:
    """The nearest covariance."""
    values, vectors = np.linalg.eigh(matrix)
    out: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return out
