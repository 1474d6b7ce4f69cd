import math

import cv2
import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.imaging.edges import OPERATORS, find_edges


def half_plane(angle: float, offset: float, *, blur: float = 1.0, noise: float = 0.0) -> np.ndarray:
    """Bright to the side of the direction `angle`, the edge `offset` pixels from the middle."""
    parts = 8
    y, x = (np.mgrid[: 64 * parts, : 64 * parts] + 0.5) / parts - 0.5
    distance = (x - 31.5) * math.cos(angle) + (y - 31.5) * math.sin(angle) - offset
    fine = cv2.GaussianBlur((distance > 0).astype(float), (0, 0), blur * parts)
    grey = 40.0 + 150.0 * fine.reshape(64, parts, 64, parts).mean(axis=(1, 3))
    grey += np.random.default_rng(0).normal(0.0, noise, grey.shape) if noise else 0.0
    return np.rint(grey).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 4, 1.5, 2.4, -1.9])
def test_a_straight_edge_is_found_between_the_pixels(operator: str, angle: float) -> None:
    for offset in (0.0, 0.37):
        edges = find_edges(half_plane(angle, offset), operator)
        normal = np.array([math.cos(angle), math.sin(angle)])
        middle = (np.abs(edges.points - 31.5) < 24).all(axis=1)
        distance = (edges.points[middle] - 31.5) @ normal - offset
        assert middle.sum() >= 40
        assert abs(distance.mean()) < (0.2 if operator == "kirsch" else 0.03)
        assert distance.std() < 0.12
        assert (edges.normals[middle] @ normal > 0.95).all()
        assert (edges.strength > 0).all()


@pytest.mark.parametrize("operator", OPERATORS)
def test_strength_is_the_slope_of_the_grey_levels(operator: str) -> None:
    edges = find_edges(half_plane(0.0, 0.2, blur=3.0), operator)
    # 150 grey levels over a Gaussian of 3 pixels; what an operator smooths makes it flatter.
    steepest = 150.0 / (3.0 * math.sqrt(2.0 * math.pi))
    assert 0.8 * steepest < np.median(edges.strength) < 1.1 * steepest


@pytest.mark.parametrize("operator", OPERATORS)
def test_an_even_image_has_no_edges(operator: str) -> None:
    assert len(find_edges(np.full((40, 50), 90, np.uint8), operator).points) == 0


def test_canny_leaves_weak_edges_that_hang_on_no_strong_one() -> None:
    image = half_plane(0.0, -8.0).astype(float)
    image[:, 52:] += 40.0
    image = image.clip(0, 255).astype(np.uint8)
    columns = np.unique(np.rint(find_edges(image, "canny").points[:, 0]))
    assert columns.max() < 30


def test_unknown_operators_are_refused() -> None:
    with pytest.raises(DegenerateInputError, match="operator"):
        find_edges(np.zeros((40, 40), np.uint8), "roberts")
