from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from alignment.calibration.adjustment import Adjustment, AdjustmentSettings, adjust
from alignment.calibration.equations import linearise
from alignment.calibration.observations import CalibrationInput, CameraKey, PlateView, cameras_of_rig
from alignment.calibration.problem import MODELS, Priors, advanced, build_problem, initial_state
from alignment.calibration.start import start_values
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import MarkObservations, Plate
from alignment.values import RigCalibration, nominal_vehicle_from_rig
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.simulated_views import STAGES, SimulatedViews, ViewErrors, observe, square_plate

EXACT = ViewErrors(pixel=0.0, mark_mm=0.0, flatness_mm=0.0, stage_mm=0.0)
ONE: CameraKey = ("head_1", "left")


def rig(seed: int = 1, spec: str = "standard") -> dict[CameraKey, PosedCamera]:
    return cameras_of_rig(build_rig(RIG_SPECS[spec], "front_left", "left", np.random.default_rng(seed)))


def simulated(seed: int = 1, errors: ViewErrors | None = None, **options: bool) -> SimulatedViews:
    return observe(rig(seed), square_plate(), STAGES, np.random.default_rng(seed + 100), errors, **options)


def errors_of(found: PosedCamera, true: PosedCamera) -> np.ndarray:
    turn = (true.rig_from_camera.inverse() @ found.rig_from_camera).rotvec()
    shift = found.rig_from_camera.translation - true.rig_from_camera.translation
    return np.concatenate([turn, shift, found.model.parameters - true.model.parameters])


def test_exact_observations_give_the_true_cameras() -> None:
    result = adjust(simulated(errors=EXACT).data)
    for key, true in rig().items():
        error = errors_of(result.cameras[key], true)
        assert np.abs(error[:3]).max() < 1e-7
        assert np.abs(error[3:10]).max() < 1e-3
    assert result.rms_px < 1e-5


@pytest.mark.parametrize("model", MODELS)
def test_derivatives_by_all_unknowns_are_those_of_the_residuals(model: str) -> None:
    views = simulated()
    start = start_values(views.data, model)
    rng = np.random.default_rng(0)
    problem = build_problem(views.data, start.cameras, model, Priors(stage_axes=1e-3, view_tilt=1e-3))
    state = initial_state(problem, start.cameras, list(start.rig_from_plate))
    state = advanced(problem, state, 1e-3 * rng.standard_normal(problem.size), np.zeros(1))
    at = linearise(problem, state)
    assert at is not None
    weights = rng.standard_normal((len(problem.camera), 2))
    for column in range(0, problem.size - 3, 7):
        step = np.zeros(problem.size)
        step[column] = 1e-6
        ahead = linearise(problem, advanced(problem, state, step, np.zeros(1)))
        behind = linearise(problem, advanced(problem, state, -step, np.zeros(1)))
        assert ahead is not None
        assert behind is not None
        numeric = ((ahead.residuals - behind.residuals) * weights).sum() / 2e-6
        here, local = np.nonzero(problem.columns == column)
        analytic = (at.by_local[here, :, local] * weights[here]).sum()
        scale = np.abs(at.by_local[here, :, local]).sum()
        assert abs(numeric - analytic) < 1e-5 * scale


def test_random_errors_stay_inside_the_predicted_covariance() -> None:
    errors, result = [], None
    for seed in range(12):
        result = adjust(simulated(seed).data)
        truth = rig(seed)
        deviations = np.sqrt(np.diag(result.covariance)).reshape(6, -1)
        error = np.array([errors_of(result.cameras[key], true) for key, true in truth.items()])
        errors.append(error / deviations)
        assert all(abs(scale - 1.0) < 0.1 for scale in result.noise_scale.values())
    rms = np.sqrt(np.square(errors).mean(axis=(0, 1)))
    # Six cameras of a rig share the errors of one stage: twelve rigs know an RMS to about 20 %.
    assert (np.abs(rms - 1.0) < 0.5).all(), rms


def test_stage_and_marks_are_corrected_towards_the_truth() -> None:
    views = simulated(3)
    result = adjust(views.data)
    seen = np.unique(result.mark)
    error = (views.data.plate.points + result.mark_correction_mm - views.marks)[seen]
    before = (views.data.plate.points - views.marks)[seen]
    # A shift or turn of all marks together is the frame itself.
    spread = [np.std(e[:, :2] - e[:, :2].mean(axis=0)) for e in (error, before)]
    assert spread[0] < 0.4 * spread[1]


def test_gross_errors_lose_their_weight() -> None:
    views = simulated(2)
    rng = np.random.default_rng(9)
    spoilt = []
    for view in views.data.views:
        seen = dict(view.observations)
        for key, of in view.observations.items():
            pixels = of.pixels.copy()
            pixels[rng.choice(len(pixels), 3, replace=False)] += rng.uniform(0.5, 40.0, (3, 2))
            seen[key] = replace(of, pixels=pixels)
        spoilt.append(replace(view, observations=seen))
    clean = adjust(views.data)
    result = adjust(replace(views.data, views=tuple(spoilt)))
    assert (result.weights == 0).sum() >= 3 * 6 * 7 - 2
    moved = np.array([errors_of(result.cameras[k], clean.cameras[k]) for k in clean.cameras])
    assert (np.abs(moved).ravel() < 0.6 * np.sqrt(np.diag(clean.covariance))).all()


def test_centres_of_contours_are_understood() -> None:
    camera = rig()[ONE]
    poses = hand_held()
    shown = observe(
        {ONE: camera}, square_plate(6, 12.0), poses, np.random.default_rng(0), EXACT, corrected=False
    )
    result = adjust(shown.data)
    assert result.rms_px < 1e-3
    np.testing.assert_allclose(
        result.cameras[ONE].model.parameters[:4], camera.model.parameters[:4], atol=0.05
    )
    # Taken for the marks' centres the same pixels would not fit.
    wrong = [
        replace(view, observations={k: replace(o, corrected=True) for k, o in view.observations.items()})
        for view in shown.data.views
    ]
    assert adjust(replace(shown.data, views=tuple(wrong))).rms_px > 10 * result.rms_px


def hand_held() -> list[RigidTransform]:
    """Seven poses of a small plate under the first head, up to 35° aslant."""
    rng = np.random.default_rng(5)
    middle = np.array([0.0, 266.0, 0.0])
    return [
        RigidTransform.from_rotvec(
            np.array([*rng.uniform(-0.6, 0.6, 2), 0.3 * k]), middle + rng.uniform(-15, 15, 3)
        )
        for k in range(7)
    ]


def test_a_plate_held_by_hand_calibrates_a_head_in_the_frame_of_its_first_view() -> None:
    truth = {key: camera for key, camera in rig().items() if key[0] == "head_1"}
    poses = hand_held()
    views = observe(truth, square_plate(5, 12.0), poses, np.random.default_rng(1))
    result = adjust(views.data)
    assert np.isnan(result.stage_correction_mm).all()
    for key, true in truth.items():
        expected = poses[0].inverse() @ true.rig_from_camera
        found = result.cameras[key]
        assert np.abs(found.model.parameters[:4] - true.model.parameters[:4]).max() < 2.0
        assert np.abs(found.rig_from_camera.translation - expected.translation).max() < 0.3


def test_a_hand_held_view_joins_views_of_the_stage() -> None:
    truth = {key: camera for key, camera in rig().items() if key[0] == "head_1"}
    stages = [*STAGES[:3], *hand_held()[:2]]
    views = observe(truth, square_plate(), stages, np.random.default_rng(1))
    result = adjust(views.data)
    for v in (3, 4):
        np.testing.assert_allclose(
            result.rig_from_plate[v].translation, views.rig_from_plate[v].translation, atol=0.05
        )
    assert np.isnan(result.stage_correction_mm[3:]).all()
    assert np.abs(result.stage_correction_mm[:3]).max() < 0.03


def test_parallel_views_by_hand_are_refused_with_what_to_add() -> None:
    truth = {ONE: rig()[ONE]}
    poses = [RigidTransform(np.eye(3), np.array([0.0, 266.0, z])) for z in (-20.0, 0.0, 20.0)]
    views = observe(truth, square_plate(6), poses, np.random.default_rng(1))
    with pytest.raises(DegenerateInputError, match=r"head_1 left.*Tilt the plate"):
        adjust(views.data)


def test_one_height_of_the_stage_is_refused_with_what_to_add() -> None:
    views = observe(rig(), square_plate(), STAGES[:1], np.random.default_rng(1))
    with pytest.raises(DegenerateInputError, match="head_1 left"):
        adjust(views.data)


def test_a_camera_that_saw_nothing_is_named() -> None:
    data = simulated().data
    blind = [
        replace(v, observations={k: o for k, o in v.observations.items() if k != ("head_2", "right")})
        for v in data.views
    ]
    with pytest.raises(DegenerateInputError, match="head_2 right"):
        adjust(replace(data, views=tuple(blind)))


def test_lens_terms_that_a_model_leaves_out_have_no_uncertainty() -> None:
    result = adjust(simulated().data, AdjustmentSettings("radial"))
    calibration = as_rig(result)
    assert calibration.covariance is not None
    deviations = dict(zip(calibration.parameter_names, np.sqrt(np.diag(calibration.covariance)), strict=True))
    assert deviations["head_3.right.p1"] == 0.0
    assert deviations["head_3.right.k1"] > 0.0
    assert calibration.heads[2].right.model.coefficients[2:] == (0.0, 0.0, 0.0)


def as_rig(result: Adjustment) -> RigCalibration:
    return result.rig_calibration("id", "front_left", "left", nominal_vehicle_from_rig("left"))


def test_the_thesis_cameras_with_their_division_model_are_recovered() -> None:
    truth = rig(4, "ccir")
    views = observe(truth, square_plate(), STAGES, np.random.default_rng(4))
    result = adjust(views.data, AdjustmentSettings("division"))
    deviations = np.sqrt(np.diag(result.covariance)).reshape(6, -1)
    for k, (key, true) in enumerate(truth.items()):
        assert (np.abs(errors_of(result.cameras[key], true)) < 4.5 * deviations[k]).all()


def test_a_rotated_stage_is_found_out_where_the_prior_allows_it() -> None:
    turn = RigidTransform.from_rotvec(np.array([0.0, 0.0, 2e-3]), np.zeros(3)).rotation
    views = simulated(6)
    # The stage moved along its own axes; what the file says counts along the plate's.
    nominal = [replace(v, stage_mm=turn.T @ v.stage_mm) for v in views.data.views if v.stage_mm is not None]
    data = replace(views.data, views=tuple(nominal))
    free = AdjustmentSettings(priors=Priors(stage_axes=5e-3))
    stiff, found = adjust(data), adjust(data, free)
    assert np.abs(stiff.stage_correction_mm).max() < 0.04
    offsets = np.array([t.translation for t in found.rig_from_plate]) - [v.stage_mm @ turn.T for v in nominal]
    assert np.abs(offsets).max() < 0.025


def zhang(folder: Path) -> CalibrationInput:
    corners = np.loadtxt(folder / "Model.txt").reshape(-1, 2) * 25.4
    count = len(corners)
    plate = Plate(
        np.column_stack([np.arange(count), np.zeros(count)]).astype(np.int64),
        np.column_stack([corners, np.zeros(count)]),
        np.zeros((count, 3)),
        1.0,
        np.zeros(count, bool),
        0.0,
    )
    views = []
    for k in range(1, 6):
        pixels = np.loadtxt(folder / f"data{k}.txt").reshape(-1, 2)
        covariance = np.tile(0.01 * np.eye(2), (count, 1, 1))
        views.append(
            PlateView(f"data{k}", None, {ONE: MarkObservations(np.arange(count), pixels, covariance)})
        )
    return CalibrationInput(plate, tuple(views), {ONE: (640, 480)})


def test_published_planar_views_are_fitted_as_well_as_published(published_data: Path) -> None:
    data = zhang(published_data / "zhang1998")
    everything = AdjustmentSettings("brown5", outlier_sigma=1e9)
    assert adjust(data, everything).rms_px <= 0.3364
    # The published camera has two radial terms (and a skew of 0.01°).
    found = adjust(data, AdjustmentSettings("radial", outlier_sigma=1e9)).cameras[ONE].model.parameters[:6]
    np.testing.assert_allclose(found, [832.5, 832.53, 303.959, 206.585, -0.228601, 0.190353], rtol=5e-3)
