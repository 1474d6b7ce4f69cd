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
from alignment.wheel.agreement import HeadMoves, head_moves
from alignment.wheel.load_cells import Cells, condense
from alignment.wheel.load_model import LoadModel, fit_load
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.search import SURFACE_GATE, WheelSurface, fit_chosen

_ROUNDS = 7
_SETTLED = 6e-7  # radians, 0.002′, by which the axis still turns
_WIDE = 8.0  # robust deviations; before the load is known, what it lifts is no outlier
_FEWEST_CELLS = 100


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
        Standard deviation of a height of weight 1 in them, millimetres.
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
        """Natural logarithm of how much likelier a load is than intact heads without, or moved ones."""
        return self.model.gain - max(self.knock_gain, 0.0)


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
    cells, noise, lift = _first_cells(surface)
    for _ in range(_ROUNDS):
        if len(cells.ring) < _FEWEST_CELLS:
            return None
        before = surface.fit
        model = fit_load(cells, _contact(before, down), noise, amounts)
        try:
            surface = _unloaded(pool, before, model, axes)
        except DegenerateInputError:
            return None
        cells, noise, lift = _cells(surface, model, before)
        if np.abs(surface.fit.normal - before.normal).max() < _SETTLED:
            break
    assert model is not None
    if len(cells.ring) < _FEWEST_CELLS:
        return None
    model = fit_load(cells, _contact(surface.fit, down), noise, amounts)
    fit = _turned(surface.fit, model.turn)
    moves = head_moves(surface.points.points, surface.points.head, heads, surface.fit)
    normal, target = model.freed_moves(cells, noise)
    return LoadedWheel(
        surface=replace(surface, fit=fit),
        model=model,
        moves=replace(moves, normal=normal, target=target),
        noise=noise,
        lift_mm=float(np.abs(lift).max()),
        covariance=_positive(model.covariance - model.unloaded),
        knock_gain=max((model.knock_gain(cells, noise, amounts, knock) for knock in knocks), default=0.0),
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
    chosen = nearest_candidates(fit.height(still.points), pool.group, SURFACE_GATE)
    return fit_chosen(still, chosen, fit.normal, fit.centre, axes)


def _first_cells(surface: WheelSurface) -> tuple[Cells, float, Array]:
    """Cells of a fit that knew of no load, whose weights were wrong, and the noise, much too large."""
    fit, points = surface.fit, surface.points
    rest = fit.height(points.points)
    known = np.isfinite(rest)
    scale = robust.DEVIATION_OF_MEDIAN * float(np.median(np.abs(rest[known])))
    ratio = np.square(np.where(known, rest, np.inf) / (_WIDE * scale))
    weights = np.where(ratio < 1.0, np.square(1.0 - np.minimum(ratio, 1.0)), 0.0)
    cells = condense(points.points, points.head, weights, np.where(known, rest, 0.0), fit)
    return cells, scale, np.zeros(1)


def _cells(surface: WheelSurface, model: LoadModel, before: RevolutionFit) -> tuple[Cells, float, Array]:
    """Cells of heights with the load put back on, the noise, and the load at the cells."""
    fit, points = surface.fit, surface.points
    rest = np.where(fit.weights > 0.0, fit.residuals, 0.0)
    cells = condense(points.points, points.head, fit.weights, rest, fit)
    places = (cells.points(fit) - before.centre) @ before.tilt_axes.T
    lift = model.height(places)
    noise = float(np.sqrt((fit.weights * rest**2).sum() / fit.weights.sum()))
    uneven = float(np.square(cells.freed(cells.height[:, None])).mean()) / noise**2
    return replace(cells, height=cells.height + lift), noise * max(1.0, uneven) ** 0.5, lift


def _turned(fit: RevolutionFit, turn: Array) -> RevolutionFit:
    """Lean the wheel as the joint solution says: heights that rise along an axis lean the normal away."""
    normal = fit.normal - turn @ fit.tilt_axes
    return replace(fit, normal=normal / np.linalg.norm(normal))


def _positive(matrix: Array) -> Array:
    """The nearest covariance."""
    values, vectors = np.linalg.eigh(matrix)
    out: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return out
