from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.adjustment import AdjustmentSettings, adjust
from alignment.calibration.gate import (
    CalibrationProblem,
    GateJudgement,
    GateLimits,
    judge_calibration,
    judge_failure,
    judge_input,
)
from alignment.calibration.observations import CalibrationInput, CameraKey, PlateView, cameras_of_rig
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.imaging.plate import MarkObservations
from alignment.units import ARCMIN
from alignment.values import nominal_vehicle_from_rig
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.simulated_views import STAGES, observe, square_plate

SETTINGS = AdjustmentSettings()


def rig() -> dict[CameraKey, PosedCamera]:
    return cameras_of_rig(build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1)))


def seen(
    stages: tuple[tuple[float, float, float], ...] = STAGES,
    cameras: dict[CameraKey, PosedCamera] | None = None,
) -> CalibrationInput:
    return observe(cameras or rig(), square_plate(), stages, np.random.default_rng(8)).data


def judged(
    data: CalibrationInput, limits: GateLimits | None = None, settings: AdjustmentSettings = SETTINGS
) -> GateJudgement:
    before = judge_input(data, limits)
    if not before:
        return before
    try:
        adjustment = adjust(data, settings)
    except DegenerateInputError as error:
        return judge_failure(data, error, settings)
    calibration = adjustment.rig_calibration("id", "front_left", "left", nominal_vehicle_from_rig("left"))
    return judge_calibration(adjustment, calibration, limits)


def changed(
    data: CalibrationInput, number: int, change: Callable[[PlateView], PlateView]
) -> CalibrationInput:
    views = list(data.views)
    views[number] = change(views[number])
    return replace(data, views=tuple(views))


def at(*stage: float) -> Callable[[PlateView], PlateView]:
    return lambda view: replace(view, stage_mm=np.array(stage))


def swapped(*heads: str) -> Callable[[PlateView], PlateView]:
    def change(view: PlateView) -> PlateView:
        other = {"left": "right", "right": "left"}
        observations = {
            (head, other[side] if head in heads else side): found
            for (head, side), found in view.observations.items()
        }
        return replace(view, observations=observations)

    return change


def test_a_good_session_is_accepted_with_its_figures() -> None:
    answer = judged(seen())
    assert answer, answer.reason
    assert answer.camber_u95 is not None
    assert 0.0 < answer.camber_u95 < 0.05 * ARCMIN
    assert all(f.views == 7 and f.image_share > 0.6 and abs(f.structure) < 0.15 for f in answer.cameras)


def looking(blur_px: float | None, contrast: float | None) -> CalibrationInput:
    """A session whose fourth view one camera sees with this blur and contrast."""

    def change(view: PlateView) -> PlateView:
        key: CameraKey = ("head_2", "right")
        look = replace(view.observations[key], blur_px=blur_px, contrast=contrast)
        return replace(view, observations={**view.observations, key: look})

    return changed(seen(), 3, change)


@pytest.mark.parametrize(
    ("blur_px", "contrast", "problem", "warning"),
    [
        (None, None, None, None),
        (2.4, 41.0, None, None),
        (2.6, 41.0, None, "blurred over 2.6 px in view view_4"),
        (2.4, 39.0, None, "stand out by only 39 times the noise in view view_4"),
        (5.1, 41.0, CalibrationProblem.BLURRED, "blurred over 5.1 px in view view_4"),
        (2.4, 9.0, CalibrationProblem.DARK, "stand out by only 9 times the noise in view view_4"),
    ],
)
def test_a_blurred_or_dark_camera_is_named_and_refused_where_it_is_too_much(
    blur_px: float | None, contrast: float | None, problem: CalibrationProblem | None, warning: str | None
) -> None:
    """They were accepted without a word."""
    answer = judged(looking(blur_px, contrast))
    assert answer.problem is problem
    figures = next(f for f in answer.cameras if f.camera == ("head_2", "right"))
    assert (figures.blur_px, figures.contrast) == (blur_px, contrast)
    if warning is None:
        assert answer.warnings == ()
    else:
        assert len(answer.warnings) == 1
        assert answer.warnings[0].startswith("head_2 right: ")
        assert warning in answer.warnings[0]
    if problem is not None:
        assert answer.reason.startswith("head_2 right: ")


def test_a_view_without_marks_is_named() -> None:
    blind = changed(seen(), 2, lambda view: replace(view, observations={}))
    answer = judged(blind)
    assert answer.problem is CalibrationProblem.MISSING_VIEW
    assert "view_3" in answer.reason


def test_a_camera_that_missed_a_stage_view_is_named() -> None:
    def without(view: PlateView) -> PlateView:
        return replace(
            view, observations={k: v for k, v in view.observations.items() if k != ("head_2", "right")}
        )

    answer = judged(changed(seen(), 4, without))
    assert answer.problem is CalibrationProblem.MISSING_VIEW
    assert "view_5" in answer.reason
    assert "head_2 right" in answer.reason


def test_too_few_views_are_refused() -> None:
    answer = judged(seen(STAGES[:2]))
    assert answer.problem is CalibrationProblem.TOO_FEW_VIEWS
    assert "2 views" in answer.reason


def test_too_few_marks_are_refused() -> None:
    answer = judged(seen(), GateLimits(marks=2000))
    assert answer.problem is CalibrationProblem.TOO_FEW_MARKS
    assert "head_1 left" in answer.reason


def test_marks_in_a_part_of_the_image_are_refused() -> None:
    def half(view: PlateView) -> PlateView:
        kept = {}
        for key, found in view.observations.items():
            rows = found.pixels[:, 0] < 600 if key == ("head_3", "left") else np.full(len(found.marks), True)
            kept[key] = MarkObservations(found.marks[rows], found.pixels[rows], found.covariance[rows])
        return replace(view, observations=kept)

    data = seen()
    answer = judged(replace(data, views=tuple(half(view) for view in data.views)))
    assert answer.problem is CalibrationProblem.COVERAGE
    assert "head_3 left" in answer.reason


def test_views_at_nearly_one_height_are_refused() -> None:
    answer = judged(seen(((0, 0, -3.0), (5, 0, 0.0), (0, 5, 3.0))))
    assert answer.problem is CalibrationProblem.VIEWS_TOO_ALIKE
    assert "other heights" in answer.reason


def test_an_uncertain_calibration_is_refused_with_its_figures() -> None:
    answer = judged(seen(STAGES[:3]), GateLimits(angle_u95=0.01 * ARCMIN))
    assert answer.problem is CalibrationProblem.UNCERTAIN
    assert "add views" in answer.reason
    assert answer.toe_u95 is not None


def test_a_model_that_the_views_cannot_determine_is_refused() -> None:
    answer = judged(seen(), settings=AdjustmentSettings("tilted"))
    assert answer.problem is CalibrationProblem.ILL_CONDITIONED
    assert "simpler model" in answer.reason


def test_a_model_that_leaves_structured_residuals_is_refused() -> None:
    lens = CameraModel(1280, 1024, 3000.0, 3000.0, 640.0, 512.0, "brown", (-0.2, 1.5, 1e-3, 1e-3, 0.0))
    cameras = {key: replace(camera, model=lens) for key, camera in rig().items()}
    answer = judged(seen(cameras=cameras), settings=AdjustmentSettings("division"))
    assert answer.problem is CalibrationProblem.STRUCTURED
    assert "more terms than division" in answer.reason


def test_swapped_images_of_a_head_are_told() -> None:
    data = seen()
    both = replace(data, views=tuple(swapped("head_2")(view) for view in data.views))
    answer = judged(both)
    assert answer.problem is CalibrationProblem.SWAPPED_IMAGES
    assert "head_2" in answer.reason


def test_swapped_images_of_a_head_in_one_view_are_told() -> None:
    answer = judged(changed(seen(), 3, swapped("head_2")))
    assert answer.problem is CalibrationProblem.WRONG_INPUT
    assert "view_4" in answer.reason
    assert "head_2 are swapped" in answer.reason


@pytest.mark.parametrize(
    ("view", "stage", "axes"),
    [(1, (0.0, 0.0, 30.0), "in z"), (5, (-7.5, 4.0, 8.0), "in x"), (6, (5.0, 7.5, -22.0), "in x and y")],
)
def test_a_stage_position_with_the_wrong_sign_is_named(
    view: int, stage: tuple[float, ...], axes: str
) -> None:
    answer = judged(changed(seen(), view, at(*stage)))
    assert answer.problem is CalibrationProblem.WRONG_INPUT
    assert f"view_{view + 1}" in answer.reason
    assert f"wrong sign {axes}," in answer.reason


def test_a_wrong_sign_among_three_views_is_named() -> None:
    data = seen(((0, 0, -30.0), (0, 0, 0.0), (0, 0, 30.0)))
    answer = judged(changed(data, 0, at(0.0, 0.0, 30.0)))
    assert answer.problem is CalibrationProblem.WRONG_INPUT
    assert "view_1: its stage position (0.00, 0.00, 30.00) mm has the wrong sign in z" in answer.reason


def test_a_stage_that_counts_the_other_way_is_told() -> None:
    data = seen()
    turned = [
        replace(view, stage_mm=view.stage_mm * [1, 1, -1]) for view in data.views if view.stage_mm is not None
    ]
    answer = judged(replace(data, views=tuple(turned)))
    assert answer.problem is CalibrationProblem.WRONG_INPUT
    assert "all stage positions have the wrong sign in z" in answer.reason


def test_a_wrong_stage_position_is_told_with_the_right_one() -> None:
    answer = judged(changed(seen(), 4, at(0.0, 0.0, 25.0)))
    assert answer.problem is CalibrationProblem.WRONG_INPUT
    assert "view_5" in answer.reason
    assert "30.0" in answer.reason


def test_a_camera_that_moved_in_one_view_is_told() -> None:
    def moved(view: PlateView) -> PlateView:
        found = view.observations["head_1", "left"]
        shifted = replace(found, pixels=found.pixels + np.array([1.5, -0.8]))
        return replace(view, observations={**view.observations, ("head_1", "left"): shifted})

    answer = judged(changed(seen(), 2, moved))
    assert not answer
    assert "view_3" in answer.reason or "head_1 left" in answer.reason


def test_marks_that_do_not_fit_the_plate_are_refused() -> None:
    data = seen()
    rng = np.random.default_rng(0)

    def spoilt(view: PlateView) -> PlateView:
        found = view.observations["head_1", "right"]
        pixels = found.pixels + np.where(rng.random((len(found.marks), 1)) < 0.15, 3.0, 0.0)
        return replace(
            view, observations={**view.observations, ("head_1", "right"): replace(found, pixels=pixels)}
        )

    answer = judged(replace(data, views=tuple(spoilt(view) for view in data.views)))
    assert answer.problem is CalibrationProblem.NOISY
    assert "head_1 right" in answer.reason
