"""A head that moved is seen in the residuals of the common surface."""

import numpy as np
import pytest

from alignment.arrays import Array
from alignment.wheel.agreement import head_misfits
from alignment.wheel.revolution import fit_revolution


def misfits(rng: np.random.Generator, move: Array) -> Array:
    """Of three heads of which the second is moved by (rise, lean x, lean y), millimetres and radians."""
    points, head = [], []
    for k in range(3):
        angle = np.radians(90.0 + 120.0 * k) + rng.uniform(-0.3, 0.3, 3000)
        radius = rng.uniform(205.0, 315.0, 3000)
        height = -0.003 * (radius - 260.0) ** 2 + rng.normal(0.0, 0.015, 3000)
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        if k == 1:
            height = height + move[0] + move[1] * (x - x.mean()) + move[2] * (y - y.mean())
        points.append(np.column_stack([x, y, height]))
        head += [k] * 3000
    every, count = np.concatenate(points), 9000
    rays = np.tile([0.0, 0.0, -1.0], (count, 1))
    normal = np.array([0.0, 0.0, 1.0])
    fit = fit_revolution(every, np.full(count, 0.015), rays, np.arange(count) // 25, normal, np.zeros(3))
    return head_misfits(every, np.array(head), 3, fit)


def test_heads_in_place_differ_by_a_thousandth_of_a_millimetre() -> None:
    assert misfits(np.random.default_rng(1), np.zeros(3)).max() < 0.003


@pytest.mark.parametrize("move", [(0.0, 0.0017, 0.0), (0.0, 0.0, 0.0017), (0.3, 0.0, 0.0)])
def test_a_head_that_leans_by_a_tenth_of_a_degree_or_rises_is_seen(move: tuple[float, ...]) -> None:
    found = misfits(np.random.default_rng(2), np.array(move))
    assert found.max() > 0.012
