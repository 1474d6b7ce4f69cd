import cv2
import numpy as np
import pytest
from hypothesis import given, settings

from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel
from tests.strategies import cameras

PIXELS = np.array([[x, y] for x in np.linspace(0, 1279, 9) for y in np.linspace(0, 1023, 7)])


@given(cameras())
@settings(max_examples=200)
def test_unproject_then_project_returns_the_pixel(camera: CameraModel) -> None:
    again = camera.project(camera.unproject(PIXELS) * 400.0)
    np.testing.assert_allclose(again, PIXELS, atol=1e-9)


@given(cameras())
def test_project_then_unproject_returns_the_ray(camera: CameraModel) -> None:
    points = camera.unproject(PIXELS) * np.linspace(100, 900, len(PIXELS))[:, None]
    rays = camera.unproject(camera.project(points))
    np.testing.assert_allclose(rays, points / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-12)


@given(cameras())
def test_brown_models_agree_with_opencv(camera: CameraModel) -> None:
    if camera.model != "brown" or camera.skew:
        camera = CameraModel(1280, 1024, 3000, 3000, 640, 512, "brown", (-0.2, 0.1, 1e-3, -1e-3, 0.02))
    points = np.array([[20.0, -30.0, 400.0], [-60.0, 45.0, 380.0], [0.0, 0.0, 500.0]])
    zero = np.zeros(3)
    expected, _ = cv2.projectPoints(points, zero, zero, camera.matrix, np.array(camera.coefficients))
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)


def test_the_division_model_bends_as_its_equation_says() -> None:
    camera = CameraModel(752, 582, 1700.0, 1750.0, 376.0, 291.0, "division", (-0.1,))
    pixel = np.array([[600.0, 100.0]])
    x, y = (600.0 - 376.0) / 1700.0, (100.0 - 291.0) / 1750.0
    bend = 1.0 - 0.1 * (x * x + y * y)
    np.testing.assert_allclose(camera.normalise(pixel), [[x / bend, y / bend]], rtol=1e-15)


def test_a_point_behind_the_camera_is_refused() -> None:
    camera = CameraModel(1280, 1024, 3000, 3000, 640, 512)
    with pytest.raises(DegenerateInputError, match="behind"):
        camera.project(np.array([[0.0, 0.0, -1.0]]))


def test_a_pixel_beyond_the_fold_of_the_lens_is_refused() -> None:
    camera = CameraModel(1280, 1024, 500, 500, 640, 512, "brown", (-0.5, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(DegenerateInputError, match="without a ray"):
        camera.unproject(np.array([[0.0, 0.0]]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "fisheye"}, "'division' or 'brown'"),
        ({"coefficients": (0.1, 0.2)}, "5 or 8 or 12 or 14"),
        ({"fx": -3000.0}, "positive focal lengths"),
        ({"cx": float("nan")}, "finite"),
        ({"width": 0}, "positive size"),
    ],
)
def test_an_impossible_camera_is_refused(change: dict[str, object], message: str) -> None:
    values: dict[str, object] = {"width": 1280, "height": 1024, "fx": 3e3, "fy": 3e3, "cx": 640, "cy": 512}
    with pytest.raises(DegenerateInputError, match=message):
        CameraModel(**(values | change))  # type: ignore[arg-type]


def test_parameters_round_trip_by_name() -> None:
    camera = CameraModel(1280, 1024, 3000, 3010, 640, 512, "brown", tuple(np.arange(8) / 100))
    assert camera.parameter_names[-1] == "k6"
    assert camera.with_parameters(camera.parameters) == camera


def test_other_parameters_keep_size_lens_model_and_skew() -> None:
    camera = CameraModel(1280, 1024, 3000.0, 2990.0, 640.0, 512.0, "brown", (-0.1, 0.0, 0.0, 0.0, 0.0), 1.5)
    other = camera.with_parameters(camera.parameters + np.arange(9.0))
    assert (other.width, other.height, other.model, other.skew) == (1280, 1024, "brown", 1.5)
    assert other.parameters.tolist() == (camera.parameters + np.arange(9.0)).tolist()
    points = np.array([[30.0, -20.0, 400.0]])
    same = camera.with_parameters(camera.parameters)
    assert same.project(points).tolist() == camera.project(points).tolist()
