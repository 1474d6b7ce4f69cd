"""Bad moments: what was acknowledged stays, and the error says what to do."""

from __future__ import annotations

import os
import resource
import shutil
import sqlite3
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from uuid import UUID

import psycopg
import pytest
from sqlalchemy import event
from sqlalchemy.pool import Pool

from alignment.errors import ConfigurationError, StoreError, StoreUnavailableError
from db.connection import describe, migrate, parse_url
from db.store import ResultStore
from tests.db.example_records import CALIBRATION, cycle, wheel


def sqlite_path(url: str) -> Path:
    return Path(url.removeprefix("sqlite:///"))


def test_a_record_that_contradicts_itself_is_refused_whole(
    store: ResultStore,
) -> None:
    wheels = (wheel("front_left"), wheel("front_right", toe=0.1))
    with pytest.raises(StoreError, match=r"contradicts itself.*ck_wheel_results_ok_is_within_limits"):
        store.write_cycle(cycle(wheels=wheels))
    assert store.counts()["cycles"] == store.counts()["vehicles"] == 0


def test_a_number_that_a_column_cannot_hold_is_refused(
    postgres_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(postgres_url)
    store.record_calibration(CALIBRATION)
    with pytest.raises(StoreError, match=r"failed\. See the database's own message.*out of range"):
        store.write_cycle(cycle(wheels=(wheel(points_used=2**40),)))


def test_readers_that_take_every_connection_do_not_hang_the_writer(
    sqlite_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(sqlite_url, timeout_s=0.05)
    with ExitStack() as readers:
        for _ in range(15):
            readers.enter_context(store.reading())
        with pytest.raises(StoreUnavailableError, match=r"cannot be used.*timed out"):
            store.write_cycle(cycle())


def test_a_locked_database_says_so_in_time_and_the_repeated_write_succeeds(
    sqlite_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(sqlite_url, timeout_s=0.05)
    store.record_calibration(CALIBRATION)
    record = cycle()
    other = sqlite3.connect(sqlite_path(sqlite_url), isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(StoreUnavailableError, match="is locked by another program"):
        store.write_cycle(record)
    # Readers go on.
    assert store.counts()["cycles"] == 0
    other.close()
    store.write_cycle(record)
    assert store.counts()["cycles"] == 1


def test_a_locked_postgresql_says_so_in_time(
    postgres_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(postgres_url, timeout_s=0.1)
    store.record_calibration(CALIBRATION)
    record = cycle()
    with psycopg.connect(postgres_url) as other:
        other.execute("LOCK TABLE cycles")
        with pytest.raises(StoreUnavailableError, match="is locked by another program"):
            store.write_cycle(record)
    store.write_cycle(record)
    assert store.counts()["cycles"] == 1


def test_a_server_that_dropped_all_connections_is_used_again(
    postgres_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(postgres_url)
    store.record_calibration(CALIBRATION)
    store.write_cycle(cycle())
    with psycopg.connect(postgres_url, autocommit=True) as other:
        ended = other.execute(
            "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity"
            " WHERE datname = current_database() AND application_name = 'truewheel'"
        ).fetchone()
    assert ended is not None
    assert ended[0] >= 1
    store.write_cycle(cycle())
    assert store.counts()["cycles"] == 2


@pytest.fixture
def full_disk(sqlite_url: str) -> Iterator[Callable[[], None]]:
    """Let the database's files grow by half a megabyte and no more."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill() -> None:
        path = sqlite_path(sqlite_url)
        size = max(path.stat().st_size, path.with_name(path.name + "-wal").stat().st_size)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 500_000, hard))

    yield fill
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def write_until_refused(store: ResultStore, written: list[UUID]) -> None:
    for _ in range(1000):
        record = cycle()
        store.write_cycle(record)
        written.append(record.uuid)


def test_a_disk_that_fills_up_loses_nothing_and_is_used_again_after(
    sqlite_url: str, open_store: Callable[..., ResultStore], full_disk: Callable[[], None]
) -> None:
    store = open_store(sqlite_url)
    store.record_calibration(CALIBRATION)
    written: list[UUID] = []
    full_disk()
    with pytest.raises(StoreError, match="the disk"):
        write_until_refused(store, written)
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    assert len(written) > 1
    assert [stored.record.uuid for stored in store.recent_cycles(1000)] == written[::-1]
    store.write_cycle(cycle())
    assert store.counts()["cycles"] == len(written) + 1


def test_a_database_that_may_not_grow_is_called_full(
    sqlite_url: str, open_store: Callable[..., ResultStore]
) -> None:
    migrate(sqlite_url)

    def limit(connection: sqlite3.Connection, _: object) -> None:
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        connection.execute(f"PRAGMA max_page_count={pages + 5}")

    event.listen(Pool, "connect", limit)
    try:
        store = open_store(sqlite_url)
        store.record_calibration(CALIBRATION)
        with pytest.raises(StoreError, match=r"the disk is full\. Free some space"):
            write_until_refused(store, [])
    finally:
        event.remove(Pool, "connect", limit)


@pytest.fixture
def ordinary_user() -> Iterator[Callable[[Path], None]]:
    """Hand a folder to a user without privileges and become that user: root may write everything."""
    if os.geteuid() != 0:
        yield lambda folder: None
        return

    def become(folder: Path) -> None:
        for path in (folder, *folder.iterdir()):
            os.chown(path, 65534, 65534)
        os.seteuid(65534)

    yield become
    os.seteuid(0)


@pytest.fixture
def open_folder() -> Iterator[Path]:
    # Under pytest's own folder no other user gets through.
    folder = Path(tempfile.mkdtemp(prefix="truewheel-"))
    yield folder
    folder.chmod(0o700)
    shutil.rmtree(folder)


def test_a_file_that_may_not_be_written_is_found_when_opening(
    open_folder: Path, ordinary_user: Callable[[Path], None]
) -> None:
    path = open_folder / "results.db"
    migrate(f"sqlite:///{path}")
    ordinary_user(open_folder)
    path.chmod(0o444)
    with pytest.raises(StoreError, match=r"is not writable\. Give this user the right"):
        ResultStore(f"sqlite:///{path}").open()


def test_a_folder_that_may_not_be_written_is_named(
    open_folder: Path, ordinary_user: Callable[[Path], None]
) -> None:
    ordinary_user(open_folder)
    open_folder.chmod(0o555)
    with pytest.raises(StoreUnavailableError, match=r"results\.db cannot be opened.*folder exists"):
        ResultStore(f"sqlite:///{open_folder / 'results.db'}", create=True).open()


def test_a_file_that_is_no_database_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("camber of the prototype\n" * 100)
    for action in (
        lambda: ResultStore(f"sqlite:///{path}", create=True).open(),
        lambda: migrate(f"sqlite:///{path}"),
    ):
        with pytest.raises(StoreError, match=r"notes\.txt is not an SQLite database"):
            action()
    assert path.read_text() == "camber of the prototype\n" * 100


def test_a_damaged_file_is_called_damaged(sqlite_url: str) -> None:
    with ResultStore(sqlite_url, create=True) as store:
        store.record_calibration(CALIBRATION)
        for _ in range(50):
            store.write_cycle(cycle())
    path = sqlite_path(sqlite_url)
    content = bytearray(path.read_bytes())
    content[4096 * 5 :] = b"\xa5" * (len(content) - 4096 * 5)
    path.write_bytes(content)
    with pytest.raises(StoreError, match=r"is damaged.*restore the last backup"):
        read_all(sqlite_url)


def read_all(url: str) -> None:
    with ResultStore(url) as store:
        store.recent_cycles(100)
        store.counts()


def test_a_database_moved_away_is_not_replaced_by_an_empty_one(
    sqlite_url: str, open_store: Callable[..., ResultStore], tmp_path: Path
) -> None:
    migrate(sqlite_url)
    store = ResultStore(sqlite_url)
    path = sqlite_path(sqlite_url)
    path.rename(tmp_path / "moved.db")
    with pytest.raises(StoreUnavailableError, match="does not exist"):
        store.open()
    assert not path.exists()


def test_a_server_that_is_not_there_is_named_without_its_password() -> None:
    url = "postgresql://quality:geheim-7@127.0.0.1:9/results"
    with pytest.raises(StoreUnavailableError, match=r"cannot be reached\. Check host, port") as caught:
        ResultStore(url).open()
    shown = "".join(traceback.format_exception(caught.value))
    assert "postgresql://quality:***@127.0.0.1:9/results" in str(caught.value)
    assert "geheim-7" not in shown


def test_a_wrong_password_is_not_repeated(postgres_url: str) -> None:
    url = parse_url(postgres_url).set(password="geheim-7").render_as_string(hide_password=False)
    with pytest.raises(StoreUnavailableError) as caught:
        ResultStore(url).open()
    assert "password authentication failed" in str(caught.value)
    assert "geheim-7" not in "".join(traceback.format_exception(caught.value))


def test_a_missing_database_on_a_server_is_named(postgres_url: str) -> None:
    with pytest.raises(StoreUnavailableError, match='database "absent" does not exist'):
        ResultStore(postgres_url.rsplit("/", 1)[0] + "/absent").open()


def test_a_standby_or_a_role_that_may_only_read_is_named(postgres_url: str) -> None:
    migrate(postgres_url)
    with psycopg.connect(postgres_url, autocommit=True) as connection:
        connection.execute(
            "ALTER ROLE truewheel IN DATABASE "
            f"{connection.info.dbname} SET default_transaction_read_only = on"
        )
    with pytest.raises(StoreError, match="is read-only"):
        ResultStore(postgres_url).open()


@pytest.mark.parametrize(
    ("url", "seen"),
    [
        ("results.db", "something that is no URL"),
        ("postgresql://quality:geheim-7@host:port/results", "something that is no URL"),
        ("mysql://quality:geheim-7@host/results", "a URL that begins with 'mysql:'"),
        ("sqlite://", "an SQLite database in memory"),
        ("sqlite:///:memory:", "an SQLite database in memory"),
        ("sqlite:///", "an SQLite database in memory"),
        ("sqlite:///%20", "an SQLite database in memory"),
        ("sqlite:/// ", "an SQLite database in memory"),
        ("sqlite:///results.db?mode=memory", "the parameters mode"),
        ("sqlite:///results.db?immutable=1&nolock=1", "the parameters immutable, nolock"),
        ("sqlite:///results.db?cache=shared", "the parameters cache"),
        ("sqlite:///results.db?vfs=unix-none", "the parameters vfs"),
        ("sqlite:///file:results.db?mode=memory&uri=true", "a path that is no path of a file"),
        ("sqlite:///file::memory:", "a path that is no path of a file"),
        ("sqlite:///results\0.db", "a path that is no path of a file"),
        ("sqlite://results.db", "a name of a computer"),
    ],
)
def test_a_url_of_another_kind_is_refused_without_its_password(url: str, seen: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        ResultStore(url)
    assert seen in str(caught.value)
    assert "geheim-7" not in "".join(traceback.format_exception(caught.value))


def test_a_password_in_the_query_is_hidden_too() -> None:
    shown = describe(parse_url("postgresql://quality@host/results?password=geheim-7&sslmode=require"))
    assert shown == "postgresql://quality@host/results?password=hidden&sslmode=require"
