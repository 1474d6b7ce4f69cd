"""Degrees of freedom, sides and targets, where few values make a slip show: against scipy and numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from alignment.statistics.budgets import Component, budget
from alignment.statistics.capabilities import capability
from alignment.statistics.charts import control_chart
from alignment.statistics.choices import ChartKind, Contribution, GrrMethod
from alignment.statistics.grr_study import GaugeData, grr
from alignment.statistics.linearity_study import bias, linearity
from alignment.statistics.stability_study import LEAST_POINTS, drift_of, stability
from alignment.statistics.summary import Moments, moments
from alignment.statistics.type1_study import type1

FOUR = Moments(5, 0.0, 4.0, -1.0, 1.0)
"""Mean 0, standard deviation 1."""


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (None, 2.0, stats.norm.sf(2.0)),
        (-1.5, None, stats.norm.cdf(-1.5)),
        (-1.5, 2.0, stats.norm.sf(2.0) + stats.norm.cdf(-1.5)),
        (None, -1.0, stats.norm.sf(-1.0)),
        (1.0, None, stats.norm.cdf(1.0)),
    ],
)
def test_share_outside_counts_the_limits_that_are_there(
    low: float | None, high: float | None, expected: float
) -> None:
    """Parts per million of one limit are one tail, not two, and not none."""
    found = capability(FOUR, low, high)
    assert found.expected_outside_ppm == pytest.approx(1e6 * float(expected), rel=1e-12)


def test_index_of_one_limit_is_that_side_alone() -> None:
    upper, lower = capability(FOUR, None, 1.5), capability(FOUR, -3.0, None)
    both = capability(FOUR, -3.0, 1.5)
    assert upper.ppk is not None
    assert lower.ppk is not None
    assert both.ppk is not None
    assert both.pp is not None
    assert (upper.ppk.value, lower.ppk.value, both.ppk.value, both.pp.value) == pytest.approx(
        (0.5, 1.0, 0.5, 0.75)
    )
    outside = capability(FOUR, 1.0, None)
    assert outside.ppk is not None
    assert outside.ppk.value == pytest.approx(-1 / 3)


def test_degrees_of_freedom_of_both_spreads_make_their_own_limits() -> None:
    found = capability(FOUR, -6.0, 6.0, within_sigma=1.0, within_df=3)
    assert found.cp is not None
    assert found.pp is not None
    assert found.cp.low == pytest.approx(2.0 * math.sqrt(stats.chi2.ppf(0.025, 3) / 3))
    assert found.pp.low == pytest.approx(2.0 * math.sqrt(stats.chi2.ppf(0.025, 4) / 4))
    assert found.pp.high == pytest.approx(2.0 * math.sqrt(stats.chi2.ppf(0.975, 4) / 4))
    narrower = capability(FOUR, -6.0, 6.0, confidence=0.9)
    assert narrower.pp is not None
    assert narrower.pp.low == pytest.approx(2.0 * math.sqrt(stats.chi2.ppf(0.05, 4) / 4))


X = np.array([1.0, 1.0, 2.0, 2.0, 4.0])
Y = X + np.array([0.02, -0.01, 0.03, 0.05, 0.04])


def linear() -> tuple[np.ndarray, np.ndarray]:
    return np.append(X, 4.0), np.append(Y, 4.09)


def test_line_through_six_errors_has_four_degrees_of_freedom() -> None:
    """With sixty values n − 1 and n − 2 look alike; with six they do not."""
    x, y = linear()
    found, expected = linearity(y, x), stats.linregress(x, y - x)
    assert (found.slope, found.intercept) == pytest.approx((expected.slope, expected.intercept))
    assert found.slope_p == pytest.approx(expected.pvalue)
    assert found.slope_t == pytest.approx(expected.slope / expected.stderr)
    assert found.intercept_t == pytest.approx(expected.intercept / expected.intercept_stderr)
    assert found.intercept_p == pytest.approx(2 * stats.t.sf(abs(found.intercept_t or 0.0), 4))
    assert found.r_squared == pytest.approx(expected.rvalue**2)
    coefficients, covariance = np.polyfit(x, y - x, 1, cov=True)
    at = np.array([1.0, 2.5, 6.0])
    line = np.polyval(coefficients, at)
    half = stats.t.ppf(0.975, 4) * np.sqrt(
        covariance[0, 0] * at**2 + 2 * covariance[0, 1] * at + covariance[1, 1]
    )
    low, high = found.band(at)
    assert low == pytest.approx(line - half)
    assert high == pytest.approx(line + half)


def test_zero_that_leaves_the_band_at_one_master_is_enough() -> None:
    x = np.repeat([0.0, 1.0, 2.0], 3)
    noise = np.tile([-0.01, 0.0, 0.01], 3)
    bent = linearity(x + noise + np.where(x > 1.5, 0.02, 0.0), x)
    assert bent.outside_band == 1
    assert bent.acceptable is False
    low, high = bent.band(np.array([0.0, 1.0, 2.0]))
    assert [bool(a <= 0 <= b) for a, b in zip(low, high, strict=True)] == [True, True, False]


def test_bias_of_three_repetitions_is_the_t_test_of_one_sample() -> None:
    values = [0.11, 0.14, 0.12]
    found, expected = bias(values, 0.1), stats.ttest_1samp(values, 0.1)
    assert (found.t, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    limits = expected.confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx((limits.low - 0.1, limits.high - 0.1))
    below = bias([0.09, 0.06, 0.08], 0.1)
    assert (below.bias < 0, below.p) == (True, pytest.approx(found.p))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_bias_of_either_sign_costs_cgk(sign: float) -> None:
    values = np.tile([-0.02, 0.02], 6) + sign * 0.03
    found = type1(values, 0.0, 1.0)
    s = float(np.std(values, ddof=1))
    assert found.cg == pytest.approx(0.2 / (6 * s))
    assert found.cgk == pytest.approx((0.1 - 0.03) / (3 * s))
    assert found.bias_p == pytest.approx(stats.ttest_1samp(values, 0.0).pvalue)
    assert found.bias == pytest.approx(sign * 0.03)


def test_drift_of_four_values_has_two_degrees_of_freedom() -> None:
    at, values = np.array([0.0, 1.0, 2.0, 5.0]), np.array([0.1, 0.3, 0.2, 0.6])
    expected = stats.linregress(at, values)
    assert drift_of(values, at) == pytest.approx((expected.slope, expected.pvalue))
    assert drift_of(-values, at) == pytest.approx((-expected.slope, expected.pvalue))
    # Per day, from seconds.
    found = stability(values, at * 86_400)
    assert (found.drift, found.drift_p) == pytest.approx((expected.slope, expected.pvalue))


@pytest.mark.parametrize(("n", "stable"), [(LEAST_POINTS - 1, None), (LEAST_POINTS, True)])
def test_chart_says_stable_from_eight_points_on(n: int, stable: bool | None) -> None:
    values = np.tile([0.1, 0.13, 0.11, 0.12], 3)
    assert stability(values[:n]).stable is stable
    subgroups = np.tile([0.1, 0.13, 0.12, 0.11], 2 * n)[: 2 * n]
    assert stability(subgroups, size=2).stable is stable
    # What signals is not stable, however few there are.
    assert stability([0.0] * 5 + [1.0]).stable is False
    assert LEAST_POINTS == 8


@pytest.mark.parametrize(
    ("u_ms", "u_mp", "capable"),
    [(0.0375, 0.0, True), (0.03751, 0.0, False), (0.0, 0.075, True), (0.0, 0.07501, False)],
)
def test_budget_is_capable_up_to_fifteen_and_thirty_percent(u_ms: float, u_mp: float, capable: bool) -> None:
    """Tolerance 1, k 2: Q = 400 u percent."""
    found = budget(
        [Component(Contribution.CALIBRATION, u_ms), Component(Contribution.TEMPERATURE, u_mp)], 1.0
    )
    assert found.capable is capable
    assert (found.q_ms, found.q_mp) == pytest.approx((400 * u_ms, 400 * math.hypot(u_ms, u_mp)))
    assert budget([line.component for line in found.lines], 1.0, 3.0).q_mp == pytest.approx(1.5 * found.q_mp)


def test_contributions_of_one_kind_add_as_squares_and_the_largest_spread_counts() -> None:
    found = budget(
        [
            Component(Contribution.BIAS, 0.03), Component(Contribution.BIAS, 0.04),
            Component(Contribution.RESOLUTION, 0.12), Component(Contribution.MASTER_REPEATABILITY, 0.05),
            Component(Contribution.PART_REPEATABILITY, 0.11),
        ],
        1.0,
    )  # fmt: skip
    assert (found.u_ms, found.u_mp) == pytest.approx((0.13, 0.13))


def test_categories_are_rounded_down_and_shares_are_of_the_whole() -> None:
    """Two parts three apart, repetitions ±0.5: by hand, mean squares 18 and 0.5, so parts √(17.5 / 2)."""
    found = grr(GaugeData(list("aabb"), np.array([0.0, 1.0, 3.0, 4.0])))
    part = math.sqrt((9.0 - 0.5) / 2)
    assert found.repeatability == pytest.approx(math.sqrt(0.5))
    assert found.part_variation == pytest.approx(part)
    assert found.ndc == math.floor(1.41 * part / math.sqrt(0.5)) == 4
    assert found.percent_study_variation(found.grr) == pytest.approx(
        100 * math.sqrt(0.5) / math.hypot(part, math.sqrt(0.5))
    )
    assert grr(GaugeData(list("aabb"), np.array([0.0, 1.0, 3.0, 4.0])), tolerance=6.0).percent_tolerance(
        0.1
    ) == pytest.approx(10.0)


@pytest.mark.parametrize("method", GrrMethod)
def test_mean_of_a_study_is_that_of_the_values_with_their_offset(method: GrrMethod) -> None:
    found = grr(GaugeData(list("aabb"), np.array([0.0, 1.0, 3.0, 4.0]), offset=10.0), method)
    assert found.mean == pytest.approx(12.0)


def test_spread_has_signals_below_its_lower_limit_too() -> None:
    """From seven values on a subgroup can be too quiet."""
    rng = np.random.default_rng(41)
    values = rng.normal(0.0, 1.0, (12, 8))
    values[7] = 1e-3 * np.arange(8)
    for kind in (ChartKind.XBAR_R, ChartKind.XBAR_S):
        chart = control_chart(kind, values.ravel(), size=8)
        assert [signal.index for signal in chart.spread.signals] == [7]
        assert chart.in_control is False


def test_moments_of_three_by_hand() -> None:
    found = moments([1.0, 2.0, 4.0])
    assert (found.n, found.low, found.high) == (3, 1.0, 4.0)
    assert (found.mean, found.variance) == pytest.approx((7 / 3, 7 / 3))
