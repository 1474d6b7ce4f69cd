"""One thread for each rig: cameras mostly wait, and the mathematics releases the interpreter.

A rig that hangs keeps its own thread and no other. What was given up is remembered as long as it goes on: its
cameras are still in use.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, wait
from typing import Any, ParamSpec, TypeVar

from alignment.errors import TruewheelError
from station.cycle.wheels.series import MOST_WAITING
from station.cycle.words import ErrorCode, Failure, fault
from station.threads import Worker, WorkerError

_P = ParamSpec("_P")
_T = TypeVar("_T")
_CLOSING_S = 5.0


class WheelThreads:
    """The threads of some rigs, by their names; with `series` a second one each, that measures."""

    def __init__(self, rigs: Iterable[str], *, series: bool = False) -> None:
        self._workers = {rig: Worker(f"wheel {rig}") for rig in rigs}
        # Measure the exposures of a series while the rig's own thread takes the next.
        self._measuring = (
            {rig: Worker(f"series {rig}", MOST_WAITING) for rig in self._workers} if series else {}
        )
        self._left: set[Future[Any]] = set()

    @property
    def workers(self) -> tuple[Worker, ...]:
        """Of all rigs."""
        return (*self._workers.values(), *self._measuring.values())

    def measuring(self, rig: str) -> Worker:
        """The thread that measures the series of a rig; KeyError where there are none."""
        return self._measuring[rig]

    @property
    def left(self) -> bool:
        """Whether anything that was given up still goes on."""
        self.look()
        return bool(self._left)

    def look(self) -> None:
        """Let go what was given up and has ended, with the images that it came with."""
        self._left = {future for future in self._left if not future.done()}

    def submit(self, rig: str, call: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Let a rig's thread make a call; a thread that takes none gives a future that says so."""
        try:
            return self._workers[rig].submit(call, *args, **kwargs)
        except WorkerError as error:
            failed: Future[_T] = Future()
            failed.set_exception(error)
            return failed

    def each(self, calls: Mapping[str, Callable[[], None]], timeout_s: float) -> dict[str, Failure]:
        """Let some rigs make a call beside each other, within one bound; why those failed that did."""
        futures = {self.submit(rig, call): rig for rig, call in calls.items()}
        _, late = wait(futures, timeout_s)
        self.leave(late)
        failures = {}
        for future, rig in futures.items():
            if future in late:
                text = f"{rig}: its cameras did not answer within {timeout_s:g} s"
                failures[rig] = fault(ErrorCode.CAMERA_FAULT, text)
            elif isinstance(error := future.exception(), TruewheelError):
                failures[rig] = fault(ErrorCode.CAMERA_FAULT, str(error))
            elif error is not None:
                # A mistake in the program must become a fault that the line is told of.
                failures[rig] = fault(ErrorCode.INTERNAL_FAULT, f"{rig}: {type(error).__name__}: {error}")
        return failures

    def leave(self, futures: Iterable[Future[Any]]) -> None:
        """Give up waiting; what has not begun does not begin."""
        self._left |= {future for future in futures if not future.cancel()}

    def drain(self, timeout_s: float) -> bool:
        """Wait for what was given up; false when it goes on beyond the bound."""
        wait(self._left, timeout_s)
        return not self.left

    def close(self) -> bool:
        """End all threads within a bound; false when one hangs and is left to itself."""
        deadline = time.monotonic() + _CLOSING_S
        ended = [worker.close(max(0.0, deadline - time.monotonic())) for worker in self.workers]
        return all(ended)
