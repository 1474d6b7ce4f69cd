"""Recalibration in use from crosses alone, computed without images."""

from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.crosses import CrossPairs, joined
from alignment.calibration.prediction import NominalWheel, wheel_points
from alignment.calibration.refreshing import Movement, Sightings, estimate, refresh_from
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.values import HeadCalibration, RigCalibration
from sensors.simulation.rigs import RIG_SPECS, build_rig

NOISE_PX = 0.02
HEIGHTS = (-30.0, -10.0, 10.0, 30.0)
CHANGE = [4e-4, 0.0, 6e-4, 0.0, 0.0, 0.0]


def rig() -> RigCalibration:
    """True cameras, with a covariance of a thousandth of what a knock does."""
    true = build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1))
    return replace(true, covariance=1e-14 * np.eye(len(true.parameter_names)))


def crosses(true: RigCalibration, seed: int = 0) -> Sightings:
    """What the true cameras see of wheels at several heights and tilts."""
    rng = np.random.default_rng(seed)
    pairs = []
    for head in true.heads:
        flat = wheel_points(head, NominalWheel())[::2]
        shots = []
        for height in HEIGHTS:
            wheel = RigidTransform.from_rotvec(0.02 * rng.standard_normal(3), np.array([0.0, 0.0, height]))
            points = wheel.apply(flat)
            left, right = (camera.project(points) for camera in head.cameras)
            noisy = (pixels + NOISE_PX * rng.standard_normal(pixels.shape) for pixels in (left, right))
            shots.append(CrossPairs(*noisy))
        pairs.append(joined(shots))
    return Sightings(tuple(pairs))


def knocked(calibration: RigCalibration, number: int, change: list[float]) -> RigCalibration:
    """The same rig with the left camera of a head elsewhere."""
    heads = list(calibration.heads)
    head = heads[number]
    pose = head.left.rig_from_camera.perturbed(np.array(change[:3]), np.array(change[3:]))
    heads[number] = HeadCalibration(head.name, PosedCamera(head.left.model, pose), head.right)
    return replace(calibration, heads=tuple(heads))


def test_rigs_as_calibrated_are_left_alone() -> None:
    true = rig()
    found = refresh_from(crosses(true), true)
    assert found.moved is None
    assert found.certain
    assert found.calibration is true
    assert not any(state.changed for state in found.heads)
    assert found.row_rms_px == pytest.approx(np.sqrt(2.0) * NOISE_PX, rel=0.2)


def test_the_head_of_a_knocked_camera_is_found_and_its_rows_agree_again() -> None:
    true = rig()
    in_force = knocked(true, 1, CHANGE)
    found = refresh_from(crosses(true), in_force)
    assert found.moved is not None
    assert found.moved.camera[0] == "head_2"
    assert [state.changed for state in found.heads] == [False, True, False]
    assert found.heads[1].row_rms_px > 0.5
    assert found.row_rms_px < 1.3 * np.sqrt(2.0) * NOISE_PX
    assert found.wheels == 0
    for number in (0, 2):
        assert found.calibration.heads[number] is in_force.heads[number]


def test_rows_alone_leave_open_which_camera_and_the_covariance_covers_both() -> None:
    true = rig()
    in_force = knocked(true, 1, CHANGE)
    seen = crosses(true)
    found = refresh_from(seen, in_force)
    assert found.moved is not None
    assert found.other is not None
    assert not found.certain
    assert {found.moved.camera, found.other.camera} == {("head_2", "left"), ("head_2", "right")}
    assert found.moved.share + found.other.share == pytest.approx(1.0)
    assert found.moved.share >= 0.5
    # Along the difference of the two the mixture is as wide as their shares make it.
    one, other = (estimate(seen, in_force, moved.camera) for moved in (found.moved, found.other))
    assert found.calibration.covariance is not None
    assert one.calibration.covariance is not None
    first = found.calibration.parameter_names.index("head_2.left.rx")
    left, right = (one, other) if found.moved.camera[1] == "left" else (other, one)
    share = found.other.share
    variance = found.calibration.covariance[first, first]
    assert variance >= share * left.step[0] ** 2
    assert np.abs(right.step[0]) > 1e-4
    assert np.linalg.eigvalsh(found.calibration.covariance).min() > -1e-12


def test_the_pose_of_a_named_camera_comes_back() -> None:
    true = rig()
    in_force = knocked(true, 1, CHANGE)
    found = estimate(crosses(true), in_force, ("head_2", "left"), Movement(shift_mm=1e-4))
    np.testing.assert_allclose(found.step[[0, 2]], [-CHANGE[0], -CHANGE[2]], atol=6e-5)
    covariance = found.calibration.covariance
    assert covariance is not None
    # The turn about the axis across the baseline moves points along the rows: it stays unknown.
    names = in_force.parameter_names
    sigma = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))
    assert sigma["head_2.left.rx"] < 1e-4 < sigma["head_2.left.ry"]


def test_a_rig_that_was_placed_in_the_vehicle_keeps_its_place_and_the_place_s_uncertainty() -> None:
    bare = replace(rig(), covariance=None)
    size = len(bare.parameter_names)
    covariance = np.diag([1e-14] * size + [4e-10] * 3 + [4e-4] * 3)
    in_force = knocked(replace(bare, vehicle_from_rig_measured=True, covariance=covariance), 1, CHANGE)
    found = refresh_from(crosses(bare), in_force)
    assert found.moved is not None
    assert found.moved.camera[0] == "head_2"
    after = found.calibration
    assert after.vehicle_from_rig_measured
    assert after.vehicle_from_rig is in_force.vehicle_from_rig
    assert after.covariance is not None
    np.testing.assert_allclose(after.covariance[size:, size:], covariance[size:, size:], rtol=1e-6)


def test_two_changed_heads_need_a_plate() -> None:
    true = rig()
    with pytest.raises(DegenerateInputError, match=r"head_1, head_3.*plate"):
        refresh_from(crosses(true), knocked(knocked(true, 0, CHANGE), 2, CHANGE))


def test_a_head_without_crosses_is_named() -> None:
    true = rig()
    seen = crosses(true)
    few = CrossPairs(seen.pairs[1].left[:9], seen.pairs[1].right[:9])
    with pytest.raises(DegenerateInputError, match=r"head_2.*found 9"):
        refresh_from(replace(seen, pairs=(seen.pairs[0], few, seen.pairs[2])), true)


def test_a_calibration_without_covariance_is_refused() -> None:
    true = rig()
    with pytest.raises(DegenerateInputError, match="covariance"):
        refresh_from(crosses(true), replace(true, covariance=None))


def test_a_camera_of_another_rig_is_refused() -> None:
    true = rig()
    with pytest.raises(DegenerateInputError, match="head_9"):
        estimate(crosses(true), true, ("head_9", "left"))
