"""Gauge studies against the worked example of AIAG's Measurement Systems Analysis, 4th edition."""

from __future__ import annotations

import csv
import math
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.statistics.choices import GrrMethod
from alignment.statistics.constants import d2_star
from alignment.statistics.grr_study import GaugeData, grr, range_components
from alignment.statistics.summary import deviations


@pytest.fixture
def aiag(published_data: Path) -> GaugeData:
    with (published_data / "aiag_msa4" / "grr_10x3x3.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    reference, values = deviations([Decimal(row["value"]) for row in rows])
    return GaugeData(
        [row["part"] for row in rows], values, [row["appraiser"] for row in rows], offset=reference
    )


def test_average_and_range_gives_the_printed_figures(aiag: GaugeData) -> None:
    """The sheet multiplies numbers that were rounded to four digits, so its own last digit is not firm."""
    found = grr(aiag, GrrMethod.RANGE)
    printed = {
        found.repeatability: 0.20188, found.reproducibility: 0.22963, found.grr: 0.30575,
        found.part_variation: 1.10456, found.total_variation: 1.14610,
    }  # fmt: skip
    for value, expected in printed.items():
        assert value == pytest.approx(expected, abs=1.2e-4)
    percents = [
        found.percent_study_variation(component)
        for component in (found.repeatability, found.reproducibility, found.grr, found.part_variation)
    ]
    assert percents == pytest.approx([17.62, 20.04, 26.68, 96.38], abs=0.01)
    assert found.ndc == 5
    assert round(found.mean, 4) == 0.0014


def test_range_constants_are_the_printed_ones() -> None:
    assert round(1 / d2_star(3, 10**9), 4) == 0.5908
    assert round(1 / d2_star(3, 1), 4) == 0.5231
    assert round(1 / d2_star(10, 1), 4) == 0.3146
    assert round(1 / d2_star(2, 1), 4) == 0.7071


def test_analysis_of_variance_gives_the_printed_figures(aiag: GaugeData) -> None:
    found = grr(aiag, GrrMethod.ANOVA)
    part, appraiser, residual, total = found.table
    assert [round(x, 3) for x in (part.squares, appraiser.squares, total.squares)] == [88.362, 3.167, 94.647]
    assert (part.df, appraiser.df, residual.df, total.df) == (9, 2, 78, 89)
    assert round(residual.mean_square, 4) == 0.0400
    assert found.pooled
    assert round(found.repeatability**2, 4) == 0.0400
    assert round(found.reproducibility**2, 4) == 0.0515
    assert round(found.part_variation**2, 3) == 1.086
    assert round(found.grr**2, 4) == 0.0914
    assert round(found.percent_study_variation(found.grr), 1) == 27.9
    assert found.ndc == 4


def test_interaction_of_the_printed_table_is_kept_when_asked(aiag: GaugeData) -> None:
    found = grr(aiag, pooling_p=1.0)
    _, _, interaction, residual, _ = found.table
    assert (round(interaction.squares, 3), interaction.df) == (0.359, 18)
    assert round(interaction.mean_square, 5) == 0.01994
    assert (round(residual.squares, 3), residual.df) == (2.759, 60)
    assert round(residual.mean_square, 5) == 0.04598
    # A negative estimate of a variance is zero.
    assert found.interaction == 0.0


def test_components_of_a_known_gauge_are_found() -> None:
    rng = np.random.default_rng(11)
    parts, appraisers, trials = 60, 20, 4
    cube = (
        rng.normal(0, 3.0, (parts, 1, 1))
        + rng.normal(0, 1.0, (1, appraisers, 1))
        + rng.normal(0, 0.8, (parts, appraisers, 1))
        + rng.normal(0, 0.5, (parts, appraisers, trials))
    )
    index = np.indices(cube.shape).reshape(3, -1)
    found = grr(GaugeData([str(i) for i in index[0]], cube.ravel(), [str(i) for i in index[1]]))
    assert not found.pooled
    assert found.repeatability == pytest.approx(0.5, rel=0.05)
    assert found.interaction == pytest.approx(0.8, rel=0.1)
    assert found.appraiser == pytest.approx(1.0, rel=0.4)
    assert found.part_variation == pytest.approx(3.0, rel=0.2)
    assert found.reproducibility == pytest.approx(math.hypot(found.appraiser, found.interaction))


def test_automatic_station_has_no_reproducibility() -> None:
    rng = np.random.default_rng(12)
    values = np.repeat(rng.normal(0, 2.0, 30), 5) + rng.normal(0, 0.1, 150)
    parts = [str(number // 5) for number in range(150)]
    for method in GrrMethod:
        found = grr(GaugeData(parts, values), method, tolerance=2.0)
        assert (found.appraisers, found.reproducibility, found.trials) == (0, 0.0, 5)
        assert found.repeatability == found.grr == pytest.approx(0.1, rel=0.15)
        assert found.percent_tolerance(found.grr) == pytest.approx(100 * 6 * found.grr / 2.0)


def test_parts_of_the_automatic_station_may_have_different_numbers_of_trials() -> None:
    values = np.array([1.0, 1.2, 1.1, 2.0, 2.2, 3.1, 3.0, 3.2])
    found = grr(GaugeData(list("aaabbccc"), values))
    assert found.trials is None
    # By hand: 0.02 + 0.02 + 0.02 within; 8 values less 3 parts.
    assert found.repeatability**2 == pytest.approx(0.06 / 5)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, math.nan])
def test_tolerance_without_width_is_refused(tolerance: float) -> None:
    with pytest.raises(DegenerateInputError, match="tolerance"):
        grr(GaugeData(["a", "a", "b", "b"], np.arange(4.0)), tolerance=tolerance)


def test_missing_cell_is_named() -> None:
    data = GaugeData(list("aabbaab"), np.arange(7.0), ["Jo"] * 4 + ["Al"] * 3)
    with pytest.raises(DegenerateInputError, match=r"2 values of appraiser 'Al' for part 'b'.*found 1"):
        grr(data)


@pytest.mark.parametrize(
    ("parts", "appraisers", "field"),
    [("aa", ("J", "K"), "part"), ("aabb", ("J",) * 4, "appraiser"), ("abab", ("J", "J", "K", "K"), "trial")],
)
def test_too_small_study_says_what_is_missing(parts: str, appraisers: tuple[str, ...], field: str) -> None:
    with pytest.raises(DegenerateInputError) as caught:
        grr(GaugeData(list(parts), np.arange(float(len(parts))), appraisers))
    assert caught.value.field == field


def test_perfect_gauge_has_no_number_of_categories() -> None:
    found = grr(GaugeData(list("aabb"), np.array([1.0, 1.0, 2.0, 2.0])))
    assert found.ndc is None
    assert found.percent_study_variation(found.grr) == 0.0


def test_equipment_share_larger_than_the_appraisers_leaves_none() -> None:
    equipment, appraiser, _ = range_components(1.0, 0.01, 3.0, trials=3, appraisers=3, parts=10)
    assert (appraiser, equipment > 0) == (0.0, True)
