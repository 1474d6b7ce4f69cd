"""A quotient of nothing by nothing is no verdict: gauges that stand still, processes of two values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from alignment.statistics.anova import one_way
from alignment.statistics.budgets import Component, budget
from alignment.statistics.capabilities import LEAST_CPK, capability, judged, normality_p, quantile_performance
from alignment.statistics.charts import Baseline, control_chart
from alignment.statistics.choices import ChartKind, Conclusion, Contribution, GrrMethod, RuleSet
from alignment.statistics.grr_study import GaugeData, grr
from alignment.statistics.linearity_study import bias, linearity
from alignment.statistics.spread import coarse_step
from alignment.statistics.stability_study import drift_of
from alignment.statistics.summary import Moments, merged, moments
from alignment.statistics.type1_study import type1

# Numbers that no double holds: their mean is not one of them, so a naive spread is not zero.
STUCK = (0.0, 0.1, 0.3, 1.1, -7.7, 299.85)
PARTS = [str(number) for number in range(5) for _ in range(6)]
WHO = ["A", "A", "A", "B", "B", "B"] * 5


@pytest.mark.parametrize("value", STUCK)
def test_equal_values_have_no_spread_whatever_is_rounded(value: float) -> None:
    for n in (2, 3, 7, 10, 49):
        found = moments([value] * n)
        assert (found.mean, found.deviation, found.varied) == (value, 0.0, False)
    together = merged([moments([value] * 3), moments([value] * 7)])
    assert (together.mean, together.deviation, together.varied) == (value, 0.0, False)


@pytest.mark.parametrize("value", STUCK)
@pytest.mark.parametrize("method", GrrMethod)
@pytest.mark.parametrize("appraisers", [None, WHO])
def test_dead_gauge_has_no_share_of_anything(
    value: float, method: GrrMethod, appraisers: list[str] | None
) -> None:
    """It was "0.0 % of the study variation: acceptable"."""
    found = grr(GaugeData(PARTS, np.full(30, value), appraisers), method, tolerance=1.0)
    assert not found.repeated_differently
    assert found.percent_study_variation(found.grr) is None
    assert found.ndc is None
    assert (found.grr, found.part_variation) == (0.0, 0.0)


@pytest.mark.parametrize("method", GrrMethod)
def test_gauge_that_never_repeats_differently_shows_no_repeatability(method: GrrMethod) -> None:
    """Parts that differ, repetitions that do not: 0 % would be the display's coarse step, not the gauge."""
    values = np.repeat([1.0, 1.0, 2.0, 3.0, 3.0], 6)
    found = grr(GaugeData(PARTS, values, WHO), method)
    assert not found.repeated_differently
    assert found.part_variation > 0.0
    assert grr(GaugeData(PARTS, values + 1e-6 * np.arange(30) ** 2, WHO), method).repeated_differently


@pytest.mark.parametrize("value", STUCK)
def test_stuck_master_has_neither_index_nor_test(value: float) -> None:
    found = type1([value] * 25, 0.2, 1.0)
    assert (found.cg, found.cgk, found.bias_p, found.least_tolerance) == (None, None, None, None)
    assert found.deviation == 0.0
    one = bias([value] * 5, 0.2)
    assert (one.t, one.p, one.significant) == (None, None, None)


@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_linearity_without_repeated_spread_is_not_judged(slope: float) -> None:
    """A gauge that shows every master exactly, and one that shows the same for all, both stood still."""
    references = np.repeat([0.1, 0.3, 0.7, 1.1], 5)
    found = linearity(slope * references + 0.3 * (1 - slope), references)
    assert found.acceptable is None
    assert found.slope == pytest.approx(slope - 1.0, abs=1e-12)
    exact = linearity(references, references)
    assert (exact.acceptable, exact.r_squared) == (None, None)


@pytest.mark.parametrize("value", STUCK)
@pytest.mark.parametrize("kind", ChartKind)
def test_chart_without_spread_is_neither_in_control_nor_out(value: float, kind: ChartKind) -> None:
    chart = control_chart(kind, np.full(24, value), RuleSet.NELSON, size=4)
    assert (chart.in_control, chart.sigma) == (None, 0.0)
    assert chart.location.signals == chart.spread.signals == ()


@pytest.mark.parametrize("kind", [ChartKind.XBAR_R, ChartKind.XBAR_S])
@pytest.mark.parametrize("low", STUCK)
def test_subgroups_that_stand_still_while_their_means_run_away_are_not_in_control(
    kind: ChartKind, low: float
) -> None:
    """Width of the limits nothing, distance from the centre anything: it was "in control"."""
    chart = control_chart(kind, np.repeat(low + np.arange(8.0), 3), RuleSet.WESTERN_ELECTRIC, size=3)
    assert (chart.sigma, chart.in_control) == (0.0, None)


def test_limits_of_a_period_without_spread_judge_nothing() -> None:
    chart = control_chart(
        ChartKind.INDIVIDUALS, [1.0, 5.0, 1.0, 5.0, 2.0], baseline=Baseline(centre=1.0, sigma=0.0)
    )
    assert chart.in_control is None
    assert chart.spread.signals == ()


def test_drift_of_a_stuck_gauge_has_no_probability() -> None:
    for value in STUCK:
        assert drift_of([value] * 9, np.arange(9.0)) == (0.0, None)


@pytest.mark.parametrize("value", STUCK)
@pytest.mark.parametrize("n", [2, 9, 50, 1000])
def test_process_that_stands_still_has_no_index_and_no_normality(value: float, n: int) -> None:
    """`normality_p` was 0.0, from a spread of rounding."""
    found = capability(moments([value] * n), value - 1.0, value + 1.0, within_sigma=1e-17, within_df=n - 1)
    assert (found.cp, found.cpk, found.pp, found.ppk, found.expected_outside_ppm) == (None,) * 5
    assert judged(found).judgement is Conclusion.NONE
    assert "equal" in judged(found).reason
    assert normality_p([value] * n) is None
    assert quantile_performance([value] * n, value - 1.0, value + 1.0) is None


def test_spread_that_rounding_left_in_a_sum_is_none() -> None:
    """Sums of a database merge in floating point: squares of 1e-34 from values that are all equal."""
    found = capability(Moments(40, 0.1, 3e-34, 0.1, 0.1), 0.0, 0.2)
    assert (found.pp, found.ppk, found.expected_outside_ppm) == (None, None, None)


def test_two_values_are_not_a_capable_process() -> None:
    """0.10 and 0.12 in limits 0 and 0.2: Cpk 2.12, its lower limit -0.85."""
    found = capability(moments([0.10, 0.12]), 0.0, 0.2, within_sigma=0.02 / math.sqrt(2), within_df=1)
    assert found.cpk is not None
    assert found.cpk.value > LEAST_CPK
    assert found.cpk.low < 0.0
    assert judged(found).judgement is Conclusion.NONE
    assert "2 values" in judged(found).reason


@pytest.mark.parametrize("n", [3, 4, 9])
def test_a_handful_of_close_values_is_not_a_capable_process(n: int) -> None:
    """So close that even the lower limit is high: chance, or the display's step."""
    values = 0.1 + 1e-7 * np.arange(n)
    found = capability(moments(values), 0.0, 0.2, within_sigma=1e-7, within_df=n - 1)
    assert judged(found).judgement is Conclusion.NONE


@pytest.mark.parametrize(
    ("low_of_cpk", "expected"),
    [(LEAST_CPK + 1e-3, Conclusion.SHOWN), (LEAST_CPK - 1e-3, Conclusion.NOT_SHOWN)],
)
def test_capability_is_shown_by_the_lower_limit_alone(low_of_cpk: float, expected: Conclusion) -> None:
    """Just inside and just outside; the target is the plant's 1.33, not 1."""
    n, sigma = 60, 1.0
    # Bissell's lower limit as a function of the room to the only limit, turned round by bisection.
    near, far = 3.0, 30.0
    for _ in range(200):
        room = (near + far) / 2
        found = capability(Moments(n, 0.0, (n - 1) * sigma**2, -2.0, 2.0), None, room)
        assert found.ppk is not None
        near, far = (near, room) if found.ppk.low > low_of_cpk else (room, far)
    assert found.ppk.value > LEAST_CPK
    assert judged(found).judgement is expected
    assert LEAST_CPK == 1.33


def test_incapable_process_is_said_to_be_so() -> None:
    found = capability(Moments(200, 0.0, 199.0, -3.0, 3.0), -3.0, 3.0, within_sigma=1.0, within_df=150)
    answer = judged(found)
    assert answer.judgement is Conclusion.NOT_SHOWN
    assert "below" in answer.reason


def test_spread_within_subgroups_that_is_none_is_no_verdict() -> None:
    """Values differ from hour to hour and never within one: the short-term spread was not seen."""
    found = capability(moments([0.1] * 20 + [0.12] * 20), 0.0, 0.2, within_sigma=0.0, within_df=38)
    assert found.cpk is None
    assert judged(found).judgement is Conclusion.NONE


def test_factor_of_a_dead_gauge_explains_nothing() -> None:
    found = one_way([[0.1, 0.1], [0.1, 0.1, 0.1]])
    assert (found.r_squared, found.between.f, found.between.p) == (None, None, None)


def test_budget_of_nothing_is_not_capable() -> None:
    """Contributions of zero gave Q_MS 0 %: capable."""
    nothing = [Component(kind, 0.0) for kind in (Contribution.RESOLUTION, Contribution.CALIBRATION)]
    assert budget(nothing, 1.0).capable is None
    stuck = [Component(Contribution.MASTER_REPEATABILITY, 0.0), Component(Contribution.CALIBRATION, 1e-4)]
    assert budget(stuck, 1.0).capable is None
    # With the resolution that explains the equal values it is a budget again.
    assert budget([*stuck, Component(Contribution.RESOLUTION, 1e-3)], 1.0).capable is True
    assert budget([Component(Contribution.CALIBRATION, 1.0)], 1.0).capable is False


def test_step_of_a_coarse_display_is_found_and_that_of_a_fine_one_is_not_called_coarse() -> None:
    rng = np.random.default_rng(31)
    fine = rng.normal(0.1, 0.01, 50)
    assert coarse_step(fine) is None
    assert coarse_step(np.round(fine, 3)) is None
    assert coarse_step(0.1 + np.round((fine - 0.1) / 0.03) * 0.03) == pytest.approx(0.03)
    assert coarse_step([0.1] * 50) is None
    # The step between neighbours, not the largest gap: one value far away makes no display coarse.
    assert coarse_step([*np.round(fine, 3), 5.0]) is None
    assert coarse_step([0.0] * 9 + [1.0] * 9 + [3.0]) == pytest.approx(1.0)
