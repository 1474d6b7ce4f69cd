"""The plate that an independent path tracer rendered, its true cameras given."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from alignment.geometry.cameras import PosedCamera
from alignment.imaging.mark_bias import camera_offsets, homography_offsets
from alignment.imaging.mark_plane import fit_grid_homography
from alignment.imaging.plate import Plate
from alignment.imaging.plate_grid import PlateRefusal, PlateRefusalCode, observe_plate
from tests import path_traced

OUTLINE = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)


class Session:
    """Plate, stage positions and images of the path-traced plate."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.plate_file = json.loads((folder / "plate" / "plate.json").read_text(encoding="utf-8"))
        self.calibration = path_traced.calibration(folder)
        self.groups = {
            name: np.array([(i, j), (i + 2, j), (i, j + 1)])
            for name, (i, j) in self.plate_file["corner_index"].items()
        }
        low, high = self.plate_file["index_range"]
        indices = np.array([(i, j) for j in range(low, high + 1) for i in range(low, high + 1)])
        rings = {tuple(index) for group in self.groups.values() for index in group.tolist()}
        count = len(indices)
        self.plate = Plate(
            indices=indices,
            points=np.column_stack([indices * self.plate_file["pitch_mm"], np.zeros(count)]),
            sigma_mm=np.full((count, 3), 0.006),
            mark_radius_mm=self.plate_file["mark_diameter_mm"] / 2,
            hollow=np.array([tuple(index) in rings for index in indices.tolist()]),
            hollow_radius_mm=self.plate_file["hollow_diameter_mm"] / 2,
        )

    def image(self, view: dict, head: str, side: str) -> np.ndarray:
        name = view["images"].replace("N_left|right", f"{head.removeprefix('head_')}_{side}")
        image = cv2.imread(str(self.folder / "plate" / name), cv2.IMREAD_UNCHANGED)
        assert image is not None
        return image


@pytest.fixture(scope="module")
def session(published_data: Path) -> Session:
    return Session(published_data / "path_traced")


def whole_in_image(camera: PosedCamera, points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the marks whose outline is in the image, and the projections of all that may be."""
    inside = camera.rig_from_camera.inverse().apply(points)
    near = np.flatnonzero((np.abs(inside[:, :2]) < 0.4 * inside[:, 2:]).all(axis=1))
    outline = radius * np.column_stack([np.cos(OUTLINE), np.sin(OUTLINE), np.zeros(len(OUTLINE))])
    pixels = camera.project((points[near, None] + outline).reshape(-1, 3)).reshape(len(near), -1, 2)
    limit = np.array([camera.model.width, camera.model.height]) - 0.5
    whole = ((pixels >= -0.5) & (pixels <= limit)).all(axis=(1, 2))
    projected = np.full((len(points), 2), np.nan)
    projected[near] = camera.project(points[near])
    return near[whole], projected


def test_every_whole_mark_is_found_none_invented_and_centres_agree(session: Session) -> None:
    residuals = []
    for view in session.plate_file["views"]:
        points = session.plate.points + np.array(view["stage_mm"])
        for head in session.calibration.heads:
            for side, camera in (("left", head.left), ("right", head.right)):
                image = session.image(view, head.name, side)
                result = observe_plate(image, session.plate, ring_group=session.groups[head.name])
                assert result, getattr(result, "reason", "")
                whole, projected = whole_in_image(camera, points, session.plate.mark_radius_mm)
                np.testing.assert_array_equal(result.marks, whole)
                residuals.append(result.pixels - projected[result.marks])
    error = np.concatenate(residuals)
    assert len(error) == 1679
    # What is left is the plate's own error: ±0.01 mm of the marks and of the stage are ±0.08 pixels each.
    assert np.sqrt((error**2).mean()) < 0.075
    assert np.abs(error.mean(axis=0)).max() < 0.01


def test_the_ring_marks_of_three_equal_groups_do_not_tell_the_place(session: Session) -> None:
    view = session.plate_file["views"][1]
    result = observe_plate(session.image(view, "head_2", "left"), session.plate)
    assert isinstance(result, PlateRefusal)
    assert result.code is PlateRefusalCode.AMBIGUOUS


def test_perspective_from_the_grid_agrees_with_the_true_cameras(session: Session) -> None:
    view = session.plate_file["views"][0]
    head = session.calibration.heads[1]
    image = session.image(view, head.name, "left")
    result = observe_plate(image, session.plate, ring_group=session.groups[head.name])
    assert result
    points = session.plate.points[result.marks]
    stage = np.array(view["stage_mm"])
    true = camera_offsets(head.left, points + stage, np.array([0.0, 0.0, 1.0]), session.plate.mark_radius_mm)
    homography = fit_grid_homography(points[:, :2], result.pixels)
    seen = homography_offsets(homography, points[:, :2], session.plate.mark_radius_mm)
    assert np.abs(true).max() > 0.005
    # Lens distortion bends the circles by a little that a plane's homography does not know.
    assert np.abs(seen - true).max() < 0.012


@pytest.mark.parametrize("wheel", path_traced.WHEELS)
def test_a_wheel_under_light_lines_is_no_plate(session: Session, wheel: str) -> None:
    for pair in path_traced.images(session.folder, wheel):
        for image in (pair.left, pair.right):
            assert isinstance(observe_plate(image, session.plate), PlateRefusal)
