"""A thread that makes calls one after the other, for work that may hang or fail in ways nobody foresaw.

Unlike an executor of the standard library it can be left: its queue is bounded, closing it is bounded, and a
call that never returns keeps neither the caller nor the end of the program.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, ParamSpec, TypeVar

from alignment.errors import LineError, TruewheelError
from station.threads.supervised import SupervisedThread, described

_P = ParamSpec("_P")
_T = TypeVar("_T")
_Call = tuple[Future[Any], Callable[[], Any]]
_LOOK_S = 0.05
_LOG = logging.getLogger("truewheel.threads")


class WorkerError(TruewheelError, RuntimeError):
    """A thread that takes no more calls: it has ended, or too many wait already."""


class Worker:
    """Makes calls in the order in which they were submitted.

    What a call raises is the result of its future. An error that is none of the product's, or of the
    operating system's, is a defect: it is counted and remembered as well, so that it shows in the health of
    the station even where nobody asks for the result.

    Parameters
    ----------
    name
        Of the thread.
    most_waiting
        Calls that may wait for the one under way.
    """

    def __init__(self, name: str, most_waiting: int = 64) -> None:
        self.name = name
        self._waiting: queue.Queue[_Call] = queue.Queue(most_waiting)
        self._most_waiting = most_waiting
        self._closed = False
        self._busy_since_s: float | None = None
        self._defects = 0
        self._last_defect: str | None = None
        self._thread = SupervisedThread(name, self._step)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """True while the thread runs."""
        return self._thread.alive

    @property
    def failures(self) -> int:
        """How many calls, or steps between them, raised what nobody foresaw."""
        return self._defects + self._thread.failures

    @property
    def last_error(self) -> str | None:
        """The last of these, in words."""
        return self._last_defect or self._thread.last_error

    @property
    def idle(self) -> bool:
        """Whether nothing is under way and nothing waits."""
        return self._waiting.unfinished_tasks == 0

    def submit(self, call: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Let a call be made; returns at once.

        Raises
        ------
        WorkerError
            When the thread has ended, or too many calls wait.
        """
        if self._closed or not self.alive:
            cause = f": {self.last_error}" if self.last_error is not None else ""
            raise WorkerError(f"the thread '{self.name}' has ended{cause}. Restart the station")
        future: Future[_T] = Future()
        try:
            self._waiting.put_nowait((future, lambda: call(*args, **kwargs)))
        except queue.Full:
            since = self._busy_since_s
            busy = "" if since is None else f", for one of {time.monotonic() - since:.1f} s ago"
            raise WorkerError(
                f"the thread '{self.name}' is too slow: {self._most_waiting} calls wait{busy}"
            ) from None
        return future

    def close(self, timeout_s: float = 5.0) -> bool:
        """Finish the calls that were submitted, and end; false when that takes longer than the bound.

        Then what has not begun is cancelled, and what is under way is left to itself.
        """
        self._closed = True
        deadline = time.monotonic() + timeout_s
        while not self.idle and self.alive and time.monotonic() < deadline:
            self._thread.stopping.wait(_LOOK_S / 5)
        finished = self.idle
        with contextlib.suppress(queue.Empty):
            while True:
                self._waiting.get_nowait()[0].cancel()
        self._thread.stopping.set()
        with contextlib.suppress(queue.Full):
            # Something to take, so that a thread that waits for work sees at once that it shall end.
            self._waiting.put_nowait((Future(), lambda: None))
        try:
            self._thread.stop(max(2 * _LOOK_S, deadline - time.monotonic()))
        except LineError:
            _LOG.error("the thread '%s' did not end within %g s and is left behind", self.name, timeout_s)
            return False
        return finished

    def _step(self, stopping: threading.Event) -> None:
        try:
            future, call = self._waiting.get(timeout=_LOOK_S)
        except queue.Empty:
            return
        try:
            if future.set_running_or_notify_cancel():
                self._busy_since_s = time.monotonic()
                self._make(future, call)
        finally:
            self._busy_since_s = None
            self._waiting.task_done()

    def _make(self, future: Future[Any], call: Callable[[], Any]) -> None:
        try:
            result = call()
        except BaseException as error:  # noqa: BLE001  (whatever it is, the caller must learn of it)
            if not isinstance(error, (TruewheelError, OSError)):
                self._defects += 1
                # In words: the error would keep what the call held, such as the images of a wheel.
                self._last_defect = described(error)
                _LOG.error("the thread '%s' failed", self.name, exc_info=error)
            future.set_exception(error)
        else:
            future.set_result(result)
