"""Gloss sends each camera another light, which moves their lines apart; the ratio tells by how much."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.imaging.lines import extract_light_lines
from alignment.wheel.gloss import gloss_shifts

AXES = np.array([[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]] * 3)
GAIN = 0.7  # mm²; three pixels wide, 400 mm away
Z = np.array([0.0, 0.0, 1.0])


def field(points: Array) -> tuple[Array, Array]:
    """Log ratio of the light on a sidewall, a lobe that leans over the angle, and its gradient (N, 2)."""
    x, y = points[:, 0], points[:, 1]
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    middle = np.radians(np.round(np.degrees(angle) / 120.0) * 120.0)
    turn = np.angle(np.exp(1j * (angle - middle)))
    lobe = 0.3 * np.exp(-0.5 * ((r - 260.0) / 12.0) ** 2)
    by_r, by_arc = -lobe * (r - 260.0) / 144.0 * (1.0 + turn), (lobe + 0.4) / r
    out = np.column_stack([by_r * x / r - by_arc * y / r, by_r * y / r + by_arc * x / r])
    return lobe * (1.0 + turn) + 0.4 * turn, out


def sidewall(rng: np.random.Generator, per_head: int = 4000) -> tuple[Array, NDArray[np.int64]]:
    head = np.repeat(np.arange(3), per_head)
    angle = np.radians(120.0 * head) + rng.uniform(-0.28, 0.28, len(head))
    radius = rng.uniform(205.0, 315.0, len(head))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(len(head))]), head


def light_of(ratio: Array, lean: float | Array) -> Array:
    return np.column_stack([np.exp(ratio), np.broadcast_to(lean, ratio.shape), np.full(len(ratio), GAIN)])


def assert_recovered(found: Array, expected: Array) -> None:
    """Nine tenths of the shift, for the rings' smoothing takes a little, and nothing that was not there."""
    assert 0.88 < (found @ expected) / (expected @ expected) < 1.03
    assert np.linalg.norm(found - expected) < 0.35 * np.linalg.norm(expected)


@given(st.integers(0, 2**31), st.floats(-0.9, 0.9))
@settings(max_examples=10)
def test_steep_lines_are_moved_by_the_change_along_the_rows(seed: int, lean: float) -> None:
    rng = np.random.default_rng(seed)
    points, head = sidewall(rng)
    ratio, gradient = field(points)
    found = gloss_shifts(
        points, head, light_of(ratio + rng.normal(0.0, 0.03, len(ratio)), lean), AXES, Z, np.zeros(3)
    )
    expected = GAIN * (1.0 + lean**2) * gradient[:, 0]
    inner = np.abs(np.hypot(points[:, 0], points[:, 1]) - 260.0) < 50.0
    assert_recovered(found[inner], expected[inner])
    for k in range(3):
        # What all points of a head share is what pulls the wheel.
        assert abs((found - expected)[inner & (head == k)].mean()) < 3e-4


def test_flat_lines_are_moved_by_the_change_along_the_columns() -> None:
    rng = np.random.default_rng(1)
    points, head = sidewall(rng)
    ratio, gradient = field(points)
    found = gloss_shifts(points, head, light_of(ratio, 2.0), AXES, Z, np.zeros(3))
    inner = np.abs(np.hypot(points[:, 0], points[:, 1]) - 260.0) < 50.0
    assert_recovered(found[inner], -GAIN * 2.5 * gradient[inner, 1])


def test_letters_and_dirt_that_reflect_otherwise_do_not_spoil_their_surroundings() -> None:
    rng = np.random.default_rng(2)
    points, head = sidewall(rng)
    ratio, gradient = field(points)
    dirty = ratio + np.where(rng.random(len(ratio)) < 0.15, rng.uniform(0.5, 1.5, len(ratio)), 0.0)
    dirty += rng.normal(0.0, 0.02, len(ratio))
    found = gloss_shifts(points, head, light_of(dirty, 0.0), AXES, Z, np.zeros(3))
    inner = np.abs(np.hypot(points[:, 0], points[:, 1]) - 260.0) < 50.0
    assert_recovered(found[inner], GAIN * gradient[inner, 0])


def test_the_same_light_in_both_cameras_moves_nothing() -> None:
    points, head = sidewall(np.random.default_rng(3))
    found = gloss_shifts(points, head, light_of(np.full(len(head), 0.7), 0.0), AXES, Z, np.zeros(3))
    assert np.abs(found).max() < 1e-9


@pytest.mark.parametrize("count", [1, 5, 30])
def test_a_head_with_hardly_any_points_is_left_alone(count: int) -> None:
    points, head = sidewall(np.random.default_rng(4), count)
    ratio, _ = field(points)
    ratio[0] = -np.inf
    found = gloss_shifts(points, head, light_of(ratio, 0.0), AXES, Z, np.zeros(3))
    assert np.isfinite(found).all()
    assert np.abs(found).max() <= 0.05


@pytest.mark.parametrize("growth", [-0.004, 0.002, 0.006])
@pytest.mark.parametrize("sigma", [2.0, 3.5])
def test_light_that_grows_across_a_line_moves_its_top_by_variance_times_growth(
    growth: float, sigma: float
) -> None:
    x = np.arange(640.0)
    places = np.arange(60.0, 600.0, 90.0) + 0.3
    lines = sum(np.exp(-0.5 * ((x - place) / sigma) ** 2) for place in places)
    image = 6000.0 + 6000.0 * lines * np.exp(growth * (x - 320.0))
    found = extract_light_lines(np.tile(np.round(image), (480, 1)).astype(np.uint16))
    assert found is not None
    off = found.points[:, 0][:, None] - places
    nearest = off[np.arange(len(off)), np.abs(off).argmin(axis=1)]
    np.testing.assert_allclose(nearest, sigma**2 * growth, atol=0.002 + 0.05 * sigma**2 * abs(growth))


@pytest.mark.parametrize("sigma", [1.6, 2.5, 4.0, 6.0, 8.0])
def test_lines_are_measured_as_wide_as_they_are(sigma: float) -> None:
    rng, x = np.random.default_rng(5), np.arange(1280.0)
    lines = sum(np.exp(-0.5 * ((x - place) / sigma) ** 2) for place in np.arange(60.0, 1250.0, 110.0))
    image = np.clip(6.0 + 150.0 * lines + rng.normal(0.0, 1.5, (1024, 1280)), 0.0, 255.0)
    found = extract_light_lines(image.astype(np.uint8))
    assert found is not None
    assert found.width == pytest.approx(sigma, rel=0.1)
