"""Two serial devices joined back to back, so that two programs on one machine talk slcan without hardware.

Each end is a pseudo-terminal; python-can's ``slcan`` interface opens it like an adapter, with the option
``sleep_after_open = 0.0``. Linux and macOS only. What is sent while the other end is closed is lost, as on a
real bus with nobody on it.
"""

from __future__ import annotations

import os
import select
import threading
import tty
from types import TracebackType
from typing import Any, Self

from station.line.wire import BusSettings
from station.threads import SupervisedThread

SLCAN_OPTIONS: dict[str, Any] = {"sleep_after_open": 0.0}
_CHUNK = 65_536
_POLL_MS, _HUNG_UP_POLL_S = 50, 0.005
_LARGEST_BACKLOG = 65_536


class Cable:
    """A cable with two ends; use it in a `with`, or call `close`.

    Attributes
    ----------
    ends
        Device names of the two ends.
    lost_bytes
        What was sent to an end that nobody had open, or that nobody read.
    """

    def __init__(self) -> None:
        pairs = [os.openpty() for _ in range(2)]
        self.ends = (os.ttyname(pairs[0][1]), os.ttyname(pairs[1][1]))
        self._masters = [master for master, _ in pairs]
        self._backlog = [b"", b""]
        self.lost_bytes = 0
        for master, slave in pairs:
            tty.setraw(slave)
            os.set_blocking(master, False)
            # Not held open: a master whose device nobody has open says so.
            os.close(slave)
        self._poll = select.poll()
        for master in self._masters:
            self._poll.register(master, select.POLLIN)
        self._relay = SupervisedThread("line cable", self._step)
        self._relay.start()

    def settings(self, end: int) -> BusSettings:
        """How to open one end, 0 or 1."""
        return BusSettings("slcan", self.ends[end], options=SLCAN_OPTIONS)

    def close(self) -> None:
        """Pull the cable out; harmless when closed."""
        self._relay.stop()
        masters, self._masters = self._masters, []
        for master in masters:
            os.close(master)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _step(self, stopping: threading.Event) -> None:
        waiting = any(self._backlog)
        ready = dict(self._poll.poll(0 if waiting else _POLL_MS))
        hung_up = [bool(ready.get(master, 0) & select.POLLHUP) for master in self._masters]
        for source in (0, 1):
            if hung_up[source]:
                self.lost_bytes += len(self._backlog[source])
                self._backlog[source] = b""
            elif ready.get(self._masters[source], 0) & select.POLLIN:
                self._backlog[1 - source] += os.read(self._masters[source], _CHUNK)
        for target in (0, 1):
            if self._backlog[target] and not hung_up[target]:
                self._write(target)
        if any(hung_up) or waiting:
            stopping.wait(_HUNG_UP_POLL_S if any(hung_up) else 0.0005)

    def _write(self, target: int) -> None:
        data = self._backlog[target]
        try:
            data = data[os.write(self._masters[target], data) :]
        except BlockingIOError:
            # Whoever has that end open does not read; the oldest frames are lost first, whole ones.
            if len(data) > _LARGEST_BACKLOG:
                kept = data[data.find(b"\r", len(data) - _LARGEST_BACKLOG) + 1 :]
                self.lost_bytes += len(data) - len(kept)
                data = kept
        self._backlog[target] = data
