"""Line points of both images that meet on the surface come back as its points, with what is told of them."""

import numpy as np
import pytest

from alignment.arrays import Array
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.crosses import Crosses
from alignment.imaging.lines import LightLines
from alignment.stereo.correspondence import GAIN, LEAN, RATIO, match_lines
from alignment.values import HeadCalibration

MODEL = CameraModel(1280, 1024, 3000.0, 3000.0, 640.0, 512.0, "brown", (-0.08, 0.01, 1e-4, -1e-4, 0.0))
FACING = np.diag([-1.0, 1.0, -1.0])
NO_CROSSES = Crosses(np.zeros((0, 2)), np.zeros((0, 2), np.int64), np.zeros((0, 2)))
DEPTHS, WIDTH, SIGMA = (-60.0, 60.0), 3.0, 0.02


def camera(x: float) -> PosedCamera:
    return PosedCamera(MODEL, RigidTransform(FACING, np.array([x, 260.0, 400.0])))


HEAD = HeadCalibration("head_1", camera(40.0), camera(-40.0))


def surface(places: Array) -> Array:
    """Upright lines of 200 points on a bulged surface, one at each x (L,): (L, 200, 3)."""
    x, y = np.meshgrid(places, np.linspace(235.0, 285.0, 200), indexing="ij")
    return np.stack([x, y, 8.0 - 0.004 * (y - 250.0) ** 2 + 0.05 * x], axis=-1)


def light_lines(seen_by: PosedCamera, lines: Array, strength: float) -> LightLines:
    pixels = np.array([seen_by.project(line) for line in lines])
    along = np.gradient(pixels, axis=1)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    count, each = pixels.shape[:2]
    return LightLines(
        points=pixels.reshape(-1, 2),
        tangents=along.reshape(-1, 2),
        sigma=np.full(count * each, SIGMA),
        strength=np.full(count * each, strength),
        starts=each * np.arange(count + 1),
        width=WIDTH,
        crosses=NO_CROSSES,
    )


def test_a_line_comes_back_as_the_points_of_the_surface_with_its_width_and_light_there() -> None:
    lines = surface(np.array([0.0]))
    found = match_lines(
        light_lines(HEAD.left, lines, 30.0), light_lines(HEAD.right, lines, 20.0), HEAD, DEPTHS
    )
    assert found.offered == 200
    assert len(found.points) >= 198  # its ends may have no partner on both sides
    true = lines[0][found.left_point]
    np.testing.assert_allclose(found.points, true, atol=2e-3)
    away = true - HEAD.left.rig_from_camera.translation
    np.testing.assert_allclose(found.rays, away / np.linalg.norm(away, axis=1, keepdims=True), atol=1e-5)
    depth = -away[:, 2]
    np.testing.assert_allclose(found.spread, (WIDTH * depth / MODEL.fx) ** 2, rtol=0.01)
    np.testing.assert_allclose(found.light[:, RATIO], 1.5)
    # Both images err by a fiftieth of a pixel, across the baseline of 80 mm.
    expected = depth**2 / 80.0 * np.sqrt(2.0) * SIGMA / MODEL.fx * np.linalg.norm(away, axis=1) / depth
    np.testing.assert_allclose(found.sigma, expected, rtol=0.03)
    # Light that changes across the line in one camera alone moves its top by variance times change, and the
    # point by that times depth over baseline.
    np.testing.assert_allclose(found.light[:, GAIN], found.spread * depth / 80.0, rtol=0.01)
    lean = np.gradient(HEAD.left.project(lines[0]), axis=0)
    np.testing.assert_allclose(found.light[:, LEAN], (lean[:, 0] / lean[:, 1])[found.left_point], atol=1e-3)


def test_neighbours_of_a_pattern_are_ghosts_beside_the_true_partner() -> None:
    lines = surface(np.linspace(-10.0, 10.0, 5))
    left, right = light_lines(HEAD.left, lines, 30.0), light_lines(HEAD.right, lines, 30.0)
    found = match_lines(left, right, HEAD, DEPTHS)
    near = np.linalg.norm(found.points - lines.reshape(-1, 3)[found.left_point], axis=1) < 5e-3
    assert len(np.unique(found.left_point[near])) >= 5 * 198
    assert 0.2 < near.mean() < 0.9
    assert (np.diff(found.left_point) >= 0).all()


@pytest.mark.parametrize("depths", [(20.0, 60.0), (-60.0, -20.0)])
def test_a_surface_out_of_depth_gives_nothing(depths: tuple[float, float]) -> None:
    lines = surface(np.array([0.0]))
    left, right = light_lines(HEAD.left, lines, 30.0), light_lines(HEAD.right, lines, 30.0)
    assert len(match_lines(left, right, HEAD, depths).points) == 0


def test_swapped_images_give_nothing() -> None:
    lines = surface(np.array([0.0]))
    left, right = light_lines(HEAD.left, lines, 30.0), light_lines(HEAD.right, lines, 30.0)
    assert len(match_lines(right, left, HEAD, DEPTHS).points) == 0


def test_an_ambiguous_pattern_is_thinned_by_whole_points_all_over_the_image() -> None:
    """Candidates beyond the table's end were dropped in line order: the last lines had no partner at all."""
    lines = surface(np.linspace(-20.0, 20.0, 41))
    left, right = light_lines(HEAD.left, lines, 30.0), light_lines(HEAD.right, lines, 30.0)
    found = match_lines(left, right, HEAD, DEPTHS)
    assert len(found.points) <= 4 * len(left.points) + 1024
    assert found.every > 1
    assert (found.left_point % found.every == 0).all()
    assert set(found.left_line) == set(range(41))
    assert found.offered == np.ceil(len(left.points) / found.every)
    # Of a point that stays, every candidate stays: the true one too, and the wheel can be told.
    near = np.linalg.norm(found.points - lines.reshape(-1, 3)[found.left_point], axis=1) < 5e-3
    assert len(np.unique(found.left_point[near])) >= 0.95 * found.offered
    per_line = np.bincount(found.left_line[near], minlength=41)
    assert per_line.min() >= 0.8 * per_line.max()
    assert (np.diff(found.left_point) >= 0).all()
