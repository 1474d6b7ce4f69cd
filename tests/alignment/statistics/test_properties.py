"""What must hold for any data: units do not matter, order does only where it should."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from alignment.statistics.capabilities import capability
from alignment.statistics.charts import control_chart
from alignment.statistics.choices import ChartKind, GrrMethod, RuleSet
from alignment.statistics.grr_study import GaugeData, grr
from alignment.statistics.rules import signals
from alignment.statistics.summary import merged, moments

SMALL = st.floats(-1e3, 1e3, allow_nan=False).map(lambda value: round(value, 3))
SCALES = st.sampled_from([1e-3, 0.5, 57.29577951308232, 60.0])
SHIFTS = st.sampled_from([0.0, -3.0, 1e4])


@st.composite
def cubes(draw: st.DrawFn) -> np.ndarray:
    shape = (draw(st.integers(2, 6)), draw(st.integers(2, 4)), draw(st.integers(2, 4)))
    return draw(arrays(np.float64, shape, elements=SMALL))


def study(cube: np.ndarray, appraisers: bool) -> GaugeData:
    part, who, _ = np.indices(cube.shape).reshape(3, -1)
    names = [str(each) for each in who] if appraisers else None
    return GaugeData([str(each) for each in part], cube.ravel(), names)


@settings(max_examples=60)
@given(cube=cubes(), scale=SCALES, shift=SHIFTS, method=st.sampled_from(GrrMethod), appraisers=st.booleans())
def test_gauge_study_does_not_depend_on_the_unit(
    cube: np.ndarray, scale: float, shift: float, method: GrrMethod, appraisers: bool
) -> None:
    one, other = (grr(study(each, appraisers), method) for each in (cube, scale * cube + shift))
    tolerance = 1e-8 * scale * max(1.0, float(np.abs(cube).max()), abs(shift) / scale)
    if one.pooled != other.pooled:
        # A probability that falls on the limit may round to either side of it.
        assert one.interaction_p == pytest.approx(other.interaction_p, abs=1e-6)
        return
    for name in ("repeatability", "appraiser", "interaction", "part_variation", "total_variation"):
        # A square root of a rounded zero: compared as variances.
        mine, scaled = scale * getattr(one, name), getattr(other, name)
        assert scaled == pytest.approx(mine, rel=1e-6, abs=math.sqrt(tolerance * scale))


@given(cube=cubes())
def test_variances_of_a_gauge_study_add_up(cube: np.ndarray) -> None:
    found = grr(study(cube, appraisers=True))
    assert found.total_variation**2 == pytest.approx(
        found.repeatability**2 + found.appraiser**2 + found.interaction**2 + found.part_variation**2
    )
    *lines, total = found.table
    assert sum(line.df for line in lines) == total.df == cube.size - 1
    assert math.fsum(line.squares for line in lines) == pytest.approx(
        moments(cube.ravel()).squares, rel=1e-6, abs=1e-9
    )


@given(values=st.lists(SMALL, min_size=2, max_size=60), cuts=st.lists(st.integers(0, 60), max_size=4))
def test_moments_do_not_depend_on_how_values_are_split(values: list[float], cuts: list[int]) -> None:
    edges = [0, *sorted(min(cut, len(values)) for cut in cuts), len(values)]
    parts = [values[a:b] for a, b in itertools.pairwise(edges) if b > a]
    whole, together = moments(values), merged(moments(part) for part in parts)
    assert (together.n, together.low, together.high) == (whole.n, whole.low, whole.high)
    assert together.mean == pytest.approx(whole.mean, rel=1e-12, abs=1e-12)
    assert together.squares == pytest.approx(whole.squares, rel=1e-9, abs=1e-9)
    assert together.low <= together.mean <= together.high or together.squares < 1e-9


@given(values=st.lists(SMALL, min_size=12, max_size=60), scale=SCALES, kind=st.sampled_from(ChartKind))
def test_chart_in_another_unit_has_the_same_signals(
    values: list[float], scale: float, kind: ChartKind
) -> None:
    chart = control_chart(kind, values, RuleSet.NELSON, size=4)
    other = control_chart(kind, [scale * value for value in values], RuleSet.NELSON, size=4)
    assert other.sigma == pytest.approx(scale * chart.sigma, rel=1e-9, abs=1e-12)
    if chart.sigma > 0.0:
        z = np.abs(chart.location.points - chart.location.centre) / chart.sigma * math.sqrt(chart.size)
        # Points on a line may round to either side of it.
        near = np.min(np.abs(z[:, None] - np.arange(4.0)), initial=1.0) < 1e-6
        ties = np.min(np.abs(np.diff(chart.location.points)), initial=1.0) < 1e-9
        if not near and not ties:
            assert other.location.signals == chart.location.signals


@given(z=st.lists(st.floats(-5, 5), max_size=60), rules=st.sampled_from(RuleSet))
def test_signals_look_only_back(z: list[float], rules: RuleSet) -> None:
    whole = signals(z, rules)
    half = signals(z[: len(z) // 2], rules)
    assert half == tuple(signal for signal in whole if signal.index < len(z) // 2)
    assert {s.index for s in signals(z, RuleSet.THREE_SIGMA)} <= {s.index for s in whole}


@given(
    values=st.lists(SMALL, min_size=3, max_size=40), low=st.floats(-2e3, -1.5e3), high=st.floats(1.5e3, 2e3)
)
def test_ppk_is_never_above_pp_and_lies_within_its_limits(
    values: list[float], low: float, high: float
) -> None:
    found = capability(moments(values), low, high)
    if found.pp is None or found.ppk is None:
        assert len(set(values)) == 1
        return
    assert found.ppk.value <= found.pp.value * (1 + 1e-12)
    for index in (found.pp, found.ppk):
        assert index.low < index.value < index.high
