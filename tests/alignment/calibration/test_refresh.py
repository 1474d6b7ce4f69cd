from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.common_light import CommonLight
from alignment.calibration.prediction import NominalWheel, wheel_points
from alignment.calibration.refresh import RefreshSettings, refresh
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.values import HeadCalibration, RigCalibration
from sensors.simulation.rigs import RIG_SPECS, build_rig

ARCMIN = np.pi / 10800.0
TILTS = (np.array([0.02, -0.01, 0.0]), np.array([-0.03, 0.02, 0.0]))


def rig() -> RigCalibration:
    return build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1))


def shot(calibration: RigCalibration, tilt: np.ndarray, noise_px: float, seed: int) -> CommonLight:
    """What true cameras see of a tilted wheel: crosses, and lines along the tyre and across it."""
    rng = np.random.default_rng(seed)
    wheel = NominalWheel()
    rig_from_wheel = RigidTransform.from_rotvec(tilt, np.array([1.0, -2.0, 3.0]))
    crosses, lines = [], []
    for number, head in enumerate(calibration.heads):
        flat = wheel_points(head, wheel)
        inner = np.hypot(flat[:, 0], flat[:, 1])
        flat = flat[(inner > wheel.inner_mm + 8.0) & (inner < wheel.outer_mm - 8.0)]
        points = rig_from_wheel.apply(flat)
        # Lines across the epipolar ones, seen as two near points.
        base = head.right.rig_from_camera.translation - head.left.rig_from_camera.translation
        across = np.cross(base, [0.0, 0.0, 1.0]) / np.linalg.norm(base)
        beside = flat + 0.1 * across
        beside[:, 2] = wheel.height(np.hypot(beside[:, 0], beside[:, 1]))
        left, right = head.left.project(points), head.right.project(points)
        tangent = head.right.project(rig_from_wheel.apply(beside)) - right
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        left, right = (pixels + noise_px * rng.standard_normal(pixels.shape) for pixels in (left, right))
        which = np.full(len(points), number)
        crosses.append((which[::4], left[::4], right[::4]))
        lines.append((which, left, right, tangent))
    columns = [np.concatenate(part) for table in (crosses, lines) for part in zip(*table, strict=True)]
    return CommonLight(*columns, rig_from_wheel.rotation[:, 2], rig_from_wheel.translation)


def knocked(calibration: RigCalibration, change: list[float], focal: float = 1.0) -> RigCalibration:
    """The same rig with its second head's left camera elsewhere."""
    first, second, third = calibration.heads
    model = replace(second.left.model, fx=second.left.model.fx * focal, fy=second.left.model.fy * focal)
    pose = second.left.rig_from_camera.perturbed(np.array(change[:3]), np.array(change[3:]))
    moved = HeadCalibration(second.name, PosedCamera(model, pose), second.right)
    return replace(calibration, heads=(first, moved, third))


def test_the_changed_camera_is_found_and_its_pose_with_it() -> None:
    true = rig()
    size = len(true.parameter_names)
    in_force = knocked(replace(true, covariance=1e-12 * np.eye(size)), [4e-4, -6e-4, 5e-4, 0.02, 0.0, 0.0])
    shots = [shot(true, tilt, 0.02, seed) for seed, tilt in enumerate(TILTS)]
    found = refresh(shots, in_force)
    assert found.camera is not None
    assert found.camera[0] == "head_2"
    assert found.hypotheses[0].misfit < 0.5
    before, after = found.epipolar_px["head_2"]
    assert before > 0.5
    assert after < 0.04
    assert found.epipolar_px["head_1"][0] == found.epipolar_px["head_1"][1]
    # Camber and toe come back to those of the true cameras within the stated uncertainty.
    again = refresh(shots, found.calibration)
    assert again.camera is None
    for camera in (("head_1", 0), ("head_3", 1)):
        heads = {head.name: head for head in found.calibration.heads}
        kept = {head.name: head for head in in_force.heads}
        assert heads[camera[0]].cameras[camera[1]] is kept[camera[0]].cameras[camera[1]]
    assert found.calibration.covariance is not None
    added = np.diag(found.calibration.covariance) - 1e-12
    assert np.count_nonzero(added > 1e-15) == 6
    assert 0.0 < found.toe_u < 0.5 * ARCMIN


def test_without_noise_the_change_itself_comes_out() -> None:
    true = rig()
    change = [3e-4, -4e-4, 5e-4, 0.0, 0.0, 0.0]
    found = refresh([shot(true, tilt, 1e-4, 0) for tilt in TILTS], knocked(true, change))
    assert found.camera == ("head_2", "left")
    assert found.certain
    np.testing.assert_allclose(found.turn, -np.array(change[:3]), atol=6e-5)


def test_nothing_changed_leaves_the_calibration_alone() -> None:
    true = rig()
    found = refresh([shot(true, tilt, 0.02, seed) for seed, tilt in enumerate(TILTS)], true)
    assert found.camera is None
    assert found.calibration is true
    assert found.camber_change == found.toe_change == 0.0
    assert len(found.hypotheses) == 6


def test_a_refocused_camera_is_found_when_focal_lengths_may_change() -> None:
    true = rig()
    in_force = knocked(true, [0.0] * 6, focal=1.002)
    shots = [shot(true, tilt, 1e-3, seed) for seed, tilt in enumerate(TILTS)]
    found = refresh(shots, in_force, RefreshSettings(focal=True))
    assert found.camera is not None
    assert found.camera[0] == "head_2"
    assert found.epipolar_px["head_2"][1] < 0.05


def test_without_a_shot_there_is_nothing_to_find() -> None:
    with pytest.raises(DegenerateInputError, match="at least one shot"):
        refresh([], rig())
