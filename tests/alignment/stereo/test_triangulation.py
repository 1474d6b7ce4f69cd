import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.stereo.rectification import Rectification
from alignment.stereo.triangulation import noise_covariance, triangulate

MODEL = CameraModel(1280, 1024, 3000, 3005, 640, 512, "brown", (-0.08, 0.01, 1e-4, -1e-4, 0.0))
FACING = np.diag([-1.0, 1.0, -1.0])


def camera(x: float, turn: float = 0.0) -> PosedCamera:
    pose = RigidTransform(FACING, np.array([x, 260.0, 400.0])).perturbed(
        np.array([0.0, turn, 0.01]), np.zeros(3)
    )
    return PosedCamera(MODEL, pose)


LEFT, RIGHT = camera(40.0, 0.02), camera(-40.0, -0.03)
POINTS = np.random.default_rng(0).uniform([-60, 220, -20], [60, 300, 20], (50, 3))


def test_exact_pixels_give_the_exact_point() -> None:
    points, gap = triangulate(LEFT, RIGHT, LEFT.project(POINTS), RIGHT.project(POINTS))
    np.testing.assert_allclose(points, POINTS, atol=1e-9)
    assert gap.max() < 1e-9


def test_covariance_predicts_the_scatter() -> None:
    rng, sigma = np.random.default_rng(1), 0.05
    point = POINTS[:1]
    many = np.repeat(point, 4000, axis=0)
    left = LEFT.project(many) + sigma * rng.standard_normal((4000, 2))
    right = RIGHT.project(many) + sigma * rng.standard_normal((4000, 2))
    points, _ = triangulate(LEFT, RIGHT, left, right)
    predicted = np.sqrt(np.diag(noise_covariance(LEFT, RIGHT, point, sigma)[0]))
    np.testing.assert_allclose(points.std(axis=0), predicted, rtol=0.06)


def test_a_rectified_pair_shares_rows_and_gives_depth_by_disparity() -> None:
    frame = Rectification.of(LEFT, RIGHT)
    left, _ = frame.coordinates(LEFT, LEFT.project(POINTS))
    right, _ = frame.coordinates(RIGHT, RIGHT.project(POINTS))
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-12)
    depth = frame.baseline / (left[:, 0] - right[:, 0])
    expected = (POINTS - frame.origin) @ frame.rectified_from_rig.T
    np.testing.assert_allclose(depth, expected[:, 2], atol=1e-8)


def test_two_cameras_in_one_place_are_refused() -> None:
    with pytest.raises(DegenerateInputError, match="side by side"):
        Rectification.of(LEFT, LEFT)


def test_parallel_rays_are_refused() -> None:
    pixel = np.array([[640.0, 512.0]])
    with pytest.raises(DegenerateInputError, match="meet"):
        triangulate(camera(40.0), camera(-40.0), pixel, pixel)
