import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.ellipses import conic_centres
from alignment.imaging.mark_bias import camera_offsets, homography_offsets
from station.studies.rendered_marks import imaged_circle
from tests.alignment.imaging.plates import RADIUS, plate, project, view

LENS = (-0.12, 0.03, 4e-4, -3e-4, 0.0)


def camera(coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)) -> PosedCamera:
    model = CameraModel(1280, 1024, 1500.0, 1502.0, 640.0, 510.0, "brown", coefficients)
    pose = RigidTransform.from_rotvec(np.array([np.pi + 0.5, 0.1, 0.05]), np.array([60.0, -115.0, 330.0]))
    return PosedCamera(model, pose)


def plane_homography(posed: PosedCamera) -> np.ndarray:
    inverse = posed.rig_from_camera.inverse()
    columns = np.column_stack([inverse.rotation[:, 0], inverse.rotation[:, 1], inverse.translation])
    return np.asarray(posed.model.matrix @ columns)


@pytest.mark.parametrize("tilt", [0.0, 20.0, 45.0])
def test_the_offset_is_that_of_the_imaged_circle(tilt: float) -> None:
    homography, points = view(tilt=tilt, azimuth=70.0, turn=10.0), plate().points
    centres = np.array([imaged_circle(homography, point[:2], RADIUS)[0] for point in points])
    offsets = homography_offsets(homography, points[:, :2], RADIUS)
    np.testing.assert_allclose(centres + offsets, project(homography, points), atol=1e-8)
    assert (np.abs(offsets).max() > 0.03) == (tilt > 0.0)


def test_the_offset_grows_with_the_square_of_the_radius() -> None:
    homography, points = view(tilt=30.0), plate().points[:, :2]
    small, large = (homography_offsets(homography, points, r) for r in (0.5, 1.0))
    np.testing.assert_allclose(large, 4.0 * small, rtol=2e-3, atol=1e-6)


def test_without_distortion_the_camera_agrees_with_its_homography() -> None:
    posed, points = camera(), plate().points
    offsets = camera_offsets(posed, points, np.array([0.0, 0.0, 1.0]), RADIUS)
    expected = homography_offsets(plane_homography(posed), points[:, :2], RADIUS)
    np.testing.assert_allclose(offsets, expected, atol=1e-7)
    assert np.abs(offsets).max() > 0.02


def test_distortion_shifts_the_centres_too() -> None:
    posed, points = camera(LENS), plate().points
    offsets = camera_offsets(posed, points, np.array([0.0, 0.0, 1.0]), RADIUS)
    pinhole = camera_offsets(camera(), points, np.array([0.0, 0.0, 1.0]), RADIUS)
    assert 0.003 < np.abs(offsets - pinhole).max() < 0.1
    # The centre of area of the imaged disc is another measure of the same place.
    angle = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    for k in (0, 40, 98):
        x, y = posed.project(points[k] + RADIUS * ring).T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        area = cross.sum() / 2
        middle = np.array([((v + np.roll(v, -1)) * cross).sum() for v in (x, y)]) / (6 * area)
        expected = posed.project(points[k : k + 1])[0] - middle
        np.testing.assert_allclose(offsets[k], expected, atol=2e-4)


def test_conic_centres_are_exact_for_ellipses() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 7, endpoint=False)
    ellipse = np.column_stack([30.0 * np.cos(angle) + 400.0, 12.0 * np.sin(angle + 0.3) + 900.0])
    np.testing.assert_allclose(conic_centres(ellipse[None]), [[400.0, 900.0]], atol=1e-8)


def test_circles_at_infinity_are_refused() -> None:
    homography = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.01, 0.0, 1.0]])
    with pytest.raises(DegenerateInputError, match="infinity"):
        homography_offsets(homography, np.array([[-100.0, 0.0]]), 1.0)
