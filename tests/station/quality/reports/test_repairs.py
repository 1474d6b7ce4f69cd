"""The repair loop: what was found first, how often it came back, and who released what stayed bad."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from db.queries import Filter, ResultReader, repair_loop
from db.records import CycleOutcome, CycleRecord, VehicleRecord
from db.store import ResultStore
from station.quality.reports.choices import ReportKind
from station.quality.reports.make import ReportOptions, make_report, write_report
from tests.db.example_records import CALIBRATION, NOON, concession, cycle, not_ok

NOW = datetime(2026, 12, 1, tzinfo=UTC)
HOUR = timedelta(hours=1)


def measured(number: int, hours: float, outcome: str, station: str = "EOL-1") -> CycleRecord:
    made = not_ok if outcome == "nok" else cycle
    more = {"outcome": CycleOutcome(outcome)}
    if outcome in ("fault", "aborted"):
        more |= {"reason_code": "store", "reason_text": "the disk is full"}
    vehicle = VehicleRecord(f"TRUEWHEEL0000010{number}", "compact")
    return made(vehicle=vehicle, received_utc=NOON + hours * HOUR, station=station, **more)


RECORDS = (
    measured(1, 0.0, "ok"),
    # Came back twice, at another station at last.
    measured(2, 1.0, "nok"),
    measured(2, 2.0, "nok"),
    measured(2, 2.5, "ok", "EOL-2"),
    # No verdict at first: what counts is the first one.
    measured(3, 3.0, "fault"),
    measured(3, 4.0, "ok"),
    # Stays bad: released, and not.
    measured(4, 5.0, "nok"),
    measured(5, 6.0, "nok"),
    # Good, and looked at again.
    measured(6, 7.0, "ok"),
    measured(6, 30.0, "nok"),
    measured(7, 31.0, "aborted"),
)


@pytest.fixture(params=["sqlite", "postgresql"])
def reader(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[ResultReader]:
    with ExitStack() as stack:
        url = f"sqlite:///{tmp_path / 'r.db'}"
        if request.param == "postgresql":
            url = stack.enter_context(request.getfixturevalue("postgres_server").database())
        with ResultStore(url, create=True) as store:
            store.record_calibration(CALIBRATION)
            for record in RECORDS:
                store.write_cycle(record)
            store.grant_concession(concession(RECORDS[6].uuid))
        yield stack.enter_context(ResultReader(url))


def test_a_vehicle_counts_by_its_first_verdict_and_is_followed_to_its_last(reader: ResultReader) -> None:
    found = repair_loop(reader)
    (first,) = found.first
    assert (first.station, first.vehicle_type, first.vehicles, first.ok) == ("EOL-1", "compact", 6, 3)
    told = [
        (each.vin[-1], str(each.found), each.attempts, str(each.left), each.repair_s)
        for each in found.repaired
    ]
    assert told == [
        ("6", "ok", 2, "nok", None),
        ("5", "nok", 1, "nok", None),
        ("4", "nok", 1, "nok", None),
        ("2", "nok", 3, "ok", 1.5 * 3600.0),
    ]
    assert found.repaired[3].left_station == "EOL-2"
    assert [each.concession is not None for each in found.repaired] == [False, False, True, False]


def test_a_period_chooses_vehicles_by_their_first_verdict(reader: ResultReader) -> None:
    """A vehicle that came back the next day was counted as good at first on that day."""
    next_day = Filter(from_utc=NOON + 24.0 * HOUR)
    assert repair_loop(reader, next_day).first == ()
    early = repair_loop(reader, Filter(until_utc=NOON + 1.5 * HOUR))
    assert [(each.vehicles, each.ok) for each in early.first] == [(2, 1)]
    assert [each.left for each in early.repaired] == [CycleOutcome.OK]
    assert repair_loop(reader, Filter(stations=("EOL-2",))).first == ()
    assert len(repair_loop(reader, Filter(vehicle_types=("compact",)), newest=2).repaired) == 2


def test_the_report_says_share_times_and_who_released(reader: ResultReader, tmp_path: Path) -> None:
    report = make_report(reader, ReportKind.REPAIRS, Filter(), ReportOptions(), NOW)
    sections = {section.name: section for section in report.sections}
    assert sections["first_pass"].figures == {"vehicles_judged": 6, "first_pass_percent": 50.0}
    assert sections["repairs"].figures == {
        "repaired": 1,
        "released": 1,
        "not_ok": 2,
        "repair_median_min": 90.0,
        "repair_p95_min": 90.0,
    }
    rows = {str(row["vin"])[-1]: row for row in sections["repairs"].rows}
    assert rows["4"]["released_by"] == "A. Example"
    assert rows["4"]["as_left"] == "nok"
    write_report(tmp_path / "repairs.html", report)
    text = (tmp_path / "repairs.html").read_text(encoding="utf-8")
    assert "A. Example" in text


def test_nobody_was_judged(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'r.db'}"
    with ResultStore(url, create=True):
        pass
    with ResultReader(url) as empty:
        report = make_report(empty, ReportKind.REPAIRS, Filter(), ReportOptions(), NOW)
    assert [section.rows for section in report.sections] == [[], []]
