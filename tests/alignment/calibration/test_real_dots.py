"""Photographs of dots by a stereo endoscope: the published cameras are found again from the published places.

They are the minimum with one focal length for both axes, a free centre and k1 alone, from the one view of
one plane, every line counted (the images hold every second one). One slanted plane tells no more: aspect and
k2 as further unknowns take the focal length some percent away at hardly smaller residuals, as their
uncertainties say.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from alignment.calibration.adjustment import AdjustmentSettings, adjust
from alignment.calibration.observations import CalibrationInput, PlateView
from alignment.calibration.planar import calibrate_planar
from alignment.geometry.cameras import CameraModel
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import MarkObservations, Plate

SIZE = (1920, 1080)
PUBLISHED = {
    "left": (1676.49, 902.469, 521.366, -0.218883),
    "right": (1660.21, 977.488, 529.236, -0.260808),
}


def dots(published_data: Path, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Points (70, 3) of the plane, millimetres, and pixels (70, 2)."""
    folder = published_data / "real_dots" / "coplanar"
    points = np.loadtxt(folder / "model.txt")[:, 1:]
    pixels = np.loadtxt(folder / f"1479224185706804480_{side}.txt")[:, 1:] * [1.0, 2.0]
    return points, pixels


@pytest.mark.parametrize("side", PUBLISHED)
def test_published_cameras_are_the_minimum_of_the_published_places(published_data: Path, side: str) -> None:
    points, pixels = dots(published_data, side)
    start = calibrate_planar([(points[:, :2], pixels)], SIZE)
    (pose,) = start.camera_from_plate

    def residuals(q: np.ndarray) -> np.ndarray:
        f, cx, cy, k1 = q[6:]
        model = CameraModel(*SIZE, f, f, cx, cy, "brown", (k1, 0.0, 0.0, 0.0, 0.0))
        moved = RigidTransform.from_rotvec(q[:3], q[3:6])
        return np.asarray((model.project(moved.apply(points)) - pixels).ravel())

    first = np.array([*pose.rotvec(), *pose.translation, start.model.fy, *np.array(SIZE) / 2.0, -0.2])
    found = least_squares(residuals, first, x_scale=np.maximum(np.abs(first), 0.1), xtol=1e-12, ftol=1e-12).x
    np.testing.assert_allclose(found[6:], PUBLISHED[side], rtol=1e-3)


def test_more_unknowns_than_one_plane_tells_are_reported_as_uncertain(published_data: Path) -> None:
    points, pixels = dots(published_data, "left")
    exact = np.full((len(points), 3), 1e-6)
    plate = Plate(
        np.rint(points[:, :2] / 4.0).astype(int), points, exact, 1.0, np.zeros(len(points), bool), 0.0
    )
    covariance = np.tile(np.eye(2), (len(points), 1, 1))
    seen = MarkObservations(np.arange(len(points)), pixels, covariance)
    key = ("head", "left")
    found = adjust(
        CalibrationInput(plate, (PlateView("one", None, {key: seen}),), {key: SIZE}),
        AdjustmentSettings("radial"),
    )
    focal = found.cameras[key].model.fx
    sigma = float(np.sqrt(found.covariance[6, 6]))
    assert sigma > 0.01 * focal
    assert abs(focal - PUBLISHED["left"][0]) < 3.0 * sigma
    assert found.rms_px < 1.0
