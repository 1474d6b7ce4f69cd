"""Which revisions a program opens, and what it says about the others."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Connection, Engine, inspect, text

import db.connection.revisions
from alignment.errors import StoreSchemaError, StoreUnavailableError
from db.connection import current_revision, head_revision, make_engine, migrate, parse_url
from db.schema import metadata
from db.store import ResultStore
from tests.db.example_records import CALIBRATION, cycle

# The face has a function of the same name.


def run(url: str, *statements: str) -> None:
    engine = make_engine(parse_url(url), timeout_s=5.0, create=True)
    with engine.begin() as connection:
        for statement in statements:
            connection.exec_driver_sql(statement)
    engine.dispose()


def described(connection: Connection) -> dict[str, object]:
    """Everything alembic does not compare: CHECKs with their text, names of keys."""
    inspector = inspect(connection)
    return {
        table: (
            sorted(
                (str(check["name"]), check["sqltext"]) for check in inspector.get_check_constraints(table)
            ),
            inspector.get_pk_constraint(table),
            sorted(str(key["name"]) for key in inspector.get_foreign_keys(table)),
            sorted(str(key["name"]) for key in inspector.get_unique_constraints(table)),
            [
                (column["name"], str(column["type"]), column["nullable"])
                for column in inspector.get_columns(table)
            ],
        )
        for table in metadata.tables
    }


def is_no_partition(name: str | None, kind: str, _: object) -> bool:
    return kind != "table" or not (name or "").startswith("wheel_results_")


def test_migrations_build_exactly_the_schema_of_the_program(empty_database_url: str) -> None:
    migrate(empty_database_url)
    engine: Engine = make_engine(parse_url(empty_database_url), timeout_s=5.0)
    with engine.connect() as connection:
        context = MigrationContext.configure(
            connection, opts={"target_metadata": metadata, "include_name": is_no_partition}
        )
        assert compare_metadata(context, metadata) == []
        migrated = described(connection)
    run(empty_database_url, *(f"DROP TABLE {table.name}" for table in reversed(metadata.sorted_tables)))
    with engine.begin() as connection:
        metadata.create_all(connection)
        assert described(connection) == migrated
    engine.dispose()


def test_an_empty_database_is_built_only_when_asked(empty_database_url: str) -> None:
    run(empty_database_url)
    assert current_revision(empty_database_url) is None
    with pytest.raises(StoreSchemaError, match=r"is empty\. Migrate the database"):
        ResultStore(empty_database_url).open()
    assert current_revision(empty_database_url) is None
    with ResultStore(empty_database_url, create=True) as store:
        assert store.counts()["cycles"] == 0
    assert current_revision(empty_database_url) == head_revision()
    with ResultStore(empty_database_url):
        pass


def test_a_missing_file_is_not_made_by_mistake(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'missing.db'}"
    for action in (lambda: ResultStore(url).open(), lambda: current_revision(url)):
        with pytest.raises(StoreUnavailableError, match=r"does not exist\. Make the database .* first"):
            action()
    assert list(tmp_path.iterdir()) == []


def test_migrating_twice_changes_nothing_and_keeps_the_data(
    empty_database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    assert migrate(empty_database_url) == head_revision()
    store = open_store(empty_database_url, create=False)
    store.record_calibration(CALIBRATION)
    record = cycle()
    store.write_cycle(record)
    assert migrate(empty_database_url) == head_revision()
    stored = store.cycle(record.uuid)
    assert stored is not None
    assert stored.record == record


def test_a_newer_database_is_refused_by_store_and_migration(empty_database_url: str) -> None:
    migrate(empty_database_url)
    run(empty_database_url, "UPDATE alembic_version SET version_num = '9999'")
    for action in (
        lambda: ResultStore(empty_database_url).open(),
        lambda: ResultStore(empty_database_url, create=True).open(),
        lambda: migrate(empty_database_url),
    ):
        with pytest.raises(StoreSchemaError) as caught:
            action()
        assert "database revision 9999 is newer than this program" in str(caught.value)
        assert "install the Truewheel version that migrated it" in str(caught.value)


def test_an_older_database_is_refused_with_the_command_that_cures_it(
    empty_database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    migrate(empty_database_url)
    current = head_revision()
    monkeypatch.setattr(db.connection.revisions, "_revisions", lambda: [current, "9999"])
    with pytest.raises(StoreSchemaError) as caught:
        ResultStore(empty_database_url).open()
    assert f"has revision {current}, older than revision 9999" in str(caught.value)
    assert "Migrate the database" in str(caught.value)


def test_a_downgrade_is_refused_with_the_reason(empty_database_url: str) -> None:
    migrate(empty_database_url)
    with pytest.raises(StoreSchemaError, match=r"would drop stored results\. Restore the backup"):
        migrate(empty_database_url, "0001")
    assert current_revision(empty_database_url) == head_revision()


def test_a_database_of_the_first_revision_keeps_its_rows_when_migrated(
    empty_database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    migrate(empty_database_url, "0001")
    run(
        empty_database_url, "INSERT INTO vehicles (vin, vehicle_type) VALUES ('TRUEWHEEL00000001', 'compact')"
    )
    assert migrate(empty_database_url) == head_revision()
    assert open_store(empty_database_url, create=False).counts()["vehicles"] == 1


def test_an_unknown_target_is_refused(sqlite_url: str) -> None:
    with pytest.raises(StoreSchemaError, match=r"expected one of the revisions 0001, .*found 'latest'"):
        migrate(sqlite_url, "latest")


def test_somebody_elses_database_is_left_alone(empty_database_url: str) -> None:
    run(empty_database_url, "CREATE TABLE invoices (id INTEGER)")
    for action in (
        lambda: migrate(empty_database_url),
        lambda: ResultStore(empty_database_url, create=True).open(),
        lambda: current_revision(empty_database_url),
    ):
        with pytest.raises(StoreSchemaError, match="found the tables invoices without a schema revision"):
            action()
    engine = make_engine(parse_url(empty_database_url), timeout_s=5.0)
    with engine.connect() as connection:
        assert inspect(connection).get_table_names() == ["invoices"]
    engine.dispose()


def test_a_migration_that_fails_leaves_the_database_as_it_was(
    empty_database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(empty_database_url)

    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    upgrade = db.connection.revisions.command.upgrade
    monkeypatch.setattr(db.connection.revisions.command, "upgrade", lambda *given: (upgrade(*given), fail()))
    with pytest.raises(KeyboardInterrupt):
        migrate(empty_database_url)
    monkeypatch.undo()
    assert current_revision(empty_database_url) is None
    assert migrate(empty_database_url) == head_revision()


def test_sqlite_writes_ahead_with_full_sync_and_foreign_keys(sqlite_url: str) -> None:
    migrate(sqlite_url)
    engine = make_engine(parse_url(sqlite_url), timeout_s=2.5)
    with engine.connect() as connection:
        pragmas = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
        }
    engine.dispose()
    assert pragmas == {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1, "busy_timeout": 2500}


def test_postgresql_commits_synchronously_in_utc(postgres_url: str) -> None:
    engine = make_engine(parse_url(f"{postgres_url}?options=-c%20search_path%3Dpublic"), timeout_s=2.5)
    with engine.connect() as connection:
        settings = {
            name: connection.execute(text(f"SHOW {name}")).scalar()
            for name in ("synchronous_commit", "TimeZone", "lock_timeout", "statement_timeout", "search_path")
        }
    engine.dispose()
    assert settings == {
        "synchronous_commit": "on",
        "TimeZone": "UTC",
        "lock_timeout": "2500ms",
        "statement_timeout": "5s",
        "search_path": "public",
    }


def test_a_file_whose_name_is_no_uri_is_found_again(tmp_path: Path) -> None:
    path = tmp_path / "Prüfstand 1 #2 50%.db"
    url = f"sqlite:///{path}"
    migrate(url)
    assert path.exists()
    assert current_revision(url) == head_revision()
    with sqlite3.connect(path) as connection:
        assert connection.execute("SELECT count(*) FROM cycles").fetchone() == (0,)
    connection.close()
