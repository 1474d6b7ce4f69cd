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
from dataclasses import dataclass, field

import numpy as np

from alignment.arrays import Array
from alignment.wheel.load_cells import Cells, angle_from
from alignment.wheel.load_shapes import BULGES, SIDE_SHIFTS, Shape, odd

_KNOTS = 8.0  # mm, of the radial profiles
_BULGE_LENGTH, _SIDE_LENGTH = 15.0, 45.0  # mm over which a radial profile hardly changes
_BULGE_MM, _SIDE_MM, _ODD_MM = 3.0, 8.0, 0.1  # standard deviations at the contact, where they begin
_LEAST_MM, _MOST_MM = 0.003, 12.0
_ODD_SHARE = 0.2  # of the bulge, at most
_TURN, _PLACE_MM = 0.01, 30.0  # standard deviations of the axis, radians and mm
_BELIEF = 1e-4  # of an average; less is left out
_STEPS = 7
_LONGEST_STEP = 0.3  # of a parameter of a shape
_SURE_MISFIT = 1.3  # chi squared per cell up to which no side force is looked for


@dataclass(frozen=True, eq=False)
class LoadHypothesis:
    """One shape of the load, fitted.

    Attributes
    ----------
    log_evidence
        Natural logarithm, up to a number that all hypotheses share.
    turn, covariance
        (2,) leans of the wheel's plane along the tilt axes that remain, and (2, 2), radians.
    parts
        Angular shape, its parameters and radial coefficients (K,), of each part.
    misfit
        Chi squared.
    design, prior
        Columns of the load (C, m), in units of the noise, and the precision (m, m) of their numbers.
    """

    log_evidence: float
    turn: Array
    covariance: Array
    parts: tuple[tuple[Shape | None, Array, Array], ...]
    misfit: float
    design: Array
    prior: Array


@dataclass(frozen=True, eq=False)
class LoadModel:
    """A load as the heads see it, the average of its hypotheses.

    Attributes
    ----------
    hypotheses, beliefs
        And how far each is believed; they sum to 1.
    knots
        (K,) radii of the splines' middles, millimetres.
    contact
        (2,) direction of contact along the tilt axes.
    gain
        Difference of the logarithm of the evidence to that of no load.
    turn, covariance
        (2,) and (2, 2) of the average.
    unloaded
        (2, 2) covariance of the turn were there no load.
    """

    hypotheses: tuple[LoadHypothesis, ...]
    beliefs: Array
    knots: Array
    contact: Array
    gain: float
    turn: Array
    covariance: Array
    unloaded: Array

    def height(self, places: Array) -> Array:
        """(n,) by how much the load lifts the sidewall at places (n, 2) along the tilt axes, millimetres."""
        angle = angle_from(places, self.contact)
        basis = spline_basis(np.hypot(places[:, 0], places[:, 1]), self.knots)
        out = np.zeros(len(places))
        for belief, hypothesis in zip(self.beliefs, self.hypotheses, strict=True):
            for shape, parameters, coefficients in hypothesis.parts:
                value = odd(angle) if shape is None else shape.evaluate(angle, parameters)[0]
                out += belief * value * (basis @ coefficients)
        return out

    def freed_moves(self, cells: Cells, noise: float) -> tuple[Array, Array]:
        """Normal equations (5 H, 5 H), (5 H,) of the heads' moves, with the load free to explain them.

        In the units of `HeadMoves`; the likeliest hypothesis is asked.
        """
        best = self.hypotheses[int(self.beliefs.argmax())]
        moves, heights = _moves(cells, noise)
        by_load = best.design.T @ moves
        right = best.design.T @ heights
        inner = np.linalg.inv(best.design.T @ best.design + best.prior)
        normal = moves.T @ moves - by_load.T @ inner @ by_load
        target = moves.T @ heights - by_load.T @ inner @ right
        return normal * noise**2, target * noise**2

    def knock_gain(self, cells: Cells, noise: float, amounts: Array | None, knock: Array) -> float:
        """Difference of the logarithm of the evidence that a head moved, no load, to that nothing did.

        `knock` (5 H, 6) are its moves by one standard deviation, `amounts` as for `fit_load`.
        """
        moves, heights = _moves(cells, noise)
        axis = cells.freed(cells.moves[:, 1:]) / noise
        scale = np.array([_TURN] * 2 + [_PLACE_MM] * 2)
        known = np.zeros((moves.shape[1], 0)) if amounts is None else _root(amounts)
        values = []
        for more in (np.zeros((len(known), 0)), knock):
            columns = np.hstack([axis * scale, moves @ known, moves @ more])
            matrix = columns.T @ columns + np.eye(columns.shape[1])
            right = columns.T @ heights
            values.append(0.5 * float(right @ np.linalg.solve(matrix, right) - np.linalg.slogdet(matrix)[1]))
        return values[1] - values[0]


def _moves(cells: Cells, noise: float) -> tuple[Array, Array]:
    """(C, 5 H) moves of the heads and (C,) heights, free of the profile, in units of the noise."""
    return cells.freed(cells.by_head()) / noise, cells.freed(cells.height[:, None])[:, 0] / noise


def _root(covariance: Array) -> Array:
    """(n, n) columns whose products add up to a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    out: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return out


def spline_basis(radius: Array, knots: Array) -> Array:
    """(n, K) cubic B-splines about equally spaced knots."""
    u = np.abs(radius[:, None] - knots) / (knots[1] - knots[0])
    inner, outer = 2.0 / 3.0 - u * u + 0.5 * u**3, np.square(2.0 - u) * (2.0 - u) / 6.0
    return np.where(u < 1.0, inner, np.where(u < 2.0, outer, 0.0))


@dataclass(eq=False)
class _Problem:
    """What all hypotheses share."""

    angle: Array
    basis: Array
    nuisance: Array  # (C, 4 + n): the axis, then errors of the heads in units of their deviations
    prior: Array  # (4 + n,) of their precision
    heights: Array
    cells: Cells
    noise: float
    precision: dict[str, Array]  # of radial coefficients for a deviation of 1 mm
    odd_columns: Array = field(init=False)

    def __post_init__(self) -> None:
        self.odd_columns = self.freed(self.basis * odd(self.angle)[:, None])

    def freed(self, columns: Array) -> Array:
        """In units of the noise."""
        return self.cells.freed(columns) / self.noise


def fit_load(cells: Cells, contact: Array, noise: float, amounts: Array | None) -> LoadModel:
    """Weigh hypotheses about the load.

    Parameters
    ----------
    cells
        Of the wheel.
    contact
        (2,) unit direction from the axis to the contact patch, along the tilt axes.
    noise
        Standard deviation of a height of weight 1, millimetres.
    amounts
        (5 H, 5 H) covariance of the heads' moves by the calibration; None: none.
    """
    problem, knots = _problem(cells, contact, noise, amounts)
    plain, unloaded = _without_load(problem)
    found = [_fitted(problem, bulge, None) for bulge in BULGES]
    if min(each.misfit for each in found) > _SURE_MISFIT * len(cells.weight):
        found += [_fitted(problem, bulge, side) for side in SIDE_SHIFTS for bulge in BULGES]
    evidence = np.array([each.log_evidence for each in found])
    beliefs = np.exp(evidence - evidence.max())
    gain = float(evidence.max() + math.log(beliefs.mean())) - plain
    kept = [k for k in range(len(found)) if beliefs[k] > _BELIEF * beliefs.sum()]
    beliefs = beliefs[kept] / beliefs[kept].sum()
    hypotheses = tuple(found[k] for k in kept)
    turns = np.array([each.turn for each in hypotheses])
    turn = beliefs @ turns
    covariance = np.einsum("h,hij->ij", beliefs, np.array([each.covariance for each in hypotheses]))
    covariance += np.einsum("h,hi,hj->ij", beliefs, turns - turn, turns - turn)
    return LoadModel(hypotheses, beliefs, knots, contact, gain, turn, covariance, unloaded)


def _problem(cells: Cells, contact: Array, noise: float, amounts: Array | None) -> tuple[_Problem, Array]:
    radius = cells.radius
    knots = np.arange(radius.min() - 1.1 * _KNOTS, radius.max() + 2.0 * _KNOTS, _KNOTS)
    errors = np.zeros((len(radius), 0))
    if amounts is not None:
        errors = cells.by_head() @ _root(amounts)
    share = np.clip((knots - radius.min()) / (radius.max() - radius.min()), 0.0, 1.0)
    problem = _Problem(
        angle=cells.angle_from(contact),
        basis=spline_basis(radius, knots),
        nuisance=np.zeros(0),
        prior=np.concatenate([[_TURN**-2] * 2, [_PLACE_MM**-2] * 2, np.ones(errors.shape[1])]),
        heights=np.zeros(0),
        cells=cells,
        noise=noise,
        precision={
            "bulge": _precision(knots, np.minimum(1.0, 0.1 + 2.5 * share), _BULGE_LENGTH),
            "side": _precision(knots, 0.2 + share, _SIDE_LENGTH),
        },
    )
    problem.nuisance = problem.freed(np.column_stack([cells.moves[:, 1:], errors]))
    problem.heights = problem.freed(cells.height[:, None])[:, 0]
    return problem, knots


def _precision(knots: Array, envelope: Array, length: float) -> Array:
    """(K, K) inverse covariance of a Gaussian process at the knots."""
    apart = (knots[:, None] - knots) / length
    process = np.exp(-0.5 * np.square(apart)) + 1e-4 * np.eye(len(knots))
    out: Array = np.asarray(np.linalg.inv(np.outer(envelope, envelope) * process), np.float64)
    return out


def _without_load(problem: _Problem) -> tuple[float, Array]:
    """Logarithm of the evidence, and covariance (2, 2) of the leans."""
    n, y = problem.nuisance, problem.heights
    matrix = n.T @ n + np.diag(problem.prior)
    solution = np.linalg.solve(matrix, n.T @ y)
    evidence = -0.5 * float(y @ y - (n.T @ y) @ solution) - 0.5 * float(
        np.linalg.slogdet(matrix)[1] - np.log(problem.prior).sum()
    )
    covariance: Array = np.asarray(np.linalg.inv(matrix), np.float64)[:2, :2]
    return evidence, covariance


def _fitted(problem: _Problem, bulge: Shape, side: Shape | None) -> LoadHypothesis:
    """Fit one hypothesis by Gauss–Newton steps; the sizes of bulge and odd part are found on the way."""
    fit = _HypothesisFit(problem, bulge, side)
    for _ in range(_STEPS):
        fit.step()
    return fit.result()


class _HypothesisFit:
    """Working point of one hypothesis."""

    def __init__(self, problem: _Problem, bulge: Shape, side: Shape | None) -> None:
        self._problem = problem
        self._shapes: list[tuple[Shape, Array, str]] = [(bulge, bulge.mean.copy(), "bulge")]
        self._sizes = [_BULGE_MM, _ODD_MM]
        if side is not None:
            self._shapes.append((side, side.mean.copy(), "side"))
            self._sizes.insert(1, _SIDE_MM)
        count = problem.basis.shape[1]
        self._radial = [np.zeros(count) for _ in self._sizes]
        self._solve()

    def _precisions(self) -> list[Array]:
        kinds = [kind for _, _, kind in self._shapes] + ["bulge"]
        return [self._problem.precision[kind] for kind in kinds]

    def _solve(self) -> None:
        p = self._problem
        columns, derivatives, pulls, stiff = [p.nuisance], [], [], []
        for (shape, parameters, _), radial in zip(self._shapes, self._radial, strict=False):
            value, slopes = shape.evaluate(p.angle, parameters)
            columns.append(p.freed(p.basis * value[:, None]))
            derivatives.append(p.freed((slopes * (p.basis @ radial)).T))
            stiff.append(shape.deviation**-2.0)
            pulls.append((shape.mean - parameters) * shape.deviation**-2.0)
        columns += [p.odd_columns, *derivatives]
        design = np.hstack(columns)
        first, count = p.nuisance.shape[1], p.basis.shape[1]
        prior = np.zeros((design.shape[1], design.shape[1]))
        prior[:first, :first] = np.diag(p.prior)
        for k, (precision, size) in enumerate(zip(self._precisions(), self._sizes, strict=True)):
            begin = first + k * count
            prior[begin : begin + count, begin : begin + count] = precision / size**2
        begin = first + len(self._sizes) * count
        prior[begin:, begin:] = np.diag(np.concatenate(stiff))
        right = design.T @ p.heights
        right[begin:] += np.concatenate(pulls)
        self._design, self._prior, self._begin = design, prior, begin
        self._matrix = design.T @ design + prior
        self._inverse: Array = np.asarray(np.linalg.inv(self._matrix), np.float64)
        self._solution: Array = self._inverse @ right
        self._radial = [
            self._solution[first + k * count : first + (k + 1) * count] for k in range(len(self._sizes))
        ]

    def step(self) -> None:
        """Move the shapes and the sizes, and solve again."""
        begin, first, count = (
            self._begin, self._problem.nuisance.shape[1], self._problem.basis.shape[1]
        )  # fmt: skip
        for k, (shape, parameters, _) in enumerate(self._shapes):
            step = self._solution[begin : begin + len(parameters)]
            moved = parameters + np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
            reach = 3.0 * shape.deviation
            self._shapes[k] = (
                shape, np.clip(moved, shape.mean - reach, shape.mean + reach), self._shapes[k][2]
            )  # fmt: skip
            begin += len(parameters)
        for k, precision in enumerate(self._precisions()):
            if k == 1 and len(self._sizes) == 3:
                continue  # what is not seen of a side shift must not be taken for small
            block = slice(first + k * count, first + (k + 1) * count)
            squares = self._radial[k] @ precision @ self._radial[k] + np.sum(
                precision * self._inverse[block, block]
            )
            self._sizes[k] = float(np.clip(math.sqrt(squares / count), _LEAST_MM, _MOST_MM))
        self._sizes[-1] = min(self._sizes[-1], _ODD_SHARE * max(self._sizes[0], _LEAST_MM))
        self._solve()

    def result(self) -> LoadHypothesis:
        p = self._problem
        rest = p.heights - self._design[:, : self._begin] @ self._solution[: self._begin]
        penalty = float(
            self._solution[: self._begin] @ self._prior[: self._begin, : self._begin]
            @ self._solution[: self._begin]
        )  # fmt: skip
        log_prior = float(np.log(p.prior).sum())
        for precision, size in zip(self._precisions(), self._sizes, strict=True):
            log_prior += float(np.linalg.slogdet(precision)[1]) - 2.0 * len(precision) * math.log(size)
        for shape, parameters, _ in self._shapes:
            penalty += float(np.square((parameters - shape.mean) / shape.deviation).sum())
            log_prior -= 2.0 * float(np.log(shape.deviation).sum())
        misfit = float(rest @ rest)
        evidence = 0.5 * (log_prior - misfit - penalty - float(np.linalg.slogdet(self._matrix)[1]))
        parts: list[tuple[Shape | None, Array, Array]] = [
            (shape, parameters, radial)
            for (shape, parameters, _), radial in zip(self._shapes, self._radial, strict=False)
        ]
        parts.append((None, np.zeros(0), self._radial[-1]))
        first = p.nuisance.shape[1]
        return LoadHypothesis(
            evidence, self._solution[:2], self._inverse[:2, :2], tuple(parts), misfit,
            self._design[:, first:], self._prior[first:, first:],
        )  # fmt: skip
