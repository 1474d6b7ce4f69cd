"""Gauge studies in the database: planned, filled from live cycles or a file, and the same again."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest

from alignment.errors import ConfigurationError, InputError
from alignment.statistics.choices import GrrMethod
from db.queries import Characteristic
from db.records import StudyKind, VehicleRecord
from db.store import ResultStore
from station.cli import main
from station.quality.gauge.analysis import analyse_grr
from station.quality.gauge.plan import plan_from_text
from station.quality.gauge.source import open_source, source_of
from station.quality.gauge.store import all_studies, fill_study, load_gauge_study, plan_study
from tests.db.databases import new_database
from tests.db.example_records import CALIBRATION, cycle, refused_wheel, wheel

VINS = ("GAUGEVEHICLE00001", "GAUGEVEHICLE00002", "GAUGEVEHICLE00003")
TOE = Characteristic.parse("front_left.toe")


@pytest.fixture
def database(tmp_path: Path) -> str:
    url = new_database(tmp_path / "results.db")
    with ResultStore(url) as store:
        store.record_calibration(CALIBRATION)
    return url


def run(arguments: list[str]) -> int:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    return int(end.value.code or 0)


def drive(database: str, vin: str, toe_deg: float | None, number: int) -> UUID:
    """One cycle of a vehicle, in the future of the plan; None for a wheel that is refused."""
    uuid = UUID(int=10_000 + number)
    time = datetime.now(UTC) + timedelta(minutes=1 + number)
    bad = toe_deg is None
    measured = refused_wheel("front_left") if bad else wheel("front_left", toe=math.radians(toe_deg or 0.0))
    record = cycle(
        uuid, vehicle=VehicleRecord(vin, "compact"), received_utc=time, measured_utc=time,
        wheels=(measured,), axles=(), vehicle_angles=None, outcome="fault" if bad else "ok",
        reason_code="refused" if bad else None, reason_text="refused" if bad else None,
    )  # fmt: skip
    with ResultStore(database) as store:
        store.write_cycle(record)
    return uuid


def test_plan_runs_through_all_parts_in_a_new_order_each_time(database: str) -> None:
    record = plan_study(
        database, StudyKind.GRR, "night", TOE, VINS, appraisers=("Jö", "Al"), trials=3, seed=4
    )
    order = record.plan["order"]
    assert sorted(map(tuple, order)) == sorted(
        (vin, who, trial) for vin in VINS for who in ("Jö", "Al") for trial in (1, 2, 3)
    )
    blocks = [tuple(run[0] for run in order[start : start + 3]) for start in range(0, 18, 3)]
    assert all(set(block) == set(VINS) for block in blocks)
    assert len(set(blocks)) > 1
    assert (
        plan_study(
            database, StudyKind.GRR, "again", TOE, VINS, appraisers=("Jö", "Al"), trials=3, seed=4
        ).plan["order"]
        == order
    )


def test_live_cycles_fill_a_plan_and_a_refusal_is_driven_again(database: str) -> None:
    plan_study(database, StudyKind.GRR, "live", TOE, VINS, trials=2, tolerance=math.radians(0.2), seed=1)
    values = {VINS[0]: [0.10, 0.101], VINS[1]: [None, 0.05, 0.051], VINS[2]: [0.15]}
    number = 0
    for turn in range(3):
        for vin in VINS:
            if turn < len(values[vin]):
                drive(database, vin, values[vin][turn], number)
                number += 1
    first = fill_study(database, "live")
    assert (first.added, [(run.part, run.trial) for run in first.missing]) == (5, [(VINS[2], 2)])
    drive(database, VINS[2], 0.151, number)
    second = fill_study(database, "live")
    assert (second.added, second.missing) == (1, ())
    assert fill_study(database, "live").added == 0

    source = source_of(load_gauge_study(database, StudyKind.GRR, "live"))
    assert source.unit == "deg"
    assert source.number("tolerance", None) == pytest.approx(0.2)
    found = {(row.part, row.trial): float(row.value) for row in source.rows}
    assert found[VINS[1], 1] == pytest.approx(0.05)
    assert found[VINS[2], 2] == pytest.approx(0.151)
    with_cycles = load_gauge_study(database, None, "live").values
    assert all(value.cycle is not None and value.utc is not None for value in with_cycles)


def test_cycles_before_the_plan_are_not_its_and_runs_follow_the_clock(database: str) -> None:
    """A vehicle that was there yesterday, and cycles that reached the database in another order."""
    drive(database, VINS[0], 0.19, -24 * 60)
    plan_study(database, StudyKind.GRR, "clock", TOE, VINS[:1], trials=3, seed=1)
    for toe_deg, number in ((0.12, 20), (0.10, 0), (0.11, 10)):
        drive(database, VINS[0], toe_deg, number)
    assert fill_study(database, "clock").added == 3
    rows = source_of(load_gauge_study(database, StudyKind.GRR, "clock")).rows
    assert [(row.trial, round(float(row.value), 6)) for row in rows] == [(1, 0.1), (2, 0.11), (3, 0.12)]


def test_same_figures_from_the_stored_values_as_from_the_file(
    database: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(3)
    file = tmp_path / "study.csv"
    parts = rng.normal(0, 1.0, 10)
    lines = [
        f"P{part},{who},{trial},{parts[part] + rng.normal(0, 0.05):.4f}"
        for part in range(10) for who in "AB" for trial in (1, 2, 3)
    ]  # fmt: skip
    file.write_text("part,appraiser,trial,value\n" + "\n".join(lines))
    run(["gauge", "grr", "--from-file", str(file), "--json", "--unit", "mm"])
    from_file = json.loads(capsys.readouterr().out)
    run(
        ["gauge", "grr", "--from-file", str(file), "--json", "--unit", "mm", "--database", database,
         "--name", "Prüfmittel 1", "--tolerance", "10"]
    )  # fmt: skip
    stored = json.loads(capsys.readouterr().out)
    run(["gauge", "grr", "--database", database, "--study", "Prüfmittel 1", "--json"])
    again = json.loads(capsys.readouterr().out)
    assert again["figures"] == stored["figures"]
    assert again["unit"] == "mm"
    for name, value in from_file["figures"].items():
        assert stored["figures"][name] == pytest.approx(value, rel=1e-12)
    run(["gauge", "list", "--database", database, "--json"])
    (listed,) = json.loads(capsys.readouterr().out)["studies"]
    assert (listed["name"], listed["values"], listed["planned"]) == ("Prüfmittel 1", 60, 60)


def test_part_2_comes_before_part_10(database: str, tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text("part,value\n" + "".join(f"P{part},{part}\nP{part},{part}.5\n" for part in (10, 2, 1)))
    source = open_source(StudyKind.GRR, file, database, None, "order", "", {})
    assert [row.part for row in source.rows] == ["P1", "P1", "P2", "P2", "P10", "P10"]


def test_linearity_keeps_its_certified_values(database: str, tmp_path: Path) -> None:
    file = tmp_path / "l.csv"
    file.write_text(
        "reference,value\n" + "\n".join(f"{r},{r + d}" for r in (1, 2, 3) for d in (0.01, -0.01, 0.0))
    )
    source = open_source(StudyKind.LINEARITY, file, database, None, "lin", "°", {})
    assert sorted({float(row.reference or 0) for row in source.rows}) == [1.0, 2.0, 3.0]
    assert source.unit == "°"


def test_two_studies_of_one_name_are_refused(database: str) -> None:
    plan_study(database, StudyKind.GRR, "one", TOE, VINS)
    with pytest.raises(ConfigurationError, match="a name that no study has"):
        plan_study(database, StudyKind.GRR, "one", TOE, VINS)
    assert len(all_studies(database)) == 1


def test_study_that_is_not_there_or_of_another_kind_is_named(database: str) -> None:
    plan_study(database, StudyKind.GRR, "one", TOE, VINS)
    with pytest.raises(InputError, match="list of the studies"):
        load_gauge_study(database, StudyKind.GRR, "two")
    with pytest.raises(InputError, match="of kind grr"):
        load_gauge_study(database, StudyKind.TYPE1, "one")


def test_incomplete_study_says_what_is_missing(database: str) -> None:
    plan_study(database, StudyKind.GRR, "half", TOE, VINS, trials=2)
    for number, vin in enumerate((*VINS, *VINS[:2])):
        drive(database, vin, 0.1 + 0.01 * number, number)
    fill_study(database, "half")
    source = source_of(load_gauge_study(database, None, "half"))
    with pytest.raises(InputError, match=r"half.*2 values.*found 1"), source.named_in_errors():
        analyse_grr(source.rows, GrrMethod.RANGE)


@pytest.mark.parametrize(
    ("kind", "parts", "said"),
    [
        ("grr", ["A"], "at least 2 parts"),
        ("type1", ["A=0.1", "B=0.2"], "one part"),
        ("type1", ["A"], "VIN=DEGREES"),
        ("linearity", ["A=1", "B=x"], "degrees"),
        ("grr", ["A*", "B"], "without"),
        ("grr", ["A", "A"], "each once"),
        ("guess", ["A"], "kind"),
    ],
)
def test_impossible_plans_are_refused(database: str, kind: str, parts: list[str], said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        plan_from_text(database, kind, "x", "front_left.toe", parts, [], 3, None, None, 0)
    assert all_studies(database) == []


def test_plan_fill_and_list_on_the_command_line(database: str, capsys: pytest.CaptureFixture[str]) -> None:
    run(
        ["gauge", "plan", "type1", "--database", database, "--name", "master", "--characteristic",
         "front_left.toe", "--part", f"{VINS[0]}=0.1", "--trials", "12", "--tolerance", "0.2", "--json"]
    )  # fmt: skip
    assert len(json.loads(capsys.readouterr().out)["order"]) == 12
    for number in range(12):
        drive(database, VINS[0], 0.1 + 0.001 * math.sin(number), number)
    run(["gauge", "fill", "master", "--database", database, "--json"])
    assert json.loads(capsys.readouterr().out)["missing"] == []
    run(["gauge", "type1", "--database", database, "--study", "master", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (found["reference"], found["tolerance"]) == pytest.approx((0.1, 0.2))
    assert found["figures"]["cg"] > 1.33
    assert run(["gauge", "fill", "nothing", "--database", database]) == 2
