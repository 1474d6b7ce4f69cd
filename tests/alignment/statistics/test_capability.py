"""Capability indices and their confidence limits against published examples and simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from alignment.errors import DegenerateInputError
from alignment.statistics.capabilities import (
    capability,
    moving_range_sigma,
    normality_p,
    quantile_performance,
)
from alignment.statistics.summary import Moments, moments


def test_limits_of_cp_of_a_published_example() -> None:
    """Montgomery, Introduction to Statistical Quality Control, confidence interval on Cp: n 20, s 1.75.

    The book rounds Cp to 2.29 before it multiplies: 1.57 there, 1.565 without.
    """
    found = capability(Moments(20, 50.0, 19 * 1.75**2, 46.0, 54.0), 38.0, 62.0)
    assert found.pp is not None
    assert round(found.pp.value, 2) == 2.29
    assert (found.pp.low, found.pp.high) == pytest.approx((1.57, 3.01), abs=0.006)


def test_limits_of_cpk_of_a_published_example() -> None:
    """The same book, interval on Cpk: n 20, Cpk 1.33; 1.33 · (1 ± 1.96 · √(1/(9·20·1.33²) + 1/38))."""
    found = capability(Moments(20, 0.0, 19.0, -2.0, 2.0), None, 3 * 1.33)
    assert found.ppk is not None
    half = 1.33 * 1.959964 * np.sqrt(1 / (180 * 1.33**2) + 1 / 38)
    assert found.ppk.value == pytest.approx(1.33)
    assert (found.ppk.low, found.ppk.high) == pytest.approx((1.33 - half, 1.33 + half), rel=1e-6)
    assert (round(found.ppk.low, 2), round(found.ppk.high, 2)) == (0.88, 1.78)


def test_nist_handbook_example() -> None:
    """NIST/SEMATECH e-Handbook 6.1.6: limits 8 and 20, mean 16, deviation 2: Cp 1.0, Cpk 0.6667."""
    found = capability(Moments(50, 16.0, 49 * 4.0, 10.0, 21.0), 8.0, 20.0, within_sigma=2.0, within_df=49)
    assert found.cp is not None
    assert found.cpk is not None
    assert found.pp is not None
    assert found.cp.value == found.pp.value == pytest.approx(1.0)
    assert found.cpk.value == pytest.approx(0.6667, abs=5e-5)


def test_limits_hold_the_true_index_as_often_as_they_say() -> None:
    rng = np.random.default_rng(8)
    inside_pp = inside_ppk = 0
    for _ in range(1000):
        found = capability(moments(rng.normal(0.5, 1.0, 60)), -4.0, 4.0)
        assert found.pp is not None
        assert found.ppk is not None
        inside_pp += found.pp.low <= 8 / 6 <= found.pp.high
        inside_ppk += found.ppk.low <= 3.5 / 3 <= found.ppk.high
    assert 0.93 <= inside_pp / 1000 <= 0.97
    assert 0.93 <= inside_ppk / 1000 <= 0.97


def test_drifting_mean_shows_in_performance_and_not_in_capability() -> None:
    rng = np.random.default_rng(9)
    groups = rng.normal(0.0, 1.0, (50, 5)) + np.linspace(-3, 3, 50)[:, None]
    within = float(np.sqrt(groups.var(axis=1, ddof=1).mean()))
    found = capability(moments(groups.ravel()), -6.0, 6.0, within_sigma=within, within_df=200)
    assert found.cp is not None
    assert found.pp is not None
    assert found.cp.value == pytest.approx(2.0, rel=0.1)
    assert found.pp.value < 1.1
    short = moving_range_sigma(groups.ravel())
    assert short is not None
    assert short[0] == pytest.approx(1.0, rel=0.1)
    # 249 differences, of which two thirds count.
    assert short[1] == 166
    assert moving_range_sigma([1.0, 3.0]) == (pytest.approx(math.sqrt(2.0)), 1)
    assert moving_range_sigma([1.0]) is None


def test_one_limit_gives_cpk_without_cp() -> None:
    found = capability(moments([1.0, 2.0, 3.0]), 0.0, None)
    assert found.pp is None
    assert found.ppk is not None
    assert found.ppk.value == pytest.approx(2 / 3)


def test_values_that_never_vary_have_no_index() -> None:
    found = capability(moments([1.0] * 5), 0.0, 2.0)
    assert (found.pp, found.ppk, found.expected_outside_ppm) == (None, None, None)


def test_expected_share_outside_is_that_of_the_normal_distribution() -> None:
    found = capability(Moments(100, 0.0, 99.0, -3.0, 3.0), -3.0, 3.0)
    assert found.expected_outside_ppm == pytest.approx(2699.8, abs=0.1)


@pytest.mark.parametrize(("low", "high"), [(None, None), (1.0, 1.0), (2.0, 1.0)])
def test_missing_or_crossed_limits_are_refused(low: float | None, high: float | None) -> None:
    with pytest.raises(DegenerateInputError):
        capability(moments([1.0, 2.0]), low, high)


def test_quantiles_serve_where_values_are_not_normal() -> None:
    rng = np.random.default_rng(11)
    normal = rng.normal(0.0, 1.0, 200_000)
    found = quantile_performance(normal, -4.0, 4.0)
    assert found is not None
    assert found == (pytest.approx(4 / 3, rel=0.02), pytest.approx(4 / 3, rel=0.03))
    # A limit at the quantile 99.865 % is an index of 1, whatever the distribution.
    skewed = rng.lognormal(0.0, 0.5, 200_000)
    limit = float(np.exp(0.5 * 3.0))
    one_sided = quantile_performance(skewed, None, limit)
    assert one_sided == (None, pytest.approx(1.0, rel=0.03))
    ppk = capability(moments(skewed), None, limit).ppk
    assert ppk is not None
    assert ppk.value > 1.3
    assert quantile_performance(normal[:999], -4.0, 4.0) is None
    assert quantile_performance(np.ones(2000), 0.0, 2.0) is None


def test_normality_has_the_published_critical_value() -> None:
    """Stephens 1986, table 4.7, case 3: A² (1 + 0.75/n + 2.25/n²) above 0.752 in 5 % of the cases."""
    rng = np.random.default_rng(12)
    seen = set()
    for _ in range(3000):
        z = np.sort(rng.normal(size=10))
        u = stats.norm.cdf((z - z.mean()) / z.std(ddof=1))
        i = np.arange(1, 11)
        a = -10 - np.mean((2 * i - 1) * (np.log(u) + np.log(1 - u[::-1])))
        a *= 1 + 0.75 / 10 + 2.25 / 100
        p = normality_p(z)
        assert p is not None
        if abs(a - 0.752) > 0.002:
            assert (p < 0.05) == (a > 0.752)
            seen.add(p < 0.05)
    assert seen == {True, False}


def test_normality_is_doubted_where_it_should_be_and_only_there() -> None:
    rng = np.random.default_rng(10)
    normal = [normality_p(rng.normal(size=100)) for _ in range(400)]
    skewed = [normality_p(rng.exponential(size=100)) for _ in range(20)]
    assert 0.02 <= np.mean([p is not None and p < 0.05 for p in normal]) <= 0.09
    assert all(p is not None and p < 0.01 for p in skewed)
    assert normality_p(np.ones(50)) is None
