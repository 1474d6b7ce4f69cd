"""Control charts: published constants, worked examples, and each run rule on the pattern it is made for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.statistics.charts import Baseline, control_chart
from alignment.statistics.choices import ChartKind, RuleSet
from alignment.statistics.constants import chart_constants
from alignment.statistics.rules import rule_texts, signals

# ASTM MNL 7, table of factors for control charts (the same in ISO 7870-2):
# n, d2, d3, c4, A2, A3, D3, D4, B3, B4.
PUBLISHED = """
2  1.128 0.853 0.7979 1.880 2.659 0     3.267 0     3.267
3  1.693 0.888 0.8862 1.023 1.954 0     2.575 0     2.568
4  2.059 0.880 0.9213 0.729 1.628 0     2.282 0     2.266
5  2.326 0.864 0.9400 0.577 1.427 0     2.114 0     2.089
6  2.534 0.848 0.9515 0.483 1.287 0     2.004 0.030 1.970
7  2.704 0.833 0.9594 0.419 1.182 0.076 1.924 0.118 1.882
8  2.847 0.820 0.9650 0.373 1.099 0.136 1.864 0.185 1.815
9  2.970 0.808 0.9693 0.337 1.032 0.184 1.816 0.239 1.761
10 3.078 0.797 0.9727 0.308 0.975 0.223 1.777 0.284 1.716
15 3.472 0.756 0.9823 0.223 0.789 0.347 1.653 0.428 1.572
20 3.735 0.729 0.9869 0.180 0.680 0.415 1.585 0.510 1.490
25 3.931 0.708 0.9896 0.153 0.606 0.459 1.541 0.565 1.435
"""


@pytest.mark.parametrize("row", PUBLISHED.split("\n")[1:-1])
def test_constants_are_the_published_ones(row: str) -> None:
    n, *published = row.split()
    c = chart_constants(int(n))
    found = (c.d2, c.d3, c.c4, c.A2, c.A3, c.D3, c.D4, c.B3, c.B4)
    for value, text in zip(found, published, strict=True):
        # The tables carry their own rounding of intermediate results: one unit of the last digit.
        assert value == pytest.approx(float(text), abs=1.01 * 10 ** -len(text.partition(".")[2] or "000"))


def test_constants_agree_with_closed_forms() -> None:
    two, three = chart_constants(2), chart_constants(3)
    assert two.d2 == pytest.approx(2 / math.sqrt(math.pi), abs=1e-11)
    assert two.d3 == pytest.approx(math.sqrt(2 - 4 / math.pi), abs=1e-11)
    assert three.d2 == pytest.approx(3 / math.sqrt(math.pi), abs=1e-11)


def test_mean_and_range_by_hand() -> None:
    values = [5.0, 7.0, 6.0, 4.0, 6.0, 8.0, 5.0, 5.0, 8.0]
    chart = control_chart(ChartKind.XBAR_R, values, size=3)
    assert chart.location.points == pytest.approx([6.0, 6.0, 6.0])
    assert chart.spread.points == pytest.approx([2.0, 4.0, 3.0])
    assert (chart.location.centre, chart.spread.centre) == pytest.approx((6.0, 3.0))
    assert chart.location.upper == pytest.approx(6.0 + 1.023 * 3.0, abs=2e-3)
    assert chart.spread.upper == pytest.approx(2.575 * 3.0, abs=2e-3)
    assert chart.spread.lower == 0.0
    assert chart.in_control


def test_single_values_by_hand() -> None:
    """Limits of single values are the mean ± 2.66 mean moving ranges."""
    values = [10.0, 12.0, 11.0, 13.0, 10.0, 30.0]
    chart = control_chart(ChartKind.INDIVIDUALS, values)
    ranges = [2.0, 1.0, 2.0, 3.0, 20.0]
    assert chart.spread.points == pytest.approx(ranges)
    assert chart.location.upper == pytest.approx(np.mean(values) + 2.66 * np.mean(ranges), abs=2e-2)
    assert chart.spread.upper == pytest.approx(3.267 * np.mean(ranges), abs=2e-2)
    assert [signal.index for signal in chart.spread.signals] == [4]


def test_single_values_of_the_nist_handbook() -> None:
    """NIST/SEMATECH e-Handbook 6.3.2.2, flow rates: 50.81, limits 55.8041 and 45.8159 with d2 = 1.128."""
    values = [49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1]
    chart = control_chart(ChartKind.INDIVIDUALS, values)
    track = chart.location
    assert (track.centre, track.upper, track.lower) == pytest.approx((50.81, 55.8041, 45.8159), abs=2e-3)
    assert chart.in_control


def test_mean_and_deviation_is_unbiased() -> None:
    values = np.random.default_rng(5).normal(20.0, 2.0, 20_000)
    for kind in ChartKind:
        assert control_chart(kind, values, size=4).sigma == pytest.approx(2.0, rel=0.02)


def test_known_process_gives_the_limits() -> None:
    chart = control_chart(ChartKind.XBAR_S, np.full(20, 9.0), size=4, baseline=Baseline(5.0, 2.0))
    assert (chart.location.centre, chart.location.upper) == pytest.approx((5.0, 8.0))
    assert len(chart.location.signals) == 5


def test_values_that_never_vary_give_no_signal_and_no_verdict() -> None:
    """They were "in control": limits without a width judge nothing."""
    chart = control_chart(ChartKind.INDIVIDUALS, np.full(12, 3.0), RuleSet.NELSON)
    assert chart.location.signals == ()
    assert chart.in_control is None


NELSON_PATTERNS = {
    1: ([0.1, 3.1], 1),
    2: ([0.5, 0.4] * 4 + [0.5], 8),
    3: ([-1.0, -0.6, -0.2, 0.2, 0.6, 0.9], 5),
    4: ([0.5, -0.5] * 7, 13),
    5: ([2.1, 0.1, 2.2], 2),
    6: ([1.1, 1.2, -0.1, 1.3, 1.1], 4),
    7: ([0.5, -0.3, 0.2] * 5, 14),
    8: ([1.5, -1.4, -1.5, 1.6] * 2, 7),
}


@pytest.mark.parametrize("rule", NELSON_PATTERNS)
def test_each_rule_sees_its_pattern_at_the_last_point(rule: int) -> None:
    z, index = NELSON_PATTERNS[rule]
    for mirrored in (z, [-value for value in z]):
        found = signals(mirrored, RuleSet.NELSON)
        assert [(s.index, s.rule) for s in found if s.rule == rule] == [(index, rule)]
        assert not [s for s in signals(mirrored[:-1], RuleSet.NELSON) if s.rule == rule]
        assert rule_texts(RuleSet.NELSON)[rule - 1] in {s.text for s in found}


def test_western_electric_counts_eight_and_nelson_nine() -> None:
    side = [0.5, 0.4] * 4
    assert [s.index for s in signals(side, RuleSet.WESTERN_ELECTRIC)] == [7]
    assert not signals(side, RuleSet.NELSON)
    assert [s.rule for s in signals([*side, 0.5], RuleSet.NELSON)] == [2]
    assert not signals([*side, 0.5], RuleSet.THREE_SIGMA)


def test_rates_of_false_alarms_are_those_of_the_rules() -> None:
    """Three sigma: 0.27 % of the points; Western Electric: one alarm in 92 points (Champ, Woodall 1987)."""
    z = np.random.default_rng(6).normal(size=200_000)
    assert len(signals(z, RuleSet.THREE_SIGMA)) / len(z) == pytest.approx(0.0027, rel=0.1)
    # Points at which any rule signals; runs make clusters of them, so more than 1/91.75.
    points = {s.index for s in signals(z, RuleSet.WESTERN_ELECTRIC)}
    assert 1 / 91.75 < len(points) / len(z) < 2.5 / 91.75


@pytest.mark.parametrize(("values", "size"), [([1.0], 1), ([1.0, 2.0], 2), ([1.0, 2.0, 3.0], 1)])
def test_too_few_values_are_refused(values: list[float], size: int) -> None:
    kind = ChartKind.INDIVIDUALS if len(values) == 1 else ChartKind.XBAR_R
    with pytest.raises(DegenerateInputError):
        control_chart(kind, values, size=size)
