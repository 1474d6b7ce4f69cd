"""What processes that measure need is loaded once, ahead of them, in a process that they are forked from."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import forkserver, get_context
from multiprocessing.context import ForkServerContext

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_LOADED = ["station.replay.one"]


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let processes that are started meanwhile compute in one thread each.

    They share the cores, and threads beside them only get in the way.
    """
    before = {name: os.environ.get(name) for name in _VARIABLES}
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def load_ahead() -> None:
    """Begin to load what measures, beside what this process does next; it ends with this process."""
    context = measuring_processes()
    context.set_forkserver_preload(_LOADED)
    with one_thread_each():
        forkserver.ensure_running()


def measuring_processes() -> ForkServerContext:
    """How processes that measure are started."""
    return get_context("forkserver")
