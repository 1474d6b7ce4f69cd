from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from alignment.imaging.lines import LightLines, extract_light_lines
from tests.alignment.imaging.grids import slanted_grid, steep_error


def steep_points(lines: LightLines) -> tuple[np.ndarray, np.ndarray]:
    steep = np.abs(lines.tangents[:, 1]) > np.abs(lines.tangents[:, 0])
    return lines.points[steep], lines.sigma[steep]


@pytest.mark.parametrize("slope", [0.0, 0.05, -0.3, 0.577])
@pytest.mark.parametrize("sigma", [1.2, 2.2, 4.0])
def test_centres_are_unbiased_at_every_slope_and_width(slope: float, sigma: float) -> None:
    lines = extract_light_lines(slanted_grid(slope, sigma=sigma))
    assert lines is not None
    points, _ = steep_points(lines)
    error = steep_error(points, slope)
    assert len(points) > 1500
    assert abs(error.mean()) < 0.003
    assert error.std() < 0.005 * sigma
    # A few points in the corners meet a line that crosses beyond the border, where nobody sees it.
    assert np.quantile(np.abs(error), 0.99) < 0.02 * sigma


def test_both_directions_are_found_and_every_cross() -> None:
    lines = extract_light_lines(slanted_grid(0.1, noise=1.5))
    assert lines is not None
    crosses = lines.crosses.points
    # Crosses at the meeting of x = 90 a + 0.1 y and y = 90 b − 0.1 x, away from the border.
    expected = np.array(
        [[(90 * a + 9.0 * b) / 1.01, (90 * b - 9.0 * a) / 1.01] for a in range(-4, 12) for b in range(-4, 12)]
    )
    inside = (expected > 40).all(axis=1) & (expected < [600, 440]).all(axis=1)
    for cross in expected[inside]:
        distance = np.hypot(*(crosses - cross).T).min()
        assert distance < 0.1, f"cross at {cross} is {distance:.2f} px from the nearest found"


def test_curved_lines_are_followed() -> None:
    lines = extract_light_lines(slanted_grid(-0.1, curvature=5e-4, flat=False))
    assert lines is not None
    error = steep_error(steep_points(lines)[0], -0.1, curvature=5e-4)
    assert abs(error.mean()) < 0.005
    assert error.std() < 0.03


@pytest.mark.parametrize("noise", [1.0, 3.0])
@pytest.mark.parametrize("amplitude", [40.0, 150.0])
def test_the_stated_deviation_is_the_scatter(noise: float, amplitude: float) -> None:
    image = slanted_grid(0.08, amplitude=amplitude, noise=noise)
    lines = extract_light_lines(image)
    assert lines is not None
    points, sigma = steep_points(lines)
    error = steep_error(points, 0.08)
    inliers = np.abs(error) < 6 * sigma
    assert inliers.mean() > 0.99
    assert (error[inliers] / sigma[inliers]).std() == pytest.approx(1.0, abs=0.15)


def test_ambient_light_does_not_hide_the_lines() -> None:
    dark = extract_light_lines(slanted_grid(0.05, noise=1.0))
    bright = extract_light_lines(slanted_grid(0.05, background=90.0, noise=1.0))
    assert dark is not None
    assert bright is not None
    assert len(bright.points) > 0.95 * len(dark.points)


def test_sixteen_bit_images_give_the_same_lines() -> None:
    image = slanted_grid(0.05, noise=1.0)
    eight, sixteen = extract_light_lines(image), extract_light_lines(image.astype(np.uint16) * 256)
    assert eight is not None
    assert sixteen is not None
    np.testing.assert_allclose(sixteen.points, eight.points, atol=1e-3)


@pytest.mark.parametrize("level", [0, 7, 255])
def test_an_even_image_has_no_lines(level: int) -> None:
    assert extract_light_lines(np.full((200, 300), level, np.uint8)) is None


def test_noise_alone_has_no_lines() -> None:
    noise = np.random.default_rng(3).normal(60.0, 4.0, (480, 640)).clip(0, 255).astype(np.uint8)
    lines = extract_light_lines(noise)
    assert lines is None or len(lines.points) < 200


def test_a_bright_edge_is_not_a_line() -> None:
    image = np.full((300, 400), 10, np.uint8)
    image[:, 200:] = 180
    lines = extract_light_lines(image)
    assert lines is None or len(lines.points) == 0


def test_four_threads_that_extract_at_once_get_the_same_lines() -> None:
    image = slanted_grid(0.05, noise=1.0)
    alone = extract_light_lines(image)
    assert alone is not None
    with ThreadPoolExecutor(4) as threads:
        for lines in threads.map(extract_light_lines, [image] * 12):
            assert lines is not None
            np.testing.assert_array_equal(lines.points, alone.points)
