"""Processes of this computer that measure folders, one thread each."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import parent_process
from typing import TYPE_CHECKING

from station.replay.ahead import load_ahead, measuring_processes, one_thread_each
from station.replay.values import Choices, Job, Replayed, ReplayState

if TYPE_CHECKING:
    from station.replay.one import Measurer

MOST_TRIES = 2
"""How often a folder is begun alone whose process ended amid it."""
ENDED = "the process that measured it ended; check that there is memory left"
_WAITING_FOR_EACH = 3


def measure_in_processes(jobs: Iterator[Job], choices: Choices, workers: int) -> Iterator[Replayed]:
    """Yield what came of folders, in the order in which they are done.

    Parameters
    ----------
    jobs
        Taken as there is room: few are in memory at once.
    choices
        For all of them.
    workers
        Processes.
    """
    lost: deque[Job] = deque()
    tries: dict[str, int] = {}
    while True:
        with _pool(choices, workers) as pool:
            for done, job in _measured(pool, jobs, lost, _WAITING_FOR_EACH * workers):
                if done is not None:
                    yield done
                    continue
                # With others beside it nobody knows which of them ended the process; alone it is this one.
                tries[job.key] = tries.get(job.key, 0) + 1
                if tries[job.key] > MOST_TRIES:
                    yield Replayed(job.key, ReplayState.FAILED, lacks=(ENDED,))
                else:
                    lost.append(job)
            if not lost:
                return


def _measured(
    pool: ProcessPoolExecutor, jobs: Iterator[Job], lost: deque[Job], most: int
) -> Iterator[tuple[Replayed | None, Job]]:
    """Yield folders and what came of them until none is left, or a process ends: None of those that it took.

    Those that were lost before come first, one by one.
    """
    running: dict[Future[Replayed], Job] = {}
    intact, alone = True, False
    while True:
        while intact and len(running) < most and not (alone and running):
            alone = bool(lost)
            if alone and running:
                break
            job = lost.popleft() if lost else next(jobs, None)
            if job is None:
                break
            try:
                running[pool.submit(_replay, job)] = job
            except BrokenProcessPool:
                # An idle process ended: this one is not begun.
                intact = False
                yield None, job
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            job = running.pop(future)
            try:
                yield future.result(), job
            except BrokenProcessPool:
                intact = False
                yield None, job


@contextmanager
def _pool(choices: Choices, workers: int) -> Iterator[ProcessPoolExecutor]:
    load_ahead()
    with one_thread_each():
        pool = ProcessPoolExecutor(workers, measuring_processes(), _begin, (choices,))
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _begin(choices: Choices) -> None:
    """Prepare a process: interrupts are the asking process's business, and without it there is none."""
    # Numba and all that measures; the asking process does without.
    from station.replay.one import Measurer

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True, name="end with the parent").start()
    _OWN.append(Measurer(choices))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


_OWN: list[Measurer] = []


def _replay(job: Job) -> Replayed:
    return _OWN[-1].replay(job)
