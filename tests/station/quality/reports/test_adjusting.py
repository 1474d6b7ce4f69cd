"""The report of adjusting: times, first pass and drift, from what is stored of each adjuster."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from db.queries import Filter, ResultReader, adjusted
from db.records import AdjustingRecord, CycleOutcome, CycleRecord, VehicleRecord, Verdict
from db.store import ResultStore
from station.quality.reports.choices import ReportKind
from station.quality.reports.make import ReportOptions, make_report, write_report
from station.quality.reports.report import Report
from tests.db.example_records import CALIBRATION, adjusting, cycle, wheel

NOW = datetime(2026, 11, 30, tzinfo=UTC)
VAN = VehicleRecord("TRUEWHEEL00000002", "van")


def once(
    name: str = "front_left", begun_s: float = 2.0, ended_s: float = 32.0, **more: Any
) -> AdjustingRecord:
    return adjusting(name, corrections=1, begun_s=begun_s, ended_s=ended_s, **more)


def vehicle(*turned: AdjustingRecord, outcome: CycleOutcome = CycleOutcome.OK, **more: Any) -> CycleRecord:
    if outcome is CycleOutcome.NOK:
        more |= {"wheels": (wheel(verdict=Verdict.NOK, toe=0.1),)}
    elif outcome is CycleOutcome.ABORTED:
        more |= {"reason_code": "aborted", "reason_text": "the line sent an abort"}
    return cycle(outcome=outcome, adjustings=turned, **more)


RECORDS = (
    # Both sides at once: 40 s from the first turn to the last.
    vehicle(once(drift=0.001), once("front_right", 12.0, 42.0, drift=0.002)),
    vehicle(once(ended_s=52.0), adjusting("front_right", corrections=2, nuts_locked=2, drift=0.004)),
    # One correction, and outside after it.
    vehicle(once(ended_s=62.0, nuts_locked=0, drift=None), outcome=CycleOutcome.NOK),
    vehicle(once(ended_s=72.0, nuts_locked=0, drift=None), outcome=CycleOutcome.ABORTED),
    # Nothing had to be turned.
    cycle(),
    vehicle(once(adjuster="camber_bolt", drift=-0.001, outcome="unreachable", reason="range"), vehicle=VAN),
)


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    with ExitStack() as stack:
        if request.param == "sqlite":
            url = f"sqlite:///{tmp_path / 'r.db'}"
        else:
            url = stack.enter_context(request.getfixturevalue("postgres_server").database())
        with ResultStore(url, create=True) as store:
            store.record_calibration(CALIBRATION)
            for record in RECORDS:
                store.write_cycle(record)
        yield url


def asked(url: str, where: Filter | None = None) -> Report:
    with ResultReader(url) as reader:
        return make_report(reader, ReportKind.ADJUSTING, where or Filter(), ReportOptions(), NOW)


def test_times_first_pass_and_drift_are_those_of_the_records(database: str, tmp_path: Path) -> None:
    report = asked(database)
    vehicles, locking = report.sections
    rows = {(row["by"], row["name"]): row for row in vehicles.rows}
    assert set(rows) == {("all", ""), ("station", "EOL-1"), ("type", "compact"), ("type", "van")}
    compact = rows["type", "compact"]
    assert [compact[name] for name in ("vehicles", "ok", "nok", "no_verdict")] == [4, 2, 1, 1]
    # The second needed two corrections of a rod, the third was outside after one; the fourth: no verdict.
    assert compact["first_pass_percent"] == pytest.approx(100.0 / 3.0)
    # 40, 50, 60 and 70 s.
    assert compact["time_median_s"] == pytest.approx(55.0)
    assert compact["time_p95_s"] == pytest.approx(68.5)
    assert compact["unreachable"] == 0
    assert rows["type", "van"]["unreachable"] == 1
    drifts = {(row["type"], row["axle"], row["adjuster"]): row for row in locking.rows}
    assert set(drifts) == {("compact", "front", "tie_rod"), ("van", "front", "camber_bolt")}
    rods = drifts["compact", "front", "tie_rod"]
    # 1 and 2, one that stands for itself (1.5), and 4 of two nuts, in thousandths of a radian.
    assert rods["nuts"] == 5
    assert rods["mean_deg"] == pytest.approx(math.degrees(12.5e-3 / 5.0))
    assert rods["most_deg"] == pytest.approx(math.degrees(0.004))
    figures = report.as_json()["figures"]
    assert figures["vehicles_adjusted"] == 5
    assert figures["nuts_locked"] == 6
    assert figures["adjusting_first_pass_percent"] == pytest.approx(50.0)
    for name in ("r.html", "r.pdf"):
        write_report(tmp_path / name, report)


def test_a_filter_leaves_its_vehicles_and_wheels(database: str) -> None:
    with ResultReader(database) as reader:
        assert {each.vehicle_type for each in adjusted(reader, Filter(vehicle_types=("van",)))} == {"van"}
        assert len(adjusted(reader, Filter(wheels=("front_right",)))) == 2
        assert {each.outcome for each in adjusted(reader, Filter(verdict=Verdict.NOK))} == {CycleOutcome.NOK}
        newest = adjusted(reader, newest=2)
        assert [each.vehicle_type for each in newest] == ["van", "compact"]
        assert newest[0].record == RECORDS[-1].adjustings[0]


def test_nothing_adjusted_is_a_report_that_says_so(database: str) -> None:
    report = asked(database, Filter(stations=("EOL-9",)))
    assert [list(section.rows) for section in report.sections] == [[], []]
    assert report.as_json()["figures"] == {
        "vehicles_adjusted": 0,
        "adjusting_first_pass_percent": None,
        "adjusting_time_median_s": None,
        "adjusting_time_p95_s": None,
        "nuts_locked": 0,
    }


def test_the_report_of_everything_tells_of_adjusting_where_a_vehicle_was_adjusted(database: str) -> None:
    def sections(where: Filter) -> set[str]:
        with ResultReader(database) as reader:
            report = make_report(reader, ReportKind.ALL, where, ReportOptions(), NOW)
        return {section.name for section in report.sections}

    assert {"adjusting", "locking_drift"} <= sections(Filter())
    assert not {"adjusting", "locking_drift"} & sections(Filter(stations=("EOL-9",)))
