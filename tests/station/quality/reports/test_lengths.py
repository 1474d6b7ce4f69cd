"""Reports of lengths: in millimetres, beside the angles and never in one table with them."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from alignment.statistics import ChartKind
from db.queries import Characteristic, Filter, Quantity, ResultReader
from db.records import CycleOutcome
from db.store import ResultStore
from station.quality.reports.choices import ReportKind
from station.quality.reports.make import ReportOptions, make_report, write_report
from station.quality.reports.report import Report
from tests.db.databases import new_database
from tests.db.example_records import CALIBRATION
from tests.db.queries.test_lengths import RECORDS, TRACKS

TRACK = Characteristic("vehicle", Quantity.TRACK_FRONT)
NOW = datetime(2026, 11, 30, tzinfo=UTC)


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> str:
    url = new_database(tmp_path_factory.mktemp("lengths") / "r.db")
    with ResultStore(url) as store:
        store.record_calibration(CALIBRATION)
        for record in RECORDS:
            store.write_cycle(record)
    return url


def asked(url: str, kind: ReportKind, where: Filter | None = None, *wanted: Characteristic) -> Report:
    with ResultReader(url) as reader:
        options = ReportOptions(characteristics=wanted, chart=ChartKind.INDIVIDUALS)
        return make_report(reader, kind, where or Filter(), options, NOW)


def test_capability_of_lengths_stands_beside_that_of_angles(database: str) -> None:
    """Millimetres would have been multiplied by 57.3 and called degrees."""
    angles, lengths = asked(database, ReportKind.CAPABILITY).sections
    assert (angles.name, lengths.name) == ("capability", "capability_lengths")
    assert not any("_mm" in name for row in angles.rows for name in row)
    rows = {row["characteristic"]: row for row in lengths.rows}
    assert set(rows) == {"vehicle.track_front", "front_left.run_out"}
    track = rows["vehicle.track_front"]
    assert track["mean_mm"] == pytest.approx(np.mean(TRACKS))
    assert track["sigma_mm"] == pytest.approx(np.std(TRACKS, ddof=1))
    assert (track["low_mm"], track["high_mm"]) == (1510.0, 1515.0)
    assert any(picture.x_label == "millimetres" for picture in lengths.pictures)


def test_one_length_alone_gives_its_figures_in_millimetres(database: str) -> None:
    report = asked(database, ReportKind.CAPABILITY, None, TRACK)
    assert report.as_json()["figures"]["mean_mm"] == pytest.approx(np.mean(TRACKS))
    (chart, signals) = asked(database, ReportKind.CHART, None, TRACK).sections
    assert (chart.name, signals.name) == ("chart", "signals")
    assert chart.rows[0]["centre_mm"] == pytest.approx(np.mean(TRACKS))


def test_report_of_a_vehicle_shows_kind_load_run_out_and_the_tyres_share(
    database: str, tmp_path: Path
) -> None:
    report = asked(database, ReportKind.VIN, Filter(vin="TRUEWHEEL00000003"))
    sections = {section.name: section.rows for section in report.sections}
    lengths = {row["length"]: row for row in sections["lengths"]}
    assert lengths["vehicle.track_front"]["value_mm"] == TRACKS[3]
    assert lengths["vehicle.wheelbase_left"]["verdict"] == "without limits"
    assert lengths["vehicle.wheelbase_left"]["between"] == "contact_centres"
    assert "front_left.run_out" in lengths
    assert "vehicle.yaw" in {row["angle"] for row in sections["angles"]}
    wheels = {row["wheel"]: row for row in sections["wheels"]}
    assert (wheels["front_left"]["kind"], wheels["front_left"]["load_mm"]) == ("spin_axis", 0.25)
    assert wheels["front_left"]["run_out_u95_mm"] == pytest.approx(0.1)
    assert wheels["front_left"]["toe_u95_deg"] == pytest.approx(math.degrees(2e-5))
    assert wheels["front_left"]["tyre_share_percent"] == pytest.approx(36.0)
    for name in ("r.html", "r.pdf"):
        write_report(tmp_path / name, report)


def test_pareto_and_yield_count_vehicles_whose_lengths_are_out(database: str) -> None:
    (pareto,) = asked(database, ReportKind.PARETO).sections
    assert {"track_front_low", "track_front_high"} <= {row["reason"] for row in pareto.rows}
    figures = asked(database, ReportKind.YIELD).as_json()["figures"]
    assert figures["nok"] == sum(record.outcome is CycleOutcome.NOK for record in RECORDS)


def test_all_reports_together_take_lengths(database: str) -> None:
    names = [section.name for section in asked(database, ReportKind.ALL).sections]
    assert len(set(names)) == len(names)
