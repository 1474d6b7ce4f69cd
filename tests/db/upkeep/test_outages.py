"""Servers that stop, programs that are killed, power that goes: nothing lost, nothing doubled, order kept."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import UUID

import pytest
from sqlalchemy import select

from alignment.errors import StoreUnavailableError
from benchmarks.database_plant import new_cycle
from benchmarks.outages import STATION, judge, prepare
from benchmarks.postgres_server import PostgresServer, binaries, postgres_server, temporary_folder
from db.connection import make_engine, migrate, parse_url
from db.schema import cycles
from db.store import ResultStore
from db.upkeep.background import BackgroundWork
from db.upkeep.check import check_database
from db.upkeep.shipping import Shipper
from tests.db.example_records import CALIBRATION, cycle

ROOT = Path(__file__).parents[3]


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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["sqlite", "postgresql"])
def test_programs_killed_and_power_lost_at_any_moment_lose_and_double_nothing(engine: str) -> None:
    """Long: ``python -m benchmarks.outages``. A program of its own, because it forks."""
    if engine == "postgresql" and binaries() is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.outages", "--rounds", "12", "--engine", engine, "--json"],
        cwd=ROOT, check=False, capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout)
    assert found["good"]
    for bad_moment in ("writers killed", {"sqlite": "power lost", "postgresql": "shippers killed"}[engine]):
        assert found["figures"][f"{engine} {bad_moment} rounds"] == 12
        assert found["figures"][f"{engine} {bad_moment} acknowledged"] >= 12


def test_what_is_lost_doubled_or_out_of_order_is_told(tmp_path: Path) -> None:
    """The judge of the test above: nobody would notice if it found everything good."""
    url = prepare(f"sqlite:///{tmp_path / 'results.db'}")
    records = [new_cycle(STATION, number) for number in range(4)]
    with ResultStore(url) as store:
        for record in records:
            store.write_cycle(record)
    uuids = [record.uuid.hex for record in records]
    assert judge("writers killed", 1, uuids[:3], url).good
    assert judge("writers killed", 1, [*uuids, cycle().uuid.hex], url).lost == 1
    assert judge("writers killed", 1, [uuids[0], uuids[2], uuids[1], uuids[3]], url).disordered == 2
    with sqlite3.connect(tmp_path / "results.db") as connection:
        connection.execute("DROP TRIGGER wheel_results_no_delete")
        connection.execute("DELETE FROM wheel_results WHERE cycle_id = 2 AND wheel = 'front_left'")
    connection.close()
    assert judge("writers killed", 1, uuids, url).damaged > 0
