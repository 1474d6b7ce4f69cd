"""Joint adjustment of all cameras, views, stage positions and marks of a rig (bundle adjustment).

Unknowns are every camera's pose and lens, the plate's position in every view under the stage's uncertainty
(free for a plate held by hand), and every mark's deviation under the plate's uncertainty, shared by all
cameras and views. Gauss–Newton with Levenberg–Marquardt's damping on analytic derivatives; the marks are
eliminated from the normal equations (Schur complement; Triggs et al. 2000), gross errors lose their weight,
and each camera's noise is estimated from its own residuals and their redundancy (Förstner 1979).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from alignment.arrays import Array, Index
from alignment.calibration.dense import solve_symmetric
from alignment.calibration.equations import (
    Linearised,
    Reduced,
    leverages,
    linearise,
    normal_equations,
    prior_cost,
)
from alignment.calibration.observations import CalibrationInput, CameraKey
from alignment.calibration.problem import (
    MODELS,
    POSE,
    Priors,
    Problem,
    State,
    advanced,
    build_problem,
    cameras_of,
    initial_state,
)
from alignment.calibration.start import Start, start_values, with_model
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.values import HeadCalibration, RigCalibration, Side

_FULL_WEIGHT = 4.0  # standard deviations; e⁻⁸ of good observations lie beyond
# Squared length of a last step in standard deviations of the unknowns, while the noise is still being
# estimated and at the end.
_SETTLED, _CONVERGED = 0.1, 1e-5
_MEDIAN_OF_TWO = 1.3863  # median of χ² with two degrees of freedom
_SCALE_ROUNDS = 2
_LEAST_DAMPING = 1e-12
_STALLED = 1e-3  # relative gain of a step in a long valley, where more steps change nothing that matters


@dataclass(frozen=True)
class AdjustmentSettings:
    """Choices of the adjustment.

    Attributes
    ----------
    model
        Distortion model of every camera, a name of `MODELS`.
    priors
        What is known of the stage.
    outlier_sigma
        Standard deviations from which an observation carries no weight; full weight up to half of it.
    iterations
        Most steps.
    must_settle
        False takes what the last step reached, for comparisons, where the minimum itself is not needed.
    least_noise_scale
        Least noise of a camera over the stated one: stated noise that is fifty times too large is not
        believed. 1 believes it, where one view has too little redundancy to tell noise from errors of marks.
    """

    model: str = "brown5"
    priors: Priors = field(default_factory=Priors)
    outlier_sigma: float = 2.0 * _FULL_WEIGHT
    iterations: int = 30
    must_settle: bool = True
    least_noise_scale: float = 0.02

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise DegenerateInputError(
                field="model", expected=f"one of {', '.join(MODELS)}", seen=f"'{self.model}'"
            )


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Result of a joint adjustment.

    Attributes
    ----------
    data
        What it was computed from.
    model
        Name of the distortion model.
    cameras
        Every camera in the rig frame: the plate's frame at stage 0 (of the first view where all are held by
        hand).
    covariance
        (P, P) of all cameras together, ordered by `data.cameras`, each as `RigCalibration.covariance` says.
        Lens terms that the model holds at 0 have none. It covers mark finding, plate and stage; not what
        the model does not describe.
    camera, view, mark
        (N,) camera, view and row of the plate of each observation, by number.
    pixels
        (N, 2) as observed.
    residuals
        (N, 2) projected less observed, pixels.
    weights
        (N,) robust weight, 0 to 1.
    scaled
        (N,) length of each residual in its standard deviations, the camera's noise scale included.
    noise_scale
        Per camera, the found noise over the stated one.
    redundancy
        Per camera, observations left over, in equations.
    rig_from_plate
        Per view.
    stage_correction_mm
        (V, 3) found less nominal position; NaN for views held by hand.
    mark_correction_mm
        (M, 3) found less stated position of the plate's marks; 0 for marks that nobody saw.
    condition
        Ratio of the best to the worst determined combination of the unknowns, in units of their own spread.
    iterations
        Steps taken.
    """

    data: CalibrationInput
    model: str
    cameras: dict[CameraKey, PosedCamera]
    covariance: Array
    camera: Index
    view: Index
    mark: Index
    pixels: Array
    residuals: Array
    weights: Array
    scaled: Array
    noise_scale: dict[CameraKey, float]
    redundancy: dict[CameraKey, float]
    rig_from_plate: tuple[RigidTransform, ...]
    stage_correction_mm: Array
    mark_correction_mm: Array
    condition: float
    iterations: int

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals that carry weight, pixels."""
        return float(np.sqrt(self.weights @ np.square(self.residuals).sum(axis=1) / self.weights.sum()))

    def rig_calibration(
        self, identity: str, rig: str, side: Side, vehicle_from_rig: RigidTransform
    ) -> RigCalibration:
        """Return the value that the measurement uses; where the rig is in the vehicle is not measured here.

        Raises
        ------
        DegenerateInputError
            When a head lacks one of its cameras.
        """
        return as_rig_calibration(
            self.data, self.cameras, self.covariance, identity, rig, side, vehicle_from_rig
        )


def as_rig_calibration(
    data: CalibrationInput,
    cameras: dict[CameraKey, PosedCamera],
    covariance: Array | None,
    identity: str,
    rig: str,
    side: Side,
    vehicle_from_rig: RigidTransform,
) -> RigCalibration:
    """Gather the cameras of `data` to a `RigCalibration`; errors as `Adjustment.rig_calibration`."""
    expected = tuple((head, each) for head in data.heads for each in ("left", "right"))
    if tuple(data.cameras) != expected:
        raise DegenerateInputError(
            field="sizes",
            expected="left and right camera of every head, in order",
            seen=", ".join(" ".join(key) for key in data.cameras),
        )
    heads = tuple(HeadCalibration(name, cameras[name, "left"], cameras[name, "right"]) for name in data.heads)
    return RigCalibration(identity, rig, side, heads, vehicle_from_rig, covariance=covariance)


def adjust(
    data: CalibrationInput, settings: AdjustmentSettings | None = None, start: Start | None = None
) -> Adjustment:
    """Adjust all cameras of a rig, or one camera, jointly.

    Parameters
    ----------
    data
        Plate and observations.
    settings
        None for the defaults.
    start
        Start values; None finds them from the plate alone.

    Raises
    ------
    DegenerateInputError
        When the observations do not determine every camera; the message says which, and what to add.
    """
    settings = settings or AdjustmentSettings()
    start = with_model(start or start_values(data, settings.model), settings.model)
    problem = build_problem(data, start.cameras, settings.model, settings.priors)
    solution = solve(problem, initial_state(problem, start.cameras, list(start.rig_from_plate)), settings)
    return _result(problem, solution, settings.model)


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the iteration ended.

    Attributes
    ----------
    state, at, reduced
        Working point, residuals there, normal equations there.
    weights
        (N,) robust weights.
    scales
        (C,) noise of each camera over the stated one.
    redundancy
        (C,)
    covariance
        (size, size) of the unknowns but the marks.
    condition, iterations
        See `Adjustment`.
    """

    state: State
    at: Linearised
    reduced: Reduced
    weights: Array
    scales: Array
    redundancy: Array
    covariance: Array
    condition: float
    iterations: int


def solve(problem: Problem, state: State, settings: AdjustmentSettings) -> Solution:
    """Iterate from a working point to the minimum, then estimate each camera's noise and repeat.

    Raises
    ------
    DegenerateInputError
        When the unknowns are not determined, or the iteration does not end.
    """
    cameras = len(problem.data.cameras)
    state, at, weights, taken = minimise(problem, state, settings, None)
    scales = _median_scales(problem, at, settings)
    redundancy = np.zeros(cameras)
    for _ in range(_SCALE_ROUNDS):
        weights = robust_weights(problem, at, scales, settings.outlier_sigma)
        reduced = normal_equations(problem, state, at, weights / scales[problem.camera] ** 2)
        covariance = _covariance(reduced)
        taken_up = leverages(problem, at, weights / scales[problem.camera] ** 2, reduced, covariance)
        redundancy = np.bincount(problem.camera, 2.0 * weights - taken_up, cameras).astype(np.float64)
        squares = np.bincount(problem.camera, weights * np.square(at.residuals).sum(axis=1), cameras)
        scales = np.maximum(np.sqrt(squares / np.maximum(redundancy, 1.0)), settings.least_noise_scale)
        state, at, weights, more = minimise(problem, state, settings, scales)
        taken += more
    reduced = normal_equations(problem, state, at, weights / scales[problem.camera] ** 2)
    covariance = _covariance(reduced)
    deviations = np.sqrt(np.diag(covariance))
    values = np.linalg.eigvalsh(covariance / np.outer(deviations, deviations))
    condition = float(values[-1] / max(values[0], 1e-300))
    return Solution(state, at, reduced, weights, scales, redundancy, covariance, condition, taken)


def minimise(
    problem: Problem, state: State, settings: AdjustmentSettings, scales: Array | None
) -> tuple[State, Linearised, Array, int]:
    """Damped Gauss–Newton from a working point.

    Parameters
    ----------
    scales
        (C,) noise of each camera over the stated one; None lets it follow the camera's median residual.

    Returns
    -------
    state, at, weights, iterations
        The last working point, the residuals there, the robust weights (N,), the steps taken.

    Where unknowns are all but interchangeable (a tilted sensor behind a long lens) it may end in a valley
    without reaching its bottom; the condition tells.

    Raises
    ------
    DegenerateInputError
        When the unknowns are not determined, or the iteration does not end.
    """
    at = linearise(problem, state)
    if at is None:
        raise DegenerateInputError(
            field="views",
            expected="start values that see every mark",
            seen="a mark behind a camera or beyond its lens",
            cure="Check stage positions and marks, or add views at other heights.",
        )
    damping, lost, cost = 1e-6, np.inf, 0.0
    enough = _SETTLED if scales is None else _CONVERGED
    for taken in range(settings.iterations):
        here = _median_scales(problem, at, settings) if scales is None else scales
        robust = robust_weights(problem, at, here, settings.outlier_sigma)
        weight = robust / here[problem.camera] ** 2
        reduced = normal_equations(problem, state, at, weight)
        matrix, vector = reduced.schur()
        cost = _cost(problem, state, at, weight)
        while True:
            step = solve_symmetric(matrix + damping * np.diag(np.diag(matrix)), vector[None])[0]
            trial = advanced(problem, state, step, reduced.back_substitute(step))
            there = linearise(problem, trial)
            promised = float(step @ vector)
            lost = cost - _cost(problem, trial, there, weight) if there is not None else -np.inf
            if there is not None and lost >= -1e-9 * cost:
                break
            if promised < enough or damping > 1e8:
                return state, at, robust, taken
            damping *= 10.0
        state, at = trial, there
        if promised < enough:
            return state, at, robust, taken + 1
        # A step that kept three quarters of its promise may be bolder next time.
        if lost > 0.75 * promised:
            damping = max(damping / 10.0, _LEAST_DAMPING)
    if lost < _STALLED * cost or not settings.must_settle:
        return state, at, robust, settings.iterations
    raise DegenerateInputError(
        field="views",
        expected=f"an adjustment that ends within {settings.iterations} steps",
        seen="one that does not",
        cure="Check that stage positions, plate and images belong together, or choose a simpler lens model.",
    )


def _cost(problem: Problem, state: State, at: Linearised, weight: Array) -> float:
    return float(weight @ np.square(at.residuals).sum(axis=1)) + prior_cost(problem, state)


def _median_scales(problem: Problem, at: Linearised, settings: AdjustmentSettings) -> Array:
    squares = np.square(at.residuals).sum(axis=1)
    scales = np.ones(len(problem.data.cameras))
    for k in np.unique(problem.camera):
        scales[k] = np.sqrt(np.median(squares[problem.camera == k]) / _MEDIAN_OF_TWO)
    out: Array = np.maximum(scales, settings.least_noise_scale)
    return out


def robust_weights(problem: Problem, at: Linearised, scales: Array, cut: float) -> Array:
    """1 up to half of `cut` standard deviations, falling to 0 at `cut`."""
    squares = np.square(at.residuals).sum(axis=1) / scales[problem.camera] ** 2
    whole = (cut / 2.0) ** 2
    out: Array = np.clip((cut**2 - squares) / (cut**2 - whole), 0.0, 1.0) ** 2
    return out


def _covariance(reduced: Reduced) -> Array:
    matrix, _ = reduced.schur()
    return solve_symmetric(matrix, np.eye(len(matrix)))


def _result(problem: Problem, solution: Solution, model: str) -> Adjustment:
    state, data = solution.state, problem.data
    parameters = POSE + 4 + problem.lens.coefficients
    order = problem.camera_columns[:, :parameters].ravel()
    known = np.flatnonzero(order >= 0)
    covariance = np.zeros((len(order), len(order)))
    covariance[np.ix_(known, known)] = solution.covariance[np.ix_(order[known], order[known])]
    correction = np.zeros_like(data.plate.points)
    correction[problem.marks] = state.deviations
    residuals: Array = np.linalg.solve(problem.whitening, solution.at.residuals[..., None])[..., 0].astype(
        np.float64
    )
    scale = solution.scales[problem.camera]
    keys = data.cameras
    return Adjustment(
        data=data,
        model=model,
        cameras=cameras_of(problem, state),
        covariance=covariance,
        camera=problem.camera,
        view=problem.view,
        mark=problem.marks[problem.mark],
        pixels=problem.pixels,
        residuals=residuals,
        weights=solution.weights,
        scaled=np.linalg.norm(solution.at.residuals, axis=1) / scale,
        noise_scale={key: float(solution.scales[k]) for k, key in enumerate(keys)},
        redundancy={key: float(solution.redundancy[k]) for k, key in enumerate(keys)},
        rig_from_plate=tuple(
            RigidTransform(r, t) for r, t in zip(state.view_rotations, state.view_shifts, strict=True)
        ),
        stage_correction_mm=state.view_shifts - problem.stage,
        mark_correction_mm=correction,
        condition=solution.condition,
        iterations=solution.iterations,
    )
