"""Sums of days: results that come late reach them, and a check sees a day that is not its hours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import timedelta

import pytest
from sqlalchemy import Engine, func, select

from alignment.errors import Deed, Remedy
from db.connection import make_engine, parse_url
from db.queries import Filter, ResultReader, yield_counts
from db.schema import value_sums
from db.store import ResultStore
from db.sums import bring_up_to_date, update_sums
from db.upkeep.check import check_database
from tests.db.example_records import CALIBRATION, NOON, cycle, station

MIDNIGHT = NOON.replace(hour=0, minute=0, second=0, microsecond=0)
DAY = timedelta(days=1)


@pytest.fixture
def engine(database_url: str, open_store: Callable[..., ResultStore]) -> Iterator[Engine]:
    store = open_store(database_url)
    store.record_calibration(CALIBRATION)
    store.describe_station(station())
    made = make_engine(parse_url(database_url), timeout_s=5.0)
    yield made
    made.dispose()


def write(url: str, days: list[float]) -> None:
    with ResultStore(url) as store:
        for day in days:
            received = MIDNIGHT + day * DAY
            store.write_cycle(cycle(received_utc=received, measured_utc=received + timedelta(seconds=2)))


def of_day(engine: Engine, day: int) -> int:
    """How many results the closed day has; 0 while it is open."""
    start = int((MIDNIGHT + day * DAY).timestamp()) // 3600
    query = select(func.coalesce(func.max(value_sums.c.n), 0)).where(
        value_sums.c.hours == 24, value_sums.c.start == start
    )
    with engine.connect() as connection:
        return int(connection.execute(query).scalar_one())


def test_results_that_come_late_reach_the_sums_of_their_day(database_url: str, engine: Engine) -> None:
    """A station that was away ships a day after it is closed; reports of whole days lacked it for ever."""
    write(database_url, [0.3, 0.7, 1.5, 2.5])
    assert bring_up_to_date(engine) == 4
    assert [of_day(engine, day) for day in range(4)] == [2, 1, 0, 0]
    write(database_url, [0.31, 1.9, 3.5])
    assert update_sums(engine) == 3
    assert [of_day(engine, day) for day in range(4)] == [3, 2, 1, 0]
    where = Filter(from_utc=MIDNIGHT, until_utc=MIDNIGHT + 2 * DAY)
    with ResultReader(database_url) as reader:
        assert sum(row.total for row in yield_counts(reader, where)) == 5
    assert check_database(database_url, days=None).findings == ()


@pytest.mark.parametrize(
    ("statement", "seen"),
    [
        ("UPDATE value_sums SET n = n + 1 WHERE hours = 24", "value_sums of the day 2026-11-22"),
        ("UPDATE value_sums SET mean = mean + 1e-7 WHERE hours = 24", "value_sums of the day 2026-11-22"),
        ("UPDATE value_sums SET m2_within = m2_within + 1e-6 WHERE hours = 24", "value_sums of the day"),
        ("UPDATE value_sums SET n_low = n_low + 1 WHERE hours = 24", "value_sums of the day 2026-11-22"),
        ("DELETE FROM value_sums WHERE hours = 24", "value_sums of the day 2026-11-22"),
        ("UPDATE result_counts SET n = n + 1 WHERE hours = 24", "result_counts of the day 2026-11-22"),
        ("DELETE FROM result_counts WHERE hours = 24", "result_counts of the day 2026-11-22"),
        ("UPDATE value_sums SET start = start + 48 WHERE hours = 24", "value_sums of the day 2026-11-2"),
    ],
)
def test_a_day_that_is_not_the_sum_of_its_hours_is_found(
    database_url: str, engine: Engine, statement: str, seen: str
) -> None:
    """Hours alone were compared, and reports of a month are made of days."""
    write(database_url, [0.3, 0.7, 1.5])
    bring_up_to_date(engine)
    assert check_database(database_url).findings == ()
    with engine.begin() as connection:
        connection.exec_driver_sql(statement)
    for days in (7.0, None):
        report = check_database(database_url, days=days)
        assert any(seen in finding for finding in report.findings), report.findings
        assert report.remedies == (Remedy(Deed.REBUILD_SUMS),)
