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

_KNOTS, _TABLE = 8.0, 0.25  # mm, of the radial profiles, and of their tables
_BULGE_LENGTH, _SIDE_LENGTH = 15.0, 45.0  # mm over which a radial profile hardly changes
_BULGE_MM, _SIDE_MM, _ODD_MM = 3.0, 8.0, 0.1  # standard deviations at the contact, where they begin
_LEAST_MM, _MOST_MM = 0.003, 12.0
_ODD_SHARE = 0.2  # of the bulge, at most
_KNOCK_SIZES = (1.0, 0.25, 0.0625, 0.0156)  # of the one standard deviation that is given
_TURN, _PLACE_MM = 0.01, 30.0  # standard deviations of the axis, radians and mm
_BELIEF = 1e-4  # of an average; less is left out
_STEPS, _FEW_STEPS = 7, 2  # of a fit from the start, and of one that goes on
_FEWEST_PARTS = 2  # bulge and odd part; three with a side shift
_SIDE_RARITY = 6.0
_PASSES_FOR_TURN, _ACROSS = 0.25, 0.1  # of a side shift, as the heads see it
_LONGEST_STEP = 0.3  # of a parameter of a shape
_MOST_CONTINUED = 8  # hypotheses
_OTHER_BULGE = 3.0  # logarithm of the evidence by which one bulge may help a side shift more than another
_SURE_NOISE = 1.2  # of the images' noise; where no more is left over, no side force is looked for


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
    sizes
        Standard deviation of each part, millimetres.
    misfit
        Chi squared.
    design, prior
        Columns of the load (C, m), in units of the noise, and the precision (m, m) of their numbers.
    """

    log_evidence: float
    turn: Array
    covariance: Array
    parts: tuple[tuple[Shape | None, Array, Array], ...]
    sizes: tuple[float, ...]
    misfit: float
    design: Array
    prior: Array


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
    gain
        Difference of the logarithm of the evidence to that of no load.
    turn, covariance
        (2,) and (2, 2) of the average.
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
    gain: float
    turn: Array
    covariance: Array
    unloaded: Array
    noise: float
    unevenness: float

    def height(self, places: Array) -> Array:
        """(n,) by how much the load lifts the sidewall at places (n, 2) along the tilt axes, millimetres."""
        angle, radius = angle_from(places, self.contact), np.hypot(places[:, 0], places[:, 1])
        grid = np.arange(self.knots[0] - 2.0 * _KNOTS, self.knots[-1] + 2.0 * _KNOTS, _TABLE)
        basis = spline_basis(grid, self.knots)
        out = np.zeros(len(places))
        for belief, hypothesis in zip(self.beliefs, self.hypotheses, strict=True):
            for shape, parameters, coefficients in hypothesis.parts if belief > 0.0 else ():
                value = odd(angle) if shape is None else shape.evaluate(angle, parameters)[0]
                out += value * np.interp(radius, grid, basis @ (belief * coefficients))
        return out

    def freed_moves(self, cells: Cells) -> tuple[Array, Array]:
        """Normal equations (5 H, 5 H), (5 H,) of the heads' moves, with the load free to explain them.

        In the units of `HeadMoves`; the likeliest hypothesis is asked.
        """
        best = self.hypotheses[int(self.beliefs.argmax())]
        moves, heights = _moves(cells)
        by_load = best.design.T @ moves
        right = best.design.T @ heights
        inner = np.linalg.inv(best.design.T @ best.design + best.prior)
        normal = moves.T @ moves - by_load.T @ inner @ by_load
        target = moves.T @ heights - by_load.T @ inner @ right
        return normal * cells.noise**2, target * cells.noise**2

    def knock_gain(self, cells: Cells, amounts: Array | None, knock: Array) -> float:
        """Difference of the logarithm of the evidence that a head moved, no load, to that nothing did.

        `knock` (5 H, 6) are its moves by one standard deviation, `amounts` as for `fit_load`.
        """
        moves, heights = _moves(cells)
        axis = cells.freed(cells.moves[:, 1:]) / cells.noise
        scale = np.array([_TURN] * 2 + [_PLACE_MM] * 2)
        known = np.zeros((moves.shape[1], 0)) if amounts is None else _root(amounts)
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
    contact: Array
    basis: Array
    nuisance: Array  # (C, 4 + n): the axis, then errors of the heads in units of their deviations
    prior: Array  # (4 + n,) of their precision
    heights: Array
    cells: Cells
    precision: dict[str, Array]  # of radial coefficients for a deviation of 1 mm
    odd_columns: Array = field(init=False)

    def __post_init__(self) -> None:
        self.odd_columns = self.freed(self.basis * odd(self.angle)[:, None])

    def freed(self, columns: Array) -> Array:
        """In units of the noise."""
        return self.cells.freed(columns) / self.cells.noise


def fit_load(
    cells: Cells,
    contact: Array,
    amounts: Array | None,
    start: LoadModel | None = None,
    *,
    best_alone: bool = False,
    side_force: bool = True,
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
    side_force
        Look for side force, too, where the bulges of `start` leave more than noise.
    """
    problem, knots = _problem(cells, contact, amounts)
    plain, unloaded = _without_load(problem)
    if start is None:
        found = [_fitted(problem, bulge, None) for bulge in BULGES]
    else:
        likeliest = np.argsort([_rarity(each) - each.log_evidence for each in start.hypotheses])[
            : 1 if best_alone else _MOST_CONTINUED
        ]
        known = [start.hypotheses[k] for k in likeliest]
        found = [_continued(problem, each, start.knots, knots) for each in known]
        closed = best_alone or not side_force or any(len(each.sizes) > _FEWEST_PARTS for each in found)
        left = min(each.misfit for each in found) / len(cells.weight) * cells.noise**2
        if not closed and left > (_SURE_NOISE * cells.image_noise) ** 2:
            found += _with_side_force(problem)
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
        tuple(found), beliefs, knots, contact, gain, turn, covariance, uneven * unloaded,
        cells.noise * math.sqrt(uneven), uneven,
    )  # fmt: skip


def _problem(cells: Cells, contact: Array, amounts: Array | None) -> tuple[_Problem, Array]:
    radius = cells.radius
    first = _KNOTS * math.floor(radius.min() / _KNOTS - 1.0)
    knots = np.arange(first, radius.max() + 1.1 * _KNOTS, _KNOTS)
    errors = np.zeros((len(radius), 0))
    if amounts is not None:
        errors = cells.by_head() @ _root(amounts)
    share = np.clip((knots - radius.min()) / (radius.max() - radius.min()), 0.0, 1.0)
    problem = _Problem(
        angle=cells.angle_from(contact),
        contact=contact,
        basis=spline_basis(radius, knots),
        nuisance=np.zeros(0),
        prior=np.concatenate([[_TURN**-2] * 2, [_PLACE_MM**-2] * 2, np.ones(errors.shape[1])]),
        heights=np.zeros(0),
        cells=cells,
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
    return np.asarray(np.linalg.inv(np.outer(envelope, envelope) * process), dtype=np.float64)


def _without_load(problem: _Problem) -> tuple[float, Array]:
    """Logarithm of the evidence, and covariance (2, 2) of the leans."""
    n, y = problem.nuisance, problem.heights
    matrix = n.T @ n + np.diag(problem.prior)
    solution = np.linalg.solve(matrix, n.T @ y)
    evidence = -0.5 * float(y @ y - (n.T @ y) @ solution) - 0.5 * float(
        np.linalg.slogdet(matrix)[1] - np.log(problem.prior).sum()
    )
    return evidence, np.asarray(np.linalg.inv(matrix)[:2, :2], dtype=np.float64)


def _fitted(problem: _Problem, bulge: Shape, side: Shape | None) -> LoadHypothesis:
    """Fit one hypothesis by Gauss–Newton steps; the sizes of bulge and odd part are found on the way."""
    shapes = [(bulge, bulge.mean)] if side is None else [(bulge, bulge.mean), (side, side.mean)]
    sizes = [_BULGE_MM, _ODD_MM] if side is None else [_BULGE_MM, _SIDE_MM, _ODD_MM]
    radial = [np.zeros(problem.basis.shape[1]) for _ in sizes]
    return _HypothesisFit(problem, shapes, sizes, radial).after(_STEPS)


def _rarity(hypothesis: LoadHypothesis) -> float:
    """By how much less a hypothesis is believed beforehand, as a logarithm: wheels hardly push sideways."""
    return 0.0 if len(hypothesis.sizes) == _FEWEST_PARTS else _SIDE_RARITY + math.log(len(SIDE_SHIFTS))


def _with_side_force(problem: _Problem) -> list[LoadHypothesis]:
    """Hypotheses with a side shift: every one with one of the bulges, the likely ones with the others too."""
    first = [_fitted(problem, BULGES[-1], side) for side in SIDE_SHIFTS]
    best = max(each.log_evidence for each in first)
    likely = [
        side for side, each in zip(SIDE_SHIFTS, first, strict=True) if each.log_evidence > best - _OTHER_BULGE
    ]
    return first + [_fitted(problem, bulge, side) for bulge in BULGES[:-1] for side in likely]


def _continued(problem: _Problem, known: LoadHypothesis, before: Array, knots: Array) -> LoadHypothesis:
    """Go on with one hypothesis, whose radial profiles had the knots before (K',), on other heights."""
    shapes = [(shape, parameters) for shape, parameters, _ in known.parts if shape is not None]
    radial = [np.interp(knots, before, radial, 0.0, 0.0) for _, _, radial in known.parts]
    return _HypothesisFit(problem, shapes, list(known.sizes), radial).after(_FEW_STEPS)


class _HypothesisFit:
    """Working point of one hypothesis."""

    def __init__(
        self,
        problem: _Problem,
        shapes: list[tuple[Shape, Array]],
        sizes: list[float],
        radial: list[Array],
    ) -> None:
        """Begin with the parameters of the shapes, first the bulge, then the side shift where there is one,
        and with sizes and radial profiles of these and, the last, of the odd part."""
        self._problem, self._shapes, self._sizes, self._radial = problem, shapes, sizes, radial
        self._solve()

    def after(self, steps: int) -> LoadHypothesis:
        """The hypothesis after so many steps."""
        for _ in range(steps):
            self._step()
        return self._result()

    def _precisions(self) -> list[Array]:
        kinds = ("bulge", "side")[: len(self._shapes)]
        return [self._problem.precision[kind] for kind in (*kinds, "bulge")]

    def _solve(self) -> None:
        p = self._problem
        columns, derivatives, pulls, stiff = [p.nuisance], [], [], []
        for (shape, parameters), radial in zip(self._shapes, self._radial, strict=False):
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
        self._inverse: Array = np.asarray(np.linalg.inv(self._matrix), dtype=np.float64)
        self._solution: Array = self._inverse @ right
        self._radial = [
            self._solution[first + k * count : first + (k + 1) * count] for k in range(len(self._sizes))
        ]

    def _step(self) -> None:
        """Move the shapes and the sizes, and solve again."""
        begin, first, count = (
            self._begin, self._problem.nuisance.shape[1], self._problem.basis.shape[1]
        )  # fmt: skip
        for k, (shape, parameters) in enumerate(self._shapes):
            step = self._solution[begin : begin + len(parameters)]
            moved = parameters + np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
            reach = 3.0 * shape.deviation
            self._shapes[k] = (shape, np.clip(moved, shape.mean - reach, shape.mean + reach))
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

    def _result(self) -> LoadHypothesis:
        p, begin = self._problem, self._begin
        # With the shapes as they are: a step that a bound cut off must not count as taken.
        design, prior = self._design[:, :begin], self._prior[:begin, :begin]
        solution: Array = np.asarray(
            np.linalg.solve(self._matrix[:begin, :begin], design.T @ p.heights), dtype=np.float64
        )
        rest = p.heights - design @ solution
        penalty = float(solution @ prior @ solution)
        log_prior = float(np.log(p.prior).sum())
        for precision, size in zip(self._precisions(), self._sizes, strict=True):
            log_prior += float(np.linalg.slogdet(precision)[1]) - 2.0 * len(precision) * math.log(size)
        for shape, parameters in self._shapes:
            penalty += float(np.square((parameters - shape.mean) / shape.deviation).sum())
            log_prior -= 2.0 * float(np.log(shape.deviation).sum())
        misfit = float(rest @ rest)
        evidence = 0.5 * (log_prior - misfit - penalty - float(np.linalg.slogdet(self._matrix)[1]))
        first, count = p.nuisance.shape[1], p.basis.shape[1]
        radial = [solution[first + k * count : first + (k + 1) * count] for k in range(len(self._sizes))]
        parts: list[tuple[Shape | None, Array, Array]] = [
            (shape, parameters, mine) for (shape, parameters), mine in zip(self._shapes, radial, strict=False)
        ]
        parts.append((None, np.zeros(0), radial[-1]))
        return LoadHypothesis(
            evidence, solution[:2], self._inverse[:2, :2] + self._hidden(parts), tuple(parts),
            tuple(self._sizes), misfit,
            self._design[:, first:], self._prior[first:, first:],
        )  # fmt: skip

    def _hidden(self, parts: list[tuple[Shape | None, Array, Array]]) -> Array:
        """(2, 2) covariance of the turn by what of a side shift may pass for one: broad shapes of which no
        family is exact leave hardly more residuals than a turn does."""
        p = self._problem
        out: Array = np.zeros((2, 2))
        for shape, parameters, radial in parts[1:-1]:
            if shape is not None:
                seen = shape.evaluate(p.angle, parameters)[0] * (p.basis @ radial)
                turn = _PASSES_FOR_TURN * float(np.abs(seen).max()) / float(p.cells.radius.mean())
                along, across = p.contact, p.contact[::-1] * [-1.0, 1.0]
                out += turn**2 * np.outer(along, along)
                out += (_ACROSS * turn) ** 2 * np.outer(across, across)
        return out
