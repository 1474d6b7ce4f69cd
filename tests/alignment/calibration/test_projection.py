import cv2
import numpy as np
import pytest

from alignment.calibration.contour import contour_shift
from alignment.calibration.projection import INTRINSICS, project_with_derivatives
from alignment.geometry.cameras import CameraModel

CAMERAS = {
    "division": CameraModel(752, 582, 1770.0, 1830.0, 370.0, 295.0, "division", (-0.15,), 0.7),
    "brown5": CameraModel(1280, 1024, 1500.0, 1510.0, 600.0, 520.0, "brown", (-0.2, 0.05, 1e-3, -2e-3, 0.02)),
    "brown8": CameraModel(
        1280, 1024, 1500.0, 1510.0, 600.0, 520.0, "brown", (-0.2, 0.05, 1e-3, -2e-3, 0.02, 0.1, 0.03, -0.02)
    ),
    "tilted": CameraModel(
        1280,
        1024,
        1500.0,
        1510.0,
        600.0,
        520.0,
        "brown",
        (-0.2, 0.05, 1e-3, -2e-3, 0.02, 0.1, 0.03, -0.02, 1e-3, 2e-3, -1e-3, 3e-3, 0.03, -0.05),
        0.4,
    ),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_derivatives_are_those_of_the_camera_model(name: str) -> None:
    model = CAMERAS[name]
    rng = np.random.default_rng(3)
    by_point, by_intrinsics = np.zeros((2, 3)), np.zeros((2, INTRINSICS))
    for x, y in rng.uniform(-0.35, 0.35, (20, 2)):
        point = 400.0 * np.array([x, y, 1.0])
        u, v, ok = project_with_derivatives(*point, model.packed(), by_point, by_intrinsics)
        assert ok
        np.testing.assert_allclose([u, v], model.project(point[None])[0], atol=1e-9)
        for k, axis in enumerate(1e-3 * np.eye(3)):
            ahead, behind = model.project(point[None] + axis)[0], model.project(point[None] - axis)[0]
            np.testing.assert_allclose(by_point[:, k], (ahead - behind) / 2e-3, rtol=1e-5, atol=1e-6)
        parameters = model.parameters
        for k, value in enumerate(parameters):
            step = 1e-6 * max(1.0, abs(value))
            moved = [parameters.copy(), parameters.copy()]
            moved[0][k] += step
            moved[1][k] -= step
            ahead, behind = (model.with_parameters(p).project(point[None])[0] for p in moved)
            np.testing.assert_allclose(
                by_intrinsics[:, k], (ahead - behind) / (2 * step), rtol=1e-4, atol=1e-4
            )


def test_points_no_camera_sees_are_told() -> None:
    by_point, by_intrinsics = np.zeros((2, 3)), np.zeros((2, INTRINSICS))
    barrel = CameraModel(640, 480, 600.0, 600.0, 320.0, 240.0, "brown", (-0.3, 0.0, 0.0, 0.0, 0.0))
    division = CAMERAS["division"]
    for model, point in (
        (barrel, (0.0, 0.0, -5.0)),
        (division, (0.0, 0.0, 0.0)),
        (barrel, (1500.0, 0.0, 1000.0)),
    ):
        assert not project_with_derivatives(*point, model.packed(), by_point, by_intrinsics)[2]


@pytest.mark.parametrize("name", ["division", "tilted"])
def test_shift_of_a_contours_centre_is_that_of_a_fitted_ellipse(name: str) -> None:
    model = CAMERAS[name]
    tilt = cv2.Rodrigues(np.array([0.5, -0.3, 0.1]))[0]
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    for centre in ((0.0, 0.0, 400.0), (70.0, -50.0, 380.0)):
        contour = np.array(centre) + 4.0 * (
            np.cos(angles)[:, None] * tilt[:, 0] + np.sin(angles)[:, None] * tilt[:, 1]
        )
        pixels = model.project(contour)
        # The conic through the contour, by least squares about its own mean.
        origin = pixels.mean(axis=0)
        x, y = (pixels - origin).T
        a, b, c, d, e = np.linalg.lstsq(
            np.column_stack([x * x, x * y, y * y, x, y]), np.ones(len(x)), rcond=None
        )[0]
        ellipse = origin + np.linalg.solve([[2 * a, b], [b, 2 * c]], [-d, -e])
        du, dv, ok = contour_shift(
            np.array(centre), tilt[:, 0].copy(), tilt[:, 1].copy(), 4.0, model.packed()
        )
        assert ok
        shift = ellipse - model.project(np.array([centre]))[0]
        assert np.hypot(*shift) > 0.02
        np.testing.assert_allclose([du, dv], shift, atol=2e-4)
