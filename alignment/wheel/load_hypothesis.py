"""One hypothesis about a load, fitted to the cells of a wheel by Gauss–Newton steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.wheel.load_cells import Cells
from alignment.wheel.load_shapes import Shape

KNOTS_MM = 8.0  # of the radial profiles
FEWEST_PARTS = 2
"""Bulge and odd part; three with a side shift."""
TURN, PLACE_MM = 0.01, 30.0
"""Standard deviations of the axis, radians and millimetres."""
_BULGE_LENGTH, _SIDE_LENGTH = 15.0, 45.0  # mm over which a radial profile hardly changes
_BEAD = 0.05  # of a side shift at the tread may be left where the rubber begins to be seen
_LEAST_MM, _MOST_MM = 0.003, 12.0
_ODD_SHARE = 0.2  # of the bulge, at most
_CAUTION = 3.0  # times what is stated under side force: no part is exactly a product of two functions
_PIN = 3e-5  # radians, of a turn that is held
_LONGEST_STEP = 0.3  # of a parameter of a shape


@dataclass(frozen=True, eq=False)
class LoadHypothesis:
    """One shape of the load, fitted.

    Attributes
    ----------
    log_evidence
        Natural logarithm, up to a number that all hypotheses share.
    turn, covariance
        (2,) leans of the wheel's plane along the tilt axes that remain, and (2, 2), radians.
    shift
        (2,) by which its centre is off along them, millimetres.
    parts
        Angular shape, its parameters and radial coefficients (K,), of each part.
    sizes
        Standard deviation of each part, millimetres.
    misfit
        Chi squared.
    design, prior
        Columns of the load (C, m), in units of the noise, and the precision (m, m) of their numbers.
    rest
        (C,) heights that are left, in units of the noise.
    """

    log_evidence: float
    turn: Array
    shift: Array
    covariance: Array
    parts: tuple[tuple[Shape, Array, Array], ...]
    sizes: tuple[float, ...]
    misfit: float
    design: Array
    prior: Array
    rest: Array


def spline_basis(radius: Array, knots: Array) -> Array:
    """(n, K) cubic B-splines about equally spaced knots."""
    u = np.abs(radius[:, None] - knots) / (knots[1] - knots[0])
    inner, outer = 2.0 / 3.0 - u * u + 0.5 * u**3, np.square(2.0 - u) * (2.0 - u) / 6.0
    return np.where(u < 1.0, inner, np.where(u < 2.0, outer, 0.0))


@dataclass(eq=False)
class LoadProblem:
    """What all hypotheses share."""

    angle: Array
    contact: Array
    basis: Array
    nuisance: Array  # (C, 4 + n): the axis, then errors of the heads in units of their deviations
    prior: Array  # (4 + n,) of their precision
    heights: Array
    cells: Cells
    precision: dict[str, Array]  # of radial coefficients for a deviation of 1 mm

    def freed(self, columns: Array) -> Array:
        """In units of the noise."""
        return self.cells.freed(columns) / self.cells.noise


def problem_of(
    cells: Cells, contact: Array, amounts: Array | None, shift_mm: float = 0.0
) -> tuple[LoadProblem, Array]:
    """What all hypotheses share, and the knots (K,) of radial profiles; parameters as for `fit_load`."""
    radius = cells.radius
    first = KNOTS_MM * math.floor(radius.min() / KNOTS_MM - 1.0)
    knots = np.arange(first, radius.max() + 2.1 * KNOTS_MM, KNOTS_MM)
    errors = np.zeros((len(radius), 0))
    if amounts is not None:
        errors = cells.by_head() @ root_of(amounts)
    if shift_mm > 0.0:
        errors = np.hstack([errors, shift_mm**2 * cells.bends])
    share = np.clip((knots - radius.min()) / (radius.max() - radius.min()), 0.0, 1.0)
    problem = LoadProblem(
        angle=cells.angle_from(contact),
        contact=contact,
        basis=spline_basis(radius, knots),
        nuisance=np.zeros(0),
        prior=np.concatenate([[TURN**-2] * 2, [PLACE_MM**-2] * 2, np.ones(errors.shape[1])]),
        heights=np.zeros(0),
        cells=cells,
        precision={
            "bulge": _precision(knots, np.minimum(1.0, 0.1 + 2.5 * share), _BULGE_LENGTH),
            "side": _precision(knots, _BEAD + share, _SIDE_LENGTH),
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


def without_load(problem: LoadProblem) -> tuple[float, Array]:
    """Logarithm of the evidence, and covariance (2, 2) of the leans."""
    n, y = problem.nuisance, problem.heights
    matrix = n.T @ n + np.diag(problem.prior)
    solution = np.linalg.solve(matrix, n.T @ y)
    evidence = -0.5 * float(y @ y - (n.T @ y) @ solution) - 0.5 * float(
        np.linalg.slogdet(matrix)[1] - np.log(problem.prior).sum()
    )
    return evidence, np.asarray(np.linalg.inv(matrix)[:2, :2], dtype=np.float64)


def root_of(covariance: Array) -> Array:
    """(n, n) columns whose products add up to a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    out: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return out


class HypothesisFit:
    """Working point of one hypothesis."""

    def __init__(
        self,
        problem: LoadProblem,
        shapes: list[tuple[Shape, Array]],
        sizes: list[float],
        radial: list[Array],
    ) -> None:
        """Begin with parameters, sizes, radial profiles of bulge, side shift where there is one, odd part."""
        self._problem, self._shapes, self._sizes, self._radial = problem, shapes, sizes, radial
        self._pinned: float | None = None
        self._solve()

    def from_turn(self, turn: float, steps: int) -> HypothesisFit:
        """The same after steps with the wheel held at a turn towards the contact, radians, then free."""
        self._pinned = turn
        self._solve()
        for _ in range(steps):
            self._step()
        self._pinned = None
        self._solve()
        return self

    def after(self, steps: int) -> LoadHypothesis:
        """The hypothesis after so many steps."""
        for _ in range(steps):
            self._step()
        return self._result()

    def _precisions(self) -> list[Array]:
        kinds = ("bulge", "bulge") if len(self._shapes) == FEWEST_PARTS else ("bulge", "side", "bulge")
        return [self._problem.precision[kind] for kind in kinds]

    def _solve(self) -> None:
        p = self._problem
        columns, derivatives, pulls, stiff = [p.nuisance], [], [], []
        for (shape, parameters), radial in zip(self._shapes, self._radial, strict=True):
            value, slopes = shape.evaluate(p.angle, parameters)
            columns.append(p.freed(p.basis * value[:, None]))
            derivatives.append(p.freed((slopes * (p.basis @ radial)).T))
            stiff.append(shape.deviation**-2.0)
            pulls.append((shape.mean - parameters) * shape.deviation**-2.0)
        columns += derivatives
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
        if self._pinned is not None:
            prior[:2, :2] += np.outer(p.contact, p.contact) / _PIN**2
            right[:2] += p.contact * self._pinned / _PIN**2
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
        parts = tuple(
            (shape, parameters, mine) for (shape, parameters), mine in zip(self._shapes, radial, strict=True)
        )
        caution = 1.0 if len(parts) == FEWEST_PARTS else _CAUTION**2
        return LoadHypothesis(
            evidence, solution[:2], -solution[2:4], caution * self._inverse[:2, :2], parts,
            tuple(self._sizes), misfit,
            self._design[:, first:], self._prior[first:, first:], rest,
        )  # fmt: skip
