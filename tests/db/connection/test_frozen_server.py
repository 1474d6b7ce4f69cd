"""A server whose processes stand still while its kernel answers: every wait ends on this side."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import psycopg
import pytest

from alignment.errors import StoreSchemaError, StoreUnavailableError
from benchmarks.postgres_server import PostgresServer, binaries, postgres_server, temporary_folder
from db.connection import migrate
from db.queries import ResultReader, yield_counts
from db.store import ResultStore
from db.upkeep.background import BackgroundWork
from db.upkeep.shipping import Shipper
from tests.conftest import TEMPORARY
from tests.db.example_records import CALIBRATION, cycle
from tests.db.pool import pool_of

TIMEOUT_S = 0.5
# Twice the timeout and two seconds, and a machine that has other things to do.
LONGEST_S = 3.0 + 5.0


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    programs = binaries()
    if programs is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    with postgres_server(temporary_folder(os.environ.get(TEMPORARY)), programs, ["-F"]) as running:
        yield running


@pytest.fixture
def url(server: PostgresServer) -> Iterator[str]:
    with server.database() as made:
        migrate(made)
        yield made


@contextmanager
def frozen(server: PostgresServer) -> Iterator[None]:
    """Stop the server and all its processes, as a hypervisor or a debugger does."""
    first = int((server.folder / "data" / "postmaster.pid").read_text().split()[0])
    children = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(first)], capture_output=True, text=True, check=True
    )
    processes = [first, *map(int, children.stdout.split())]
    for process in processes:
        os.kill(process, signal.SIGSTOP)
    try:
        yield
    finally:
        for process in processes:
            os.kill(process, signal.SIGCONT)


@contextmanager
def within(seconds: float) -> Iterator[None]:
    started = time.monotonic()
    yield
    assert time.monotonic() - started < seconds


@pytest.mark.slow
def test_a_frozen_server_is_given_up_and_used_again(server: PostgresServer, url: str) -> None:
    """Nothing came back, ever: the kernel acknowledged what nobody read."""
    with ResultStore(url, timeout_s=TIMEOUT_S) as store, ResultReader(url, timeout_s=TIMEOUT_S) as reader:
        store.record_calibration(CALIBRATION)
        record = cycle()

        def write() -> None:
            # With a connection of the pool, and with a new one.
            for _ in range(2):
                with within(LONGEST_S), pytest.raises(StoreUnavailableError, match="cannot be reached"):
                    store.write_cycle(record)

        def ask() -> None:
            with within(LONGEST_S), pytest.raises(StoreUnavailableError):
                yield_counts(reader)

        def start() -> None:
            with within(LONGEST_S), pytest.raises(StoreUnavailableError):
                ResultStore(url, timeout_s=TIMEOUT_S).open()

        # Each waits for itself, so all may wait at once.
        with frozen(server), ThreadPoolExecutor(3) as pool:
            for ended in [pool.submit(write), pool.submit(ask), pool.submit(start)]:
                ended.result(2 * LONGEST_S)
        store.write_cycle(record)
        assert store.counts()["cycles"] == 1


def test_a_server_that_freezes_amid_a_transaction_is_given_up(server: PostgresServer, url: str) -> None:
    with ResultStore(url, timeout_s=TIMEOUT_S) as store:

        def read() -> None:
            with store.reading() as connection:
                connection.exec_driver_sql("SELECT 1")
                with frozen(server):
                    connection.exec_driver_sql("SELECT 1")

        with within(LONGEST_S), pytest.raises(StoreUnavailableError, match="no answer within 3 s"):
            read()
        assert store.counts()["cycles"] == 0


def test_a_frozen_central_server_shows_in_the_health_and_stopping_ends(
    server: PostgresServer, url: str, tmp_path: Path
) -> None:
    """It was healthy: no error, nothing pending; and stopping the station waited for ever."""
    local = f"sqlite:///{tmp_path / 'station.db'}"
    with ResultStore(local, create=True) as store:
        store.record_calibration(CALIBRATION)
        shipper = Shipper(local, url, "EOL-1", timeout_s=TIMEOUT_S)
        work = BackgroundWork(store, local, "EOL-1", shipper, period_s=0.02)
        with work:
            wait_until(lambda: work.health.pending == 0)
            last = work.health.shipped_utc
            assert last is not None
            with frozen(server):
                store.write_cycle(cycle())
                wait_until(lambda: work.health.central_error is not None)
                health = work.health
                assert health.pending in (1, 2)
                assert not health.good
                assert "Nothing was shipped since 20" in str(health.central_error)
                wait_until(lambda: [e.code for e in store.recent_events(1)] == ["central_away"])
                started = time.monotonic()
                work.__exit__()
                assert time.monotonic() - started < 2 * LONGEST_S
        assert not [thread for thread in threading.enumerate() if thread.name == "store background"]
        with shipper:
            while shipper.ship().pending:
                pass


def test_a_wait_that_goes_on_counts_as_no_answer(sqlite_url: str, tmp_path: Path) -> None:
    """Between the question and the end of patience the health must not say that all is well."""
    migrate(central := f"sqlite:///{tmp_path / 'central.db'}")
    asked, answer = threading.Event(), threading.Event()
    clock = [100.0]
    with ResultStore(sqlite_url, create=True) as store:
        store.record_calibration(CALIBRATION)
        shipper = Shipper(sqlite_url, central, "EOL-1")
        work = BackgroundWork(
            store, sqlite_url, "EOL-1", shipper, clock=lambda: clock[0],
            now=lambda: datetime(2026, 11, 30, 12, tzinfo=UTC), period_s=0.01,
        )  # fmt: skip
        ship = shipper.ship

        def hang() -> object:
            asked.set()
            assert answer.wait(60.0)
            return ship()

        shipper.ship = hang  # type: ignore[method-assign,assignment]
        with work:
            assert asked.wait(60.0)
            store.write_cycle(cycle())
            assert work.health.good
            clock[0] += 8.0
            assert work.health.pending == 2
            assert "has not answered for 8 s" in str(work.health.central_error)
            assert "Nothing was shipped since the start at 2026-11-30 12:00:00 UTC" in str(
                work.health.central_error
            )
            answer.set()
            wait_until(lambda: work.health.pending == 0)
            assert work.health.good


def test_work_that_hangs_is_left_behind_when_the_program_stops(
    sqlite_url: str, caplog: pytest.LogCaptureFixture
) -> None:
    with ResultStore(sqlite_url, create=True) as store:
        asked, answer = threading.Event(), threading.Event()

        def hang(folder: Path) -> int:
            asked.set()
            assert answer.wait(60.0)
            return 10**12

        work = BackgroundWork(store, sqlite_url, "EOL-1", free_bytes=hang, stop_s=0.05)
        with work:
            assert asked.wait(60.0)
        assert "did not end within 0.05 s and is left behind" in caplog.text
        answer.set()
        work._thread.join(60.0)
        work._engine.dispose()


def test_what_nobody_foresaw_is_counted_told_and_survived(sqlite_url: str) -> None:
    moments = iter([MemoryError("one"), KeyError("two")])
    seen = threading.Event()

    def room(folder: Path) -> int:
        error = next(moments, None)
        if error is not None:
            raise error
        seen.set()
        return 10**12

    with ResultStore(sqlite_url, create=True) as store:
        work = BackgroundWork(store, sqlite_url, "EOL-1", free_bytes=room, period_s=0.01)
        # Without the minute that it rests after a failure.
        work._stopping.wait = lambda timeout=None: work._stopping.is_set()  # type: ignore[method-assign]
        with work:
            assert seen.wait(60.0)
        assert work.health.failures == 2
        codes = [(event.code, event.text) for event in store.recent_events(5)]
        assert codes == [("background_failed", "KeyError: 'two'"), ("background_failed", "MemoryError: one")]


def test_a_server_that_keeps_text_as_bytes_is_refused(server: PostgresServer) -> None:
    server.execute(
        "CREATE DATABASE ascii ENCODING 'SQL_ASCII' LC_COLLATE 'C' LC_CTYPE 'C' TEMPLATE template0"
    )
    for use in (
        migrate,
        lambda url: ResultStore(url, create=True).open(),
        lambda url: ResultReader(url).open(),
    ):
        with pytest.raises(StoreSchemaError, match=r"keeps text as SQL_ASCII.*ENCODING 'UTF8'"):
            use(server.url("ascii"))
    server.execute("DROP DATABASE ascii")


def test_a_server_that_was_made_anew_or_restored_is_not_written_on(server: PostgresServer) -> None:
    """The station went on with whatever answered under the address; what it had stored was not there."""
    with server.database() as url:
        migrate(url)
        name = url.rpartition("/")[2]
        with ResultStore(url, timeout_s=5.0) as store:
            store.record_calibration(CALIBRATION)
            store.write_cycle(cycle())
            # A backup of this moment; then one more cycle, which OK was told for.
            pool_of(store).dispose()
            server.execute(f"CREATE DATABASE {name}_old TEMPLATE {name}")
            store.write_cycle(cycle())
            for other in (f"{name}_old", None):
                server.execute(f"DROP DATABASE {name} WITH (FORCE)")
                server.execute(f"CREATE DATABASE {name}" + (f" TEMPLATE {other}" if other else ""))
                if other is None:
                    migrate(url)
                    with psycopg.connect(url, autocommit=True) as again:
                        again.execute(
                            "INSERT INTO calibrations (id, rig, valid_from_utc, document, stored_utc)"
                            f" VALUES ('{CALIBRATION.id}', 'r', now(), '{{}}', now())"
                        )
                with pytest.raises(StoreUnavailableError, match="has lost what was stored"):
                    store.write_cycle(cycle())
            server.execute(f"DROP DATABASE {name}_old WITH (FORCE)")


def wait_until(condition: Callable[[], bool], longest_s: float = 60.0) -> None:
    until = time.monotonic() + longest_s
    rest = threading.Event()
    while not condition():
        assert time.monotonic() < until
        rest.wait(0.02)
