"""The study of turning wheels in short, and the benchmark of their answer: one wheel, few cycles."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from alignment.units import ARCMIN
from station.configuration.places import default_config
from station.cycle.words.cycle import Outcome
from station.rehearsal.turning_station import TurningTimes, planes_station, run_turning
from station.studies import spin_cycle
from station.studies.spin_cycle import SpunWheel, spun_wheel, summary
from station.studies.wheels import study_rig

GOOD = SpunWheel(0.0, (0.02 * ARCMIN, -0.03 * ARCMIN), (0.02 * ARCMIN, 0.02 * ARCMIN), (1e-6, 1e-6), 0.01, "")
FLAT = TurningTimes((0.1,) * 9, (100.0,) * 9, (Outcome.OK,) * 9)


def test_cycles_of_turning_wheels_are_answered_and_keep_nothing(tmp_path: Path) -> None:
    dbc = default_config(None, "line.dbc").resolve()
    found = run_turning(tmp_path, dbc, 12, planes_station(1), 0.0)
    assert set(found.outcomes) == {Outcome.OK}
    assert all(0.0 < answer_s < 30.0 for answer_s in found.answer_s)
    # What the processor worked for each answer does not depend on what else the computer does.
    assert len(found.cpu_s) == 12
    assert all(0.0 < cpu_s < 5.0 for cpu_s in found.cpu_s)
    # One series of images of real cameras would be a hundred megabytes, one exposure eight.
    assert found.growth_mb(4) <= 5.0


@pytest.mark.slow(32)
def test_a_rendered_wheel_on_rollers_is_true_to_a_tenth_of_a_minute() -> None:
    wheel = spun_wheel(study_rig(spin_cycle.PRESET, 1), 0, 0.0, 1)
    assert wheel.series is not None, wheel.reason
    assert max(map(abs, wheel.series)) <= 0.1 * ARCMIN
    assert wheel.run_out_error == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(
    ("wheel", "times", "missed"),
    [
        (GOOD, FLAT, set()),
        (replace(GOOD, series=(0.11 * ARCMIN, 0.0)), FLAT, {"largest_error_arcmin"}),
        (SpunWheel(0.0, None, None, (1e-6, 1e-6), None, "why"), FLAT, {"refused", "largest_error_arcmin"}),
        (GOOD, TurningTimes((0.1,) * 9, (100.0,) * 8 + (106.0,), (Outcome.OK,) * 9), {"memory_growth_mb"}),
        (GOOD, TurningTimes((0.1,), (100.0,), (Outcome.FAULT,)), {"cycles_not_ok"}),
    ],
)  # fmt: skip
def test_a_goal_that_is_missed_is_said(wheel: SpunWheel, times: TurningTimes, missed: set[str]) -> None:
    assert {goal.figure for goal in summary([wheel], times).missed} == missed


@pytest.mark.parametrize(("series", "missed"), [(0.1, False), (0.12, True)])
def test_a_series_under_load_may_not_be_worse_than_its_exposures(series: float, missed: bool) -> None:
    off = (series * ARCMIN, series * ARCMIN)
    loaded = SpunWheel(5.0, off, (1e-6, 1e-6), (0.1 * ARCMIN, 0.1 * ARCMIN), 0.0, "")
    found = summary([GOOD, loaded], FLAT)
    assert found.figures["loaded_series_over_exposures"] == pytest.approx(10.0 * series)
    assert ("loaded_series_over_exposures" in {goal.figure for goal in found.missed}) == missed
    json.dumps(found.as_json(), allow_nan=False)
    assert not math.isnan(found.figures["p95_error_arcmin"])
