"""Two serial devices joined back to back, so that two programs on one machine talk slcan without hardware.

Each end is a pseudo-terminal; python-can's ``slcan`` interface opens it like an adapter, with the option
``sleep_after_open = 0.0``. Linux and macOS only. What is sent while the other end is closed is lost, as on a
real bus with nobody on it.

The system chooses the names of the devices. An end that somebody types can have a name of its own: a symbolic
link, gone with the cable.
"""

from __future__ import annotations

import os
import select
import threading
import tty
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from alignment.errors import ConfigurationError
from station.line.wire import BusSettings
from station.threads import SupervisedThread

SLCAN_OPTIONS: dict[str, Any] = {"sleep_after_open": 0.0}
_CHUNK = 65_536
_POLL_MS, _HUNG_UP_POLL_S = 50, 0.005
_LARGEST_BACKLOG = 65_536


class Cable:
    """A cable with two ends; use it in a `with`, or call `close`.

    Parameters
    ----------
    plug
        A file name for the second end; None leaves it the one that the system chose.

    Raises
    ------
    ConfigurationError
        When something else has that name, or no link can be made there.

    Attributes
    ----------
    ends
        Device names of the two ends.
    lost_bytes
        What was sent to an end that nobody had open, or that nobody read.
    """

    def __init__(self, plug: Path | None = None) -> None:
        pairs = [os.openpty() for _ in range(2)]
        self.ends = (os.ttyname(pairs[0][1]), os.ttyname(pairs[1][1]))
        self._masters = [master for master, _ in pairs]
        self._plug: Path | None = None
        self._backlog = [b"", b""]
        self.lost_bytes = 0
        for master, slave in pairs:
            tty.setraw(slave)
            os.set_blocking(master, False)
            # Not held open: a master whose device nobody has open says so.
            os.close(slave)
        if plug is not None:
            try:
                self._name(plug)
            except BaseException:
                self._let_go()
                raise
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
        self._let_go()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _name(self, plug: Path) -> None:
        """Link the name to the second end; a link that leads nowhere was left by a killed program."""
        try:
            plug.parent.mkdir(parents=True, exist_ok=True)
            if plug.is_symlink() and not plug.exists():
                plug.unlink()
            plug.symlink_to(self.ends[1])
        except OSError as error:
            there = plug.is_symlink() or plug.exists()
            raise ConfigurationError(
                file=plug,
                choice="cable",
                expected="a new name for the other end of the cable",
                seen="something of this name" if there else error.strerror or str(error),
                cure="Choose another name, or remove it if no other program has it"
                if there
                else "Choose a place that can be written",
            ) from error
        self._plug = plug

    def _let_go(self) -> None:
        plug, self._plug = self._plug, None
        if plug is not None and plug.is_symlink() and str(plug.readlink()) == self.ends[1]:
            plug.unlink()
        masters, self._masters = self._masters, []
        for master in masters:
            os.close(master)

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
