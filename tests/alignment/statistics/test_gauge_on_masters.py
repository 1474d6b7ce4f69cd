"""Type 1, bias, linearity, stability and the VDA 5 budget, against worked examples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.statistics.budgets import (
    Component,
    bias_uncertainty,
    budget,
    resolution_uncertainty,
)
from alignment.statistics.choices import Contribution
from alignment.statistics.linearity_study import bias, linearity
from alignment.statistics.stability_study import drift_of, stability
from alignment.statistics.type1_study import type1

# AIAG, Measurement Systems Analysis: linearity example, five masters measured twelve times.
AIAG_LINEARITY = {
    2.0: (2.7, 2.5, 2.4, 2.5, 2.7, 2.3, 2.5, 2.5, 2.4, 2.4, 2.6, 2.4),
    4.0: (5.1, 3.9, 4.2, 5.0, 3.8, 3.9, 3.9, 3.9, 3.9, 4.0, 4.1, 3.8),
    6.0: (5.8, 5.7, 5.9, 5.9, 6.0, 6.1, 6.0, 6.1, 6.4, 6.3, 6.0, 6.1),
    8.0: (7.6, 7.7, 7.8, 7.7, 7.8, 7.8, 7.8, 7.7, 7.8, 7.5, 7.6, 7.7),
    10.0: (9.1, 9.3, 9.5, 9.3, 9.4, 9.5, 9.5, 9.5, 9.6, 9.2, 9.3, 9.4),
}
AIAG_BIAS = (5.8, 5.7, 5.9, 5.9, 6.0, 6.1, 6.0, 6.1, 6.4, 6.3, 6.0, 6.1, 6.2, 5.6, 6.0)


def test_linearity_gives_the_printed_figures() -> None:
    values = [value for each in AIAG_LINEARITY.values() for value in each]
    references = [reference for reference, each in AIAG_LINEARITY.items() for _ in each]
    found = linearity(values, references)
    assert [round(each.bias, 5) for each in found.biases] == [0.49167, 0.125, 0.025, -0.29167, -0.61667]
    assert (round(found.slope, 6), round(found.intercept, 6)) == (-0.131667, 0.736667)
    assert round(found.residual_deviation, 5) == 0.23954
    assert round(100 * found.r_squared, 1) == 71.4
    assert found.slope_t is not None
    assert found.intercept_t is not None
    assert (round(found.slope_t, 3), round(found.intercept_t, 3)) == (-12.043, 10.158)
    assert not found.acceptable


def test_bias_gives_the_printed_figures() -> None:
    """Mean 6.0067, deviation 0.2120, error of the mean 0.05474, t 0.1218, limits −0.1107 and 0.1241."""
    found = bias(AIAG_BIAS, 6.0)
    assert found.t is not None
    assert (round(found.mean, 4), round(found.deviation, 4), round(found.t, 4)) == (6.0067, 0.2120, 0.1218)
    assert (round(found.low, 4), round(found.high, 4)) == (-0.1107, 0.1241)
    assert found.p is not None
    assert round(found.p, 3) == 0.905
    assert not found.significant


def test_linear_gauge_is_accepted() -> None:
    rng = np.random.default_rng(21)
    references = np.repeat([-1.0, -0.5, 0.0, 0.5, 1.0], 12)
    good = linearity(references + rng.normal(0, 0.01, 60), references)
    bad = linearity(1.02 * references + rng.normal(0, 0.01, 60), references)
    assert good.acceptable
    assert not bad.acceptable
    assert bad.percent_linearity() == pytest.approx(2.0, abs=0.5)
    assert bad.percent_linearity() == pytest.approx(100 * abs(bad.slope), rel=1e-12)


def test_one_master_is_no_line() -> None:
    with pytest.raises(DegenerateInputError, match="at least 2 certified values"):
        linearity([1.0, 1.1], [1.0, 1.0])


def test_type_1_by_hand() -> None:
    """Tolerance 1, deviation 0.02, bias 0.01: Cg = 0.2 / 0.12, Cgk = (0.1 − 0.01) / 0.06."""
    values = 5.01 + 0.02 * np.tile([1.0, -1.0], 25) * math.sqrt(49 / 50)
    found = type1(values, 5.0, 1.0, resolution=0.01)
    assert found.cg == pytest.approx(0.2 / 0.12)
    assert found.cgk == pytest.approx(0.09 / 0.06)
    assert found.resolution_percent == pytest.approx(1.0)
    assert found.bias_p is not None
    assert found.bias_p < 0.01
    assert found.least_tolerance is not None
    again = type1(values, 5.0, found.least_tolerance)
    assert again.cgk == pytest.approx(1.33)


def test_type_1_of_a_gauge_that_shows_one_value_has_no_index() -> None:
    found = type1([5.0] * 30, 5.0, 1.0)
    assert (found.cg, found.cgk, found.bias_p) == (None, None, None)


def test_type_1_needs_repetitions() -> None:
    with pytest.raises(DegenerateInputError, match="at least 10 repetitions"):
        type1([5.0] * 9, 5.0, 1.0)


def test_drift_of_a_gauge_is_found() -> None:
    rng = np.random.default_rng(22)
    days = np.arange(60.0)
    still = stability(rng.normal(0, 0.01, 60), days * 86_400, reference=0.0)
    moving = stability(rng.normal(0, 0.01, 60) + 0.001 * days, days * 86_400, reference=0.0)
    assert still.drift_p is not None
    assert moving.drift_p is not None
    assert still.drift_p > 0.01 > moving.drift_p
    assert moving.drift == pytest.approx(0.001, rel=0.3)
    assert moving.bias is not None
    assert moving.bias.significant
    assert not moving.chart.in_control


def test_drift_needs_different_times() -> None:
    assert drift_of([1.0, 2.0, 3.0], [5.0, 5.0, 5.0]) == (None, None)
    slope, p = drift_of([1.0, 2.0, 3.0], [0.0, 1.0, 2.0])
    assert (slope, p) == (pytest.approx(1.0), None)


def test_budget_by_hand() -> None:
    """System: √(0.001² + 0.002² + 0.0015²); process: repeatability on parts replaces that on the master."""
    found = budget(
        [
            Component(Contribution.CALIBRATION, 0.001),
            Component(Contribution.RESOLUTION, resolution_uncertainty(0.001)),
            Component(Contribution.MASTER_REPEATABILITY, 0.002),
            Component(Contribution.BIAS, bias_uncertainty(0.0015 * math.sqrt(3))),
            Component(Contribution.PART_REPEATABILITY, 0.004),
            Component(Contribution.TEMPERATURE, 0.003),
        ],
        tolerance=0.2,
    )
    assert found.u_ms == pytest.approx(math.sqrt(1 + 4 + 2.25) * 1e-3)
    assert found.u_mp == pytest.approx(math.sqrt(1 + 16 + 2.25 + 9) * 1e-3)
    assert found.q_ms == pytest.approx(100 * 2 * 2 * found.u_ms / 0.2)
    assert found.q_mp == pytest.approx(100 * 2 * 2 * found.u_mp / 0.2)
    assert found.capable
    assert sum(line.share_percent for line in found.lines) == pytest.approx(100.0)
    assert [line.counted for line in found.lines] == [True, False, False, True, True, True]
    assert budget([line.component for line in found.lines], found.least_tolerance_ms).q_ms == pytest.approx(
        15.0
    )
    again = budget([line.component for line in found.lines], found.least_tolerance_mp)
    assert again.q_mp == pytest.approx(30.0)


def test_coarse_resolution_stands_for_the_spread() -> None:
    found = budget(
        [Component(Contribution.RESOLUTION, 0.01), Component(Contribution.MASTER_REPEATABILITY, 0.002)], 1.0
    )
    assert found.u_ms == found.u_mp == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("components", "tolerance"),
    [([], 1.0), ([Component(Contribution.BIAS, -1.0)], 1.0), ([Component(Contribution.BIAS, 1.0)], 0.0)],
)
def test_impossible_budget_is_refused(components: list[Component], tolerance: float) -> None:
    with pytest.raises(DegenerateInputError):
        budget(components, tolerance)
