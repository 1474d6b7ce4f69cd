"""Ghost surfaces of a periodic pattern, and things before a head, do not pass for the wheel."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.arrays import Array
from alignment.stereo.correspondence import Candidates
from alignment.stereo.pool import PointPool
from alignment.stereo.surface import PlaneHypothesis
from alignment.units import ARCMIN
from alignment.wheel.search import find_surface

SIGMA, GHOST = 0.02, 45.0
AXES = np.tile(np.eye(3)[:, :2], (3, 1, 1))
NORMAL = np.array([0.02, -0.03, 1.0]) / np.linalg.norm([0.02, -0.03, 1.0])


def wheel(rng: np.random.Generator, head: int) -> tuple[Array, Array]:
    """Points (N, 3) of a bulged sidewall before one head, 100 of each line, and the numbers of lines."""
    angle = np.radians(90.0 + 120.0 * head) + np.repeat(np.linspace(-0.3, 0.3, 25), 100)
    radius = np.tile(np.linspace(205.0, 315.0, 100), 25)
    height = -0.003 * (radius - 260.0) ** 2
    e1 = np.cross([0.0, 1.0, 0.0], NORMAL)
    e1 /= np.linalg.norm(e1)
    frame = np.array([e1, np.cross(NORMAL, e1), NORMAL])
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height]) @ frame
    points[:, 2] += SIGMA * rng.standard_normal(len(points))
    return points, np.repeat(np.arange(25), 100)


def seen(points: list[Array], line: Array) -> Candidates:
    """Candidates of one head, of which each line point has one from each table of points (N, 3)."""
    n, several = len(line), len(points)
    return Candidates(
        points=np.stack(points, axis=1).reshape(-1, 3),
        sigma=np.full(n * several, SIGMA),
        rays=np.tile([0.0, 0.0, -1.0], (n * several, 1)),
        spread=np.zeros(n * several),
        left_point=np.repeat(np.arange(n), several),
        left_line=np.repeat(line, several),
        right_point=np.zeros(n * several, np.int64),
        light=np.tile([1.0, 0.0, 0.0], (n * several, 1)),
        offered=n,
    )


def hypothesis(z: float, score: float) -> PlaneHypothesis:
    return PlaneHypothesis(np.array([z, 0.0, 0.0]), score)


def error(pool: PointPool, hypotheses: list[PlaneHypothesis]) -> float:
    surface = find_surface(pool, hypotheses, AXES)
    assert surface is not None
    return float(np.linalg.norm(np.cross(surface.fit.normal, NORMAL)) / ARCMIN)


@given(st.integers(0, 2**31), st.floats(1.8, 2.8))
@settings(max_examples=10)
def test_a_ghost_that_fits_nearly_as_well_and_comes_first_is_not_taken(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    heads = []
    for k in range(3):
        true, line = wheel(rng, k)
        ghost = true + np.array([0.0, 0.0, GHOST])
        # It leans, and its points scatter more than their noise.
        ghost[:, 2] += 0.004 * ghost[:, 0] + np.sqrt(scale**2 - 1.0) * SIGMA * rng.standard_normal(len(ghost))
        heads.append(seen([true, ghost], line))
    assert error(PointPool.of(heads), [hypothesis(GHOST - 8.0, 0.9), hypothesis(-8.0, 0.8)]) < 0.1


def test_a_line_point_whose_partner_is_missing_takes_no_neighbour_of_it() -> None:
    """A neighbour eight millimetres off is a ghost; only within two of the fitted wheel a match is chosen."""
    rng = np.random.default_rng(5)
    heads, ghosts = [], []
    for k in range(3):
        true, line = wheel(rng, k)
        place = rng.integers(0, 10, len(true))
        # Mirrored at the plane of the hypothesis, and nearer to it: chosen first, so that it is chosen again.
        mirrored = true.copy()
        mirrored[:, 2] = -8.0 - 0.9 * (true[:, 2] + 8.0)
        far = true + np.array([0.0, 0.0, GHOST])
        lonely = place < 2
        first = np.where(lonely[:, None], true + np.array([0.0, 0.0, 8.0]), true)
        second = np.where((place == 2)[:, None], mirrored, far)
        heads.append(seen([first, second], line))
        ghosts.append(np.repeat(lonely, 2))
    pool = PointPool.of(heads)
    surface = find_surface(pool, [hypothesis(-8.0, 0.9)], AXES)
    assert surface is not None
    assert not (surface.chosen & np.concatenate(ghosts)).any()
    assert surface.chosen.sum() > 0.75 * 7500
    assert float(np.linalg.norm(np.cross(surface.fit.normal, NORMAL))) < 0.01 * ARCMIN


def shield(points: Array) -> Array:
    """Something flat and aslant before the whole view."""
    return np.column_stack([points[:, :2], 8.0 + 0.25 * points[:, 0]])


def cable(points: Array) -> Array:
    """Something round before a part of the view."""
    hidden = np.abs(points[:, 0] - points[:, 0].mean()) < 25.0
    return np.where(hidden[:, None], points + np.array([0.0, 0.0, 12.0]), points)


@pytest.mark.parametrize("obstacle", [shield, cable])
@pytest.mark.parametrize("head", [0, 1, 2])
def test_something_before_one_head_does_not_turn_the_wheel(
    head: int, obstacle: Callable[[Array], Array]
) -> None:
    rng = np.random.default_rng(3)
    heads = []
    for k in range(3):
        true, line = wheel(rng, k)
        heads.append(seen([obstacle(true) if k == head else true], line))
    assert error(PointPool.of(heads), [hypothesis(-8.0, 0.9)]) < 0.5


def test_points_around_no_axis_make_no_wheel() -> None:
    few = seen([np.array([[200.0, 0.0, 0.0], [210.0, 3.0, 0.0]])], np.zeros(2, np.int64))
    assert find_surface(PointPool.of([few, few, few]), [hypothesis(0.0, 1.0)], AXES) is None
