import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.check import check_with_plate
from alignment.calibration.observations import cameras_of_rig
from alignment.calibration.prediction import NominalWheel, wheel_points
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import MarkObservations
from alignment.units import ARCMIN
from alignment.values import HeadCalibration, RigCalibration
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.covariance import measured_angles
from station.studies.simulated_views import STAGES, ViewErrors, observe, square_plate
from tests.rendered import moved

EXACT = ViewErrors(0.001, 0.0, 0.0, 0.0)
RNG = np.random.default_rng


def moved_by(seen: MarkObservations, shift: tuple[float, float]) -> MarkObservations:
    return replace(seen, pixels=seen.pixels + np.array(shift))


def first_of(seen: MarkObservations, count: int) -> MarkObservations:
    return MarkObservations(seen.marks[:count], seen.pixels[:count], seen.covariance[:count], seen.corrected)


def rig() -> RigCalibration:
    return build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1))


def with_moved_camera(calibration: RigCalibration, turn: np.ndarray, move: np.ndarray) -> RigCalibration:
    first, *rest = calibration.heads
    right = PosedCamera(first.right.model, first.right.rig_from_camera.perturbed(turn, move))
    return replace(calibration, heads=(HeadCalibration(first.name, first.left, right), *rest))


@pytest.mark.parametrize("corrected", [True, False])
def test_a_true_calibration_is_found_unchanged_from_two_views(corrected: bool) -> None:
    calibration = rig()
    views = observe(
        cameras_of_rig(calibration), square_plate(), STAGES[:2], np.random.default_rng(3), corrected=corrected
    )
    found = check_with_plate(views.data, calibration)
    assert abs(found.camber_change) < 0.15 * ARCMIN
    assert abs(found.toe_change) < 0.15 * ARCMIN
    assert found.rms_px < 0.12  # the plate's errors
    assert len(found.cameras) == 6


def test_contours_of_large_marks_are_brought_back_to_their_centres() -> None:
    """Moved the wrong way, the calibration in force would differ from itself by twice the shift."""
    calibration = rig()
    plate = square_plate(half=8, pitch_mm=40.0, radius_mm=12.0)
    views = observe(
        cameras_of_rig(calibration), plate, STAGES[:2], np.random.default_rng(3), EXACT, corrected=False
    )
    assert check_with_plate(views.data, calibration).rms_px < 0.005
    taken_for_centres = [
        replace(v, observations={k: replace(o, corrected=True) for k, o in v.observations.items()})
        for v in views.data.views
    ]
    found = check_with_plate(replace(views.data, views=tuple(taken_for_centres)), calibration)
    assert found.rms_px > 0.05


def test_shifted_images_are_told_by_how_far_along_each_axis() -> None:
    calibration = rig()
    views = observe(
        cameras_of_rig(calibration), square_plate(half=8, pitch_mm=40.0), STAGES[:2], RNG(3), EXACT
    )
    key = "head_2", "left"
    shifted = [
        replace(
            v,
            observations={k: moved_by(o, (0.7, -0.3)) if k == key else o for k, o in v.observations.items()},
        )
        for v in views.data.views
    ]
    found = check_with_plate(replace(views.data, views=tuple(shifted)), calibration)
    for each in found.cameras:
        # Projected less observed.
        expected = (-0.7, 0.3) if each.camera == key else (0.0, 0.0)
        assert each.shift_px == pytest.approx(expected, abs=2e-3), each.camera
        assert each.rms_px == pytest.approx(math.hypot(*expected), abs=3e-3), each.camera
    marks = np.array([each.marks for each in found.cameras])
    of_all = math.sqrt(np.square([each.rms_px for each in found.cameras]) @ marks / marks.sum())
    assert found.rms_px == pytest.approx(of_all)


@pytest.mark.parametrize("factor", [0.9, 0.98, 1.005, 1.02])
@pytest.mark.parametrize("views", [1, 3])
def test_a_wrong_pitch_is_blamed_on_the_plate_and_not_on_the_rig(factor: float, views: int) -> None:
    """All cameras seemed to stand farther away, which changes no angle: the check was within tolerance."""
    calibration, plate = rig(), square_plate()
    data = observe(cameras_of_rig(calibration), plate, STAGES[:views], RNG(8)).data
    found = check_with_plate(replace(data, plate=replace(plate, points=factor * plate.points)), calibration)
    assert found.scale == pytest.approx(factor, abs=5e-4)
    assert found.scale_reason is not None
    assert "plate and calibration disagree in every camera by one common scale" in found.scale_reason
    assert f"a pitch of 15 mm would fit where {15.0 * factor:.4g} mm is stated" in found.scale_reason
    assert "check the plate's pitch_mm and certificate first" in found.scale_reason


def test_a_right_pitch_is_not_blamed_for_a_knock() -> None:
    calibration, plate = rig(), square_plate()
    for knock in (
        calibration,
        with_moved_camera(calibration, np.array([1e-3, 0.0, 0.0]), np.array([0.0, 0.0, 8.0])),
        moved(calibration, RigidTransform(np.eye(3), np.array([0.0, 0.0, 8.0])), 1),
        moved(calibration, RigidTransform(np.eye(3), np.array([3.0, -2.0, 8.0]))),
    ):
        data = observe(cameras_of_rig(knock), plate, STAGES[:2], RNG(8)).data
        assert check_with_plate(data, calibration).scale is None


@pytest.mark.parametrize("marks", [5, 6])
def test_a_camera_that_saw_hardly_any_marks_is_named(marks: int) -> None:
    """Six coordinates of its pose from fewer than six marks would fit anything."""
    calibration = rig()
    views = observe(
        cameras_of_rig(calibration), square_plate(half=8, pitch_mm=40.0), STAGES[:2], RNG(3), EXACT
    )
    few = []
    for view, number in zip(views.data.views, (marks - 3, 3), strict=True):
        seen = dict(view.observations)
        seen["head_3", "right"] = first_of(seen["head_3", "right"], number)
        few.append(replace(view, observations=seen))
    data = replace(views.data, views=tuple(few))
    if marks == 6:
        assert check_with_plate(data, calibration).cameras[-1].marks == 6
    else:
        with pytest.raises(DegenerateInputError, match=r"'head_3 right': expected at least 6 marks.*found 5"):
            check_with_plate(data, calibration)


def test_a_stage_position_that_is_wrong_by_far_stays_in_the_residuals() -> None:
    """Were each step held but not their sum, the views would creep to where the marks fit."""
    calibration = rig()
    errors = ViewErrors(0.02, 0.0, 0.0, 0.0)
    views = observe(
        cameras_of_rig(calibration), square_plate(half=11, pitch_mm=30.0), STAGES[:2], RNG(4), errors
    )
    good, bad = views.data.views
    assert bad.stage_mm is not None
    bad = replace(bad, stage_mm=bad.stage_mm + np.array([0.3, 0.0, 0.0]))
    # 300 standard deviations, and about as certain as the marks of a view are together.
    found = check_with_plate(replace(views.data, views=(good, bad), stage_sigma_mm=1e-3), calibration)
    held = check_with_plate(replace(views.data, views=(good, bad), stage_sigma_mm=3e-5), calibration)
    assert found.rms_left_px > 0.6 * held.rms_left_px > 0.2


def test_a_moved_camera_is_named_with_what_it_does_to_the_angles() -> None:
    calibration = rig()
    turn, move = np.array([2e-4, -3e-4, 1e-4]), np.array([0.05, 0.02, -0.03])
    views = observe(
        cameras_of_rig(with_moved_camera(calibration, turn, move)),
        square_plate(),
        STAGES[:3],
        np.random.default_rng(4),
        ViewErrors(0.001, 0.0, 0.0, 0.0),
    )
    found = check_with_plate(views.data, calibration)
    worst = max(found.cameras, key=lambda each: each.rms_px)
    assert worst.camera == ("head_1", "right")
    np.testing.assert_allclose(worst.turn, turn, atol=2e-5)
    np.testing.assert_allclose(worst.move_mm, move, atol=8e-3)
    assert worst.rms_px > 0.5
    assert worst.rms_left_px < 0.005
    assert max(abs(found.camber_change), abs(found.toe_change)) > 0.3 * ARCMIN
    others = [each for each in found.cameras if each is not worst]
    assert max(each.rms_px for each in others) < 0.01


@pytest.mark.parametrize("axis", [0, 1])
def test_each_angle_changes_by_what_a_wheel_is_measured_otherwise(axis: int) -> None:
    """All heads turned together, as a bent frame turns them: about x camber changes, about y toe."""
    calibration = rig()
    turn = RigidTransform.from_rotvec(3e-4 * np.eye(3)[axis], np.zeros(3))
    true = moved(calibration, turn)
    exact = ViewErrors(0.001, 0.0, 0.0, 0.0)
    views = observe(cameras_of_rig(true), square_plate(), STAGES[:3], np.random.default_rng(8), exact)
    found = check_with_plate(views.data, calibration)
    seen = [
        (head.left.project(points), head.right.project(points))
        for head, points in ((head, wheel_points(head, NominalWheel())) for head in true.heads)
    ]
    expected = np.subtract(measured_angles(true, seen), measured_angles(calibration, seen))
    assert abs(expected[axis]) == pytest.approx(3e-4, rel=0.02)
    assert (found.camber_change, found.toe_change) == pytest.approx(tuple(expected), abs=1e-5)


def test_views_held_by_hand_find_the_moved_camera_but_not_a_common_turn() -> None:
    calibration = rig()
    poses = [
        RigidTransform.from_rotvec(np.array(turn), np.array([3.0, -2.0, 4.0]))
        for turn in ((0.02, -0.01, 0.03), (-0.03, 0.02, -0.01))
    ]
    exact = ViewErrors(0.001, 0.0, 0.0, 0.0)
    moved = with_moved_camera(calibration, np.array([0.0, 3e-4, 0.0]), np.zeros(3))
    views = observe(cameras_of_rig(moved), square_plate(), poses, np.random.default_rng(5), exact)
    found = check_with_plate(views.data, calibration)
    assert found.rms_px > 0.1
    assert found.rms_left_px < 0.005
    assert max(found.cameras, key=lambda each: each.rms_px).camera[0] == "head_1"


def test_a_refocused_lens_stays_in_the_residuals() -> None:
    calibration = rig()
    first, *rest = calibration.heads
    lens = first.left.model.with_parameters(first.left.model.parameters * [1.003, 1.003, *[1.0] * 7])
    refocused = replace(
        calibration,
        heads=(
            HeadCalibration(first.name, PosedCamera(lens, first.left.rig_from_camera), first.right),
            *rest,
        ),
    )
    views = observe(
        cameras_of_rig(refocused),
        square_plate(),
        STAGES[:3],
        np.random.default_rng(6),
        ViewErrors(0.001, 0, 0, 0),
    )
    found = check_with_plate(views.data, calibration)
    assert max(found.cameras, key=lambda each: each.rms_left_px).camera == ("head_1", "left")


def test_a_session_of_another_rig_is_refused() -> None:
    calibration = rig()
    views = observe(cameras_of_rig(calibration), square_plate(), STAGES[:1], np.random.default_rng(7))
    other = replace(calibration, heads=calibration.heads[:2])
    with pytest.raises(DegenerateInputError, match="difference in head_3 left, head_3 right"):
        check_with_plate(views.data, other)
