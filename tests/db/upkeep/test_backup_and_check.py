"""Copies are whole and restore to the same; a check finds what should be impossible."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import psycopg
import pytest
from typer.testing import CliRunner

from alignment.errors import Deed, FormatError, Remedy, StoreError
from db.connection import make_engine, migrate, parse_url
from db.store import ResultStore
from db.sums import bring_up_to_date
from db.upkeep.backups import backup, restore
from db.upkeep.check import check_database
from db.upkeep.shipping import Shipper
from station.cli import app
from tests.db.example_plant import plant
from tests.db.example_records import CALIBRATION, cycle, study, study_value
from tests.db.queries.test_lengths import RECORDS as VEHICLES


@pytest.fixture
def filled(database_url: str) -> str:
    with ResultStore(database_url, create=True) as store:
        store.record_calibration(CALIBRATION)
        for record in plant(30):
            store.write_cycle(record)
    engine = make_engine(parse_url(database_url), timeout_s=5.0)
    assert bring_up_to_date(engine) == 30
    engine.dispose()
    return database_url


@pytest.fixture
def elsewhere(filled: str, tmp_path: Path) -> Iterator[str]:
    if filled.startswith("sqlite"):
        yield f"sqlite:///{tmp_path / 'restored.db'}"
        return
    name = filled.rsplit("/", 1)[1] + "_again"
    with psycopg.connect(filled, autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}".encode())
    yield filled + "_again"
    with psycopg.connect(filled, autocommit=True) as connection:
        connection.execute(f"DROP DATABASE {name} WITH (FORCE)".encode())


def test_a_copy_restores_to_the_same_results(filled: str, elsewhere: str, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    backup(filled, copy)
    assert not list(tmp_path.glob("*.part*"))
    restore(copy, elsewhere)
    with ResultStore(filled) as before, ResultStore(elsewhere) as after:
        assert after.counts() == before.counts()
        assert after.recent_cycles(100) == before.recent_cycles(100)
        # Still append-only, still writable.
        after.write_cycle(cycle())
    assert check_database(elsewhere).findings == ()
    with pytest.raises(StoreError, match="stays as it is"):
        restore(copy, elsewhere)
    with pytest.raises(FormatError, match="Name another; it is left alone"):
        backup(filled, copy)


def test_lengths_and_run_outs_come_back_from_a_copy(filled: str, elsewhere: str, tmp_path: Path) -> None:
    with ResultStore(filled) as store:
        for record in VEHICLES:
            store.write_cycle(record)
    copy = tmp_path / "copy"
    backup(filled, copy)
    restore(copy, elsewhere)
    with ResultStore(elsewhere) as store:
        found = {stored.record.uuid: stored.record for stored in store.recent_cycles(200)}
    for record in VEHICLES:
        assert found[record.uuid] == record
    assert check_database(elsewhere, days=None).findings == ()


def test_a_copy_of_another_kind_of_database_is_refused(filled: str, tmp_path: Path) -> None:
    other = (
        "postgresql://nobody@127.0.0.1:9/x"
        if filled.startswith("sqlite")
        else f"sqlite:///{tmp_path / 'x.db'}"
    )
    copy = tmp_path / "copy"
    backup(filled, copy)
    with pytest.raises(FormatError, match="the kind of database it was made of"):
        restore(copy, other)


def test_a_healthy_database_has_no_findings(filled: str) -> None:
    report = check_database(filled, days=None)
    assert report.findings == ()
    assert (report.cycles, report.behind) == (30, 0)
    assert report.pending == (31 if filled.startswith("sqlite") else None)


def test_sums_that_disagree_are_found_and_built_again(filled: str) -> None:
    engine = make_engine(parse_url(filled), timeout_s=5.0)
    with engine.begin() as connection:
        connection.exec_driver_sql("UPDATE value_sums SET mean = mean + 1e-6 WHERE hours = 1")
    engine.dispose()
    assert check_database(filled).remedies == (Remedy(Deed.REBUILD_SUMS),)
    found = CliRunner().invoke(app, ["db", "check", "--database", filled, "--json"])
    assert found.exit_code == 1
    assert json.loads(found.stdout)["figures"]["findings"] == 10
    found = CliRunner().invoke(app, ["db", "sums", "--rebuild", "--database", filled, "--json"])
    assert json.loads(found.stdout)["figures"] == {"cycles_added": 30}
    assert check_database(filled, days=None).findings == ()


def test_a_cycle_that_vanished_from_a_file_is_found(tmp_path: Path) -> None:
    path = tmp_path / "results.db"
    with ResultStore(f"sqlite:///{path}", create=True) as store:
        store.record_calibration(CALIBRATION)
        for _ in range(3):
            store.write_cycle(cycle())
    with sqlite3.connect(path) as connection:
        connection.execute("DROP TRIGGER cycles_no_delete")
        connection.execute("DELETE FROM cycles WHERE id = 2")
    connection.close()
    findings = " ".join(check_database(f"sqlite:///{path}").findings)
    assert "2 cycles are stored, 3 are in the outbox" in findings
    assert "wheel_results name a row of cycles that is not there" in findings


def test_a_record_that_vanished_on_the_way_is_found(postgres_url: str, tmp_path: Path) -> None:
    migrate(postgres_url)
    local = f"sqlite:///{tmp_path / 'station.db'}"
    with ResultStore(local, create=True) as store, Shipper(local, postgres_url, "EOL-1") as shipper:
        store.record_calibration(CALIBRATION)
        store.write_cycle(cycle())
        store.write_cycle(cycle())
        shipper.ship()
    assert check_database(postgres_url).findings == ()
    with psycopg.connect(postgres_url) as connection:
        connection.execute("ALTER TABLE arrivals DISABLE TRIGGER USER")
        connection.execute("DELETE FROM arrivals WHERE sequence = 2")
    assert "2 records arrived, and they count up to 3" in check_database(postgres_url).findings[0]


def test_two_databases_that_shipped_as_one_station_at_once_are_found(
    postgres_url: str, tmp_path: Path
) -> None:
    migrate(postgres_url)
    for turn in range(2):
        for name in ("a", "b"):
            local = f"sqlite:///{tmp_path / name}.db"
            with (
                ResultStore(local, create=turn == 0) as store,
                Shipper(local, postgres_url, "EOL-1") as shipper,
            ):
                store.record_calibration(CALIBRATION)
                store.write_cycle(cycle())
                shipper.ship()
    assert "two stations have the same id" in check_database(postgres_url).findings[0]


def test_the_commands_say_what_they_did(tmp_path: Path, open_store: Callable[..., ResultStore]) -> None:
    url = f"sqlite:///{tmp_path / 'results.db'}"
    open_store(url).record_calibration(CALIBRATION)
    runner = CliRunner()
    done = runner.invoke(
        app, ["db", "backup", "--database", url, "--out", str(tmp_path / "copy.db"), "--json"]
    )
    assert json.loads(done.stdout)["figures"]["bytes"] > 0
    done = runner.invoke(app, ["db", "restore", str(tmp_path / "copy.db"), "--database", f"{url}2", "--json"])
    assert json.loads(done.stdout) == {"revision": migrate(url)}
    done = runner.invoke(app, ["db", "check", "--database", f"{url}2"])
    assert done.exit_code == 0
    assert "nothing is wrong" in done.stdout


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """An SQLite file with three cycles and a gauge study, closed."""
    path = tmp_path / "results.db"
    with ResultStore(f"sqlite:///{path}", create=True) as store:
        store.record_calibration(CALIBRATION)
        for _ in range(3):
            store.write_cycle(cycle())
        planned = study()
        store.plan_study(planned)
        store.record_study_values([study_value(planned.uuid)])
    return path


def test_a_damaged_file_is_no_backup(file: Path, tmp_path: Path) -> None:
    """A copy is taken page by page, so that it is sound must be looked at; an index that lost its entries."""
    with closing(sqlite3.connect(file)) as connection:
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'ix_cycles_vehicle_id'"
        (page,) = connection.execute(query).fetchone()
    content = bytearray(file.read_bytes())
    # The number of entries of the index's only page.
    content[(page - 1) * 4096 + 3 : (page - 1) * 4096 + 5] = bytes(2)
    file.write_bytes(content)
    with pytest.raises(StoreError, match=r"is damaged.*Restore an older backup"):
        backup(f"sqlite:///{file}", tmp_path / "copy.db")
    with pytest.raises(StoreError, match=r"is damaged"):
        restore(file, f"sqlite:///{tmp_path / 'again.db'}")
    assert {path.name for path in tmp_path.iterdir()} <= {file.name, f"{file.name}-wal", f"{file.name}-shm"}
    assert any("the file is damaged" in finding for finding in check_database(f"sqlite:///{file}").findings)


def test_a_restored_file_has_everything_to_ship_again(file: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(file)) as connection, connection:
        (before,) = connection.execute("SELECT origin FROM shipments").fetchone()
        connection.execute("UPDATE shipments SET shipped_sequence = 6")
    backup(f"sqlite:///{file}", tmp_path / "copy.db")
    again = f"sqlite:///{tmp_path / 'again.db'}"
    restore(tmp_path / "copy.db", again)
    assert check_database(again).pending == 6
    with closing(sqlite3.connect(tmp_path / "again.db")) as connection:
        assert connection.execute("SELECT origin FROM shipments").fetchone() != (before,)


@pytest.mark.parametrize(
    ("statement", "seen"),
    [
        ("UPDATE shipments SET shipped_sequence = 99", "99 records are called shipped, the outbox has 6"),
        ("DELETE FROM gauge_studies", "table gauge_values, row 1 refers to a row of gauge_studies"),
        ("DELETE FROM outbox WHERE sequence = 3", "the outbox holds 5 entries and counts up to 6"),
        ("DELETE FROM gauge_values", "the outbox names the study_value"),
    ],
)
def test_what_does_not_fit_together_in_a_file_is_found(file: Path, statement: str, seen: str) -> None:
    with closing(sqlite3.connect(file)) as connection, connection:
        for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            connection.execute(f"DROP TRIGGER {name}")
        connection.execute(statement)
    found = check_database(f"sqlite:///{file}").findings
    assert any(finding.startswith(seen) for finding in found), found
