"""Who only reads cannot write, and no text that a person types becomes a statement."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import psycopg
import pytest

from alignment.errors import InputError, StoreError
from db.connection import make_engine, parse_url
from db.queries import (
    Characteristic,
    Filter,
    Quantity,
    ResultReader,
    characteristic_moments,
    checks,
    cycle_records,
    events,
    gauge_studies,
    reasons,
    since_last_good_check,
    value_series,
    vin_history,
    wheel_counts,
    yield_counts,
)
from db.records import EventRecord, Severity
from db.store import ResultStore
from db.sums import update_sums
from tests.db.example_plant import plant
from tests.db.example_records import (
    CALIBRATION,
    NOON,
    check,
    installation,
    limits,
    station,
    study,
    study_value,
)

WRITES = (
    "INSERT INTO vehicles (vin, vehicle_type) VALUES ('X', 'y')",
    "UPDATE sums_state SET last_cycle_id = 0",
    "DELETE FROM value_sums",
    "DELETE FROM wheel_results",
    "DROP TABLE gauge_values",
    "CREATE TABLE mine (id integer)",
    "ALTER TABLE cycles ADD COLUMN mine integer",
)
HOSTILE = (
    "' OR '1'='1",
    "'; DROP TABLE cycles; --",
    "TRUEWHEEL%' UNION SELECT name FROM sqlite_master --",
    "\\'; TRUNCATE cycles; --",
    "_" * 17,
    "%(vin)s",
    ":vin ? $1",
    "*' OR 1=1 --",
)


def fill(url: str) -> None:
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
        store.describe_station(station(), (limits(),), (installation(),))
        store.record_check(check())
        for record in plant(20):
            store.write_cycle(record)
        planned = study()
        store.plan_study(planned)
        store.record_study_values([study_value(planned.uuid)])
        store.record_event(EventRecord(NOON, "EOL-1", Severity.INFO, "station", "start", "started 100%"))


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def filled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path_factory.mktemp('access') / 'results.db'}"
        fill(url)
        yield url
    else:
        with request.getfixturevalue("postgres_server").database() as url:
            fill(url)
            yield url


def contents(url: str) -> dict[str, int]:
    with ResultStore(url) as store:
        return store.counts()


@pytest.mark.parametrize("statement", WRITES)
def test_a_reader_cannot_write_whatever_its_user_may(filled: str, statement: str) -> None:
    before = contents(filled)
    with (
        ResultReader(filled) as reader,
        pytest.raises(StoreError, match=r"read-?\s?only|not writable"),
        reader.transaction() as connection,
    ):
        connection.exec_driver_sql(statement)
    assert contents(filled) == before


@pytest.fixture
def report_role(postgres_url: str) -> Iterator[str]:
    """URL of a user with the rights that docs/database.md gives a report's user, and no others."""
    fill(postgres_url)
    documentation = (Path(__file__).parents[3] / "docs" / "database.md").read_text()
    statements = documentation.split("```sql\n")[1].split("```")[0]
    database = parse_url(postgres_url).database
    with psycopg.connect(postgres_url, autocommit=True) as connection:
        connection.execute(statements.replace("results", str(database)).encode())
        connection.execute("ALTER ROLE report PASSWORD 'lesen'")
    yield str(
        parse_url(postgres_url).set(username="report", password="lesen").render_as_string(hide_password=False)
    ).replace("+psycopg", "")
    with psycopg.connect(postgres_url, autocommit=True) as connection:
        connection.execute("DROP OWNED BY report; DROP ROLE report")


def test_a_report_user_reads_everything_and_writes_nothing(report_role: str) -> None:
    with ResultReader(report_role) as reader:
        assert sum(row.total for row in yield_counts(reader)) == 20
        assert len(gauge_studies(reader)) == 1
        assert characteristic_moments(reader) != ()
    for statement in (*WRITES, "TRUNCATE cycles", "SELECT setval('cycles_id_seq', 1)"):
        # Past the program, with a client of one's own.
        with (
            psycopg.connect(report_role) as connection,
            pytest.raises(psycopg.errors.InsufficientPrivilege),
        ):
            connection.execute(statement.encode())
    with pytest.raises(StoreError):
        ResultStore(report_role).open()


def test_a_file_that_may_only_be_read_answers(tmp_path: Path) -> None:
    path = tmp_path / "results.db"
    fill(f"sqlite:///{path}")
    path.chmod(0o444)
    if os.geteuid() != 0:
        tmp_path.chmod(0o555)
    try:
        with ResultReader(f"sqlite:///{path}") as reader:
            assert sum(row.total for row in yield_counts(reader)) == 20
    finally:
        tmp_path.chmod(0o755)


def asked(reader: ResultReader, hostile: str) -> Iterator[Callable[[], object]]:
    """Every question, the hostile text in every place that takes one."""
    filters = [
        lambda: Filter(vin=hostile),
        lambda: Filter(stations=(hostile,)),
        lambda: Filter(plants=(hostile,)),
        lambda: Filter(vehicle_types=(hostile,)),
        lambda: Filter(wheels=(hostile,)),
    ]
    toe = Characteristic("front_left", Quantity.TOE)
    for make in filters[:4]:
        yield lambda make=make: yield_counts(reader, make())
        yield lambda make=make: value_series(reader, toe, make()).vin.tolist()
        yield lambda make=make: list(cycle_records(reader, make()))
    for make in filters:
        yield lambda make=make: wheel_counts(reader, make())
        yield lambda make=make: reasons(reader, make())
        yield lambda make=make: [
            m for m in characteristic_moments(reader, make()) if m.characteristic.part in ("front_left",)
        ]
    for make in filters[1:]:
        yield lambda make=make: [found for found in since_last_good_check(reader, make()) if found.vehicles]
    yield lambda: checks(reader, Filter(stations=(hostile,)))
    yield lambda: vin_history(reader, hostile).cycles
    yield lambda: list(value_series(reader, Characteristic(hostile, Quantity.TOE)).vin)
    yield lambda: characteristic_moments(reader, characteristics=(Characteristic(hostile, Quantity.TOE),))
    yield lambda: events(reader, codes=(hostile,))
    yield lambda: events(reader, Filter(stations=(hostile,)))
    # What is looked for in the text is found in none but the text itself.
    yield lambda: [event for event in events(reader, text=hostile) if hostile not in event.text]
    yield lambda: [s for s in gauge_studies(reader, text=hostile) if hostile not in s.name + s.comment]


def test_hostile_text_finds_nothing_and_changes_nothing(filled: str) -> None:
    engine = make_engine(parse_url(filled), timeout_s=5.0)
    # Half of it in the sums, so that both ways of answering are asked.
    update_sums(engine, most=10)
    engine.dispose()
    before = contents(filled)
    with ResultReader(filled) as reader:
        for hostile in HOSTILE:
            for question in asked(reader, hostile):
                assert list(question()) == [], hostile  # type: ignore[call-overload]
    assert contents(filled) == before


def test_text_that_no_database_stores_is_refused_before_it_gets_there(filled: str) -> None:
    with ResultReader(filled) as reader:
        for ask in (
            lambda: vin_history(reader, "\0"),
            lambda: events(reader, text="\ud800"),
            lambda: gauge_studies(reader, text="\0"),
            lambda: Characteristic("\0", Quantity.TOE),
        ):
            with pytest.raises(InputError, match="text without NUL"):
                ask()


def test_a_star_stands_for_anything_and_nothing_else_does(filled: str) -> None:
    with ResultReader(filled) as reader:
        assert sum(row.total for row in yield_counts(reader, Filter(vin="TRUEWHEEL0000001*"))) == 10
        assert sum(row.total for row in yield_counts(reader, Filter(vin="*7"))) == 2
        assert yield_counts(reader, Filter(vin="TRUEWHEEL0000001_")) == ()
