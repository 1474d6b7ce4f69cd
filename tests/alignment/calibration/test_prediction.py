from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.adjustment import adjust
from alignment.calibration.observations import cameras_of_rig
from alignment.calibration.prediction import (
    NominalWheel,
    angle_covariance,
    angle_sensitivity,
    axis_covariance,
    axis_sensitivity,
    point_covariance,
    predict_angle_uncertainty,
    predicted_misfits,
    wheel_points,
)
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.stereo.triangulation import triangulate
from alignment.values import HeadCalibration, RigCalibration, Side
from alignment.vehicle.angles import camber_toe
from alignment.wheel.reference import wheel_reference
from alignment.wheel.revolution import fit_revolution
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.covariance import line_points, measured_angles, repeat_calibrations
from station.studies.simulated_views import STAGES, observe, square_plate


def rig(side: Side = "left") -> RigCalibration:
    return build_rig(RIG_SPECS["standard"], "front_left", side, np.random.default_rng(2))


def perturbed(calibration: RigCalibration, change: np.ndarray) -> RigCalibration:
    heads, first = [], 0
    for head in calibration.heads:
        cameras = []
        for camera in head.cameras:
            size = 6 + len(camera.model.parameters)
            step = change[first : first + size]
            first += size
            cameras.append(
                PosedCamera(
                    camera.model.with_parameters(camera.model.parameters + step[6:]),
                    camera.rig_from_camera.perturbed(step[:3], step[3:6]),
                )
            )
        heads.append(HeadCalibration(head.name, *cameras))
    return replace(calibration, heads=tuple(heads))


@pytest.mark.parametrize("side", ["left", "right"])
def test_sensitivity_is_what_a_wheel_fit_does_when_a_camera_changes(side: Side) -> None:
    calibration, wheel = rig(side), NominalWheel()
    sensitivity = angle_sensitivity(calibration, wheel)
    seen = [
        (head.left.project(points), head.right.project(points))
        for head, points in ((head, wheel_points(head, wheel)) for head in calibration.heads)
    ]
    before = np.array(measured_angles(calibration, seen))
    for name, step in (
        ("head_1.left.rx", 2e-5),
        ("head_1.right.ry", 2e-5),
        ("head_2.right.cz_mm", 0.02),
        ("head_3.left.fx", 0.2),
        ("head_2.left.k1", 1e-3),
    ):
        change = np.zeros(len(calibration.parameter_names))
        change[calibration.parameter_names.index(name)] = step
        moved = np.array(measured_angles(perturbed(calibration, change), seen)) - before
        np.testing.assert_allclose(
            moved, sensitivity @ change, rtol=0.1, atol=0.1 * np.abs(moved).max() + 1e-9
        )


@pytest.mark.parametrize("side", ["left", "right"])
def test_place_of_a_wheel_moves_as_predicted_when_a_camera_changes(side: Side) -> None:
    calibration, wheel = rig(side), NominalWheel()
    sensitivity = axis_sensitivity(calibration, wheel)
    seen = [
        (head.left.project(points), head.right.project(points))
        for head, points in ((head, wheel_points(head, wheel)) for head in calibration.heads)
    ]
    before = measured_place(calibration, seen)
    assert before == pytest.approx(np.zeros(3), abs=0.02)
    for name, step in (
        ("head_1.left.rx", 1e-5),
        ("head_1.right.ry", 1e-5),
        ("head_2.right.cz_mm", 0.01),
        ("head_3.left.fx", 0.1),
        ("head_2.left.cx_mm", 0.01),
    ):
        change = np.zeros(len(calibration.parameter_names))
        change[calibration.parameter_names.index(name)] = step
        moved = measured_place(perturbed(calibration, change), seen) - before
        np.testing.assert_allclose(
            moved, sensitivity[2:] @ change, rtol=0.1, atol=0.1 * np.abs(moved).max() + 1e-5
        )


def measured_place(calibration: RigCalibration, seen: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Reference point in the vehicle frame of the wheel whose points each head saw at these pixels."""
    points = np.concatenate(
        [line_points(head, *pixels) for head, pixels in zip(calibration.heads, seen, strict=True)]
    )
    down = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    # Few points: a profile as free as the predicted one, and none of them an outlier.
    fit = fit_revolution(
        points,
        np.full(len(points), 0.02),
        down,
        np.arange(len(points)),
        -down[0],
        np.zeros(3),
        knot_step=2.0,
        scale_floor=100.0,
    )
    found = wheel_reference(fit, points, calibration, None)
    assert found is not None
    return calibration.vehicle_from_rig.apply(found.point)


def test_place_of_the_rig_is_in_the_place_of_the_wheel() -> None:
    """The gauge frame's certificate is in it as it stands, with what it has in common with the angles."""
    calibration = with_measured_pose(rig())
    names = calibration.parameter_names
    covariance = np.zeros((len(names), len(names)))
    pose = np.diag([1e-5, 1e-5, 1e-5, 0.01, 0.02, 0.03])
    pose[1, 3] = 0.004
    covariance[-6:, -6:] = pose @ pose.T
    found = axis_covariance(replace(calibration, covariance=covariance))
    assert found[2:, 2:] == pytest.approx(covariance[-3:, -3:])
    assert found[:2, :2] == pytest.approx(angle_covariance(replace(calibration, covariance=covariance)))
    assert np.abs(found[1, 2]) > 0.3 * np.sqrt(found[1, 1] * found[2, 2])


def with_measured_pose(calibration: RigCalibration) -> RigCalibration:
    """A rig that leans in its vehicle, as a gauge has measured."""
    leaning = calibration.vehicle_from_rig.perturbed(np.array([0.01, -0.02, 0.03]), np.zeros(3))
    return replace(calibration, vehicle_from_rig=leaning, vehicle_from_rig_measured=True)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sensitivity_to_the_measured_pose_is_what_a_turn_of_the_rig_does_to_the_angles(
    side: Side, axis: int
) -> None:
    """Signs count: a variance alone would not show both turns the other way round."""
    calibration = with_measured_pose(rig(side))
    nominal = calibration.vehicle_from_rig
    step = 1e-5
    angles = []
    for sign in (1.0, -1.0):
        turned = nominal.perturbed(sign * step * np.eye(3)[axis], np.zeros(3))
        angles.append(camber_toe(turned.rotation[:, 2], side))
    expected = np.subtract(*angles) / (2.0 * step)
    at = calibration.parameter_names.index("vehicle_from_rig." + ("rx", "ry", "rz")[axis])
    found = angle_sensitivity(calibration)[:, at]
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert axis == 2 or np.linalg.norm(found) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_turn_of_all_cameras_that_the_measured_pose_takes_back_costs_nothing(side: Side) -> None:
    """A gauge measures the rig with these cameras, so that their errors are in its pose, turned round."""
    calibration = with_measured_pose(rig(side))
    names = calibration.parameter_names
    stated = []
    for back in (-1.0, 0.0, 1.0):
        covariance = np.zeros((len(names), len(names)))
        for axis in range(3):
            change = np.zeros(len(names))
            first = 0
            for camera in (camera for head in calibration.heads for camera in head.cameras):
                pose = camera.rig_from_camera
                change[first : first + 3] = pose.rotation.T @ np.eye(3)[axis]
                change[first + 3 : first + 6] = np.cross(np.eye(3)[axis], pose.translation)
                first += 6 + len(camera.model.parameters)
            change[-6 + axis] = back
            covariance += 1e-4**2 * np.outer(change, change)
        stated.append(predict_angle_uncertainty(replace(calibration, covariance=covariance)))
    taken_back, alone, added = np.array(stated)
    assert alone == pytest.approx([1e-4, 1e-4], rel=0.02)
    assert taken_back.max() < 1e-7
    assert added == pytest.approx(2.0 * alone, rel=1e-3)


def test_covariance_of_points_is_what_triangulation_does_when_a_camera_changes() -> None:
    calibration = rig()
    head = calibration.heads[0]
    points = np.array([[0.0, 266.0, 0.0], [30.0, 290.0, -20.0]])
    pixels = head.left.project(points), head.right.project(points)
    size = len(calibration.parameter_names)
    for row, step in ((1, 1e-5), (4, 1e-2), (6, 0.1), (10, 1e-3)):
        covariance = np.zeros((size, size))
        covariance[row, row] = step**2
        change = np.zeros(size)
        change[row] = step
        other = perturbed(calibration, change).heads[0]
        moved = triangulate(other.left, other.right, *pixels)[0] - points
        stated = np.sqrt(
            np.diagonal(
                point_covariance(replace(calibration, covariance=covariance), 0, points), axis1=1, axis2=2
            )
        )
        np.testing.assert_allclose(np.abs(moved), stated, rtol=0.02, atol=0.05 * stated.max())


def test_prediction_is_the_scatter_of_repeated_calibrations() -> None:
    repeats = repeat_calibrations(24, 3, lambda done, doing: None, views=4)
    # So many repeats know a standard deviation to 14 %; the study makes 200.
    assert (np.abs(repeats.angle_ratios - 1.0) < 0.3).all(), repeats.angle_ratios
    assert (np.abs(repeats.point_ratios - 1.0) < 0.3).all(), repeats.point_ratios
    assert abs(np.sqrt(np.square(repeats.point_ratios).mean()) - 1.0) < 0.1
    assert abs(np.sqrt(np.square(repeats.angle_ratios).mean()) - 1.0) < 0.1


def error_of(found: RigCalibration, true: RigCalibration) -> np.ndarray:
    """Errors of all camera parameters, as the covariance counts them."""
    parts = []
    for head, other in zip(found.heads, true.heads, strict=True):
        for camera, truth in zip(head.cameras, other.cameras, strict=True):
            pose, right = camera.rig_from_camera, truth.rig_from_camera
            parts.append((right.inverse() @ pose).rotvec())
            parts.append(pose.translation - right.translation)
            parts.append(camera.model.parameters - truth.model.parameters)
    return np.concatenate(parts)


def test_the_covariance_of_a_calibration_is_that_of_its_errors_to_a_tenth() -> None:
    """All ninety parameters count with their correlations: a covariance half as large again is seen."""
    true = rig()
    squares = []
    for k in range(8):
        views = observe(cameras_of_rig(true), square_plate(), STAGES[:4], np.random.default_rng([1, k]))
        found = adjust(views.data).rig_calibration("id", true.rig, true.side, true.vehicle_from_rig)
        assert found.covariance is not None
        deviation = np.sqrt(np.diag(found.covariance))
        error = error_of(found, true) / deviation
        correlation = found.covariance / np.outer(deviation, deviation)
        squares.append(error @ np.linalg.solve(correlation, error) / len(error))
    # 720 errors know a deviation to 3 %.
    assert np.sqrt(np.mean(squares)) == pytest.approx(1.0, abs=0.1)


def test_a_calibration_without_covariance_predicts_nothing() -> None:
    with pytest.raises(DegenerateInputError, match="joint adjustment"):
        predict_angle_uncertainty(rig())


def test_uncertainty_grows_with_the_covariance() -> None:
    calibration = rig()
    size = len(calibration.parameter_names)
    small = replace(calibration, covariance=1e-10 * np.eye(size))
    large = replace(calibration, covariance=4e-10 * np.eye(size))
    np.testing.assert_allclose(angle_covariance(large), 4.0 * angle_covariance(small))


def test_heads_that_do_not_see_the_wheel_are_named() -> None:
    with pytest.raises(DegenerateInputError, match="head_1"):
        angle_sensitivity(rig(), NominalWheel(inner_mm=20.0, outer_mm=60.0))


def test_predicted_misfit_is_what_a_turned_camera_leaves_and_grows_with_its_uncertainty() -> None:
    calibration = rig()
    covariance = np.zeros((len(calibration.parameter_names),) * 2)
    at = calibration.parameter_names.index("head_2.left.ry")
    covariance[at, at] = 1e-4**2
    misfits = predicted_misfits(replace(calibration, covariance=covariance))
    # A ten-thousandth of a radian moves a third of a pixel: 0.2 mm of height, most of which the axis follows.
    assert 0.001 < misfits.max() < 0.2
    twice = predicted_misfits(replace(calibration, covariance=4.0 * covariance))
    assert twice == pytest.approx(2.0 * misfits)


def test_an_error_that_lifts_all_heads_together_is_no_misfit() -> None:
    calibration = rig()
    lift = np.array([1.0 * name.endswith("cz_mm") for name in calibration.parameter_names])
    covariance = 0.1**2 * np.outer(lift, lift)
    assert predicted_misfits(replace(calibration, covariance=covariance)).max() < 1e-3
    with pytest.raises(DegenerateInputError, match="covariance"):
        predicted_misfits(calibration)
