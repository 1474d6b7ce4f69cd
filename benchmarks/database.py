"""The result database with millions of wheel results of 20 stations, on SQLite and PostgreSQL.

Prints the sizes of the tables, the plans, the 95th percentile of each quality question (warm), and the rate
of durable writing while such questions are asked. Goals: 100 ms on PostgreSQL and 150 ms on SQLite; 500
cycles/s from 20 writers and 50 cycles/s from one. PostgreSQL is a server of its own with fsync on. A writer
commits every cycle alone, or the cycles of one second together as the shipping of a station does. Questions
are asked of what was built; writing goes to a copy of it, so what is kept can be asked again.

    python -m benchmarks.database [--wheel-results N] [--seconds S] [--engine sqlite|postgresql]
                                  [--keep FOLDER] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

from sqlalchemy import text

from benchmarks.database_plant import END, STATIONS, WHEELS, prepare
from benchmarks.database_questions import ask, plans
from benchmarks.database_writing import GOAL_RATE, Written, write_while_asking
from benchmarks.postgres_server import PostgresServer, binaries, postgres_server, temporary_folder
from db.connection import make_engine, parse_url
from db.queries import ResultReader
from db.sums import check_sums

GOAL_MS = {"postgresql": 100.0, "sqlite": 150.0}
# As the documentation recommends for a plant's server.
SERVER = tuple(
    f"-c {setting}"
    for setting in (
        "shared_buffers=1GB",
        "work_mem=32MB",
        "effective_cache_size=8GB",
        "random_page_cost=1.1",
        "max_wal_size=4GB",
        "fsync=on",
    )
)


class SqlitePlace:
    """Databases as files of a folder."""

    kind = "sqlite"

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def url(self, name: str) -> str:
        """URL of the database of this name."""
        return f"sqlite:///{self._folder / name}.db"

    def holds(self, name: str) -> bool:
        """Whether it was built."""
        return (self._folder / f"{name}.db").exists()

    @contextmanager
    def building(self, name: str) -> Iterator[str]:
        """URL of a database that gets this name when it is whole."""
        part = self._folder / f"{name}_part.db"
        part.unlink(missing_ok=True)
        yield f"sqlite:///{part}"
        part.rename(self._folder / f"{name}.db")

    @contextmanager
    def copy(self, name: str) -> Iterator[str]:
        """URL of a copy that goes in the end."""
        path = self._folder / f"{name}_copy.db"
        shutil.copyfile(self._folder / f"{name}.db", path)
        yield f"sqlite:///{path}"
        for file in self._folder.glob(f"{path.name}*"):
            file.unlink()


class PostgresPlace:
    """Databases of a server; as `SqlitePlace`."""

    kind = "postgresql"

    def __init__(self, server: PostgresServer) -> None:
        self._server = server

    def url(self, name: str) -> str:
        """URL of the database of this name."""
        return self._server.url(name)

    def holds(self, name: str) -> bool:
        """Whether it was built."""
        return self._server.holds(name)

    @contextmanager
    def building(self, name: str) -> Iterator[str]:
        """URL of a database that gets this name when it is whole."""
        self._server.execute(f"DROP DATABASE IF EXISTS {name}_part")
        self._server.execute(f"CREATE DATABASE {name}_part")
        yield self._server.url(f"{name}_part")
        self._server.execute(f"ALTER DATABASE {name}_part RENAME TO {name}")

    @contextmanager
    def copy(self, name: str) -> Iterator[str]:
        """URL of a copy that goes in the end."""
        with self._server.database(template=name) as url:
            yield url


def sizes(url: str) -> dict[str, dict[str, float]]:
    """Rows and megabytes of each table that has any; SQLite tells the megabytes of the whole file only."""
    engine = make_engine(parse_url(url), timeout_s=600.0)
    found: dict[str, dict[str, float]] = {}
    names = ("vehicles", "cycles", "wheel_results", "value_sums", "result_counts")
    with engine.connect() as connection:
        for name in names:
            entry: dict[str, float] = {
                "rows": connection.execute(text(f"SELECT count(*) FROM {name}")).scalar_one()
            }
            if engine.dialect.name == "postgresql":
                # Partitions are counted with their table.
                query = (
                    "SELECT sum(pg_total_relation_size(c.oid)) FROM pg_class c LEFT JOIN pg_inherits i"
                    f" ON i.inhrelid = c.oid WHERE '{name}'::regclass IN (c.oid, i.inhparent)"
                )
                entry["MB"] = float(connection.execute(text(query)).scalar_one()) / 1e6
            found[name] = entry
    engine.dispose()
    if url.startswith("sqlite"):
        path = Path(url.removeprefix("sqlite:///"))
        found["file"] = {"MB": sum(p.stat().st_size for p in path.parent.glob(f"{path.name}*")) / 1e6}
    return found


def run(
    place: SqlitePlace | PostgresPlace,
    wheel_results: int,
    seconds: float,
    times: int,
    say: Callable[[str], None],
) -> Any:
    """Everything on one engine; print as it goes, return the figures."""
    kind, name = place.kind, f"plant_{wheel_results}"
    say(f"\n{kind}: {wheel_results:,} wheel results of {len(STATIONS)} stations")
    if not place.holds(name):
        with place.building(name) as url:
            steps = prepare(url, wheel_results)
        say(f"  loaded in {steps['load_s']:.0f} s, sums built in {steps['sums_s']:.0f} s")
    url = place.url(name)
    tables = sizes(url)
    for table, entry in tables.items():
        say("  " + f"{table:15}" + "".join(f" {value:>14,.0f} {unit}" for unit, value in entry.items()))
    cycles = wheel_results // len(WHEELS)
    with ResultReader(url, timeout_s=600.0) as reader:
        started = time.monotonic()
        with reader.transaction() as connection:
            last_day = int((END - timedelta(days=3)).timestamp()) // 3600
            checked = check_sums(connection, last_day)
        say(f"  sums of the last three days against the results: {len(checked.differences)} differences in"
            f" {checked.sums + checked.counts:,} ({time.monotonic() - started:.1f} s)")  # fmt: skip
        asked = ask(reader, cycles, times)
        for one in asked:
            say(f"  {one.name:45} p50 {one.p50_ms:7.1f} ms  p95 {one.p95_ms:7.1f} ms"
                f"  CPU p95 {one.cpu_p95_ms:7.1f} ms  ({one.rows:,} rows)")  # fmt: skip
        explained = plans(reader, cycles)
    for question, lines in explained.items():
        say(f"  plan of {question}:")
        for line in lines:
            say(f"    {line.strip()}")
    written: list[Written] = []
    for batch in () if not seconds else (1,) if kind == "sqlite" else (1, 25):
        with place.copy(name) as url:
            # What was copied is not to be written back while commits are timed.
            os.sync()
            found = write_while_asking(url, kind, seconds, batch, cycles)
        written.append(found)
        say(f"  {found.writers} writers, {batch} per commit: {found.cycles_per_s:.0f} cycles/s, commit p95"
            f" {found.commit_p95_ms:.0f} ms, CPU {found.cpu_ms:.2f} ms a cycle; meanwhile")  # fmt: skip
        for answer in found.asked:
            say(f"    {answer.name:43} p50 {answer.p50_ms:7.1f} ms  p95 {answer.p95_ms:7.1f} ms"
                f"  CPU p95 {answer.cpu_p95_ms:7.1f} ms")  # fmt: skip
    figures = {f"{kind} {one.name} p95_ms": round(one.p95_ms, 1) for one in asked}
    for each in written:
        figures[f"{kind} cycles_per_s, {each.batch} per commit"] = round(each.cycles_per_s, 1)
        busy = {f"{kind} {one.name} p95_ms, {each.batch} per commit": one.p95_ms for one in each.asked}
        figures |= {name: round(value, 1) for name, value in busy.items()}
    fast = all(one.p95_ms <= GOAL_MS[kind] for one in asked)
    enough = not seconds or any(each.cycles_per_s >= GOAL_RATE[kind] for each in written)
    met = fast and enough and not checked.differences
    return {"figures": figures, "sizes": tables, "plans": explained, "met": met}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--wheel-results", type=int, default=10_000_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="of writing; 0 writes nothing")
    parser.add_argument("--times", type=int, default=60, help="that each question is asked")
    parser.add_argument("--engine", choices=["sqlite", "postgresql", "both"], default="both")
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="databases stay there, and are built only once",
    )
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(arguments)
    say: Callable[[str], None] = (lambda _: None) if given.json else (lambda line: print(line, flush=True))
    results = {}
    with ExitStack() as stack:
        folder: Path = given.keep or temporary_folder()
        if given.keep is None:
            stack.callback(shutil.rmtree, folder)
        folder.mkdir(parents=True, exist_ok=True)
        # The server's user is to reach its own folder in it.
        folder.chmod(0o755)
        places: list[SqlitePlace | PostgresPlace] = []
        if given.engine in ("postgresql", "both"):
            programs = binaries()
            if programs is None:
                print("PostgreSQL is not installed (Debian: apt-get install postgresql)", file=sys.stderr)
                return 2
            own = folder / "postgresql"
            own.mkdir(exist_ok=True)
            server = postgres_server(own, programs, SERVER, keep=given.keep is not None)
            places.append(PostgresPlace(stack.enter_context(server)))
        if given.engine in ("sqlite", "both"):
            places.append(SqlitePlace(folder))
        for place in places:
            results[place.kind] = run(place, given.wheel_results, given.seconds, given.times, say)
    if given.json:
        figures = {name: value for one in results.values() for name, value in one["figures"].items()}
        print(json.dumps({"figures": figures, **results}, indent=2))
    return 0 if all(one["met"] for one in results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
