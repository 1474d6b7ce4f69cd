"""The budget of a vehicle: every source alone, and all together, by the vehicle's own frame."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from alignment.units import ARCMIN
from alignment.vehicle.wheel_axes import FOUR_WHEELS
from station.studies import vehicle_budget
from station.studies.vehicle_budget import ErrorSource, budget_of, contributions
from station.studies.vehicle_stand import draw_vehicle_on_stand, measured_axes

U = 0.02 * ARCMIN


def known() -> tuple[dict, list[ErrorSource]]:
    rng = np.random.default_rng(2)
    nothing = {name: np.zeros((5, 5)) for name in FOUR_WHEELS}
    axes = measured_axes(draw_vehicle_on_stand(rng), nothing, rng, warm=False)
    angles = np.diag([U, U, 0.0, 0.0, 0.0]) ** 2
    lift = np.diag([3.0 * U, U, 0.0, 0.0, 0.0]) ** 2
    tilt = np.zeros(20)
    # Both sides lean to the left: camber of the left wheels falls as that of the right ones rises.
    tilt[[0, 10]], tilt[[5, 15]] = -4.0 * U, 4.0 * U
    return axes, [
        ErrorSource("noise", dict.fromkeys(FOUR_WHEELS, angles)),
        ErrorSource("load", dict.fromkeys(FOUR_WHEELS, lift)),
        ErrorSource("frame", {}, np.outer(tilt, tilt)),
        ErrorSource("warm", {}, warm=True),
        ErrorSource("widths", {}, uneven=True),
        ErrorSource("one exposure", dict.fromkeys(FOUR_WHEELS, 1e4 * angles)),
    ]


def test_each_source_is_seen_where_it_counts_and_nowhere_else() -> None:
    axes, sources = known()
    found = contributions(axes, sources)
    assert found["noise"]["front_left.camber"] == pytest.approx(U, rel=1e-6)
    assert found["noise"]["front.total_toe"] == pytest.approx(math.sqrt(2.0) * U, rel=1e-6)
    assert found["load"]["front_left.camber"] == pytest.approx(3.0 * U, rel=1e-6)
    assert found["frame"]["front_left.camber"] == pytest.approx(4.0 * U, rel=1e-6)
    assert found["frame"]["front_left.toe"] == pytest.approx(0.0, abs=5e-3 * U)
    assert found["widths"]["front.total_toe"] == pytest.approx(0.0, abs=5e-3 * U)
    assert found["widths"]["front_left.toe"] > 0.3 * ARCMIN
    assert found["warm"]["wheelbase_left"] == pytest.approx(12e-6 * 0.5 * 2700.0, rel=0.2)


def test_all_together_are_the_root_of_the_squares_and_one_exposure_is_in_no_sum() -> None:
    axes, sources = known()
    result = budget_of(axes, sources)
    assert not result.missed
    camber = 2.0 * math.sqrt(1.0 + 9.0 + 16.0) * U / ARCMIN
    assert result.figures["camber_u95_arcmin"] == pytest.approx(camber, rel=1e-3)
    assert result.figures["single_exposure_camber_u95_arcmin"] == pytest.approx(200.0 * U / ARCMIN, rel=1e-3)
    assert result.figures["equal_tyres_toe_u95_arcmin"] < 0.2 * result.figures["toe_u95_arcmin"]
    rows = {row["source"]: row for row in result.rows}
    assert rows["all together"]["toe_u95_arcmin"] == result.figures["toe_u95_arcmin"]
    assert "| all together |" in result.text
    json.dumps(result.as_json(), allow_nan=False)


@pytest.mark.slow(22)
def test_the_budget_of_a_rendered_vehicle_is_that_of_the_page() -> None:
    """The page is written by the study; whoever changes what it rests on writes it anew."""
    result = vehicle_budget.run(0, True, lambda done, doing: None)
    page = (vehicle_budget_page()).splitlines()
    (together,) = [line for line in page if line.startswith("| all together |")]
    told = [float(cell) for cell in together.strip("| ").split("|")[1:]]
    (row,) = [row for row in result.rows if row["source"] == "all together"]
    found = [value for name, value in row.items() if name != "source"]
    assert found == pytest.approx(told, rel=0.2, abs=0.01)


def vehicle_budget_page() -> str:
    from pathlib import Path

    text = (Path(__file__).parents[3] / "docs" / "accuracy.md").read_text(encoding="utf-8")
    return text.split("## vehicle-budget")[1].split("\n## ")[0]
