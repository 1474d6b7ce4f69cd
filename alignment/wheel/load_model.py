"""What of the heights around a wheel is a load: hypotheses about its shape, weighed by their evidence.

The height of a cell above the surface of revolution is

    turn and place of the axis + errors of the heads + φ(θ) q(ρ) + φₛ(θ) qₛ(ρ) + φₒ(θ) qₒ(ρ) + noise

with a bulge, a side shift and a small odd part, each an angular shape of its own about the contact and a free
radial profile (Gaussian process on a spline). Shapes enter through their parameters, to first order about the
best ones. Each hypothesis gives the turn of the axis, its covariance and its evidence (Laplace's method;
MacKay, Information Theory, Inference, and Learning Algorithms, ch. 27 and 28); they are averaged by it, so
that what the heads cannot tell apart makes the covariance larger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment import robust
from alignment.arrays import Array
from alignment.wheel.load_cells import Cells, angle_from
from alignment.wheel.load_hypothesis import (
    FEWEST_PARTS,
    KNOTS_MM,
    PLACE_MM,
    TURN,
    HypothesisFit,
    LoadHypothesis,
    LoadProblem,
    problem_of,
    root_of,
    spline_basis,
    without_load,
)
from alignment.wheel.load_shapes import BULGES, ODD, ODD_BESIDE_SIDE_FORCE, SIDE_SHIFTS, Shape

_TABLE = 0.25  # mm, of the tables of radial profiles
_BULGE_MM, _SIDE_MM, _ODD_MM = 3.0, 8.0, 0.1  # standard deviations at the contact, where they begin
_KNOCK_SIZES = (1.0, 0.25, 0.0625, 0.0156)  # of the one standard deviation that is given
_BELIEF = 1e-4  # of an average; less is left out
_STEPS, _FEW_STEPS = 7, 2  # of a fit from the start, and of one that goes on
_SIDE_RARITY = 6.0
_PASSES, _LEAST_SHARE = 3, 1e-4  # of weighing cells, and what is left of the weight of one that is off
_OTHER_TURNS = (-6e-3, -3e-3, -1e-3, 1e-3, 3e-3, 6e-3)  # radians
_LOOK_STEPS = 4  # until the evidence is asked
_MOST_CONTINUED = 8  # hypotheses
_OTHER_BULGE = 3.0  # logarithm of the evidence by which one bulge may help a side shift more than another


@dataclass(frozen=True, eq=False)
class LoadModel:
    """A load as the heads see it, the average of its hypotheses.

    Attributes
    ----------
    hypotheses, beliefs
        And how far each is believed; they sum to 1, and are 0 where they would be next to nothing.
    knots
        (K,) radii of the splines' middles, millimetres.
    contact
        (2,) direction of contact along the tilt axes.
    cells
        Those that it was fitted to.
    gain
        Difference of the logarithm of the evidence to that of no load.
    turn, shift, covariance
        (2,), (2,) and (2, 2) of the average.
    unloaded
        (2, 2) covariance of the turn were there no load.
    noise
        Standard deviation of a height of weight 1, millimetres, with what is uneven over more than a cell.
    unevenness
        Chi squared per cell that the likeliest hypothesis leaves, 1 at least; by so much all that is said of
        the load is less sure than the noise of the cells alone would have it.
    """

    hypotheses: tuple[LoadHypothesis, ...]
    beliefs: Array
    knots: Array
    contact: Array
    cells: Cells
    gain: float
    turn: Array
    shift: Array
    covariance: Array
    unloaded: Array
    noise: float
    unevenness: float

    @property
    def explained(self) -> float:
        """Weight of the cells that it was fitted to, over the mean square that it leaves, mm⁻²."""
        best = self.hypotheses[int(self.beliefs.argmax())]
        left = best.misfit / len(self.cells.weight) * self.cells.noise**2
        return float(self.cells.weight.sum()) / max(left, 1e-12)

    def height(self, places: Array) -> Array:
        """(n,) by how much the load lifts the sidewall at places (n, 2) along the tilt axes, millimetres."""
        angle, radius = angle_from(places, self.contact), np.hypot(places[:, 0], places[:, 1])
        grid = np.arange(self.knots[0] - 2.0 * KNOTS_MM, self.knots[-1] + 2.0 * KNOTS_MM, _TABLE)
        basis = spline_basis(grid, self.knots)
        out = np.zeros(len(places))
        for belief, hypothesis in zip(self.beliefs, self.hypotheses, strict=True):
            for shape, parameters, coefficients in hypothesis.parts if belief > 0.0 else ():
                value = shape.evaluate(angle, parameters)[0]
                out += value * np.interp(radius, grid, basis @ (belief * coefficients))
        return out

    def freed_moves(self) -> tuple[Array, Array]:
        """Normal equations (5 H, 5 H), (5 H,) of the heads' moves, with the load free to explain them.

        In the units of `HeadMoves`; the likeliest hypothesis is asked.
        """
        best = self.hypotheses[int(self.beliefs.argmax())]
        moves, heights = _moves(self.cells)
        by_load = best.design.T @ moves
        right = best.design.T @ heights
        inner = np.linalg.inv(best.design.T @ best.design + best.prior)
        normal = moves.T @ moves - by_load.T @ inner @ by_load
        target = moves.T @ heights - by_load.T @ inner @ right
        return normal * self.cells.noise**2, target * self.cells.noise**2

    def knock_gain(self, amounts: Array | None, knock: Array) -> float:
        """Difference of the logarithm of the evidence that a head moved, no load, to that nothing did.

        `knock` (5 H, 6) are its moves by one standard deviation, `amounts` as for `fit_load`.
        """
        cells = self.cells
        moves, heights = _moves(cells)
        axis = cells.freed(cells.moves[:, 1:]) / cells.noise
        scale = np.array([TURN] * 2 + [PLACE_MM] * 2)
        known = np.zeros((moves.shape[1], 0)) if amounts is None else root_of(amounts)
        values = []
        # As the judgement of knocks tries several sizes: a wide one alone would make small knocks unlikely.
        for more in (np.zeros((len(known), 0)), *(size * knock for size in _KNOCK_SIZES)):
            columns = np.hstack([axis * scale, moves @ known, moves @ more])
            matrix = columns.T @ columns + np.eye(columns.shape[1])
            right = columns.T @ heights
            values.append(0.5 * float(right @ np.linalg.solve(matrix, right) - np.linalg.slogdet(matrix)[1]))
        return (max(values[1:]) - values[0]) / self.unevenness


def _moves(cells: Cells) -> tuple[Array, Array]:
    """(C, 5 H) moves of the heads and (C,) heights, free of the profile, in units of the noise."""
    return cells.freed(cells.by_head()) / cells.noise, cells.freed(cells.height[:, None])[:, 0] / cells.noise


def fit_load(
    cells: Cells,
    contact: Array,
    amounts: Array | None,
    start: LoadModel | None = None,
    *,
    best_alone: bool = False,
    elsewhere: bool = True,
    shift_mm: float = 0.0,
) -> LoadModel:
    """Weigh hypotheses about the load.

    Parameters
    ----------
    cells
        Of the wheel.
    contact
        (2,) unit direction from the axis to the contact patch, along the tilt axes.
    amounts
        (5 H, 5 H) covariance of the heads' moves by the calibration; None: none.
    start
        Of the round before, from where each of its hypotheses goes on; None: from the beginning.
    best_alone
        Follow only the likeliest hypothesis of `start`.
    elsewhere
        Look for other optima with side force, too.
    shift_mm
        By how much the centre of the axis may be off, to second order; then there is side force, and cells
        that nothing explains are left out. 0 where a surface was fitted to the points.
    """
    known = None if start is None else _Known(start.hypotheses, start.knots)
    every = None
    if shift_mm > 0.0:
        cells, every = _trusted(cells, contact, amounts, known, shift_mm)
    problem, knots = problem_of(cells, contact, amounts, shift_mm)
    plain, unloaded = without_load(problem)
    found = _hypotheses(problem, knots, known or every, best_alone=best_alone, side_force=False)
    if elsewhere and not best_alone:
        found += _elsewhere(problem, max(found, key=_likelihood))
    evidence = np.array([each.log_evidence - _rarity(each) for each in found])
    uneven = max(1.0, found[int(evidence.argmax())].misfit / len(cells.weight))
    # What no hypothesis explains is taken for noise that neighbours share: it makes all of them less sure.
    beliefs = np.exp((evidence - evidence.max()) / uneven)
    gain = (float(evidence.max()) - plain) / uneven + math.log(beliefs.mean())
    beliefs = np.where(beliefs > _BELIEF * beliefs.sum(), beliefs, 0.0)
    beliefs /= beliefs.sum()
    turns = np.array([each.turn for each in found])
    turn = beliefs @ turns
    covariance = uneven * np.einsum("h,hij->ij", beliefs, np.array([each.covariance for each in found]))
    covariance += np.einsum("h,hi,hj->ij", beliefs, turns - turn, turns - turn)
    return LoadModel(
        tuple(found), beliefs, knots, contact, cells, gain, turn,
        beliefs @ np.array([each.shift for each in found]), covariance, uneven * unloaded,
        cells.noise * math.sqrt(uneven), uneven,
    )  # fmt: skip


def gain_from(model: LoadModel, amounts: Array | None, turn: float) -> float:
    """Gain of a bulge, about as `LoadModel.gain`, were the contact elsewhere: turned by so many radians."""
    sine, cosine = math.sin(turn), math.cos(turn)
    contact = np.array([[cosine, -sine], [sine, cosine]]) @ model.contact
    problem, _ = problem_of(model.cells, contact, amounts)
    plain, _ = without_load(problem)
    best = max((_fitted(problem, bulge, None, _LOOK_STEPS) for bulge in BULGES), key=_likelihood)
    return (best.log_evidence - plain) / max(1.0, best.misfit / len(model.cells.weight))


@dataclass(frozen=True)
class _Known:
    """Hypotheses, and the knots (K,) of their radial profiles."""

    hypotheses: Sequence[LoadHypothesis]
    knots: Array


def _hypotheses(
    problem: LoadProblem, knots: Array, known: _Known | None, *, best_alone: bool, side_force: bool
) -> list[LoadHypothesis]:
    """Fit the bulges, or all with side force, or go on with what is known."""
    if known is None and side_force:
        return _with_side_force(problem)
    if known is None:
        found = [_fitted(problem, bulge, None) for bulge in BULGES]
    else:
        before = sorted(known.hypotheses, key=_likelihood, reverse=True)
        found = [
            _continued(problem, each, known.knots, knots)
            for each in before[: 1 if best_alone else _MOST_CONTINUED]
        ]
    return found


def side_force_seen(model: LoadModel, amounts: Array | None, knocks: Sequence[Array]) -> tuple[float, float]:
    """Logarithms of how much likelier side force, and a moved head, make the heights beside a bulge.

    Of a model of bulges; `knocks` (5 H, 6) each, as for `knock_gain`.
    """
    problem, _ = problem_of(model.cells, model.contact, amounts)
    best = max(model.hypotheses, key=_likelihood)
    (bulge, bulged, radial), (odd, tilted, ahead) = best.parts
    pushed = moved = -math.inf
    for side in SIDE_SHIFTS:
        start = [(bulge, bulged), (side, side.mean), (ODD_BESIDE_SIDE_FORCE, tilted)]
        sizes = [best.sizes[0], _SIDE_MM, best.sizes[1]]
        fit = HypothesisFit(problem, start, sizes, [radial, np.zeros_like(radial), ahead])
        pushed = max(pushed, _likelihood(fit.after(_LOOK_STEPS)))
    for knock in knocks:
        beside = replace(
            problem,
            nuisance=np.hstack([problem.nuisance, _moves(model.cells)[0] @ knock]),
            prior=np.concatenate([problem.prior, np.ones(knock.shape[1])]),
        )
        fit = HypothesisFit(beside, [(bulge, bulged), (odd, tilted)], list(best.sizes), [radial, ahead])
        moved = max(moved, fit.after(_LOOK_STEPS).log_evidence)
    plain = _likelihood(best)
    return pushed - plain, moved - plain


def _elsewhere(problem: LoadProblem, best: LoadHypothesis) -> list[LoadHypothesis]:
    """Other optima of the likeliest hypothesis with side force: from wheels that lean otherwise."""
    if len(best.sizes) == FEWEST_PARTS:
        return []
    found = []
    for turn in _OTHER_TURNS:
        shapes = [(shape, parameters) for shape, parameters, _ in best.parts]
        radial = [radial for _, _, radial in best.parts]
        fit = HypothesisFit(problem, shapes, list(best.sizes), radial)
        found.append(
            fit.from_turn(float(best.turn @ problem.contact) + turn, _FEW_STEPS + 1).after(_FEW_STEPS + 1)
        )
    return found


def _likelihood(hypothesis: LoadHypothesis) -> float:
    return hypothesis.log_evidence - _rarity(hypothesis)


def _trusted(
    cells: Cells, contact: Array, amounts: Array | None, known: _Known | None, shift_mm: float
) -> tuple[Cells, _Known]:
    """The cells but for those that no load, turn or profile explains: letters, edges, ghosts."""
    share = np.ones(len(cells.weight))
    every: _Known | None = None
    for _ in range(_PASSES):
        problem, knots = problem_of(cells.weighed(share), contact, amounts, shift_mm)
        found = _hypotheses(problem, knots, known, best_alone=known is not None, side_force=known is None)
        every = every or _Known(found, knots)
        best = max(found, key=_likelihood)
        off = np.abs(best.rest) / np.sqrt(share)
        scale = robust.BIWEIGHT * max(1.0, robust.DEVIATION_OF_MEDIAN * float(np.median(off)))
        share = np.maximum(np.square(1.0 - np.minimum(np.square(off / scale), 1.0)), _LEAST_SHARE)
        known = _Known((best,), knots)
    assert every is not None
    return cells.weighed(share).where(share > _LEAST_SHARE), every


def _fitted(problem: LoadProblem, bulge: Shape, side: Shape | None, steps: int = _STEPS) -> LoadHypothesis:
    """Fit one hypothesis by Gauss–Newton steps; the sizes of bulge and odd part are found on the way."""
    odd = ODD if side is None else ODD_BESIDE_SIDE_FORCE
    shapes = [(shape, shape.mean) for shape in (bulge, side, odd) if shape is not None]
    sizes = [_BULGE_MM, _ODD_MM] if side is None else [_BULGE_MM, _SIDE_MM, _ODD_MM]
    radial = [np.zeros(problem.basis.shape[1]) for _ in sizes]
    return HypothesisFit(problem, shapes, sizes, radial).after(steps)


def _rarity(hypothesis: LoadHypothesis) -> float:
    """By how much less a hypothesis is believed beforehand, as a logarithm: wheels hardly push sideways."""
    return 0.0 if len(hypothesis.sizes) == FEWEST_PARTS else _SIDE_RARITY + math.log(len(SIDE_SHIFTS))


def _with_side_force(problem: LoadProblem) -> list[LoadHypothesis]:
    """Hypotheses with a side shift: every one with one of the bulges, the likely ones with the others too."""
    first = [_fitted(problem, BULGES[-1], side) for side in SIDE_SHIFTS]
    best = max(each.log_evidence for each in first)
    likely = [
        side for side, each in zip(SIDE_SHIFTS, first, strict=True) if each.log_evidence > best - _OTHER_BULGE
    ]
    return first + [_fitted(problem, bulge, side) for bulge in BULGES[:-1] for side in likely]


def _continued(problem: LoadProblem, known: LoadHypothesis, before: Array, knots: Array) -> LoadHypothesis:
    """Go on with one hypothesis, whose radial profiles had the knots before (K',), on other heights."""
    shapes = [(shape, parameters) for shape, parameters, _ in known.parts]
    radial = [np.interp(knots, before, radial, 0.0, 0.0) for _, _, radial in known.parts]
    return HypothesisFit(problem, shapes, list(known.sizes), radial).after(_FEW_STEPS)
