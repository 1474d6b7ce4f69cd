"""Compiling in processes of its own: the asking process goes on in time, and two cores share the work."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from alignment.errors import Deed, Remedy, WarmUpError
from station.warm_up.needs import Needed

_POLL_S = 0.05
MOST_WORKERS = 4  # each takes about 300 MB
COMMAND = (sys.executable, "-m", "station.warm_up.worker")
_ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Compiled:
    """One function that was compiled or found; `unsaved` says why the disk did not keep it."""

    what: Needed
    compiled: bool
    seconds: float
    unsaved: str | None = None


@dataclass
class _Worker:
    process: subprocess.Popen[bytes]
    errors: IO[bytes]
    task: Needed | None = None
    since_s: float = 0.0
    read: bytes = field(default=b"")


def worker_count() -> int:
    """Return how many processes may compile at once."""
    return max(1, min(MOST_WORKERS, len(os.sched_getaffinity(0))))


def compile_apart(
    tasks: Sequence[Needed],
    timeout_s: float,
    stopping: threading.Event,
    *,
    count: int | None = None,
    command: Sequence[str] = COMMAND,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Compiled]:
    """Compile in processes of its own, and yield what is done; ends early when `stopping` is set.

    Parameters
    ----------
    tasks
        In the order in which they begin.
    timeout_s
        Bound of each.
    stopping
        Ends it: the processes are killed.
    count, command
        Of the processes.
    clock
        Monotonic seconds.

    Raises
    ------
    WarmUpError
        When a function does not compile, a process ends or hangs.
    """
    waiting = list(reversed(tasks))
    number = min(count or worker_count(), len(waiting))
    with _started(number, command) as workers, selectors.DefaultSelector() as selector:
        for worker in workers:
            selector.register(_output(worker), selectors.EVENT_READ, worker)
            _give(worker, waiting, clock())
        while any(worker.task for worker in workers) and not stopping.is_set():
            for key, _ in selector.select(_POLL_S):
                worker = key.data
                answer = _answer(worker)
                if answer is not None:
                    _give(worker, waiting, clock())
                    yield answer
            for worker in workers:
                if worker.task is not None and clock() - worker.since_s > timeout_s:
                    raise WarmUpError(
                        f"compiling {worker.task.name} did not end within {timeout_s:g} s; check the load of "
                        "the computer",
                        Remedy(Deed.WARM_UP),
                    )


def _give(worker: _Worker, waiting: list[Needed], now_s: float) -> None:
    worker.task = waiting.pop() if waiting else None
    if worker.task is None:
        return
    worker.since_s = now_s
    text = json.dumps({"name": worker.task.name, "signature": worker.task.signature})
    assert worker.process.stdin is not None
    try:
        worker.process.stdin.write(text.encode() + b"\n")
        worker.process.stdin.flush()
    except OSError:
        # It ended; its output says so too.
        return


def _answer(worker: _Worker) -> Compiled | None:
    """Take what a worker wrote; None while its line is not whole."""
    part = os.read(_output(worker).fileno(), 65_536)
    if not part:
        raise WarmUpError(_last_words(worker), Remedy(Deed.WARM_UP))
    worker.read += part
    line, found, rest = worker.read.partition(b"\n")
    if not found or worker.task is None:
        return None
    worker.read = rest
    answer = json.loads(line)
    if answer["error"] is not None:
        raise WarmUpError(answer["error"])
    return Compiled(worker.task, answer["compiled"], answer["seconds"], answer["unsaved"])


def _last_words(worker: _Worker) -> str:
    code = worker.process.wait()
    worker.errors.seek(0)
    lines = worker.errors.read().decode(errors="replace").strip().splitlines()
    how = f"by signal {-code}" if code < 0 else f"with exit status {code}"
    said = f": {lines[-1]}" if lines else ""
    doing = "" if worker.task is None else f" at {worker.task.name}"
    return f"a process that compiles ended{doing} {how}{said}; check that there is memory left"


def _output(worker: _Worker) -> IO[bytes]:
    assert worker.process.stdout is not None
    return worker.process.stdout


@contextmanager
def _started(count: int, command: Sequence[str]) -> Iterator[list[_Worker]]:
    """Start the processes; none is left at the end, however it comes."""
    workers: list[_Worker] = []
    # The same program as this one, wherever this one was started.
    path = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"PYTHONPATH": path}
    try:
        for _ in range(count):
            errors = tempfile.TemporaryFile()  # noqa: SIM115  (closed below)
            # A session of its own: an interrupt at the terminal is answered by the asking process alone.
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                start_new_session=True,
                env=environment,
            )
            workers.append(_Worker(process, errors))
        yield workers
    finally:
        for worker in workers:
            worker.process.kill()
        for worker in workers:
            worker.process.communicate()
            worker.errors.close()
