"""A camera from hand-held views of a plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from alignment.calibration.one_camera import Known
from alignment.calibration.planar import calibrate_planar, pose_of_plane
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import Array
from alignment.geometry.projective import fit_homography
from tests.alignment.calibration.cameras import ASPECT, SIZE, camera, plate_points

PLATE = plate_points(0.0)[:, :2]


def view(tilt: float, turn: float, centre: tuple[float, float] = (380.0, 284.0)) -> tuple[Array, Array]:
    return PLATE, camera(tilt, turn, centre=centre).project(plate_points(0.0))


def test_exact_views_give_the_true_camera_and_poses() -> None:
    poses = [(0.4, 0.0), (-0.5, 1.0), (0.3, 2.0)]
    found = calibrate_planar([view(*pose) for pose in poses], SIZE)
    assert found.rms_px < 1e-6
    np.testing.assert_allclose(found.model.matrix, camera(centre=(380.0, 284.0)).model.matrix, atol=1e-4)
    for pose, camera_from_plate in zip(poses, found.camera_from_plate, strict=True):
        true = camera(*pose).rig_from_camera.inverse()
        np.testing.assert_allclose(camera_from_plate.rotation, true.rotation, atol=1e-7)
        np.testing.assert_allclose(camera_from_plate.translation, true.translation, atol=1e-4)


def test_two_views_suffice() -> None:
    found = calibrate_planar([view(0.4, 0.0), view(-0.5, 1.0)], SIZE)
    np.testing.assert_allclose(found.model.matrix, camera(centre=(380.0, 284.0)).model.matrix, atol=1e-3)


def test_one_view_suffices_where_aspect_and_centre_are_known() -> None:
    found = calibrate_planar([view(0.4, 0.3, (375.5, 290.5))], SIZE, Known(aspect=ASPECT))
    np.testing.assert_allclose(found.model.matrix, camera().model.matrix, atol=1e-5)


def test_views_that_separate_nothing_are_refused_with_the_cure() -> None:
    with pytest.raises(DegenerateInputError, match="Tilt the plate"):
        calibrate_planar([view(0.4, 0.0), view(0.4, 0.0)], SIZE)
    flat = PLATE, PLATE * 2.0 + 300.0
    with pytest.raises(DegenerateInputError, match="Tilt the plate"):
        calibrate_planar([flat], SIZE)
    with pytest.raises(DegenerateInputError, match="at least one view"):
        calibrate_planar([], SIZE)


def test_homography_needs_points_off_one_line() -> None:
    line = np.column_stack([np.arange(6.0), np.zeros(6)])
    with pytest.raises(DegenerateInputError, match="line"):
        fit_homography(line, line)
    with pytest.raises(DegenerateInputError, match="four pairs"):
        fit_homography(PLATE[:3], PLATE[:3])


def test_pose_of_a_plane() -> None:
    true = camera(0.6, -1.0)
    found = pose_of_plane(true.model.matrix, -fit_homography(*view(0.6, -1.0, (375.5, 290.5))))
    np.testing.assert_allclose(found.translation, true.rig_from_camera.inverse().translation, atol=1e-6)


def test_published_views_of_a_planar_target(published_data: Path) -> None:
    """Zhang's five views; his own start values, before the adjustment, were within 5 % of his result."""
    folder = published_data / "zhang1998"
    plane = np.loadtxt(folder / "Model.txt").reshape(-1, 2)
    views = [(plane, np.loadtxt(folder / f"data{i}.txt").reshape(-1, 2)) for i in range(1, 6)]
    found = calibrate_planar(views, (640, 480))
    np.testing.assert_allclose(found.model.parameters[:2], [832.5, 832.53], rtol=0.05)
    np.testing.assert_allclose(found.model.parameters[2:4], [303.959, 206.585], atol=15.0)
    assert found.rms_px < 1.0
