"""Methods that calibrate one camera: the truth comes back, noise acts as it should, bad input is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from alignment.calibration.dlt import decompose, fit_projection
from alignment.calibration.faugeras import decompose_closed, fit_projection_unit_axis
from alignment.calibration.lenz import calibrate_lenz
from alignment.calibration.methods import ONE_CAMERA_METHODS
from alignment.calibration.one_camera import CalibratedCamera, Known
from alignment.calibration.tsai import calibrate_tsai
from alignment.calibration.tsai_radial import brown_from_kappa, calibrate_tsai_radial, kappa_of
from alignment.calibration.two_system import PARAMETERS, calibrate_two_system, equations
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import Array, CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from tests.alignment.calibration.cameras import ASPECT, SIZE, camera, plate_points

KNOWN = Known(aspect=ASPECT)
IN_SPACE = tuple(name for name in ONE_CAMERA_METHODS if name != "lenz")
HEIGHTS = (-30.0, 0.0, 30.0)


def points_for(method: str) -> Array:
    return plate_points(20.0) if method == "lenz" else plate_points(*HEIGHTS)


def assert_same_camera(found: PosedCamera, true: PosedCamera, tolerance: float = 1e-6) -> None:
    np.testing.assert_allclose(found.model.matrix, true.model.matrix, rtol=0, atol=tolerance * 1e3)
    np.testing.assert_allclose(
        found.rig_from_camera.rotation, true.rig_from_camera.rotation, rtol=0, atol=tolerance
    )
    np.testing.assert_allclose(
        found.rig_from_camera.translation, true.rig_from_camera.translation, rtol=0, atol=tolerance * 1e3
    )


@pytest.mark.parametrize("method", ONE_CAMERA_METHODS)
@settings(max_examples=15)
@given(
    tilt=st.floats(0.2, 0.7).flatmap(lambda a: st.sampled_from((a, -a))),
    turn=st.floats(-3.0, 3.0),
    distance=st.floats(300.0, 900.0),
)
def test_exact_points_give_the_true_camera(method: str, tilt: float, turn: float, distance: float) -> None:
    true, points = camera(tilt, turn, distance), points_for(method)
    found = ONE_CAMERA_METHODS[method](points, true.project(points), SIZE, KNOWN)
    assert found.rms_px < 1e-6
    assert_same_camera(found.camera, true, 1e-5)


@pytest.mark.parametrize("method", IN_SPACE)
def test_a_camera_that_looks_straight_at_the_plate(method: str) -> None:
    true, points = camera(0.0, 0.0), plate_points(*HEIGHTS)
    assert_same_camera(
        ONE_CAMERA_METHODS[method](points, true.project(points), SIZE, KNOWN).camera, true, 1e-5
    )


@pytest.mark.parametrize("method", IN_SPACE)
def test_frame_of_the_points_may_lie_anywhere(method: str) -> None:
    true, points = camera(), plate_points(*HEIGHTS)
    pixels = true.project(points)
    shift = np.array([2000.0, -500.0, 300.0])
    found = ONE_CAMERA_METHODS[method](points + shift, pixels, SIZE, KNOWN).camera
    np.testing.assert_allclose(
        found.rig_from_camera.translation - shift, true.rig_from_camera.translation, atol=1e-3
    )


@pytest.mark.parametrize("d", [-0.25, 0.0, 0.15])
def test_two_system_finds_distortion(d: float) -> None:
    true, points = camera(d=d, centre=(381.0, 283.0)), plate_points(*HEIGHTS)
    found = calibrate_two_system(points, true.project(points), SIZE)
    assert found.rms_px < 1e-8
    np.testing.assert_allclose(found.camera.model.parameters, true.model.parameters, rtol=0, atol=1e-6)


def test_two_system_derivatives_agree_with_finite_differences() -> None:
    rng = np.random.default_rng(7)
    points = plate_points(*HEIGHTS)
    values = np.array([2.8, 0.2, -0.4, 5.0, -8.0, 390.0, 1390.0, 1440.0, 380.0, 285.0, -0.2])
    pixels = camera().project(points) + rng.normal(size=(len(points), 2))
    jacobian = equations(values, points, pixels)[1]
    for k, name in enumerate(PARAMETERS):
        step = np.zeros(len(values))
        step[k] = 1e-6 * max(1.0, abs(values[k]))
        numeric = (
            equations(values + step, points, pixels)[0] - equations(values - step, points, pixels)[0]
        ) / (2 * step[k])
        scale = np.abs(jacobian[:, :, k]).max()
        assert np.abs(numeric - jacobian[:, :, k]).max() < 1e-7 * scale, name


def test_each_printed_system_alone_has_a_family_of_solutions() -> None:
    """Why the mean must be weighted: α against C_y in F_x, β against C_x in F_y, in exact data."""
    true, points = camera(d=-0.2), plate_points(*HEIGHTS)
    pose, m = true.rig_from_camera.inverse(), true.model
    angles = Rotation.from_matrix(pose.rotation).as_euler("xyz")
    values = np.array([*angles, *pose.translation, m.fx, m.fy, m.cx, m.cy, m.coefficients[0]])
    jacobian = equations(values, points, true.project(points))[1]
    for system, absent in ((0, "ty"), (1, "tx")):
        j = np.delete(jacobian[system], PARAMETERS.index(absent), axis=1)
        extents = np.linalg.svd(j / np.linalg.norm(j, axis=0), compute_uv=False)
        assert extents[-1] < 1e-9 * extents[0] < extents[-2]
    both = jacobian.reshape(-1, len(PARAMETERS))
    extents = np.linalg.svd(both / np.linalg.norm(both, axis=0), compute_uv=False)
    assert extents[-1] > 1e-6 * extents[0]


def test_two_system_error_is_near_that_of_the_best_estimate() -> None:
    """Projected points move by σ √(parameters / points) or little more."""
    rng = np.random.default_rng(3)
    true, points = camera(d=-0.2), plate_points(*HEIGHTS)
    exact, squares = true.project(points), []
    for _ in range(20):
        found = calibrate_two_system(points, exact + rng.normal(0, 0.05, exact.shape), SIZE)
        squares.append(np.square(found.camera.project(points) - exact).sum(axis=1).mean())
    assert np.sqrt(np.mean(squares)) < 1.3 * 0.05 * np.sqrt(len(PARAMETERS) / len(points))


@settings(max_examples=20)
@given(error=st.floats(0.98, 1.02))
def test_tsai_does_not_feel_the_scale_factor(error: float) -> None:
    rng = np.random.default_rng(11)
    true, points = camera(), plate_points(*HEIGHTS)
    pixels = true.project(points) + rng.normal(0, 0.5, (len(points), 2))
    right = calibrate_tsai(points, pixels, SIZE, KNOWN).camera
    wrong = calibrate_tsai(points, pixels, SIZE, Known(aspect=error * ASPECT)).camera
    assert_same_camera(wrong, right, 1e-8)


def test_lenz_reads_a_wrong_scale_factor_as_another_camera() -> None:
    true, points = camera(tilt=0.7), plate_points(0.0)
    found = calibrate_lenz(points, true.project(points), SIZE, Known(aspect=1.004 * ASPECT))
    place = found.camera.rig_from_camera.translation - true.rig_from_camera.translation
    assert 1.0 < np.linalg.norm(place) < 20.0


def test_linear_matrix_with_skew_is_taken_apart() -> None:
    model = CameraModel(640, 480, 800.0, 820.0, 310.0, 250.0, "division", (0.0,), skew=3.0)
    true, points = PosedCamera(model, camera().rig_from_camera), plate_points(*HEIGHTS)
    matrix = fit_projection(points, true.project(points))
    k, rotation, translation = decompose(matrix)
    np.testing.assert_allclose(k, model.matrix, atol=1e-6)
    np.testing.assert_allclose(matrix, k @ np.column_stack([rotation, translation]), atol=1e-6)


def test_faugeras_norm_does_not_depend_on_the_frame() -> None:
    rng = np.random.default_rng(5)
    true, points = camera(), plate_points(*HEIGHTS)
    pixels = true.project(points) + rng.normal(0, 1.0, (len(points), 2))
    here = fit_projection_unit_axis(points, pixels)
    there = fit_projection_unit_axis(points + np.array([900.0, 0.0, -300.0]), pixels)
    for a, b in zip(decompose_closed(here)[:2], decompose_closed(there)[:2], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_kappa_and_brown_translate_into_each_other() -> None:
    kappa = -0.3
    coefficients = brown_from_kappa(kappa, 0.4)
    model = CameraModel(800, 600, 1250.0, 1250.0, 399.5, 299.5, "brown", coefficients)
    distorted = np.column_stack([np.linspace(0.0, 0.4, 30), np.zeros(30)])
    rays = model.normalise(distorted * 1250.0 + (399.5, 299.5))
    np.testing.assert_allclose(rays[:, 0], distorted[:, 0] * (1 + kappa * distorted[:, 0] ** 2), atol=1e-5)
    assert kappa_of(model) == pytest.approx(kappa, rel=1e-3)
    with pytest.raises(DegenerateInputError, match="inverted"):
        brown_from_kappa(-2.5, 0.4)


@pytest.mark.parametrize("method", ONE_CAMERA_METHODS)
@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (lambda p, x: (p[:4], x[:4]), "at least"),
        (lambda p, x: (p, x[:-1]), "shapes"),
        (lambda p, x: (p, x * np.where(np.arange(len(x)) == 3, np.nan, 1.0)[:, None]), "finite"),
        (lambda p, x: (p * (1.0, 0.0, 0.0), x), "line|plane"),
    ],
)
def test_bad_points_are_named(method: str, bad, says: str) -> None:  # type: ignore[no-untyped-def]
    points = points_for(method)
    with pytest.raises(DegenerateInputError, match=says):
        ONE_CAMERA_METHODS[method](*bad(points, camera().project(points)), SIZE)


@pytest.mark.parametrize("method", ["dlt", "faugeras", "tsai", "two_system"])
def test_points_of_one_plane_are_refused_with_the_cure(method: str) -> None:
    points = plate_points(0.0)
    with pytest.raises(DegenerateInputError, match="other heights"):
        ONE_CAMERA_METHODS[method](points, camera().project(points), SIZE)


@pytest.mark.parametrize("method", ["dlt", "faugeras", "tsai", "two_system"])
def test_mirrored_images_are_refused(method: str) -> None:
    points = plate_points(*HEIGHTS)
    pixels = camera().project(points) * (-1.0, 1.0) + (SIZE[0] - 1, 0)
    with pytest.raises(DegenerateInputError, match="mirrored"):
        ONE_CAMERA_METHODS[method](points, pixels, SIZE, KNOWN)


def test_lenz_refuses_several_heights_and_a_parallel_plate() -> None:
    several = plate_points(*HEIGHTS)
    with pytest.raises(DegenerateInputError, match="one height"):
        calibrate_lenz(several, camera().project(several), SIZE, KNOWN)
    plate = plate_points(0.0)
    face_to_face = RigidTransform(np.diag([1.0, -1.0, -1.0]), np.array([5.0, 3.0, 400.0]))
    parallel = PosedCamera(camera().model, face_to_face)
    with pytest.raises(DegenerateInputError, match="parallel"):
        calibrate_lenz(plate, parallel.project(plate), SIZE, KNOWN)


# Willson's sets: 0.023 mm sensor elements.
PITCH_MM = 0.023


def willson(folder: Path, name: str) -> tuple[Array, Array, Array]:
    rows = np.loadtxt(folder / "tsai_willson" / f"{name}_cd.dat")
    return rows[:, :3], rows[:, 3:], np.loadtxt(folder / "tsai_willson" / f"{name}_cpcc.dat")


def test_published_non_coplanar_set(published_data: Path) -> None:
    points, pixels, published = willson(published_data, "ncc")
    found: CalibratedCamera = calibrate_tsai_radial(points, pixels, (576, 480))
    model, pose = found.camera.model, found.camera.rig_from_camera.inverse()
    f_mm = model.fy * PITCH_MM
    values = [model.cx, model.cy, model.fx / model.fy, f_mm, kappa_of(model) / f_mm**2, *pose.translation]
    np.testing.assert_allclose(values, published[6:14], rtol=0.005)
    # The published camera reprojects no better than the one found.
    assert found.rms_px < 0.0895


def test_published_coplanar_set_fixes_only_the_ratio_of_f_and_distance(published_data: Path) -> None:
    points, pixels, published = willson(published_data, "cc")
    found = calibrate_tsai_radial(points, pixels, (576, 480), Known(centre=(published[6], published[7])))
    ratio = found.camera.model.fy * PITCH_MM / found.camera.rig_from_camera.inverse().translation[2]
    assert ratio == pytest.approx(published[9] / published[13], rel=0.005)
