"""The questions that quality engineers ask of a plant: how long each takes, and its plan."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import Engine, event

from benchmarks.database_plant import END, SEED, STATIONS, WHEELS
from db.queries import (
    Characteristic,
    Filter,
    GroupBy,
    Quantity,
    ResultReader,
    characteristic_moments,
    reasons,
    since_last_good_check,
    value_series,
    vin_history,
    wheel_counts,
    yield_counts,
)


@dataclass(frozen=True)
class Asked:
    """One question, asked many times with other stations and times: milliseconds.

    Attributes
    ----------
    cpu_p95_ms
        Of processors that worked for it, here and in the server: without what others on this computer took.
    rows
        Of the last answer.
    """

    name: str
    p50_ms: float
    p95_ms: float
    worst_ms: float
    cpu_p95_ms: float
    rows: int


def cpu_clock(engine: Engine) -> Callable[[], float]:
    """Milliseconds of processor time of this program and of its connection's process in the server."""
    if engine.dialect.name == "sqlite":
        return lambda: 1e3 * time.process_time()
    with engine.connect() as connection:
        driver: Any = connection.connection.dbapi_connection
        counted = Path(f"/proc/{driver.info.backend_pid}/schedstat")

    def clock() -> float:
        # Nanoseconds come first; a connection that was replaced counts no more.
        server = int(counted.read_text().split()[0]) if counted.exists() else 0
        return 1e3 * time.process_time() + 1e-6 * server

    return clock


def questions(reader: ResultReader, cycles: int, rng: random.Random) -> dict[str, Callable[[], int]]:
    """The questions that quality engineers ask, each with its own station and time at every call."""

    def newest() -> datetime:
        # Of the newest data, at an odd time.
        return END + timedelta(minutes=rng.uniform(1.0, 59.0))

    def toe() -> Characteristic:
        return Characteristic(rng.choice(WHEELS), Quantity.TOE)

    def shift(stations: tuple[str, ...]) -> int:
        # The one that runs, or one of the two before it.
        start = END - timedelta(hours=8 * rng.randint(0, 2))
        where = Filter(from_utc=start, until_utc=start + timedelta(hours=8), stations=stations)
        return (
            len(yield_counts(reader, where, by=(GroupBy.HOUR,)))
            + len(wheel_counts(reader, where, by=(GroupBy.PART,)))
            + len(reasons(reader, where))
            + len(characteristic_moments(reader, where))
        )

    def month(stations: tuple[str, ...]) -> int:
        until = newest()
        return len(
            characteristic_moments(reader, Filter(until - timedelta(days=30), until, stations), (toe(),))
        )

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


def ask(reader: ResultReader, cycles: int, times: int) -> list[Asked]:
    """Ask every question some times, after some times that only warm up."""
    rng = random.Random(SEED)
    clock = cpu_clock(engine_of(reader))
    found = []
    for name, question in questions(reader, cycles, rng).items():
        for _ in range(5):
            question()
        found.append(summary([timed(name, question, clock) for _ in range(times)]))
    return found


def ask_once(reader: ResultReader, cycles: int, seed: int) -> list[Asked]:
    """Every question once, a little apart, as people and screens ask."""
    clock = cpu_clock(engine_of(reader))
    found = []
    for name, question in questions(reader, cycles, random.Random(seed)).items():
        found.append(timed(name, question, clock))
        time.sleep(0.1)
    return found


def timed(name: str, question: Callable[[], int], clock: Callable[[], float]) -> Asked:
    """One answer; `clock` counts processor time."""
    worked, started = clock(), time.perf_counter()
    rows = question()
    took = 1e3 * (time.perf_counter() - started)
    return Asked(name, took, took, took, clock() - worked, rows)


def summary(parts: Sequence[Asked]) -> Asked:
    """Percentiles over single answers."""
    p50, p95 = np.percentile([part.p50_ms for part in parts], [50, 95])
    cpu = np.percentile([part.cpu_p95_ms for part in parts], 95)
    worst = max(part.worst_ms for part in parts)
    return Asked(parts[0].name, float(p50), float(p95), worst, float(cpu), parts[-1].rows)


def engine_of(reader: ResultReader) -> Engine:
    """The reader's connections, which are nobody else's business."""
    engine = reader._engine
    assert engine is not None
    return engine


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
    engine = engine_of(reader)
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
