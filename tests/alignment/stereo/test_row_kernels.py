"""Pairs of crosses and row fields against plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from alignment.imaging.crosses import Crosses
from alignment.imaging.lines import LightLines
from alignment.stereo.correspondence import Candidates
from alignment.stereo.rows import TERMS, RowFields, RowViews, fitted_fields, row_fields
from tests import rendered
from tests.alignment.stereo import plain_rows

Array = NDArray[np.float64]


def assert_same(found: RowFields, expected: RowFields) -> None:
    np.testing.assert_array_equal(found.pairs, expected.pairs)
    np.testing.assert_allclose(found.rms_px, expected.rms_px, rtol=1e-9)
    np.testing.assert_allclose(found.field, expected.field, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.information, expected.information, rtol=1e-7, atol=1e-6)


@given(st.integers(0, 2**31))
@settings(max_examples=60)
def test_fields_are_those_of_plain_arrays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, differences = [], []
    for count in rng.choice([0, 3, 14, 15, 16, 17, 30, 31, 200], 3):
        u, v = rng.uniform(-1.0, 1.0, (2, count))
        terms = np.column_stack([np.ones(count), u, v, u * v, v * v])
        values = terms @ rng.normal(0.0, 0.5, TERMS) + rng.normal(0.0, 0.05, count)
        wrong = rng.uniform(size=count) < rng.choice([0.0, 0.1, 0.4])
        values[wrong] += rng.uniform(-20.0, 20.0, int(wrong.sum()))
        places.append(terms)
        differences.append(values)
    assert_same(fitted_fields(places, differences), plain_rows.fitted_fields(places, differences))


@pytest.mark.parametrize("value", [0.0, 0.7])
def test_crosses_that_all_differ_by_the_same_have_a_field(value: float) -> None:
    """Without any scatter the median of the rest is zero, and all values are the median."""
    u, v = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 20))
    terms = np.column_stack([np.ones(20), u, v, u * v, v * v])
    values = [np.full(20, value)]
    assert_same(fitted_fields([terms], values), plain_rows.fitted_fields([terms], values))


@dataclass(frozen=True)
class Shot:
    """A head's lines, crosses and matched points drawn at random, mistakes among them."""

    lines: tuple[LightLines, LightLines]
    matched: Candidates
    chosen: NDArray[np.bool_]

    @classmethod
    def draw(cls, rng: np.random.Generator, crosses: int, points: int) -> Shot:
        steep, flat = (int(n) for n in rng.integers(2, 9, 2))
        count = steep + flat
        starts = np.r_[0, np.cumsum(rng.integers(0, 40, count - 1) * 5), 400]
        starts = np.minimum(np.sort(starts), 400)
        left_line = np.sort(rng.integers(0, count, points))
        # Mostly the same line on the right, at times another, and at times one that is empty.
        right_line = np.where(rng.uniform(size=points) < 0.8, left_line, rng.integers(0, count, points))
        right_point = np.minimum(starts[right_line], 399)
        meet = np.column_stack([rng.integers(0, steep, crosses), rng.integers(steep, count, crosses)])
        at = np.column_stack([rng.uniform(200.0, 1000.0, crosses), rng.uniform(150.0, 850.0, crosses)])
        shown = rng.permutation(crosses)[: int(0.9 * crosses)]
        shift = np.column_stack([np.full(len(shown), 160.0), rng.normal(0.0, 3.0, len(shown))])
        lines = (cls._lines(at, meet, starts), cls._lines(at[shown] - shift, meet[shown], starts))
        none = np.zeros((points, 3))
        matched = Candidates(
            none, none[:, 0], none, none[:, 0], np.arange(points), left_line, right_point, none, points
        )
        return cls(lines, matched, rng.uniform(size=points) < 0.9)

    @staticmethod
    def _lines(at: Array, meet: NDArray[np.int64], starts: NDArray[np.int64]) -> LightLines:
        none = np.zeros((400, 2))
        return LightLines(
            none, none, none[:, 0], none[:, 0], starts, 2.0, Crosses(np.ascontiguousarray(at), meet, at)
        )


@given(st.integers(0, 2**31))
@settings(max_examples=40)
def test_crosses_are_paired_as_by_plain_arrays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    views = RowViews.of(rendered.rig().heads)
    sizes = rng.choice([0, 1, 40, 120], 3)
    shots = [Shot.draw(rng, int(crosses), int(rng.choice([0, 300, 900]))) for crosses in sizes]
    level = rng.uniform(-400.0, 400.0)

    def height(points: Array) -> Array:
        return np.where(points[:, 0] > level, 0.0, np.where(points[:, 1] > 0.0, np.nan, 5.0))

    given_shots = (
        [shot.lines for shot in shots],
        [shot.matched for shot in shots],
        np.concatenate([shot.chosen for shot in shots]),
        views,
    )
    assert_same(row_fields(*given_shots, height), plain_rows.row_fields(*given_shots, height))


def test_pairs_of_crosses_are_found_at_all() -> None:
    rng = np.random.default_rng(1)
    shot = Shot.draw(rng, 120, 900)
    views = RowViews.of(rendered.rig().heads[:1])
    found = row_fields([shot.lines], [shot.matched], shot.chosen, views, lambda p: 0.0 * p[:, 0])
    assert found.pairs[0] > 60
    nothing = replace(shot, chosen=np.zeros(900, np.bool_))
    none = row_fields([nothing.lines], [nothing.matched], nothing.chosen, views, lambda p: p[:, 0])
    assert none.pairs[0] == 0
