"""Servers that stop, programs that are killed, power that goes: nothing lost, nothing doubled, order kept."""

from __future__ import annotations

import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import UUID

import pytest
from sqlalchemy import select

from alignment.errors import StoreUnavailableError
from benchmarks.postgres_server import PostgresServer, binaries, postgres_server, temporary_folder
from db.background import BackgroundWork
from db.check import check_database
from db.engine import make_engine, parse_url
from db.migrate import migrate
from db.schema import cycles
from db.shipping import Shipper
from db.store import ResultStore
from tests.db.example_records import CALIBRATION, cycle

ROOT = Path(__file__).parents[2]
# More of them on request: `TRUEWHEEL_KILLS=1000 python -m pytest tests/db -k "killed or power"`.
KILLS = int(os.environ.get("TRUEWHEEL_KILLS", "12"))


@pytest.fixture
def own_server() -> Iterator[PostgresServer]:
    """A server that a test may stop; with fsync, because it is stopped as by a crash."""
    programs = binaries()
    if programs is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    with postgres_server(temporary_folder(), programs) as server:
        yield server


@pytest.fixture
def local_url(tmp_path: Path) -> str:
    url = f"sqlite:///{tmp_path / 'station.db'}"
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
    return url


def order(url: str) -> list[str]:
    engine = make_engine(parse_url(url), timeout_s=5.0)
    with engine.connect() as connection:
        found = [
            uuid.hex for uuid in connection.execute(select(cycles.c.uuid).order_by(cycles.c.id)).scalars()
        ]
    engine.dispose()
    return found


def test_a_server_that_crashes_and_comes_back_while_cycles_go_on(
    own_server: PostgresServer, local_url: str, open_store: Callable[..., ResultStore]
) -> None:
    with own_server.database() as central:
        migrate(central)
        store = open_store(local_url, create=False)
        shipper = Shipper(local_url, central, "EOL-1", timeout_s=2.0)
        work = BackgroundWork(store, local_url, "EOL-1", shipper)
        shipper.open()
        written: list[UUID] = []

        def produce(number: int) -> None:
            for _ in range(number):
                record = cycle()
                store.write_cycle(record)
                written.append(record.uuid)

        produce(10)
        work.step()
        own_server.stop("immediate")
        for _ in range(3):
            # Production does not notice.
            produce(5)
            work.step()
        assert work.health.pending == 16
        assert work.health.central_error is not None
        with pytest.raises(StoreUnavailableError):
            shipper.ship()
        own_server.start()
        produce(5)
        while not work.health.good or work.health.pending:
            work.step()
        shipper.close()
        assert order(central) == [uuid.hex for uuid in written]
        assert check_database(central).findings == ()
        assert [event.code for event in store.recent_events(9)] == ["central_back", "central_away"]


def test_shippers_killed_in_the_middle_lose_and_double_nothing(
    database_url: str, local_url: str, open_store: Callable[..., ResultStore]
) -> None:
    migrate(database_url)
    done = subprocess.run(
        [sys.executable, "-m", "tests.db.kill_shipper", local_url, database_url, str(KILLS), "1"],
        cwd=ROOT, check=True, capture_output=True, text=True, timeout=60 + 10 * KILLS,
    )  # fmt: skip
    with Shipper(local_url, database_url, "EOL-1", lease_s=0.0) as shipper:
        while shipper.ship().pending:
            pass
    assert order(database_url) == done.stdout.split()
    assert check_database(local_url).findings == ()
    if not database_url.startswith("sqlite"):
        assert check_database(database_url).findings == ()


def test_power_that_goes_in_the_middle_of_writing_loses_nothing_acknowledged(
    tmp_path: Path, local_url: str
) -> None:
    """The files as a disk would hold them at a moment, with the torn end of a write behind them."""
    moments = random.Random(1)
    path = Path(local_url.removeprefix("sqlite:///"))
    writer = subprocess.Popen(
        [sys.executable, "-c",
         "import sys; from tests.db.example_records import cycle; from db.store import ResultStore\n"
         "store = ResultStore(sys.argv[1]); store.open()\n"
         "while True:\n"
         "    record = cycle(); store.write_cycle(record); print(record.uuid.hex, flush=True)\n",
         local_url],
        cwd=ROOT, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert writer.stdout is not None
    acknowledged: list[str] = []
    try:
        for number in range(KILLS):
            for _ in range(moments.randint(1, 8)):
                acknowledged.append(writer.stdout.readline().strip())
            os.kill(writer.pid, signal.SIGSTOP)
            os.waitpid(writer.pid, os.WUNTRACED)
            copy = tmp_path / f"copy-{number}.db"
            shutil.copy(path, copy)
            with Path(f"{copy}-wal").open("wb") as wal:
                wal.write(path.with_name(f"{path.name}-wal").read_bytes())
                wal.write(moments.randbytes(moments.randint(0, 9000)))
            os.kill(writer.pid, signal.SIGCONT)
            found = order(f"sqlite:///{copy}")
            # What had returned is there, in order; at most what was under way comes after it.
            assert found[: len(acknowledged)] == acknowledged
            with sqlite3.connect(copy) as connection:
                assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
                wheels = connection.execute("SELECT count(*) FROM wheel_results").fetchone()[0]
            connection.close()
            assert wheels == 4 * len(found)
    finally:
        writer.kill()
        writer.stdout.close()
        writer.wait()
