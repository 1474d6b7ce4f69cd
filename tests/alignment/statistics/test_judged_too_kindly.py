"""Studies and rules that looked at too little of what they judge."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.statistics.choices import RuleSet
from alignment.statistics.grr_study import GaugeData, grr
from alignment.statistics.linearity_study import linearity
from alignment.statistics.rules import rule_source, signals
from alignment.statistics.stability_study import LEAST_SPAN_DAYS, stability

DAY_S = 86_400.0


def errors_at(masters: list[float], *errors: float) -> tuple[list[float], list[float]]:
    """Every master read with the same errors."""
    return [ref + error for ref in masters for error in errors], [ref for ref in masters for _ in errors]


def test_zero_outside_of_the_band_between_two_masters_is_no_linearity() -> None:
    """Errors +0.037 and -0.003, three each, at 0 and 10: at 5 the band excludes zero; once called linear."""
    found = linearity(*errors_at([0.0, 10.0], *(3 * [0.037, -0.003])))
    low, _ = found.band(np.array([0.0, 5.0, 10.0]))
    assert (low > 0.0).tolist() == [False, True, False]
    assert found.acceptable is False
    assert found.outside_band == 0
    assert found.worst_reference == pytest.approx(5.0)
    assert linearity(*errors_at([0.0, 10.0], *(3 * [0.037, -0.013]))).acceptable is True


@given(
    st.lists(st.integers(0, 500), min_size=2, max_size=6, unique=True),
    st.lists(st.floats(-0.1, 0.1), min_size=12, max_size=12),
)
def test_a_band_is_judged_as_a_fine_grid_of_it(masters: list[int], errors: list[float]) -> None:
    references = [reference / 10.0 for reference in masters for _ in (0, 1)]
    values = [reference + error for reference, error in zip(references, errors, strict=False)]
    found = linearity(values, references)
    at = np.linspace(min(references), max(references), 2001)
    low, high = found.band(at)
    worst = float(np.maximum(low, -high).max())
    if found.acceptable is not None and abs(worst) > 1e-6:
        assert found.acceptable is (worst < 0.0)


def trials_alike(noise: float = 0.0) -> GaugeData:
    """Parts 1 to 5, two appraisers who read some parts differently, each twice."""
    cells = [(1, 1.2), (2, 2), (3, 2.7), (4, 4.1), (5, 5.3)]
    rows = [
        (str(part), "ab"[who], pair[who] + noise * repeat)
        for part, pair in enumerate(cells, start=1)
        for who in (0, 1)
        for repeat in (0, 1)
    ]
    return GaugeData([r[0] for r in rows], np.array([float(r[2]) for r in rows]), [r[1] for r in rows])


def test_identical_trials_keep_the_interaction() -> None:
    """F is infinite there, so the interaction is anything but chance; it went into repeatability."""
    found = grr(trials_alike())
    assert not found.pooled
    assert found.repeatability == 0.0
    assert found.interaction == pytest.approx(0.1628, abs=5e-5)
    assert found.grr == pytest.approx(0.1628, abs=5e-5)
    assert found.percent_study_variation(found.grr) == pytest.approx(10.09, abs=0.005)
    assert found.ndc == 13
    assert found.interaction_p == 0.0
    # It is the limit of trials that hardly differ.
    near = grr(trials_alike(1e-7))
    assert near.interaction == pytest.approx(found.interaction, rel=1e-5)


def test_identical_trials_without_interaction_have_none() -> None:
    rows = [(p, a) for p in range(5) for a in range(2) for _ in range(2)]
    values = np.array([p + 0.5 * a for p, a in rows])
    found = grr(GaugeData([str(p) for p, _ in rows], values, [str(a) for _, a in rows]))
    assert found.interaction == 0.0
    assert found.repeatability == 0.0
    assert found.appraiser == pytest.approx(0.5 / np.sqrt(2.0))


def indices(z: list[float], rules: RuleSet, rule: int) -> list[int]:
    return [signal.index for signal in signals(z, rules) if signal.rule == rule]


@pytest.mark.parametrize("rules", [RuleSet.WESTERN_ELECTRIC, RuleSet.NELSON])
def test_a_pattern_signals_at_the_point_that_completes_it_at_the_start_too(rules: RuleSet) -> None:
    """The window had to be full: two points beyond two sigma at the start said nothing."""
    two, four = (2, 3) if rules is RuleSet.WESTERN_ELECTRIC else (5, 6)
    assert indices([2.5, 2.5, 0.0], rules, two) == [1]
    assert indices([-2.5, 0.0, -2.5], rules, two) == [2]
    assert indices([2.5, -2.5, 0.0], rules, two) == []
    assert indices([1.5, 1.5, 1.5, 1.5, 0.0], rules, four) == [3]
    assert indices([1.5, 1.5, 1.5, 0.0, 0.0], rules, four) == []


@given(st.lists(st.floats(-4.0, 4.0), max_size=12), st.lists(st.floats(-0.9, 0.9), min_size=5, max_size=5))
def test_quiet_points_before_a_series_add_no_signal_of_runs_in_a_window(
    z: list[float], quiet: list[float]
) -> None:
    for rules, numbers in ((RuleSet.WESTERN_ELECTRIC, (2, 3)), (RuleSet.NELSON, (5, 6))):
        for rule in numbers:
            assert [i + 5 for i in indices(z, rules, rule)] == indices([*quiet, *z], rules, rule)


def test_nelsons_eighth_needs_points_on_both_sides() -> None:
    """Its text said so; eight on one side signalled."""
    assert indices([1.5] * 8, RuleSet.NELSON, 8) == []
    assert indices([1.5, -1.5] * 4, RuleSet.NELSON, 8) == [7]
    assert indices([1.5] * 7 + [-1.5], RuleSet.NELSON, 8) == [7]
    assert indices([1.5] * 7 + [-1.5, 0.5], RuleSet.NELSON, 8) == [7]
    assert "1984" in rule_source(RuleSet.NELSON)
    assert "1956" in rule_source(RuleSet.WESTERN_ELECTRIC)


def test_three_minutes_tell_no_drift_per_day() -> None:
    values = [0.0, 0.01, 0.02, 0.03, 0.05, 0.05, 0.06, 0.07, 0.08]
    short = stability(values, np.linspace(0.0, 180.0, 9))
    assert (short.drift, short.drift_p) == (None, None)
    least = LEAST_SPAN_DAYS * DAY_S
    assert stability(values, np.linspace(0.0, 0.999 * least, 9)).drift is None
    assert stability(values, np.linspace(0.0, least, 9)).drift is not None
