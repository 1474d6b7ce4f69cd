"""Rigs are put into the vehicle by what they see of a certified plate, with an honest uncertainty."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from alignment.calibration.adjustment import adjust
from alignment.calibration.gauge import (
    CertifiedPlate,
    PlacedRig,
    PlacingLimits,
    judge_placing,
    place_rig,
    placing_in_doubt,
    predicted_u95,
    transfer_u95,
)
from alignment.calibration.observations import CalibrationInput, PlateView, cameras_of_rig
from alignment.calibration.prediction import NominalWheel, wheel_points
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.units import ARCMIN
from alignment.values import RigCalibration, nominal_vehicle_from_rig
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.covariance import measured_angles
from station.studies.simulated_views import STAGES, ViewErrors, observe, square_plate

PLACE = nominal_vehicle_from_rig("left").perturbed(
    np.array([4e-3, -6e-3, 3e-3]), np.array([1350.0, 800.0, 0.0])
)
CERTIFICATE = CertifiedPlate(
    nominal_vehicle_from_rig("left").perturbed(np.zeros(3), np.array([1352.0, 803.0, 4.0])),
    0.02,
    0.05 * ARCMIN,
)
EXACT = ViewErrors(pixel=0.0, mark_mm=0.0, flatness_mm=0.0, stage_mm=0.0)


@cache
def true_rig() -> RigCalibration:
    """A rig as it stands in the vehicle, its cameras hardly uncertain."""
    built = build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(3))
    exact = 1e-18 * np.eye(len(built.parameter_names))
    return replace(built, vehicle_from_rig=PLACE, covariance=exact)


def known_rig() -> RigCalibration:
    """The same as calibrated: the cameras, and the rig where it was planned."""
    return replace(true_rig(), vehicle_from_rig=nominal_vehicle_from_rig("left"))


def seen_plate(
    rng: np.random.Generator, errors: ViewErrors | None, plate: RigidTransform
) -> CalibrationInput:
    """What the true cameras see of the gauge plate that stands there in the vehicle."""
    pose = PLACE.inverse() @ plate
    return observe(cameras_of_rig(true_rig()), square_plate(), [pose], rng, errors, corrected=False).data


def placed(errors: ViewErrors | None = None) -> PlacedRig:
    data = seen_plate(np.random.default_rng(5), errors, CERTIFICATE.vehicle_from_plate)
    return place_rig(data, known_rig(), CERTIFICATE)


def error_of(found: PlacedRig, certified: RigidTransform | None = None) -> np.ndarray:
    pose = found.calibration.vehicle_from_rig
    if certified is not None:
        pose = certified @ found.rig_from_plate.inverse()
    return np.concatenate([(PLACE.inverse() @ pose).rotvec(), pose.translation - PLACE.translation])


def test_an_exact_view_gives_the_exact_pose() -> None:
    found = placed(EXACT)
    np.testing.assert_allclose(error_of(found), 0.0, atol=1e-7)
    assert found.calibration.vehicle_from_rig_measured
    assert found.outliers == 0.0
    assert found.camber_change == pytest.approx(4e-3, rel=0.02)
    assert found.toe_change == pytest.approx(6e-3, rel=0.02)
    assert judge_placing(found) is None


def test_what_a_changed_plate_pose_does_is_what_the_covariance_assumes() -> None:
    """The certificate's share: every pose of the plate in turn moved by its standard uncertainty."""
    found = placed(EXACT)
    certified = CERTIFICATE.vehicle_from_plate
    rig_from_plate = found.rig_from_plate
    total = np.zeros((6, 6))
    for k, size in enumerate([CERTIFICATE.angle_sigma] * 3 + [CERTIFICATE.position_sigma_mm] * 3):
        step = np.zeros(6)
        step[k] = size
        ahead, behind = (
            certified.perturbed(sign * step[:3], sign * step[3:]) @ rig_from_plate.inverse()
            for sign in (1.0, -1.0)
        )
        change = np.concatenate([(behind.inverse() @ ahead).rotvec(), ahead.translation - behind.translation])
        total += np.outer(change, change) / 4.0
    of_certificate = found.pose_covariance - found.transfer_covariance
    np.testing.assert_allclose(of_certificate, total, rtol=1e-3, atol=1e-15)


def ratio(errors: list[np.ndarray], covariances: list[np.ndarray]) -> float:
    """Root mean square of errors in units of their stated deviations, whatever their correlation."""
    squares = [e @ np.linalg.solve(c, e) / len(e) for e, c in zip(errors, covariances, strict=True)]
    return math.sqrt(float(np.mean(squares)))


def test_the_stated_covariance_of_a_pose_is_that_of_many_to_a_tenth() -> None:
    """Within 30 % as before, a covariance half as large again passed."""
    true = known_rig()
    errors, transfers, found = [], [], []
    for k in range(80):
        rng = np.random.default_rng([9, k])
        off = rng.normal(0.0, CERTIFICATE.angle_sigma, 3), rng.normal(0.0, CERTIFICATE.position_sigma_mm, 3)
        stands = CERTIFICATE.vehicle_from_plate.perturbed(*off)
        found.append(place_rig(seen_plate(rng, None, stands), true, CERTIFICATE))
        errors.append(error_of(found[-1]))
        transfers.append(error_of(found[-1], stands))
    # 480 errors know a deviation to 3 %.
    assert ratio(errors, [each.pose_covariance for each in found]) == pytest.approx(1.0, abs=0.1)
    assert ratio(transfers, [each.transfer_covariance for each in found]) == pytest.approx(1.0, abs=0.1)
    each_angle = np.sqrt(np.square([t[:2] for t in transfers]).mean(axis=0))
    assert transfer_u95(found[0]) == pytest.approx(2.0 * each_angle.max(), rel=0.2)
    assert transfer_u95(found[0]) < 0.07 * ARCMIN


@pytest.mark.parametrize("turns", [(1.0, 3.0), (3.0, 1.0)])
def test_the_less_certain_of_both_angles_is_what_seeing_the_plate_costs(turns: tuple[float, float]) -> None:
    """Of a plate that is seen well about one axis the other must count; a turn about z moves no angle."""
    found = placed()
    size = 0.01 * ARCMIN
    covariance = np.diag(np.square([turns[0] * size, turns[1] * size, 9.0 * size, 0.1, 0.1, 0.1]))
    changed = replace(found, transfer_covariance=covariance)
    assert transfer_u95(changed) == pytest.approx(0.06 * ARCMIN)
    assert judge_placing(changed) is None
    for scale, good in ((1.66, True), (1.67, False)):
        said = judge_placing(replace(found, transfer_covariance=scale**2 * covariance))
        assert (said is None) == good


def test_placed_rigs_predict_each_angle_by_itself() -> None:
    """A turn of the plate about the rig's x leans wheels, about its y it turns them."""
    found = placed()
    size = len(found.calibration.parameter_names)
    for turn, expected in ((-6, (0.04, 0.0)), (-5, (0.0, 0.04))):
        covariance = np.zeros((size, size))
        covariance[turn, turn] = (0.02 * ARCMIN) ** 2
        calibration = replace(found.calibration, covariance=covariance)
        u95 = predicted_u95(replace(found, calibration=calibration))
        assert u95 is not None
        assert np.array(u95) / ARCMIN == pytest.approx(expected, abs=1e-3)


def test_the_limits_of_a_placing_are_those_that_are_published() -> None:
    found = placed()
    key = ("head_2", "left")
    for changed, good in (
        (replace(found, marks=found.marks | {key: 20}), True),
        (replace(found, marks=found.marks | {key: 19}), False),
        (replace(found, turn_from_nominal=math.radians(9.99)), True),
        (replace(found, turn_from_nominal=math.radians(10.01)), False),
        (replace(found, outliers=0.0499), True),
        (replace(found, outliers=0.0501), False),
        (replace(found, noise_scale=found.noise_scale | {key: 5.99}), True),
        (replace(found, noise_scale=found.noise_scale | {key: 6.01}), False),
    ):
        assert (judge_placing(changed) is None) == good, judge_placing(changed)


def test_angles_of_calibrated_and_placed_rigs_are_inside_their_prediction() -> None:
    """The calibration's errors enter through the plate and through the wheel, and partly cancel."""
    true = true_rig()
    seen = [
        (head.left.project(points), head.right.project(points))
        for head, points in ((head, wheel_points(head, NominalWheel())) for head in true.heads)
    ]
    truth = measured_angles(true, seen)
    errors, predicted = [], []
    for k in range(14):
        rng = np.random.default_rng([11, k])
        views = observe(cameras_of_rig(true), square_plate(), STAGES[:5], rng).data
        known = adjust(views).rig_calibration("plate", true.rig, true.side, nominal_vehicle_from_rig("left"))
        stands = CERTIFICATE.vehicle_from_plate.perturbed(
            rng.normal(0.0, CERTIFICATE.angle_sigma, 3), rng.normal(0.0, CERTIFICATE.position_sigma_mm, 3)
        )
        found = place_rig(seen_plate(rng, None, stands), known, CERTIFICATE)
        errors.append(np.subtract(measured_angles(found.calibration, seen), truth))
        u95 = predicted_u95(found)
        assert u95 is not None
        predicted.append(np.array(u95) / 2.0)
    ratio = np.sqrt(np.square(errors).mean() / np.square(predicted).mean())
    assert 0.7 < ratio < 1.4, ratio
    assert np.sqrt(np.square(predicted).mean()) / ARCMIN < 0.08


def test_a_calibration_without_covariance_is_placed_without_prediction() -> None:
    data = seen_plate(np.random.default_rng(5), None, CERTIFICATE.vehicle_from_plate)
    found = place_rig(data, replace(known_rig(), covariance=None), CERTIFICATE)
    assert found.calibration.covariance is None
    assert predicted_u95(found) is None
    assert 0.0 < transfer_u95(found) < 0.1 * ARCMIN


def test_a_rig_is_placed_anew_from_its_placed_calibration() -> None:
    data = seen_plate(np.random.default_rng(5), None, CERTIFICATE.vehicle_from_plate)
    first = place_rig(data, known_rig(), CERTIFICATE)
    again = place_rig(data, first.calibration, CERTIFICATE)
    assert again.camber_change == again.toe_change == 0.0
    np.testing.assert_allclose(again.calibration.covariance, first.calibration.covariance, rtol=1e-9)


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_a_gauge_plate_of_another_pitch_is_named_and_not_a_camera(factor: float) -> None:
    data = seen_plate(np.random.default_rng(5), None, CERTIFICATE.vehicle_from_plate)
    wrong = replace(data, plate=replace(data.plate, points=factor * data.plate.points))
    reason = judge_placing(place_rig(wrong, known_rig(), CERTIFICATE))
    assert reason is not None
    assert f"a pitch of 15 mm would fit where {15.0 * factor:.4g} mm is stated" in reason
    assert judge_placing(place_rig(data, known_rig(), CERTIFICATE)) is None


def test_a_camera_that_was_knocked_is_named() -> None:
    known = known_rig()
    head = known.heads[1]
    pose = head.right.rig_from_camera.perturbed(np.array([1e-3, 0.0, 0.0]), np.zeros(3))
    heads = (known.heads[0], replace(head, right=PosedCamera(head.right.model, pose)), known.heads[2])
    data = seen_plate(np.random.default_rng(5), None, CERTIFICATE.vehicle_from_plate)
    said = judge_placing(place_rig(data, replace(known, heads=heads), CERTIFICATE))
    assert said is not None
    assert "head_2" in said


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        (PlacingLimits(marks=1000), "at least 1000"),
        (PlacingLimits(turn_from_nominal=math.radians(0.1)), "turned by 0.4°"),
        (PlacingLimits(outliers=-1.0), "do not fit"),
        (PlacingLimits(noise_scale=0.5), "times the noise"),
        (PlacingLimits(transfer_u95=0.001 * ARCMIN), "uncertain by"),
    ],
)
def test_each_limit_refuses_with_its_sentence(limits: PlacingLimits, expected: str) -> None:
    said = judge_placing(placed(), limits)
    assert said is not None
    assert expected in said


def test_views_that_are_no_gauge_view_are_refused() -> None:
    data = seen_plate(np.random.default_rng(5), None, CERTIFICATE.vehicle_from_plate)
    (view,) = data.views
    staged = replace(data, views=(replace(view, stage_mm=np.zeros(3)),))
    with pytest.raises(DegenerateInputError, match="stage position null"):
        place_rig(staged, known_rig(), CERTIFICATE)
    with pytest.raises(DegenerateInputError, match="one view"):
        place_rig(replace(data, views=(view, view)), known_rig(), CERTIFICATE)
    with pytest.raises(DegenerateInputError, match="marks of the gauge plate"):
        place_rig(replace(data, views=(PlateView("empty", None, {}),)), known_rig(), CERTIFICATE)
    with pytest.raises(DegenerateInputError, match="cameras of calibration"):
        place_rig(data, known_rig().without_head(0), CERTIFICATE)


def test_what_turns_every_later_wheel_needs_a_reason() -> None:
    """A rig askew by up to 10° was placed without a word, and so was one that had moved by degrees."""
    found = placed(EXACT)
    assert not found.was_measured
    ten = 10.0 * ARCMIN
    for changed, believed in (
        (replace(found, turn_from_nominal=math.radians(1.99)), True),
        (replace(found, turn_from_nominal=math.radians(2.01)), False),
        (replace(found, camber_change=1.1 * ten), True),
        (replace(found, was_measured=True, camber_change=-0.99 * ten, toe_change=0.99 * ten), True),
        (replace(found, was_measured=True, camber_change=-1.01 * ten), False),
        (replace(found, was_measured=True, toe_change=1.01 * ten), False),
    ):
        assert judge_placing(changed) is None
        assert (placing_in_doubt(changed) is None) == believed


def test_a_rig_placed_anew_is_compared_with_where_it_stood() -> None:
    data = seen_plate(np.random.default_rng(5), None, CERTIFICATE.vehicle_from_plate)
    first = place_rig(data, known_rig(), CERTIFICATE)
    leaning = CERTIFICATE.vehicle_from_plate.perturbed(np.array([math.radians(0.5), 0.0, 0.0]), np.zeros(3))
    again = place_rig(data, first.calibration, replace(CERTIFICATE, vehicle_from_plate=leaning))
    assert placing_in_doubt(first) is None
    said = placing_in_doubt(again)
    assert said is not None
    assert "against the pose that a gauge frame gave before" in said


def test_plates_of_the_other_side_are_named() -> None:
    found = placed(EXACT)
    other = nominal_vehicle_from_rig("right")
    calibration = replace(found.calibration, vehicle_from_rig=other)
    said = judge_placing(replace(found, calibration=calibration, turn_from_nominal=math.pi))
    assert said is not None
    assert "it would fit with left and right exchanged" in said
