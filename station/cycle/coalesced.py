"""Messages that a peer can provoke at will: the first is said at once, its repetitions are counted.

A controller that starts a vehicle of an unknown type again and again, a cable that makes and breaks contact:
each kind of such a message is said once, and then in summaries, at growing intervals while it goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Generic, TypeVar

FIRST_PAUSE_S, LAST_PAUSE_S = 10.0, 600.0
MOST_KINDS = 64

K = TypeVar("K", bound=Hashable)


@dataclass
class _Repeated:
    """A kind since it was said last: how often it came, when, and the latest text."""

    pause_s: float
    said_s: float
    count: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    text: str = ""


class Coalesced(Generic[K]):
    """Says the first message of a kind, then summaries with their number, time span and the latest text.

    Parameters
    ----------
    say
        Takes a kind and a text; returns False when it could not say it, which ends `flush`.
    clock
        Monotonic seconds.
    first_pause_s, last_pause_s
        From a message to the summary of what came since; doubled after each summary, up to the last. A kind
        that did not come for a whole pause is said at once again.

    All methods are called from one thread, or under one lock. Of the kinds only the 64 that came last are
    remembered, each with one text.
    """

    def __init__(
        self,
        say: Callable[[K, str], object],
        clock: Callable[[], float],
        first_pause_s: float = FIRST_PAUSE_S,
        last_pause_s: float = LAST_PAUSE_S,
    ) -> None:
        self._say = say
        self._clock = clock
        self._first_pause_s = first_pause_s
        self._last_pause_s = last_pause_s
        self._kinds: dict[K, _Repeated] = {}

    def __len__(self) -> int:
        """Kinds of messages that are remembered."""
        return len(self._kinds)

    def say(self, kind: K, text: str) -> None:
        """Say a message, or count it."""
        self.flush_due()
        now = self._clock()
        known = self._kinds.get(kind)
        if known is None:
            while len(self._kinds) >= MOST_KINDS:
                self._end(next(iter(self._kinds)))
            self._kinds[kind] = _Repeated(self._first_pause_s, now)
            self._say(kind, text)
            return
        if known.count == 0:
            known.first_s = now
        known.count += 1
        known.last_s, known.text = now, text

    def flush_due(self) -> None:
        """Say the summaries whose time has come; call it now and then."""
        now = self._clock()
        for kind, known in list(self._kinds.items()):
            if now - known.said_s < known.pause_s:
                continue
            self._end(kind)
            if known.count > 0:
                self._kinds[kind] = _Repeated(min(2.0 * known.pause_s, self._last_pause_s), now)

    def flush(self) -> None:
        """Say all summaries, as at the end of the program."""
        while self._kinds:
            if self._end(next(iter(self._kinds))) is False:
                self._kinds.clear()

    def _end(self, kind: K) -> object:
        known = self._kinds.pop(kind)
        if known.count == 0:
            return None
        if known.count == 1:
            return self._say(kind, f"1 more: {known.text}")
        span_s = known.last_s - known.first_s
        return self._say(kind, f"{known.count} more within {span_s:.1f} s, the last: {known.text}")
