import numpy as np
import pytest

from alignment.calibration.adjustment import adjust
from alignment.calibration.observations import cameras_of_rig
from alignment.calibration.two_steps import heads_then_poses, rigid_fit
from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from alignment.stereo.triangulation import triangulate
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.simulated_views import STAGES, ViewErrors, observe, square_plate

TRUE = cameras_of_rig(build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1)))


def test_exact_views_give_the_true_rig() -> None:
    views = observe(TRUE, square_plate(), STAGES, np.random.default_rng(0), ViewErrors(1e-3, 0.0, 0.0, 0.0))
    found = heads_then_poses(views.data)
    assert found.rms_px < 2e-3
    for key, true in TRUE.items():
        np.testing.assert_allclose(
            found.cameras[key].rig_from_camera.translation, true.rig_from_camera.translation, atol=0.05
        )


def test_the_joint_adjustment_puts_the_heads_better_into_one_frame() -> None:
    errors = []
    for seed in range(4):
        data = observe(TRUE, square_plate(), STAGES, np.random.default_rng(seed)).data
        errors.append(
            [plane_error(found) for found in (heads_then_poses(data).cameras, adjust(data).cameras)]
        )
    apart, joint = np.sqrt(np.square(errors).mean(axis=0))
    assert joint < apart


def plane_error(cameras: dict) -> float:
    """RMS height over the plate's plane of points that the heads measure in it, mm, mean of each head."""
    heights = []
    for head, angle in (("head_1", 90.0), ("head_2", 210.0), ("head_3", 330.0)):
        middle = 266.0 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
        points = middle + np.array([[x, y, 0.0] for x in (-30, 0, 30) for y in (-30, 0, 30)])
        left, right = cameras[head, "left"], cameras[head, "right"]
        found, _ = triangulate(
            left, right, TRUE[head, "left"].project(points), TRUE[head, "right"].project(points)
        )
        heights.append(found[:, 2].mean())
    return float(np.std(heights))


def test_hand_held_views_alone_are_refused() -> None:
    poses = [
        RigidTransform.from_rotvec(np.array([0.2 * k, 0.1, 0.0]), np.array([0.0, 266.0, 0.0]))
        for k in range(4)
    ]
    head = {key: camera for key, camera in TRUE.items() if key[0] == "head_1"}
    data = observe(head, square_plate(5, 12.0), poses, np.random.default_rng(0)).data
    with pytest.raises(DegenerateInputError, match="joint adjustment"):
        heads_then_poses(data)


def test_rigid_fit_finds_the_motion_between_two_sets_of_points() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    motion = RigidTransform.from_rotvec(np.array([0.3, -0.2, 1.0]), np.array([1.0, 2.0, 3.0]))
    found = rigid_fit(points, motion.apply(points))
    np.testing.assert_allclose(found.rotation, motion.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, motion.translation, atol=1e-12)
