"""The study of loaded tyres in short: its figures, its goals, and how it counts."""

from __future__ import annotations

import numpy as np
import pytest

from station.figures import Row
from station.studies import loaded_tyres
from station.studies.knocked import KNOCK_KINDS
from station.studies.loaded_wheels import draw_load


def silent(done: float, doing: str) -> None:
    assert 0.0 <= done <= 1.0
    assert doing


@pytest.mark.slow(22)
def test_loads_are_measured_before_both_mountings_and_knocks_are_told() -> None:
    result = loaded_tyres.run(5, True, silent)
    assert not [goal for goal in result.missed if "beyond_as_calibrated" not in goal.figure]
    assert result.figures["even_moved"] == result.figures["lifted_moved"] == 0.0
    assert result.figures["loaded_knocks"] >= loaded_tyres.QUICK.knocks / 2
    assert {str(row["knock"]) for row in result.rows if row["knock"]} == set(map(str, KNOCK_KINDS))
    assert result.plots


def test_loads_are_drawn_over_the_whole_range_and_some_wheels_hang_in_the_air() -> None:
    rng = np.random.default_rng(1)
    loads = [draw_load(rng, number) for number in range(160)]
    assert sum(load is None for load in loads) == 20
    known = [load for load in loads if load is not None]
    assert 0.0 <= min(load.bulge_mm for load in known) < 0.5
    assert 7.5 < max(load.bulge_mm for load in known) <= 8.0
    assert {load.shape for load in known} == {"gaussian", "wave"}
    assert all(18.0 <= load.width_deg <= 32.0 for load in known)
    assert 0 < sum(load.side_mm != 0.0 for load in known) <= 40
    assert all((load.side_mm != 0.0) == (load.longitudinal_mm != 0.0) for load in known)


def a_row(**other: str | float | int | None) -> Row:
    row: dict[str, str | float | int | None] = {
        "wheel": 1, "mounting": "even", "tyre": "van", "shape": "wave", "bulge_mm": 4.0, "width_deg": 20.0,
        "side_mm": 0.0, "longitudinal_mm": 0.0, "carries": 1, "knock": "", "outcome": "measured",
        "code": None, "camber_error_arcmin": 0.02, "toe_error_arcmin": -0.01, "camber_u95_arcmin": 0.03,
        "toe_u95_arcmin": 0.03, "seen_mm": 0.3, "change_over_u95": None, "change_over_stated": None,
    }  # fmt: skip
    return row | other


def test_a_wheel_refused_as_moved_misses_the_goal_and_side_force_stands_apart() -> None:
    good = [a_row(wheel=k) for k in range(1, 40)] + [a_row(camber_error_arcmin=0.04)] * 2
    assert not loaded_tyres.summarise_loads(good).missed
    refused = a_row(outcome="refused", code="head_moved", camber_error_arcmin=None)
    assert [goal.figure for goal in loaded_tyres.summarise_loads([*good, refused]).missed] == ["even_moved"]
    aside = loaded_tyres.summarise_loads([*good, a_row(side_mm=5.0, camber_error_arcmin=3.0)])
    assert not aside.missed
    assert aside.figures["even_side_force_camber_largest_arcmin"] == 3.0


def test_a_knock_in_silence_beyond_the_interval_is_missed() -> None:
    good = [a_row(wheel=k) for k in range(1, 40)] + [a_row(camber_error_arcmin=0.04)] * 2
    seen = a_row(knock=str(KNOCK_KINDS[0]), outcome="warned", change_over_u95=2.0, change_over_stated=1.5)
    hidden = a_row(knock=str(KNOCK_KINDS[0]), change_over_u95=2.0, change_over_stated=0.5)
    result = loaded_tyres.summarise_loads([*good, seen, hidden])
    assert [goal.figure for goal in result.missed] == ["loaded_beyond_as_calibrated_share"]
    assert "| camera turned about x | 2 | 0 | 1 | 1 | 0 |" in result.text
