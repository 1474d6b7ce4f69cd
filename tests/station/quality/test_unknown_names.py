"""Filters with a name that nobody has: refused with the names that exist, in every verb that filters."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from db.connection import migrate
from station.quality.reports.choices import ReportKind

Run = Callable[..., tuple[int, str, str]]

WRONG = [
    (("--station", "Halle Ost"), ["--station", "Halle Nord, Halle Süd", "'Halle Ost'"]),
    (("--station", "halle süd"), ["Did you mean 'Halle Süd'?"]),
    (("--station", "Halle Süd", "--station", "x"), ["--station", "'x'"]),
    (("--type", "kompakt ü"), ["--type", "Kompakt ü", "Did you mean 'Kompakt ü'?"]),
    (("--type", "2"), ["--type", "Kompakt ü"]),
    (("--wheel", "front"), ["--wheel", "front_left, front_right", "Did you mean"]),
    (("--plant", "Werk 9"), ["--plant", "none yet"]),
    (("--vin", "WMONTH"), ["--vin", "the newest are WMONTH00000000120, "]),
    (("--vin", "XY*"), ["--vin", "the newest are"]),
]
ANGLES = [
    (("--characteristic", "front_lef.toe"), ["--characteristic", "front_left.camber, front_left.toe"]),
    (("--characteristic", "rear.total_toe"), ["--characteristic", "found 'rear.total_toe'"]),
]


@pytest.mark.parametrize("kind", [kind for kind in ReportKind if kind is not ReportKind.VIN])
@pytest.mark.parametrize(("wrong", "parts"), WRONG + ANGLES, ids="-".join)
def test_a_report_about_what_nobody_has_is_refused(
    month: str, run: Run, kind: ReportKind, wrong: tuple[str, ...], parts: list[str]
) -> None:
    """An unknown station or type gave an empty report, exit 0; the name of a type by case, too."""
    status, out, said = run("report", kind, "--database", month, *wrong)
    assert (status, out) == (2, "")
    for part in parts:
        assert part in said


@pytest.mark.parametrize("kind", ["aqdef", "csv", "parquet"])
@pytest.mark.parametrize(("wrong", "parts"), WRONG, ids="-".join)
def test_an_export_of_what_nobody_has_is_refused(
    month: str, run: Run, tmp_path: Path, kind: str, wrong: tuple[str, ...], parts: list[str]
) -> None:
    out = tmp_path / "out.dfq"
    status, _, said = run("export", kind, "--database", month, "--out", out, *wrong)
    assert status == 2
    assert not list(tmp_path.iterdir())
    for part in parts:
        assert part in said


@pytest.mark.parametrize(
    ("wrong", "parts"),
    [(("--station", "Halle Ost"), ["--station", "Halle Nord, Halle Süd"]), ANGLES[0]],
    ids="-".join,
)
def test_a_plan_for_what_nobody_has_is_refused(
    tmp_path: Path, run: Run, wrong: tuple[str, ...], parts: list[str]
) -> None:
    from tests.station.quality.conftest import write_month

    url = f"sqlite:///{tmp_path / 'own.db'}"
    write_month(url)
    plan = ["gauge", "plan", "grr", "--database", url, "--name", "a", "--part", "V1", "--part", "V2"]
    given = wrong if "--characteristic" in wrong else ("--characteristic", "front_left.toe", *wrong)
    status, _, said = run(*plan, *given)
    assert status == 2
    for part in parts:
        assert part in said
    assert run("gauge", "list", "--database", url)[1] == "no studies\n"


def test_what_exists_and_has_nothing_in_the_period_is_no_mistake(month: str, run: Run) -> None:
    asked = ("--station", "Halle Süd", "--type", "Kompakt ü", "--until", "2020-01-01")
    assert run("report", "yield", "--database", month, *asked)[0] == 0


def test_the_names_are_shown(month: str, run: Run) -> None:
    status, out, _ = run("db", "show", "--database", month, "--newest", 2)
    assert status == 0
    assert out.splitlines() == [
        "stations: Halle Nord, Halle Süd",
        "plants: none",
        "vehicle types: Kompakt ü",
        "wheels: front_left, front_right",
        "characteristics: front_left.camber, front_left.toe, front_right.camber, front_right.toe",
        "newest 2 VINs: WMONTH00000000120, WMONTH00000000119",
    ]
    found = json.loads(run("db", "show", "--database", month, "--json")[1])
    assert found["stations"] == ["Halle Nord", "Halle Süd"]
    assert len(found["vins"]) == 20


def test_an_empty_database_says_that_it_has_none(tmp_path: Path, run: Run) -> None:
    url = f"sqlite:///{tmp_path / 'empty.db'}"
    migrate(url)
    status, _, said = run("report", "yield", "--database", url, "--station", "a")
    assert status == 2
    assert "the database has none yet, found 'a'" in said
    assert "stations: none" in run("db", "show", "--database", url)[1]
