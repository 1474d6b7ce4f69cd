"""Choice of the distortion model: the simplest that predicts what was left out as well as the best does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array, Mask
from alignment.calibration.adjustment import AdjustmentSettings, Solution, minimise, solve
from alignment.calibration.equations import prior_cost
from alignment.calibration.observations import CalibrationInput
from alignment.calibration.problem import (
    MODELS,
    Problem,
    State,
    build_problem,
    cameras_of,
    initial_state,
)
from alignment.calibration.start import Start, start_values, with_model
from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import MarkObservations

_FEWEST_VIEWS = 5  # below it, marks are left out instead of views
_MARK_FOLDS = 5
_KNOWN_MARK_MM = 1e-3  # a mark that the other views have located
_FIT_STEPS, _FOLD_STEPS = 12, 8  # a valley of equal fit need not be walked to its end


@dataclass(frozen=True)
class ModelScore:
    """How well a model predicts what was left out.

    Attributes
    ----------
    model
        Its name.
    terms
        How many lens terms it estimates.
    score
        Mean square of the left-out residuals in standard deviations; infinite where the model could not be
        fitted, or fits no better than a simpler one.
    excess, error
        Mean excess of the score over the best model's, fold by fold, and the standard error of that.
    """

    model: str
    terms: int
    score: float
    excess: float
    error: float


@dataclass(frozen=True)
class ModelChoice:
    """The chosen model, the scores of all, simplest first, and what was left out: ``views`` or ``marks``."""

    model: str
    scores: tuple[ModelScore, ...]
    left_out: str


Fit = tuple[Problem, Solution]


@dataclass(frozen=True, eq=False)
class _Fold:
    """Observations to fit to, and those left out; `new_pose` when the plate has another pose there."""

    fitted: CalibrationInput
    left_out: CalibrationInput
    new_pose: bool


def choose_model(
    data: CalibrationInput,
    settings: AdjustmentSettings | None = None,
    candidates: Sequence[str] = tuple(MODELS),
    start: Start | None = None,
    progress: Callable[[str], None] | None = None,
) -> ModelChoice:
    """Choose the distortion model by cross-validation.

    Each view in turn is left out, or, where there are fewer than five, each fifth of the marks; cameras
    fitted to the rest predict it, only the plate's pose in that view (or those marks' deviations) being
    adjusted. Models that fit no better than a simpler one are not tried. Of all models whose excess over the
    best is within its standard error the simplest counts.

    Parameters
    ----------
    data
        The observations.
    settings
        Of the adjustment; its `model` is not used.
    candidates
        Names of `MODELS`.
    start
        Start values; None finds them.
    progress
        Called with the name of each model before it is tried.

    Raises
    ------
    DegenerateInputError
        When no candidate can be fitted.
    """
    settings = settings or AdjustmentSettings()
    start = start or start_values(data, "brown5")
    ordered = sorted(candidates, key=lambda name: len(MODELS[name].estimated))
    by_view = len(data.views) >= _FEWEST_VIEWS and _views_suffice(data)
    folds = _view_folds(data) if by_view else _mark_folds(data)
    fits: dict[str, Fit] = {}
    for name in ordered:
        if progress is not None:
            progress(name)
        try:
            quick = replace(settings, model=name, iterations=_FIT_STEPS, must_settle=False)
            fits[name] = _fit(data, with_model(start, name), quick)
        except DegenerateInputError:
            continue
    if not fits:
        raise DegenerateInputError(
            field="views", expected="views to which a lens model can be fitted", seen="none that can"
        )
    # One measure for all models: the least noise that any of them found.
    scales = np.min([solution.scales for _, solution in fits.values()], axis=0)
    scores = {}
    for name in _promising(fits, scales, settings.outlier_sigma):
        quick = replace(settings, model=name, iterations=_FOLD_STEPS, must_settle=False)
        try:
            scores[name] = np.array([_score(fits[name], fold, quick, scales) for fold in folds])
        except DegenerateInputError:
            continue
    if not scores:
        raise DegenerateInputError(
            field="views", expected="views to which a lens model can be fitted", seen="none that can"
        )
    return _choose(scores, ordered, "views" if by_view else "marks")


def _promising(fits: dict[str, Fit], scales: Array, cut: float) -> list[str]:
    """Models, simplest first, that fit better than each simpler one by more than their additional terms would
    by chance (Akaike's criterion); the others cannot predict better."""
    kept: list[tuple[str, float]] = []
    for name, (problem, solution) in fits.items():
        squares = np.square(solution.at.residuals).sum(axis=1) / scales[problem.camera] ** 2
        cost = float(np.minimum(squares, cut**2).sum()) + prior_cost(problem, solution.state)
        terms = len(MODELS[name].estimated) * len(problem.data.cameras)
        if all(cost + 2.0 * terms < other for _, other in kept):
            kept.append((name, cost + 2.0 * terms))
    return [name for name, _ in kept]


def _choose(scores: dict[str, Array], ordered: Sequence[str], left_out: str) -> ModelChoice:
    best = min(scores, key=lambda name: float(scores[name].mean()))
    table = []
    for name in ordered:
        terms = len(MODELS[name].estimated)
        if name not in scores:
            table.append(ModelScore(name, terms, np.inf, np.inf, 0.0))
            continue
        excess = scores[name] - scores[best]
        error = float(excess.std(ddof=1) / np.sqrt(len(excess)))
        table.append(ModelScore(name, terms, float(scores[name].mean()), float(excess.mean()), error))
    chosen = next(s.model for s in table if s.excess <= s.error)
    return ModelChoice(chosen, tuple(table), left_out)


def _fit(data: CalibrationInput, start: Start, settings: AdjustmentSettings) -> Fit:
    problem = build_problem(data, start.cameras, settings.model, settings.priors)
    state = initial_state(problem, start.cameras, list(start.rig_from_plate))
    return problem, solve(problem, state, settings)


def _views_suffice(data: CalibrationInput) -> bool:
    """Whether every camera keeps its views, and the rig its frame, when one view is left out."""
    counts = [sum(key in view.observations for view in data.views) for key in data.cameras]
    stages = sum(view.stage_mm is not None for view in data.views)
    return min(counts) >= _FEWEST_VIEWS and (stages == 0 or stages >= 3)


def _view_folds(data: CalibrationInput) -> list[_Fold]:
    # Without any stage the first view is the rig frame and stays.
    first = 1 if all(view.stage_mm is None for view in data.views) else 0
    return [
        _Fold(
            replace(data, views=(*data.views[:v], *data.views[v + 1 :])),
            replace(data, views=(data.views[v],)),
            True,
        )
        for v in range(first, len(data.views))
    ]


def _mark_folds(data: CalibrationInput) -> list[_Fold]:
    i, j = data.plate.indices.T
    fold = (i + 2 * j) % _MARK_FOLDS  # no two neighbours in one
    return [_Fold(_only(data, fold != k), _only(data, fold == k), False) for k in range(_MARK_FOLDS)]


def _only(data: CalibrationInput, keep: Mask) -> CalibrationInput:
    """Only the observations of some marks of the plate (M,)."""
    views = []
    for view in data.views:
        seen = {}
        for key, of in view.observations.items():
            rows = keep[of.marks]
            seen[key] = MarkObservations(of.marks[rows], of.pixels[rows], of.covariance[rows], of.corrected)
        views.append(replace(view, observations=seen))
    return replace(data, views=tuple(views))


def _score(fit: Fit, fold: _Fold, settings: AdjustmentSettings, scales: Array) -> float:
    """Mean square of what was left out, in standard deviations of one coordinate, gross errors capped."""
    whole, solution = fit
    cameras = cameras_of(whole, solution.state)
    problem = build_problem(fold.fitted, cameras, settings.model, settings.priors)
    state, *_ = minimise(problem, _carried(problem, whole, solution.state), settings, scales)

    plate = fold.left_out.plate
    points, sigma = plate.points.copy(), plate.sigma_mm.copy()
    points[problem.marks] += state.deviations
    sigma[problem.marks] = np.minimum(sigma[problem.marks], _KNOWN_MARK_MM)
    data = replace(fold.left_out, plate=replace(plate, points=points, sigma_mm=sigma))
    cameras = cameras_of(problem, state)
    test = build_problem(
        data,
        cameras,
        settings.model,
        settings.priors,
        fixed_cameras=frozenset(cameras),
        fixed_views=not fold.new_pose,
        frame_is_known=True,
    )
    known, at_known = (whole, solution.state) if fold.new_pose else (problem, state)
    moved = initial_state(test, cameras, _poses(data, known, at_known))
    # First with the noise that is there: where all seems a gross error nothing would move.
    moved, *_ = minimise(test, moved, settings, None)
    _, at, *_ = minimise(test, moved, settings, scales)
    squares = np.square(at.residuals).sum(axis=1) / scales[test.camera] ** 2
    return float(np.minimum(squares, settings.outlier_sigma**2).mean() / 2.0)


def _poses(data: CalibrationInput, problem: Problem, state: State) -> list[RigidTransform]:
    """Poses of the views of `data`, which are among those of `problem`."""
    names = [view.name for view in problem.data.views]
    numbers = [names.index(view.name) for view in data.views]
    return [RigidTransform(state.view_rotations[v], state.view_shifts[v]) for v in numbers]


def _carried(problem: Problem, whole: Problem, state: State) -> State:
    """Working point of a part of a problem, from that of the whole."""
    start = initial_state(problem, cameras_of(whole, state), _poses(problem.data, whole, state))
    return replace(start, deviations=state.deviations[np.searchsorted(whole.marks, problem.marks)])
