"""Counts the steps of a cycle, and ends the process at one of them as a power cut would.

A step is the moment before or after each call of the cycle to its line and its database, each statement and
commit on the database, and each frame that the counting thread sends. The first run writes their names down;
a later run is killed at the one with a certain number.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from typing import Any

import can
from sqlalchemy import Engine, event

from station.cycle import Trigger

_QUIET = frozenset({"next_command", "tick"})


class Steps:
    """Counts steps from `begin` to `end`.

    Parameters
    ----------
    kill_at
        Number of the step at which the process is killed; None only counts.
    """

    def __init__(self, kill_at: int | None = None) -> None:
        self.names: list[str] = []
        self._kill_at = kill_at
        self._counting = False
        self._lock = threading.Lock()
        self._thread = threading.get_ident()

    def begin(self) -> None:
        """Count from now on; frames are those of the thread that made this object."""
        self._counting = True

    def end(self) -> None:
        """Count no more."""
        self._counting = False

    def step(self, name: str) -> None:
        """Come to a step."""
        with self._lock:
            if not self._counting:
                return
            if len(self.names) == self._kill_at:
                os.kill(os.getpid(), signal.SIGKILL)
            self.names.append(name)

    def frame(self, identifier: int) -> None:
        """Come to the sending of a frame."""
        if threading.get_ident() == self._thread:
            self.step(f"frame 0x{identifier:X}")

    def watch_database(self) -> None:
        """Make steps of the statements and commits of every database of this process."""

        def statement(connection: Any, cursor: Any, text: str, *rest: Any) -> None:
            self.step(f"statement {text.split('(', maxsplit=1)[0].strip()[:40]}")

        def commit(connection: Any) -> None:
            self.step("commit")

        event.listen(Engine, "before_cursor_execute", statement)
        event.listen(Engine, "commit", commit)


class Stepped:
    """Stands before an object; each call of a public method is a step before and a step after.

    A `Trigger` that comes out of `next_command` begins the counting.
    """

    def __init__(self, inner: object, steps: Steps) -> None:
        self._inner = inner
        self._steps = steps

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._inner, name)
        if not callable(found):
            return found
        return self._taking(found) if name in _QUIET else self._stepping(name, found)

    def _stepping(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def stepped(*arguments: Any, **named: Any) -> Any:
            self._steps.step(f"before {name}")
            result = call(*arguments, **named)
            self._steps.step(f"after {name}")
            return result

        return stepped

    def _taking(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def taken(*arguments: Any, **named: Any) -> Any:
            result = call(*arguments, **named)
            if isinstance(result, Trigger):
                self._steps.begin()
            if result is not None:
                self._steps.step(f"took {type(result).__name__}")
            return result

        return taken


class SteppedBus(can.BusABC):
    """Stands before a bus; each frame sent by the counting thread is a step."""

    def __init__(self, inner: can.BusABC, steps: Steps) -> None:
        super().__init__(channel=str(inner.channel_info))
        self._inner = inner
        self._steps = steps
        self.channel_info = inner.channel_info

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame."""
        self._steps.frame(msg.arbitration_id)
        self._inner.send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Receive a frame."""
        return self._inner.recv(timeout)

    def shutdown(self) -> None:
        """Close both."""
        super().shutdown()
        self._inner.shutdown()
