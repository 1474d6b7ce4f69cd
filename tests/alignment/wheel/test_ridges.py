"""The plane through the bends of light lines on synthetic wheels."""

import numpy as np
import pytest
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.wheel.revolution import RevolutionFit, fit_revolution
from alignment.wheel.ridges import fit_ridges

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


def test_the_stated_covariance_is_that_of_a_regression_on_nine_bends() -> None:
    """A plane takes three of the nine degrees of freedom; with all nine a fifth too little is stated."""
    points, head, line = lines_on_a_wheel(np.random.default_rng(3), 0.0)
    # Three lines before each head stay, each lifted along the axis by its own.
    used = np.flatnonzero(np.isin(line % 7, (0, 3, 6)))
    points, head, line = points[used], head[used], line[used]
    surface = surface_of(points, line)
    lifts = 0.03 * np.array([1.0, -0.8, 0.6, -1.1, 0.9, -0.5, 0.7, -1.2, 0.8])
    points = points + lifts[np.unique(line, return_inverse=True)[1]][:, None] * NORMAL
    plane = fit_ridges(points, head, line, surface, 3)
    assert plane.weights.sum() == len(plane.residuals) == 9
    angles = np.radians([90.0 + 120.0 * k + 3.0 * m for k in range(3) for m in (-3, 0, 3)])
    circle = 260.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    design = np.column_stack([np.ones(9), circle])
    rest = np.linalg.lstsq(design, lifts, rcond=None)[1]
    of_tilts = float(rest[0]) / (9 - 3) * np.linalg.inv(design.T @ design)[1:, 1:]
    # Turned by the axes of the tilts, the covariance keeps its eigenvalues.
    found, expected = np.linalg.eigvalsh(plane.covariance), np.linalg.eigvalsh(of_tilts)
    assert found == pytest.approx(expected, rel=0.02)


def test_a_head_without_lines_across_the_ridge_is_noticed() -> None:
    points, head, line = lines_on_a_wheel(np.random.default_rng(2), 0.005)
    surface = surface_of(points, line)
    kept = (head != 1) | (np.hypot(points[:, 0], points[:, 1]) < 235.0)
    with pytest.raises(DegenerateInputError, match="every head bend"):
        fit_ridges(points[kept], head[kept], line[kept], surface, 4)
