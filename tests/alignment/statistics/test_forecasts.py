"""Drift with time and temperature: told apart, and a forecast whose uncertainty holds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from alignment.errors import DegenerateInputError
from alignment.statistics import LEAST_TIMES, fit_drift

HOURS = np.arange(0.0, 240.0, 4.0)
DAY = 22.0 + 6.0 * np.sin(2.0 * np.pi * HOURS / 24.0 + 0.4)


def drifting(rng: np.random.Generator, slope: float = 2e-4, noise: float = 0.01) -> np.ndarray:
    return 0.1 + slope * HOURS + 0.005 * (DAY - DAY.mean()) + noise * rng.standard_normal(len(HOURS))


def test_what_follows_temperature_is_not_taken_for_drift() -> None:
    """Warming up within the period looked like drift that a straight line in time goes on with for ever."""
    warming = 20.0 + HOURS / 24.0 + np.sin(2.0 * np.pi * HOURS / 24.0)
    values = 0.3 + 0.01 * warming
    assert fit_drift(HOURS, values).slope == pytest.approx(0.01 / 24.0, rel=0.1)
    found = fit_drift(HOURS, values, warming)
    assert found.slope == pytest.approx(0.0, abs=1e-12)
    assert found.per_kelvin == pytest.approx(0.01)
    assert found.temperature == pytest.approx(warming.mean())


@pytest.mark.parametrize(("unit", "origin"), [(1.0, 0.0), (3600.0, 1.79e9), (1.0 / 720.0, -40.0)])
def test_unit_and_origin_of_time_decide_nothing(unit: float, origin: float) -> None:
    values = drifting(np.random.default_rng(1))
    plain = fit_drift(HOURS, values, DAY)
    other = fit_drift(origin + unit * HOURS, values, DAY)
    assert other.slope * unit == pytest.approx(plain.slope, rel=1e-6)
    assert other.slope_deviation * unit == pytest.approx(plain.slope_deviation, rel=1e-6)
    here, there = plain.crossing(0.4), other.crossing(0.4)
    assert here is not None
    assert there is not None
    for name in ("at", "earliest", "latest"):
        assert (getattr(there, name) - origin) / unit == pytest.approx(getattr(here, name), rel=1e-5)


def test_the_moment_of_a_limit_lies_within_its_confidence_limits_as_often_as_they_say() -> None:
    rng = np.random.default_rng(7)
    true_moment = (0.4 - 0.1) / 2e-4
    inside = told = 0
    for _ in range(400):
        crossing = fit_drift(HOURS, drifting(rng), DAY).crossing(0.4)
        if crossing is None:
            continue
        told += 1
        assert crossing.earliest < crossing.at < crossing.latest
        inside += crossing.earliest <= true_moment <= crossing.latest
    assert told > 390
    # Three standard deviations of a share of 95 % in so many trials.
    assert inside / told > 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / told)


def test_values_that_follow_each_other_do_not_make_a_forecast_sure() -> None:
    """A slow wander without any drift was told to reach its limit next week."""
    rng = np.random.default_rng(11)
    told = naive = 0
    for _ in range(300):
        wander = np.zeros(len(HOURS))
        for k in range(1, len(HOURS)):
            wander[k] = 0.6 * wander[k - 1] + rng.standard_normal()
        told += fit_drift(HOURS, wander).crossing(20.0) is not None
        naive += stats.linregress(HOURS, wander).pvalue < 0.05
    assert naive > 75, "what the correction is for"
    assert told < naive / 2


def test_without_drift_nobody_says_when_a_limit_is_reached() -> None:
    rng = np.random.default_rng(3)
    told = sum(fit_drift(HOURS, drifting(rng, slope=0.0), DAY).crossing(0.4) is not None for _ in range(300))
    assert told / 300 < 0.05 + 3.0 * math.sqrt(0.05 * 0.95 / 300)


def test_a_warmer_hall_reaches_the_limit_earlier() -> None:
    found = fit_drift(HOURS, drifting(np.random.default_rng(5)), DAY)
    mean, warm = found.crossing(0.4), found.crossing(0.4, kelvin=10.0)
    assert mean is not None
    assert warm is not None
    assert mean.at - warm.at == pytest.approx(10.0 * (found.per_kelvin or 0.0) / found.slope)


def test_a_temperature_that_never_changed_is_no_cause() -> None:
    found = fit_drift(HOURS, drifting(np.random.default_rng(5)), np.full(len(HOURS), 21.0))
    assert (found.per_kelvin, found.per_kelvin_deviation, found.temperature) == (None, None, 21.0)


@pytest.mark.parametrize(
    ("times", "values", "temperatures", "said"),
    [
        (HOURS[: LEAST_TIMES - 1], HOURS[: LEAST_TIMES - 1], None, f"at least {LEAST_TIMES} times"),
        (HOURS, HOURS[:-1], None, "with a value each"),
        (HOURS, HOURS, DAY[:-1], "as many temperatures or none"),
        (HOURS, np.where(HOURS == 8.0, np.nan, 0.0), None, "found one that is not"),
        (HOURS, HOURS, np.where(HOURS == 8.0, np.inf, DAY), "found one that is not"),
        (HOURS[::-1], HOURS, None, "times that rise"),
        (np.zeros(len(HOURS)), HOURS, None, "times that rise"),
        (HOURS, DAY, 20.0 + 0.1 * HOURS, "cannot be told apart"),
        (HOURS, np.square(HOURS - 120.0), None, "each is nearly the one before"),
    ],
)
def test_what_no_line_can_be_laid_through_is_refused(
    times: np.ndarray, values: np.ndarray, temperatures: np.ndarray | None, said: str
) -> None:
    with pytest.raises(DegenerateInputError, match=said):
        fit_drift(times, values, temperatures)
