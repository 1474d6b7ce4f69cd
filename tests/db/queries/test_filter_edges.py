"""Where a filter begins and ends: the moment itself, and every character that a pattern could mistake."""

from __future__ import annotations

from datetime import timedelta
from uuid import UUID

import pytest

from db.connection import make_engine, parse_url
from db.queries import (
    Characteristic,
    Filter,
    ResultReader,
    Shift,
    characteristic_moments,
    checks,
    cycle_records,
    events,
    reasons,
    since_last_good_check,
    value_series,
    wheel_counts,
    yield_counts,
)
from db.records import EventRecord, Severity, VehicleRecord
from db.store import ResultStore
from db.sums import bring_up_to_date
from tests.db.example_records import CALIBRATION, NOON, check, cycle, station, wheel

TOE = Characteristic.parse("front_left.toe")
HOUR = timedelta(hours=1)
# On the hour, where the sums per hour begin and end, and within one.
ON_THE_HOUR = NOON.replace(microsecond=0) + HOUR
TIMES = [ON_THE_HOUR + minutes * timedelta(minutes=1) for minutes in (-30, 0, 30, 60, 90)]
VINS = ("AB_12", "ABC12", "ab_12", "AB%12", "AB\\12", "AB?12", "AB[C]12", "AB*12", "AB12", "XAB_12", "AB_12X")


def store_cycles(url: str, cycles: list[tuple[str, object]]) -> None:
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
        store.describe_station(station())
        for number, (vin, time) in enumerate(cycles, start=1):
            store.write_cycle(
                cycle(
                    UUID(int=number), vehicle=VehicleRecord(vin, "compact"), received_utc=time,
                    measured_utc=time, wheels=(wheel("front_left", measured_utc=time),), axles=(),
                    vehicle_angles=None,
                )
            )  # fmt: skip


@pytest.fixture
def periods(database_url: str) -> str:
    store_cycles(database_url, [(f"W{number}", time) for number, time in enumerate(TIMES)])
    with ResultStore(database_url) as store:
        for time in TIMES:
            store.record_event(EventRecord(time, "EOL-1", Severity.WARNING, "line", "x", str(time)))
            store.record_check(check(utc=time))
    return database_url


EDGES = [(1, 3), (0, 2), (2, 4), (1, 2), (3, 4)]


@pytest.mark.parametrize("summed", [False, True])
def test_period_holds_its_beginning_and_not_its_end(periods: str, summed: bool) -> None:
    """The vehicle that comes at the moment itself belongs to the shift that begins, in every answer."""
    if summed:
        engine = make_engine(parse_url(periods), timeout_s=5.0)
        assert bring_up_to_date(engine) == len(TIMES)
        engine.dispose()
    with ResultReader(periods) as reader:
        for first, last in EDGES:
            where = Filter(from_utc=TIMES[first], until_utc=TIMES[last])
            wanted = [f"W{number}" for number in range(first, last)]
            n = last - first
            assert value_series(reader, TOE, where).vin.tolist() == wanted
            found = [stored.record.vehicle for stored in cycle_records(reader, where)]
            assert [vehicle.vin for vehicle in found if vehicle] == wanted
            assert sum(counts.total for counts in yield_counts(reader, where)) == n
            assert sum(counts.ok for counts in wheel_counts(reader, where)) == n
            assert sum(each.n for each in characteristic_moments(reader, where, (TOE,))) == n
            assert [event.utc for event in events(reader, where)] == TIMES[first:last]
            assert [each.check.utc for each in checks(reader, where)] == TIMES[first:last]
            assert reasons(reader, where) == ()


def test_shift_holds_its_beginning_and_not_its_end(periods: str) -> None:
    shift = Shift("short", TIMES[1].time(), TIMES[3].time())
    day = TIMES[0].replace(hour=0, minute=0)
    where = Filter(from_utc=day, until_utc=day + timedelta(days=1), shift=shift)
    with ResultReader(periods) as reader:
        assert value_series(reader, TOE, where).vin.tolist() == ["W1", "W2"]
        assert sum(counts.total for counts in yield_counts(reader, where)) == 2


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("AB_12", {"AB_12"}),
        ("AB_1*", {"AB_12", "AB_12X"}),
        ("AB%1*", {"AB%12"}),
        ("AB\\1*", {"AB\\12"}),
        ("AB?1*", {"AB?12"}),
        ("AB[C]*", {"AB[C]12"}),
        ("ab*", {"ab_12"}),
        ("*B_12", {"AB_12", "XAB_12"}),
        ("*_12*", {"AB_12", "ab_12", "XAB_12", "AB_12X"}),
        ("AB12*", {"AB12"}),
        ("*", set(VINS)),
        ("_*", set()),
        ("%*", set()),
        ("AB*12", {vin for vin in VINS if vin.startswith("AB") and vin.endswith("12")}),
    ],
)
def test_star_alone_stands_for_anything(vins: str, pattern: str, expected: set[str]) -> None:
    """`_` and `%` stand for themselves; on SQLite `ab*` found `AB…` too, on PostgreSQL not."""
    with ResultReader(vins) as reader:
        where = Filter(vin=pattern)
        assert set(value_series(reader, TOE, where).vin.tolist()) == expected
        assert sum(counts.total for counts in yield_counts(reader, where)) == len(expected)
        assert {s.record.vehicle.vin for s in cycle_records(reader, where) if s.record.vehicle} == expected
        found = since_last_good_check(reader, where)
        assert {str(vin) for group in found for vin in group.vehicles.vin} == expected


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def vins(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    cycles = [(vin, NOON + number * HOUR) for number, vin in enumerate(VINS)]
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path_factory.mktemp('vins') / 'r.db'}"
        store_cycles(url, cycles)  # type: ignore[arg-type]
        yield url
    else:
        with request.getfixturevalue("postgres_server").database() as url:
            store_cycles(url, cycles)  # type: ignore[arg-type]
            yield url
