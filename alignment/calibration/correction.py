"""Correction functions (thesis 6.2): smooth models of measured errors, chosen by what they say of others.

Every candidate is a linear smoother, errors = B θ with a penalty on θ, so that the error of each point left
out of the fit follows from one fit: e / (1 − h), h its leverage.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial.distance import cdist

from alignment.arrays import Array
from alignment.errors import DegenerateInputError

Basis = Callable[[Array], Array]
_LEAST_POINTS = 8
_OUTER_FOLDS = 60
_FLAT = 0.02
# A model with more parameters than half the points interpolates errors of measurement.
_MOST_FREEDOM = 0.5


@dataclass(frozen=True, eq=False)
class Candidate:
    """A form of model: from scaled points (N, d), its basis functions and the root (·, k) of its penalty."""

    name: str
    make: Callable[[Array], tuple[Basis, Array | None]]


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """One candidate fitted to one coordinate's errors.

    Attributes
    ----------
    name
        Of the candidate; ``none`` is the model that corrects nothing.
    degrees_of_freedom
        Effective number of parameters, the trace of the hat matrix.
    residuals
        (N,) what is left of the errors it was fitted to.
    left_out
        (N,) the errors that remain at each point when it is left out of the fit.
    """

    name: str
    degrees_of_freedom: float
    residuals: Array
    left_out: Array
    _basis: Basis
    _weights: Array

    @property
    def left_out_rms(self) -> float:
        """Root mean square of `left_out`."""
        return float(np.sqrt(np.square(self.left_out).mean()))

    def __call__(self, scaled: Array) -> Array:
        """Error (N,) predicted at scaled points (N, d)."""
        return np.asarray(self._basis(scaled) @ self._weights)


def polynomial(name: str, powers: Sequence[tuple[int, ...]]) -> Candidate:
    """Polynomial in scaled coordinates with the given exponents, one tuple of d per term."""
    exponents = np.array(powers)

    def basis(q: Array) -> Array:
        return np.asarray(np.prod(q[:, None, :] ** exponents[None], axis=2))

    return Candidate(name, lambda _: (basis, None))


def _tensor_spline(degree: int, intervals: int, dimensions: int) -> Candidate:
    knots = np.concatenate(
        [np.full(degree, -1.0), np.linspace(-1.0, 1.0, intervals + 1), np.full(degree, 1.0)]
    )

    def basis(q: Array) -> Array:
        one = [BSpline.design_matrix(axis, knots, degree).toarray() for axis in np.clip(q, -1.0, 1.0).T]
        product = one[0]
        for other in one[1:]:
            product = (product[:, :, None] * other[:, None, :]).reshape(len(q), -1)
        return np.asarray(product)

    kind = "piecewise linear" if degree == 1 else "cubic spline"
    pieces = " × ".join([str(intervals)] * dimensions)
    return Candidate(f"{kind}, {pieces} pieces", lambda _: (basis, None))


def _thin_plate(smoothing: float, dimensions: int) -> Candidate:
    """Thin-plate spline (Duchon, 1977) with a knot at every point."""

    def kernel(distance: Array) -> Array:
        if dimensions == 1:
            return np.asarray(distance**3)
        if dimensions == 2:
            return np.asarray(distance**2 * np.log(np.maximum(distance, 1e-300)))
        return -distance

    def make(points: Array) -> tuple[Basis, Array]:
        plane = np.column_stack([np.ones(len(points)), points])
        # Coefficients orthogonal to the plane keep the bending energy finite.
        free = np.linalg.qr(plane, mode="complete")[0][:, plane.shape[1] :]
        energy = free.T @ kernel(cdist(points, points)) @ free
        values, vectors = np.linalg.eigh(0.5 * (energy + energy.T))
        root = np.sqrt(values.clip(0.0))[:, None] * vectors.T
        penalty = np.sqrt(smoothing) * np.column_stack([root, np.zeros((len(root), plane.shape[1]))])

        def basis(q: Array) -> Array:
            return np.column_stack([kernel(cdist(q, points)) @ free, np.ones(len(q)), q])

        return basis, penalty

    return Candidate(f"thin-plate spline, smoothing {smoothing:g}", make)


def standard_candidates(dimensions: int) -> tuple[Candidate, ...]:
    """Polynomials, piecewise linear and smooth functions of 1, 2 or 3 coordinates.

    Polynomials of total degree 0 to 5; sums of one polynomial of degree 1 to 4 per coordinate (the thesis's
    f_x is degree 4 in x and 1 in y); piecewise linear and cubic tensor splines of 2 and 3 pieces; thin-plate
    splines of several smoothings.
    """
    candidates = []
    for degree in range(6):
        powers = [p for p in itertools.product(range(degree + 1), repeat=dimensions) if sum(p) <= degree]
        candidates.append(polynomial(f"polynomial of degree {degree}", powers))
    if dimensions > 1:
        for degrees in itertools.product(range(1, 5), repeat=dimensions):
            powers = [(0,) * dimensions]
            for axis, degree in enumerate(degrees):
                powers += [
                    tuple(n if k == axis else 0 for k in range(dimensions)) for n in range(1, degree + 1)
                ]
            if max(degrees) > 1:
                name = " + ".join(f"degree {n} in {'xyz'[k]}" for k, n in enumerate(degrees))
                candidates.append(polynomial(name, powers))
    candidates += [_tensor_spline(degree, n, dimensions) for degree in (1, 3) for n in (2, 3)]
    candidates += [_thin_plate(10.0**power, dimensions) for power in range(-5, 2)]
    return tuple(candidates)


def _nothing(errors: Array) -> ErrorModel:
    return ErrorModel("none", 0.0, errors, errors, lambda q: np.zeros((len(q), 0)), np.zeros(0))


def _fit(candidate: Candidate, points: Array, errors: Array) -> ErrorModel | None:
    """Fit one candidate; None where the points do not determine it, or it merely follows them."""
    basis, penalty = candidate.make(points)
    rows = basis(points)
    count = len(points)
    if penalty is not None:
        rows = np.concatenate([rows, penalty])
    if rows.shape[1] >= len(rows):
        return None
    q, r = np.linalg.qr(rows)
    size = np.abs(np.diag(r))
    if size.min() <= 1e-9 * size.max():
        return None
    weights = np.linalg.solve(r, q[:count].T @ errors)
    leverage = np.square(q[:count]).sum(axis=1)
    if leverage.max() > 1.0 - 1e-6 or leverage.sum() > _MOST_FREEDOM * count:
        return None
    residuals = errors - rows[:count] @ weights
    return ErrorModel(
        candidate.name, float(leverage.sum()), residuals, residuals / (1.0 - leverage), basis, weights
    )


def choose_correction(points: Array, errors: Array, candidates: Sequence[Candidate]) -> ErrorModel:
    """Fit all candidates and return the simplest that is as good on left-out points as the best.

    As good: its squared left-out errors exceed those of the best by no more than one standard error of the
    difference, point by point. Correcting nothing competes too, as the simplest.

    Parameters
    ----------
    points
        (N, d) scaled to −1 … 1.
    errors
        (N,).
    candidates
        Forms to try.
    """
    fitted = [_nothing(errors), *filter(None, (_fit(one, points, errors) for one in candidates))]
    best = min(fitted, key=lambda model: model.left_out_rms)
    for model in sorted(fitted, key=lambda model: model.degrees_of_freedom):
        excess = np.square(model.left_out) - np.square(best.left_out)
        if excess.mean() <= excess.std(ddof=1) / np.sqrt(len(excess)):
            return model
    return best


def left_out_errors(
    points: Array, errors: Array, candidates: Sequence[Candidate], folds: int = _OUTER_FOLDS
) -> Array:
    """Errors (N,) that remain at points that took part neither in the fit nor in the choice of the model.

    Each point is left out alone, of more points than `folds` every one of that distance together. Other
    arguments as `choose_model`.
    """
    remaining = np.empty_like(errors)
    fold = np.arange(len(errors)) % folds
    for k in range(min(len(errors), folds)):
        out = fold == k
        model = choose_correction(points[~out], errors[~out], candidates)
        remaining[out] = errors[out] - model(points[out])
    return remaining


@dataclass(frozen=True, eq=False)
class Correction:
    """Takes the systematic errors off measured points.

    Attributes
    ----------
    models
        One per coordinate.
    lowest, highest
        (3,) the box of the points it was fitted to, millimetres. Beyond it the correction of the box's
        nearest point holds: nothing is extrapolated.
    axes
        Coordinates that the models depend on; one in which the true points hardly differ is none: there the
        measured ones differ by their errors, and would only explain themselves.
    """

    models: tuple[ErrorModel, ErrorModel, ErrorModel]
    lowest: Array
    highest: Array
    axes: tuple[int, ...]

    @property
    def helps(self) -> tuple[bool, bool, bool]:
        """For each coordinate, whether anything is corrected: whether left-out points got better."""
        x, y, z = (model.name != "none" for model in self.models)
        return x, y, z

    def scaled(self, points: Array) -> Array:
        """Points (N, 3) as the models take them: (N, axes), −1 … 1 over the box."""
        return _scaled(points, self.lowest, self.highest, self.axes)

    def errors(self, points: Array) -> Array:
        """Predicted errors (N, 3), measured less true, of measured points (N, 3), millimetres."""
        scaled = self.scaled(points)
        return np.column_stack([model(scaled) for model in self.models])

    def apply(self, points: Array) -> Array:
        """Measured points (N, 3) less their predicted errors, millimetres."""
        return np.asarray(points, dtype=np.float64) - self.errors(points)


def _scaled(points: Array, lowest: Array, highest: Array, axes: tuple[int, ...]) -> Array:
    chosen = list(axes)
    box = np.clip(np.asarray(points, dtype=np.float64), lowest, highest)[:, chosen]
    middle, half = 0.5 * (lowest + highest)[chosen], 0.5 * (highest - lowest)[chosen]
    return np.asarray((box - middle) / half)


def fit_correction(
    points: Array, errors: Array, make_candidates: Callable[[int], Sequence[Candidate]] = standard_candidates
) -> Correction:
    """Fit a correction function to measured errors, coordinate by coordinate.

    Parameters
    ----------
    points
        (N, 3) measured points, millimetres.
    errors
        (N, 3) measured less true, millimetres; NaN where one is not known.
    make_candidates
        Forms to try, for the number of coordinates in which the points differ.

    Raises
    ------
    DegenerateInputError
        For fewer than 8 known errors of a coordinate, or points that all coincide.
    """
    points, errors = np.asarray(points, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    if points.shape != (len(points), 3) or errors.shape != points.shape or not np.isfinite(points).all():
        raise DegenerateInputError(
            field="points, errors",
            expected="finite points (N, 3) and errors (N, 3)",
            seen=f"shapes {points.shape} and {errors.shape}",
        )
    known = np.isfinite(errors)
    if known.sum(axis=0).min(initial=len(points)) < _LEAST_POINTS or len(points) < _LEAST_POINTS:
        raise DegenerateInputError(
            field="errors",
            expected=f"at least {_LEAST_POINTS} known errors of each coordinate",
            seen=str(known.sum(axis=0).tolist()),
            cure="Measure more points of the reference object.",
        )
    lowest, highest = points.min(axis=0), points.max(axis=0)
    extent = np.ptp(points - np.nan_to_num(errors), axis=0)
    axes = tuple(int(k) for k in np.flatnonzero(extent > _FLAT * extent.max()))
    if not axes:
        raise DegenerateInputError(field="points", expected="points at different places", seen="one place")
    scaled = _scaled(points, lowest, highest, axes)
    candidates = make_candidates(len(axes))
    x, y, z = (choose_correction(scaled[k], e[k], candidates) for k, e in zip(known.T, errors.T, strict=True))
    return Correction((x, y, z), lowest, highest, axes)
