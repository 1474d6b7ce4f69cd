"""The plane through the bends of light lines on synthetic wheels."""

import numpy as np
import pytest
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.wheel.revolution import RevolutionFit, fit_revolution
from alignment.wheel.ridges import fit_ridges, plane_of_bends

NORMAL = np.array([0.02, -0.03, 1.0]) / np.linalg.norm([0.02, -0.03, 1.0])


def lines_on_a_wheel(
    rng: np.random.Generator, noise: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Radial lines before three heads on a sidewall with one sharp ridge at 260 mm: points, head, line."""
    e1 = np.cross([0.0, 1.0, 0.0], NORMAL)
    e1 /= np.linalg.norm(e1)
    frame = np.array([e1, np.cross(NORMAL, e1), NORMAL])
    points, head, line = [], [], []
    for k in range(3):
        for m in range(7):
            angle = np.radians(90.0 + 120.0 * k + 3.0 * (m - 3))
            radius = np.arange(215.0, 305.0, 0.15)
            height = -0.1 * np.abs(radius - 260.0) + rng.normal(0.0, noise, len(radius))
            points.append(np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height]) @ frame)
            head += [k] * len(radius)
            line += [7 * k + m] * len(radius)
    return np.concatenate(points), np.array(head), np.array(line)


def surface_of(points: Array, line: NDArray[np.int64]) -> RevolutionFit:
    count = len(points)
    rays = np.tile([0.0, 0.0, -1.0], (count, 1))
    return fit_revolution(points, np.full(count, 0.01), rays, line, np.array([0.0, 0.0, 1.0]), np.zeros(3))


def test_bends_on_a_ridge_find_the_plane_of_the_wheel() -> None:
    points, head, line = lines_on_a_wheel(np.random.default_rng(1), 0.005)
    plane = fit_ridges(points, head, line, surface_of(points, line), 3)
    assert len(plane.weights) == 9
    assert np.linalg.norm(plane.normal - NORMAL) < 0.5 * ARCMIN
    assert np.abs(np.hypot(*plane.centroid[:2])) < 1.0


def bends(rng: np.random.Generator, shared: float, own: float) -> tuple[Array, NDArray[np.int64]]:
    """Three bends before each of three heads on a circle of 260 mm; each head's err together, and alone."""
    head = np.repeat(np.arange(3), 3)
    angle = np.radians(90.0 + 120.0 * head + np.tile([-6.0, 0.0, 6.0], 3))
    height = shared * rng.standard_normal(3)[head] + own * rng.standard_normal(9)
    return np.column_stack([260.0 * np.cos(angle), 260.0 * np.sin(angle), height]), head


@pytest.mark.parametrize(("shared", "own"), [(0.2, 0.1), (0.1, 0.1), (0.03, 0.1)])
def test_the_stated_interval_of_a_plane_of_bends_holds_the_truth(shared: float, own: float) -> None:
    """The bends of a head counted as three that err each alone: half of the intervals missed the truth."""
    rng, axis = np.random.default_rng(3), np.array([0.0, 0.0, 1.0])
    ratios = []
    for _ in range(400):
        plane = plane_of_bends(*bends(rng, shared, own), axis)
        turn = plane.tilt_axes[:, :2]
        ratios.append(plane.normal[:2] / np.sqrt(np.diag(turn.T @ plane.covariance @ turn)))
    assert np.mean(np.abs(ratios) <= 1.96) >= 0.92
    # Nor is it stated so wide that it says nothing.
    assert np.sqrt(np.mean(np.square(ratios))) > 0.4


def test_bends_of_two_heads_state_the_tilt_that_they_hardly_know() -> None:
    points, head = bends(np.random.default_rng(4), 0.05, 0.05)
    plane = plane_of_bends(points[:6], head[:6], np.array([0.0, 0.0, 1.0]))
    least, most = np.sqrt(np.linalg.eigvalsh(plane.covariance))
    assert 1e-5 < least < most
    assert most > 3.0 * least


def test_a_head_without_lines_across_the_ridge_is_noticed() -> None:
    points, head, line = lines_on_a_wheel(np.random.default_rng(2), 0.005)
    surface = surface_of(points, line)
    kept = (head != 1) | (np.hypot(points[:, 0], points[:, 1]) < 235.0)
    with pytest.raises(DegenerateInputError, match="every head bend"):
        fit_ridges(points[kept], head[kept], line[kept], surface, 4)
