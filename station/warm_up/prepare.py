"""Everything compiled and loaded before a work begins; says what it does while it takes time."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from alignment.errors import TruewheelError, WarmUpError
from alignment.imaging import extract_many
from alignment.kernels import UNSAVED
from alignment.values import Image
from station.warm_up.needs import Needed, Work, load, missing, needed, weight
from station.warm_up.workers import Compiled, compile_apart, worker_count

FUNCTION_TIMEOUT_S = 600.0
_LOG_EVERY_S = 5.0
_LOG = logging.getLogger("truewheel.station")
_DARK: dict[Work, Image] = {
    Work.MEASURE_8: np.zeros((64, 64), np.uint8),
    Work.MEASURE_16: np.zeros((64, 64), np.uint16),
}

CompileApart = Callable[[Sequence[Needed], float, threading.Event], Iterable[Compiled]]


class StoppedError(TruewheelError):
    """The program was told to end while it was starting."""


@dataclass(frozen=True)
class WarmUpProgress:
    """How far it is: the share done, 0 to 1, how many functions of how many, and the last one."""

    share: float
    done: int
    total: int
    name: str = ""


@dataclass(frozen=True)
class WarmedUp:
    """What was done: each function that was compiled, how many there are, and the time, seconds."""

    compiled: tuple[Compiled, ...]
    functions: int
    seconds: float

    @property
    def unsaved(self) -> str | None:
        """Why the disk did not keep what was compiled; None when it did."""
        return next((one.unsaved for one in self.compiled if one.unsaved is not None), None)


def warm_up(
    works: Iterable[Work],
    report: Callable[[WarmUpProgress], None] = lambda progress: None,
    stopping: threading.Event | None = None,
    *,
    loaded: bool = True,
    apart: CompileApart = compile_apart,
    clock: Callable[[], float] = time.monotonic,
) -> WarmedUp:
    """Compile what these works need and is missing, in processes of its own, and load all of it here.

    Where the disk keeps nothing (a read-only folder, no room) it is compiled in this process instead, at
    each start.

    Parameters
    ----------
    works
        What is going to be done.
    report
        Told of every step while something is compiled.
    stopping
        Ends it early.
    loaded
        Whether to load everything too, so that the first measurement does not wait for that either; without,
        only what is missing is compiled.
    apart
        Compiles in other processes.
    clock
        Monotonic seconds.

    Raises
    ------
    WarmUpError
        When something does not compile within its bound.
    StoppedError
        When `stopping` was set.
    """
    works, stopping = tuple(works), stopping or threading.Event()
    started, every, absent = clock(), needed(works), missing(works)
    compiled: list[Compiled] = []
    if absent:
        _LOG.info(
            "compiling %d functions in %d processes; once on a computer, about a minute",
            len(absent),
            min(worker_count(), len(absent)),
        )
        compiled = _compile(absent, report, stopping, apart, clock)
    if loaded or any(one.unsaved for one in compiled):
        compiled += _load(every if loaded else absent, stopping, clock)
    if loaded:
        _first_images(works)
    result = WarmedUp(tuple(compiled), len(every), clock() - started)
    if result.unsaved is not None:
        _LOG.warning(
            "what was compiled is not kept (%s): each start compiles anew; make room, or name a folder that "
            "can be written in NUMBA_CACHE_DIR",
            result.unsaved,
        )
    if absent:
        _LOG.info("compiled %d functions in %.0f s", len(absent), result.seconds)
    return result


def _compile(
    absent: Sequence[Needed],
    report: Callable[[WarmUpProgress], None],
    stopping: threading.Event,
    apart: CompileApart,
    clock: Callable[[], float],
) -> list[Compiled]:
    """Compile in other processes, until one tells that the disk keeps nothing."""
    compiled: list[Compiled] = []
    total, done, logged = sum(map(weight, absent)), 0, clock()
    report(WarmUpProgress(0.0, 0, len(absent)))
    for one in apart(absent, FUNCTION_TIMEOUT_S, stopping):
        compiled.append(one)
        done += weight(one.what)
        progress = WarmUpProgress(done / total, len(compiled), len(absent), one.what.name)
        report(progress)
        if clock() - logged >= _LOG_EVERY_S:
            logged = clock()
            _LOG.info(
                "compiled %d of %d functions (%.0f %%), the last was %s",
                len(compiled),
                len(absent),
                100 * progress.share,
                one.what.name,
            )
        if one.unsaved is not None:
            break
    _check(stopping)
    return compiled


def _load(every: Sequence[Needed], stopping: threading.Event, clock: Callable[[], float]) -> list[Compiled]:
    """Load everything into this process, compiling what the disk does not hold."""
    compiled = []
    for one in every:
        _check(stopping)
        before = clock()
        if load(one):
            compiled.append(Compiled(one, True, clock() - before, UNSAVED.get(one.name)))
    return compiled


def _first_images(works: Sequence[Work]) -> None:
    """Look for lines in dark images: numba's lists and the threads of the search begin with their first."""
    for dark in (_DARK[work] for work in works if work in _DARK):
        if any(found is not None for found in extract_many([dark, dark])):
            raise WarmUpError(
                "the search for light lines found some in a dark image; report this as a defect"
            )


def _check(stopping: threading.Event) -> None:
    if stopping.is_set():
        raise StoppedError("told to end while starting")
