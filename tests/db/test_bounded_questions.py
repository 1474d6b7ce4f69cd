"""What a station asks at its start and at each cycle reads the same few rows, however much is stored."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from datetime import timedelta
from typing import Any
from uuid import UUID

import psycopg
import pytest
from sqlalchemy.event import listen

from db.connection import make_engine, parse_url
from db.records import EventRecord, Severity
from db.rows import record_of
from db.store import ResultStore
from db.sums import bring_up_to_date, update_sums
from station.cycle.answering.answers import Standing
from station.cycle.recording.held import Closing, closing_text, unacknowledged
from tests.db.example_records import (
    CALIBRATION,
    NOON,
    cycle,
    installation,
    limits,
    revocation,
    station,
    zero,
)
from tests.db.pool import pool_of

MANY = 20_000
# Steps of SQLite's machine, and rows that PostgreSQL reads: for a handful of rows, not for thousands.
MOST_STEPS, MOST_ROWS = 60_000, 2_000
COUNT = f"WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < {MANY})"


def uuids(prefix: str, sqlite: bool) -> str:
    if sqlite:
        return f"printf('{prefix}%030x', i)"
    return f"lpad(to_hex(i), 32, '{prefix}0000000')::uuid"


def fill(url: str) -> None:
    """Thousands of rows where a station of one day has a few."""
    sqlite = url.startswith("sqlite")
    time = "'2026-11-01 12:00:00.000000'"
    each = (
        "strftime('%Y-%m-%d %H:%M:%f000', '2026-10-01', i || ' minutes')"
        if sqlite
        else "timestamptz '2026-10-01' + i * interval '1 minute'"
    )
    numbered = "printf('z%d', i)" if sqlite else "'z' || i"
    code = f"CASE i % 2 WHEN 0 THEN '{Closing.ACKNOWLEDGED}' ELSE 'started' END"
    no = "0" if sqlite else "false"
    statements = (
        "INSERT INTO cycles (uuid, station, trigger_sequence, received_utc, stored_utc, software_version,"
        f" config_hash, outcome, reason_code, reason_text) {COUNT} SELECT {uuids('aa', sqlite)}, 'EOL-1', i,"
        f" {time}, {time}, '1', 'x', 'fault', 'c', 't' FROM n",
        f"INSERT INTO events (uuid, utc, station, severity, source, code, text) {COUNT} SELECT"
        f" {uuids('bb', sqlite)}, {time}, 'EOL-1', 'info', 's', {code}, 't' FROM n",
        "INSERT INTO zero_measurements (id, rig, calibration_id, measured_utc, master, method, shots, camber,"
        " toe, certified_camber, certified_toe, camber_u, toe_u, correlation, software_version, stored_utc)"
        f" {COUNT} SELECT {numbered}, 'front_left', '{CALIBRATION.id}', {each}, 'm', 'm', 1, 0, 0, 0, 0,"
        f" 1e-5, 1e-5, 0, '1', {time} FROM n",
        "INSERT INTO station_versions (uuid, station_id, plant_id, valid_from_utc, label, software_version,"
        f" config_hash, configuration, stored_utc) {COUNT} SELECT {uuids('cc', sqlite)}, 1, 1, {time}, 'l',"
        f" '1', 'x', '{{}}', {time} FROM n",
        "INSERT INTO vehicle_type_limits (uuid, station_id, vehicle_type, valid_from_utc, guard_band, limits,"
        f" stored_utc) {COUNT} SELECT {uuids('dd', sqlite)}, 1, 'van', {time}, {no}, '{{}}', {time} FROM n",
        "INSERT INTO installations (uuid, rig_id, calibration_id, from_utc, stored_utc)"
        f" {COUNT} SELECT {uuids('ee', sqlite)}, 2, '{CALIBRATION.id}', {time}, {time} FROM n",
    )
    if sqlite:
        with sqlite3.connect(url.removeprefix("sqlite:///")) as connection:
            for statement in statements:
                connection.execute(statement)
        connection.close()
        return
    with psycopg.connect(url, autocommit=True, options="-c timezone=UTC") as server:
        for statement in statements:
            # PostgreSQL wants text told to be a time, a document.
            typed = statement.replace(time, f"timestamptz {time}").replace("'{}'", "'{}'::jsonb")
            server.execute(typed.encode())
        server.execute("ANALYZE")


class Work:
    """What a database has done so far."""

    def __init__(self, url: str, store: ResultStore) -> None:
        self._url, self._store, self.steps = url, store, 0

    def of(self, ask: Callable[[], object]) -> int:
        if self._url.startswith("sqlite"):
            with pool_of(self._store).connect() as connection:
                driver = connection.connection.driver_connection
                assert isinstance(driver, sqlite3.Connection)
            # The same connection comes back from the pool.
            before = self.steps
            driver.set_progress_handler(self._count, 100)
            ask()
            driver.set_progress_handler(None, 100)
            return 100 * (self.steps - before)
        before = self._rows()
        ask()
        # A server counts when a connection ends.
        pool_of(self._store).dispose()
        return self._rows() - before

    def _count(self) -> None:
        self.steps += 1

    def _rows(self) -> int:
        with psycopg.connect(self._url, autocommit=True) as server:
            row = server.execute(
                "SELECT sum(seq_tup_read + coalesce(idx_tup_fetch, 0))::bigint FROM pg_stat_user_tables"
                " WHERE relname IN ('cycles', 'events', 'zero_measurements', 'station_versions',"
                " 'vehicle_type_limits', 'installations', 'chain_links', 'zero_revocations')"
            ).fetchone()
        assert row is not None
        return int(row[0])


@pytest.mark.slow
def test_a_start_and_a_cycle_read_a_few_rows_of_a_large_database(
    database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    """A station with a new id read all cycles of all stations: 10 s and 477 MB for 26,000 of them."""
    store = open_store(database_url)
    store.record_calibration(CALIBRATION)
    store.describe_station(station(), (limits(),), (installation(),))
    fill(database_url)
    last = cycle()
    store.write_cycle(last)
    engine = make_engine(parse_url(database_url), timeout_s=30.0)
    bring_up_to_date(engine)
    asked: dict[str, Callable[[], object]] = {
        "last cycle": lambda: unacknowledged(store, "EOL-1"),
        "last cycle of a new station": lambda: unacknowledged(store, "EOL-NEW"),
        "calibration": lambda: store.record_calibration(CALIBRATION),
        "description": lambda: store.describe_station(station(label="b"), (limits(),), (installation(),)),
        "description of a new station": lambda: store.describe_station(
            station(station="EOL-NEW"), (limits(station="EOL-NEW"),), (installation(station="EOL-NEW"),)
        ),
        "zeros": lambda: store.zeros_in_force([("front_left", CALIBRATION.id), ("rear_left", "other")]),
        "event": lambda: store.record_event(
            EventRecord(
                NOON,
                "EOL-1",
                Severity.INFO,
                "s",
                Closing.ACKNOWLEDGED,
                closing_text(last.uuid, 7),
                cycle_uuid=last.uuid,
            )
        ),
        "cycle": lambda: store.write_cycle(cycle()),
    }
    work = Work(database_url, store)
    done = {name: work.of(ask) for name, ask in asked.items()}
    most = MOST_STEPS if database_url.startswith("sqlite") else MOST_ROWS
    assert {name: number for name, number in done.items() if number > most} == {}, done
    # Counted at all: what reads everything is seen.
    assert work.of(store.zeros_in_force) > most
    assert update_sums(engine) == 1
    engine.dispose()


def test_the_last_cycle_of_a_station_and_what_became_of_it(store: ResultStore) -> None:
    mine, later, others = cycle(), cycle(), cycle(station="EOL-2")
    for record in (mine, later, others):
        store.write_cycle(record)
    found = unacknowledged(store, "EOL-1")
    assert found is not None
    assert found[0] == later
    assert unacknowledged(store, "EOL-3") is None

    def close(uuid: UUID, code: str, name: str = "EOL-1", ago: float = 0.0) -> None:
        utc = NOON - timedelta(seconds=ago)
        said = EventRecord(utc, name, Severity.INFO, "s", code, closing_text(uuid, 7), cycle_uuid=uuid)
        store.record_event(said)

    close(mine.uuid, Closing.ACKNOWLEDGED)
    close(later.uuid, "not_acknowledged")
    # What a person writes is no acknowledgement, whatever it begins with.
    text = closing_text(later.uuid, 7)
    store.record_event(EventRecord(NOON, "EOL-1", Severity.INFO, "s", Closing.ACKNOWLEDGED, text))
    close(others.uuid, Closing.ACKNOWLEDGED, "EOL-2")
    assert unacknowledged(store, "EOL-1") is not None
    # By a clock that was set back an hour since.
    close(later.uuid, Closing.ACKNOWLEDGED, ago=3600.0)
    assert unacknowledged(store, "EOL-1") is None
    assert [event.code for event in store.recent_events(1, "EOL-1")] == [Closing.ACKNOWLEDGED]
    assert [event.station for event in store.recent_events(9, "EOL-2")] == ["EOL-2"]
    assert len(store.recent_events(1, "EOL-1", ("not_acknowledged", Closing.ACKNOWLEDGED))) == 2


def test_the_zeros_of_what_is_installed_are_those_in_force(store: ResultStore) -> None:
    first, second = zero("a"), zero("b", measured_utc=NOON + timedelta(hours=1))
    for record in (second, first, zero("c", rig="rear_left")):
        store.record_zero(record)
    assert store.zeros_in_force([("front_left", CALIBRATION.id)]) == (second,)
    assert store.zeros_in_force([("front_left", "other"), ("rear_right", CALIBRATION.id)]) == ()
    assert store.zeros_in_force([]) == ()
    assert {zero.id for zero in store.zeros_in_force()} == {"b", "c"}
    store.revoke_zero(revocation("b"))
    assert store.zeros_in_force([("front_left", CALIBRATION.id)]) == (first,)
    assert {zero.id for zero in store.zeros_in_force()} == {"a", "c"}
    found = store.zero("b")
    assert found is not None
    assert (found.record, found.revocation) == (second, revocation("b"))
    assert store.zero("d") is None


class Asked:
    """The questions that a database is asked meanwhile, and how many rows become records."""

    def __init__(self, store: ResultStore, monkeypatch: pytest.MonkeyPatch) -> None:
        self.statements: list[str] = []
        self.records = 0
        listen(pool_of(store), "before_cursor_execute", self._note)
        monkeypatch.setattr("db.rows.reading.record_of", self.counted)

    def _note(self, connection: object, cursor: object, statement: str, *_: object) -> None:
        if statement.startswith("SELECT"):
            self.statements.append(statement)

    def counted(self, *given: Any, **nested: Any) -> Any:
        self.records += 1
        return record_of(*given, **nested)


def test_zeros_in_force_are_one_question_and_no_other_rows(
    store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every zero measurement was read at each start, and Python kept the newest of each rig."""
    rigs = ("front_left", "front_right", "rear_left")
    for number in range(30):
        for rig in rigs:
            late = NOON + timedelta(hours=number)
            store.record_zero(zero(f"{rig}-{number}", rig=rig, measured_utc=late))
    for number in range(20, 30):
        store.revoke_zero(revocation(f"front_left-{number}"))
    asked = Asked(store, monkeypatch)
    installed = [(rig, CALIBRATION.id) for rig in (*rigs, "rear_right")]
    newest = {"front_left-19", "front_right-29", "rear_left-29"}
    for of in (installed, None):
        assert {one.id for one in store.zeros_in_force(of)} == newest
        assert (len(asked.statements), asked.records) == (1, len(rigs))
        asked.statements, asked.records = [], 0
    assert store.zero("rear_left-3") is not None
    assert (len(asked.statements), asked.records) == (1, 1)


def test_what_became_of_a_cycle_is_one_question_and_a_row_for_each_answer(
    store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was looked for in the texts of the last events."""
    last = cycle()
    store.write_cycle(last)
    for code in (*[Closing.OFFERED] * 3, *["not_acknowledged"] * 50):
        said = EventRecord(NOON, "EOL-1", Severity.INFO, "s", code, "", cycle_uuid=last.uuid)
        store.record_event(said)
    asked = Asked(store, monkeypatch)
    monkeypatch.setattr("db.store.record_of", asked.counted)
    found = unacknowledged(store, "EOL-1")
    assert found is not None
    assert found[1] is Standing.COMMITTED
    # The cycle, its wheels, axles, vehicle, geometry, steering, axes, what was turned, doubts; its events.
    assert len(asked.statements) == 10
    of_cycle = 1 + len(last.wheels) + len(last.axles) + 2
    assert asked.records == of_cycle + 1
