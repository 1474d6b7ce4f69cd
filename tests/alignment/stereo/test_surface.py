"""Of a point's candidates the one on the surface that all heads share is found among its ghosts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.stereo.surface import nearest_candidates, plane_hypotheses

DEPTHS, SLOPE = (-60.0, 60.0), 0.15


@given(
    st.floats(-30.0, 30.0),
    st.tuples(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08)),
    st.integers(0, 2**31),
)
@settings(max_examples=20)
def test_the_shared_surface_is_among_the_planes_and_its_candidates_are_chosen(
    z: float, slopes: tuple[float, float], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    count = 900
    x, y = rng.uniform(-300.0, 300.0, (2, count))
    on = z + slopes[0] * x + slopes[1] * y + rng.uniform(-3.0, 3.0, count)
    # One to four candidates each, in any order, the others of them anywhere.
    several = rng.integers(1, 5, count)
    group = np.repeat(np.arange(count), several)
    heights = rng.uniform(*DEPTHS, len(group))
    true = np.cumsum(several) - 1 - rng.integers(0, several)
    heights[true] = on
    points = np.column_stack([x[group], y[group], heights])
    found = plane_hypotheses(points, group, DEPTHS, SLOPE)
    assert [h.score for h in found] == sorted((h.score for h in found), reverse=True)
    np.testing.assert_allclose(found[0].coefficients[1:], slopes, atol=0.01)
    assert found[0].coefficients[0] == pytest.approx(z, abs=2.0)
    c = found[0].coefficients
    chosen = nearest_candidates(heights - (c[0] + points[:, :2] @ c[1:]), group, 25.0)
    assert chosen[true].mean() > 0.85
    assert np.bincount(group[chosen]).max() == 1


def test_two_points_make_no_plane() -> None:
    assert plane_hypotheses(np.zeros((2, 3)), np.arange(2), DEPTHS, SLOPE) == []
