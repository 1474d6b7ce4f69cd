"""The result database with millions of wheel results of 20 stations, on SQLite and PostgreSQL.

Prints the sizes of the tables, the plans, the 95th percentile of each quality question (warm), and the rate
of durable writing while such questions are asked. Goals: 100 ms on PostgreSQL and 150 ms on SQLite; 500
cycles/s from 20 writers and 50 cycles/s from one. PostgreSQL is a server of its own with fsync on. A writer
commits every cycle alone, or the cycles of one second together as the shipping of a station does.

    python -m benchmarks.database [--wheel-results N] [--seconds S] [--engine sqlite|postgresql] [--json]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from sqlalchemy import Engine, event, text

from benchmarks.database_plant import (
    END,
    PLANTS,
    STATIONS,
    TYPES,
    WHEELS,
    calibration_id,
    chunks,
    load_postgresql,
    load_sqlite,
)
from benchmarks.postgres_server import binaries, postgres_server, temporary_folder
from db.engine import make_engine, parse_url
from db.migrate import migrate
from db.quality_records import InstallationRecord, StationRecord
from db.queries import (
    Characteristic,
    Filter,
    GroupBy,
    Quantity,
    ResultReader,
    moments,
    reasons,
    since_last_good_check,
    value_series,
    vin_history,
    wheel_counts,
    yield_counts,
)
from db.records import (
    CalibrationCheckRecord,
    CalibrationRecord,
    CheckKind,
    CheckOutcome,
    CycleOutcome,
    CycleRecord,
    VehicleRecord,
    Verdict,
    WheelOutcome,
    WheelRecord,
)
from db.store import ResultStore
from db.sums import bring_up_to_date, check_sums, update_sums
from db.writing import write_cycles

GOAL_MS = {"postgresql": 100.0, "sqlite": 150.0}
WRITERS = {"postgresql": 20, "sqlite": 1}
GOAL_RATE = {"postgresql": 500.0, "sqlite": 50.0}
SEED = 1
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


@dataclass(frozen=True)
class Asked:
    """One question, asked many times with other stations and times: milliseconds."""

    name: str
    p50_ms: float
    p95_ms: float
    worst_ms: float
    rows: int


def prepare(url: str, wheel_results: int) -> dict[str, float]:
    """Build a database with the plant in it; return seconds of each step."""
    migrate(url)
    with ResultStore(url) as store:
        for number, name in enumerate(STATIONS):
            uses = []
            for wheel in WHEELS:
                used = calibration_id(name, wheel)
                store.record_calibration(CalibrationRecord(used, wheel, END - timedelta(days=400), {}))
                uses.append(InstallationRecord(name, wheel, used, END - timedelta(days=400)))
                for hours in (26.0, 150.0, 320.0):
                    outcome = CheckOutcome.WITHIN
                    store.record_check(
                        CalibrationCheckRecord(
                            END - timedelta(hours=hours),
                            used,
                            CheckKind.MASTER_WHEEL,
                            outcome,
                            "ok",
                            {"d": 0.0},
                        )
                    )
            plant = PLANTS[number % len(PLANTS)]
            described = StationRecord(
                name, plant, name, END - timedelta(days=400), "0.1.0", "benchmark", {"id": name}, WHEELS
            )
            store.describe_station(described, (), uses)
    started = time.monotonic()
    parts = chunks(wheel_results, SEED)
    if url.startswith("sqlite"):
        load_sqlite(url.removeprefix("sqlite:///"), parts)
    else:
        load_postgresql(url, parts)
    loaded = time.monotonic()
    engine = make_engine(parse_url(url), timeout_s=3600.0)
    bring_up_to_date(engine)
    summed = time.monotonic()
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.execute(text("ANALYZE" if url.startswith("sqlite") else "VACUUM ANALYZE"))
    engine.dispose()
    return {"load_s": loaded - started, "sums_s": summed - loaded}


def questions(reader: ResultReader, cycles: int, rng: random.Random) -> dict[str, Callable[[], int]]:
    """The questions that quality engineers ask, each with its own station and time at every call."""

    def newest() -> datetime:
        # Of the newest data, at an odd time.
        return END + timedelta(minutes=rng.uniform(1.0, 59.0))

    def toe() -> Characteristic:
        return Characteristic(rng.choice(WHEELS), Quantity.TOE)

    def shift(stations: tuple[str, ...]) -> int:
        start = END - timedelta(hours=8 * rng.randint(1, 2))
        where = Filter(from_utc=start, until_utc=start + timedelta(hours=8), stations=stations)
        return (
            len(yield_counts(reader, where, by=(GroupBy.HOUR,)))
            + len(wheel_counts(reader, where, by=(GroupBy.PART,)))
            + len(reasons(reader, where))
            + len(moments(reader, where))
        )

    def month(stations: tuple[str, ...]) -> int:
        until = newest()
        return len(moments(reader, Filter(until - timedelta(days=30), until, stations), (toe(),)))

    def chart() -> int:
        until = newest()
        where = Filter(until - timedelta(days=7), until, (rng.choice(STATIONS),))
        return len(value_series(reader, toe(), where))

    def vin() -> int:
        return len(vin_history(reader, f"TWBENCH{rng.randint(1, cycles):010d}").cycles)

    def since(stations: tuple[str, ...]) -> int:
        return sum(len(found.vehicles) for found in since_last_good_check(reader, Filter(stations=stations)))

    return {
        "shift report, one station": lambda: shift((rng.choice(STATIONS),)),
        "shift report, whole plant": lambda: shift(()),
        "Cpk of a month, one station": lambda: month((rng.choice(STATIONS),)),
        "Cpk of a month, whole plant": lambda: month(()),
        "chart of a week": chart,
        "one VIN": vin,
        "VINs since the last good check, one station": lambda: since((rng.choice(STATIONS),)),
        "VINs since the last good check, whole plant": lambda: since(()),
    }


def ask(reader: ResultReader, cycles: int, times: int, pause_s: float = 0.0) -> list[Asked]:
    """Ask every question some times, after some times that only warm up."""
    rng = random.Random(SEED)
    found = []
    for name, question in questions(reader, cycles, rng).items():
        for _ in range(5):
            question()
        took = []
        rows = 0
        for _ in range(times):
            started = time.perf_counter()
            rows = question()
            took.append(1000.0 * (time.perf_counter() - started))
            time.sleep(pause_s)
        p50, p95 = np.percentile(took, [50, 95])
        found.append(Asked(name, float(p50), float(p95), max(took), rows))
    return found


@contextmanager
def statements(engine: Engine) -> Iterator[list[tuple[str, Any]]]:
    """Collect what is executed meanwhile."""
    seen: list[tuple[str, Any]] = []

    def note(connection: Any, cursor: Any, statement: str, parameters: Any, *_: Any) -> None:
        seen.append((statement, parameters))

    event.listen(engine, "before_cursor_execute", note)
    yield seen
    event.remove(engine, "before_cursor_execute", note)


def plans(reader: ResultReader, cycles: int) -> dict[str, list[str]]:
    """The plan of the longest statement of each question."""
    engine = reader._engine
    assert engine is not None
    word = "EXPLAIN QUERY PLAN" if engine.dialect.name == "sqlite" else "EXPLAIN (COSTS OFF)"
    found = {}
    for name, question in questions(reader, cycles, random.Random(SEED)).items():
        with statements(engine) as seen:
            question()
        statement, parameters = max(seen, key=lambda item: len(item[0]))
        with engine.connect() as connection:
            rows = connection.exec_driver_sql(f"{word} {statement}", parameters).all()
        lines = [str(row[-1]).rstrip() for row in rows]
        found[name] = [line for line in lines if "Scan" in line or "SCAN" in line or "SEARCH" in line]
    return found


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


def new_cycle(station: str, number: int) -> CycleRecord:
    """A good vehicle at the end of the line, now."""
    received = END + timedelta(minutes=30, seconds=number % 1700)
    wheels = tuple(
        WheelRecord(
            wheel,
            WheelOutcome.MEASURED,
            Verdict.OK,
            received,
            camber=-0.009,
            toe=0.0017,
            camber_u=1.2e-5,
            toe_u=1.2e-5,
            coverage_factor=2.0,
            method="tyre_plane/revolution",
            calibration_id=calibration_id(station, wheel),
            camber_low=-0.02,
            camber_high=0.0,
            toe_low=0.0,
            toe_high=0.0035,
            guard_band=True,
            points_used=4000,
            residual_rms_mm=0.02,
            duration_s=0.2,
        )
        for wheel in WHEELS
    )
    vin = f"TWNEW{os.getpid():07d}{number:08d}"
    return CycleRecord(
        uuid4(), station, number, received, CycleOutcome.OK, "0.1.0", "benchmark",
        VehicleRecord(vin, TYPES[number % 3]), 1.0, received, 2.0, None, None, wheels,
    )  # fmt: skip


def write_for(url: str, station: str, rate: float, seconds: float, batch: int, ready: Any, out: Any) -> None:
    """Write cycles at a rate, each transaction durable before the next; put how many and how long it took."""
    engine = make_engine(parse_url(url), timeout_s=10.0)
    latencies: list[float] = []
    number = 0
    store = ResultStore(url, timeout_s=10.0)
    store.open()
    store.write_cycle(new_cycle(station, 99_999_999))
    ready.wait()
    started = time.perf_counter()
    while (now := time.perf_counter() - started) < seconds:
        due = int(now * rate) + 1
        if number + batch > due:
            time.sleep(max(0.0, (number + batch - 1) / rate - now))
            continue
        records = [new_cycle(station, number + k) for k in range(batch)]
        before = time.perf_counter()
        if batch == 1:
            store.write_cycle(records[0])
        else:
            with engine.connect().execution_options(writes=True) as connection, connection.begin():
                write_cycles(connection, records, END)
        latencies.append(1000.0 * (time.perf_counter() - before))
        number += batch
    out.put((number, latencies))
    store.close()
    engine.dispose()


@dataclass(frozen=True)
class Written:
    """Writing while questions are asked.

    Attributes
    ----------
    cycles_per_s
        Durable, all writers together.
    commit_p95_ms
        Of one transaction of `batch` cycles.
    asked
        The questions meanwhile.
    """

    writers: int
    batch: int
    cycles_per_s: float
    commit_p95_ms: float
    asked: list[Asked]


def write_while_asking(url: str, kind: str, seconds: float, batch: int, cycles: int) -> Written:
    """Write at the goal's rate from the goal's number of programs while one thread asks and one sums."""
    context = multiprocessing.get_context("spawn")
    ready, out = context.Event(), context.Queue()
    # A little above the goal: a writer that waits for the next second is not late.
    rate = 1.02 * GOAL_RATE[kind] / WRITERS[kind]
    writers = [
        context.Process(target=write_for, args=(url, STATIONS[k], rate, seconds, batch, ready, out))
        for k in range(WRITERS[kind])
    ]
    for writer in writers:
        writer.start()
    time.sleep(0.3 * len(writers) + 2.0)
    stopping = threading.Event()
    engine = make_engine(parse_url(url), timeout_s=30.0)

    def keep_sums() -> None:
        while not stopping.wait(0.5):
            update_sums(engine, most=500 if kind == "sqlite" else 5_000)

    keeper = threading.Thread(target=keep_sums)
    asked: list[Asked] = []
    with ResultReader(url) as reader:
        keeper.start()
        ready.set()
        started = time.perf_counter()
        rounds: list[list[Asked]] = []
        while time.perf_counter() - started < seconds - 1.0:
            rounds.append(ask_once(reader, cycles, len(rounds)))
        asked = [summary([one[k] for one in rounds]) for k in range(len(rounds[0]))]
    results = [out.get(timeout=seconds + 60.0) for _ in writers]
    for writer in writers:
        writer.join()
    stopping.set()
    keeper.join()
    engine.dispose()
    total = sum(number for number, _ in results)
    latencies = [value for _, part in results for value in part]
    return Written(len(writers), batch, total / seconds, float(np.percentile(latencies, 95)), asked)


def ask_once(reader: ResultReader, cycles: int, seed: int) -> list[Asked]:
    """Every question once, a little apart, as people and screens ask."""
    found = []
    for name, question in questions(reader, cycles, random.Random(seed)).items():
        started = time.perf_counter()
        rows = question()
        took = 1000.0 * (time.perf_counter() - started)
        found.append(Asked(name, took, took, took, rows))
        time.sleep(0.1)
    return found


def summary(parts: Sequence[Asked]) -> Asked:
    """Percentiles over single answers."""
    took = [part.p50_ms for part in parts]
    p50, p95 = np.percentile(took, [50, 95])
    return Asked(parts[0].name, float(p50), float(p95), max(took), parts[-1].rows)


def run(
    kind: str, url: str, wheel_results: int, seconds: float, times: int, say: Callable[[str], None]
) -> Any:
    """Everything on one engine; print as it goes, return the figures."""
    say(f"\n{kind}: {wheel_results:,} wheel results of {len(STATIONS)} stations")
    steps = prepare(url, wheel_results)
    say(f"  loaded in {steps['load_s']:.0f} s, sums built in {steps['sums_s']:.0f} s")
    tables = sizes(url)
    for name, entry in tables.items():
        say("  " + f"{name:15}" + "".join(f" {value:>14,.0f} {unit}" for unit, value in entry.items()))
    cycles = wheel_results // len(WHEELS)
    with ResultReader(url) as reader:
        started = time.monotonic()
        with reader.transaction() as connection:
            last_day = int((END - timedelta(days=3)).timestamp()) // 3600
            checked = check_sums(connection, last_day)
        say(f"  sums of the last three days against the results: {len(checked.differences)} differences in"
            f" {checked.sums + checked.counts:,} ({time.monotonic() - started:.1f} s)")  # fmt: skip
        asked = ask(reader, cycles, times)
        for one in asked:
            say(f"  {one.name:45} p50 {one.p50_ms:7.1f} ms  p95 {one.p95_ms:7.1f} ms  ({one.rows:,} rows)")
        explained = plans(reader, cycles)
    for name, lines in explained.items():
        say(f"  plan of {name}:")
        for line in lines:
            say(f"    {line.strip()}")
    written: list[Written] = []
    for batch in (1,) if kind == "sqlite" else (1, 25):
        found = write_while_asking(url, kind, seconds, batch, cycles)
        written.append(found)
        say(f"  {found.writers} writers, {batch} per commit: {found.cycles_per_s:.0f} cycles/s,"
            f" commit p95 {found.commit_p95_ms:.0f} ms; meanwhile")  # fmt: skip
        for answer in found.asked:
            say(f"    {answer.name:43} p50 {answer.p50_ms:7.1f} ms  p95 {answer.p95_ms:7.1f} ms")
    figures = {f"{kind} {one.name} p95_ms": round(one.p95_ms, 1) for one in asked}
    for each in written:
        figures[f"{kind} cycles_per_s, {each.batch} per commit"] = round(each.cycles_per_s, 1)
        busy = {f"{kind} {one.name} p95_ms, {each.batch} per commit": one.p95_ms for one in each.asked}
        figures |= {name: round(value, 1) for name, value in busy.items()}
    fast = all(one.p95_ms <= GOAL_MS[kind] for one in asked)
    enough = any(each.cycles_per_s >= GOAL_RATE[kind] for each in written)
    met = fast and enough and not checked.differences
    return {"figures": figures, "sizes": tables, "plans": explained, "met": met}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--wheel-results", type=int, default=10_000_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="of writing")
    parser.add_argument("--times", type=int, default=60, help="that each question is asked")
    parser.add_argument("--engine", choices=["sqlite", "postgresql", "both"], default="both")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(arguments)
    say: Callable[[str], None] = (lambda _: None) if given.json else (lambda line: print(line, flush=True))
    results = {}
    with ExitStack() as stack:
        if given.engine in ("postgresql", "both"):
            programs = binaries()
            if programs is None:
                print("PostgreSQL is not installed (Debian: apt-get install postgresql)", file=sys.stderr)
                return 2
            server = stack.enter_context(postgres_server(temporary_folder(), programs, SERVER))
            url = stack.enter_context(server.database())
            results["postgresql"] = run(
                "postgresql", url, given.wheel_results, given.seconds, given.times, say
            )
        if given.engine in ("sqlite", "both"):
            folder = Path(tempfile.mkdtemp(prefix="truewheel-bench-"))
            stack.callback(shutil.rmtree, folder)
            url = f"sqlite:///{folder / 'results.db'}"
            results["sqlite"] = run("sqlite", url, given.wheel_results, given.seconds, given.times, say)
    if given.json:
        figures = {name: value for one in results.values() for name, value in one["figures"].items()}
        print(json.dumps({"figures": figures, **results}, indent=2))
    return 0 if all(one["met"] for one in results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
