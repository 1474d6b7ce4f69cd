"""What must still be stored: kept in its order until the database has taken it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import dataclass

from alignment.errors import InputError, StoreUnavailableError
from station.cycle.recording.store_thread import StoreThread
from station.threads import WorkerError

# Between two attempts that nobody waits for.
RETRY_S = 1.0
_LOG = logging.getLogger("truewheel.station")


@dataclass(eq=False)
class _Entry:
    what: str
    write: Callable[[], None]
    future: Future[None] | None = None
    tried_s: float = 0.0

    @property
    def pending(self) -> bool:
        return self.future is not None and not self.future.done()

    @property
    def error(self) -> BaseException | None:
        """Why it is not stored, when the attempt has ended without."""
        if self.future is None or self.future.cancelled():
            return StoreUnavailableError("the database could not be asked")
        return self.future.exception() if self.future.done() else None


class Owed:
    """Writes that are never given up, unlike a call that outlasts its bound.

    Each is handed to the store's thread at once, behind whatever hangs there, and again as long as it fails.
    Writing twice is harmless: a record is stored once. The station is at fault while anything is owed, so no
    more than what belongs to one vehicle collects.

    Parameters
    ----------
    thread
        Makes the writes.
    clock
        Monotonic seconds.
    """

    def __init__(self, thread: StoreThread, clock: Callable[[], float]) -> None:
        self._thread = thread
        self._clock = clock
        self._entries: list[_Entry] = []

    def __bool__(self) -> bool:
        """Whether anything is owed, as far as was looked."""
        return bool(self._entries)

    def add(self, what: str, write: Callable[[], None]) -> None:
        """Owe a write; `what` names it for people."""
        entry = _Entry(what, write)
        self._entries.append(entry)
        self._try(entry)

    def look(self) -> bool:
        """Without waiting, drop what was stored and try the rest once in a while; true when none is left."""
        self._drop()
        for entry in self._entries:
            if not entry.pending and self._clock() - entry.tried_s >= RETRY_S:
                self._try(entry)
        return not self._entries

    def settle(self) -> bool:
        """Wait within the store's bound until all is stored; what failed before is tried once more."""
        self._drop()
        for entry in self._entries:
            if not entry.pending:
                self._try(entry)
        wait([entry.future for entry in self._entries if entry.future is not None], self._thread.timeout_s)
        self._drop()
        for entry in self._entries:
            _LOG.error("%s is not stored yet: %s", entry.what, _why(entry))
        return not self._entries

    def _try(self, entry: _Entry) -> None:
        entry.tried_s = self._clock()
        try:
            entry.future = self._thread.submit(entry.write)
        except WorkerError as error:
            entry.future = None
            _LOG.error("%s is not stored yet: %s", entry.what, error)

    def _drop(self) -> None:
        self._entries = [entry for entry in self._entries if not _is_done(entry)]


def _is_done(entry: _Entry) -> bool:
    if entry.pending:
        return False
    error = entry.error
    if isinstance(error, InputError):
        # No database will ever take it, and the line must not wait for that.
        _LOG.error("%s cannot be stored: %s", entry.what, error)
        return True
    return error is None


def _why(entry: _Entry) -> str:
    return "the database does not answer" if entry.pending else str(entry.error)
