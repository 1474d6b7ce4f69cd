"""Row fields of heads from pairs of crosses: numbers alone."""

from __future__ import annotations

import numpy as np
import pytest

from alignment.stereo.rows import TERMS, fitted_fields


def places(rng: np.random.Generator, count: int) -> np.ndarray:
    u, v = rng.uniform(-1.0, 1.0, (2, count))
    return np.column_stack([np.ones(count), u, v, u * v, v * v])


def test_a_smooth_field_is_found_under_noise_and_wrong_pairs() -> None:
    rng = np.random.default_rng(1)
    terms = places(rng, 60)
    true = np.array([0.4, -0.2, 0.1, 0.3, -0.1])
    values = terms @ true + rng.normal(0.0, 0.03, 60)
    values[:8] += rng.choice([-1.0, 1.0], 8) * rng.uniform(1.0, 20.0, 8)
    found = fitted_fields([terms], [values])
    deviation = np.sqrt(np.diag(np.linalg.inv(found.information[0])))
    assert np.abs(found.field[0] - true) == pytest.approx(0.0, abs=4.0 * deviation.max())
    assert 0.003 < deviation[0] < 0.02
    assert found.rms_px[0] == pytest.approx(np.sqrt(np.mean(np.square(terms @ true))), rel=0.2)


def test_stated_deviations_are_those_of_repeats() -> None:
    rng = np.random.default_rng(2)
    ratios = []
    for _ in range(200):
        terms = places(rng, 40)
        found = fitted_fields([terms], [rng.normal(0.0, 0.05, 40)])
        ratios.append(found.field[0] @ found.information[0] @ found.field[0] / TERMS)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.35)


def test_a_head_with_few_pairs_has_no_field_and_does_not_hinder_the_others() -> None:
    rng = np.random.default_rng(3)
    many = places(rng, 50)
    found = fitted_fields(
        [places(rng, 6), many, places(rng, 0)], [np.full(6, 3.0), many[:, 0] * 0.5, np.zeros(0)]
    )
    assert found.seen.tolist() == [False, True, False]
    assert found.pairs.tolist() == [6, 50, 0]
    assert not found.information[0].any()
    assert np.isnan(found.rms_px[[0, 2]]).all()
    assert found.field[1] == pytest.approx([0.5, 0.0, 0.0, 0.0, 0.0], abs=1e-6)
