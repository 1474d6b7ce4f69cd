"""Writing cycles durably from many programs while questions are asked of the same database."""

from __future__ import annotations

import multiprocessing
import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.database_plant import END, STATIONS, new_cycle
from benchmarks.database_questions import Asked, ask_once, cpu_clock, summary
from db.connection import make_engine, parse_url
from db.queries import ResultReader
from db.rows import write_cycles
from db.store import ResultStore
from db.sums import update_sums

WRITERS = {"postgresql": 20, "sqlite": 1}
GOAL_RATE = {"postgresql": 500.0, "sqlite": 50.0}


@dataclass(frozen=True)
class Written:
    """Writing while questions are asked.

    Attributes
    ----------
    cycles_per_s
        Durable, all writers together.
    commit_p95_ms
        Of one transaction of `batch` cycles.
    cpu_ms
        Processor time of one cycle, in the program that writes and in the server for it.
    asked
        The questions meanwhile.
    """

    writers: int
    batch: int
    cycles_per_s: float
    commit_p95_ms: float
    cpu_ms: float
    asked: list[Asked]


def write_for(url: str, station: str, rate: float, seconds: float, batch: int, ready: Any, out: Any) -> None:
    """Write cycles at a rate, each transaction durable before the next; put how many and how long it took."""
    engine = make_engine(parse_url(url), timeout_s=10.0)
    latencies: list[float] = []
    number = 0
    with ResultStore(url, timeout_s=10.0) as store:
        store.write_cycle(new_cycle(station, 99_999_999))
        assert store._engine is not None
        clock = cpu_clock(store._engine if batch == 1 else engine)
        out.put(None)
        ready.wait()
        worked, started = clock(), time.perf_counter()
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
        out.put((number, latencies, clock() - worked))
    engine.dispose()


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
    for _ in writers:
        out.get(timeout=120.0)
    stopping = threading.Event()
    engine = make_engine(parse_url(url), timeout_s=30.0)

    def keep_sums() -> None:
        while not stopping.wait(0.5):
            update_sums(engine, most=500 if kind == "sqlite" else 5_000)

    keeper = threading.Thread(target=keep_sums)
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
    total = sum(number for number, _, _ in results)
    latencies = [value for _, part, _ in results for value in part]
    worked = sum(cpu for _, _, cpu in results)
    p95 = float(np.percentile(latencies, 95))
    return Written(len(writers), batch, total / seconds, p95, worked / max(total, 1), asked)
