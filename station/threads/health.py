"""What becomes of the station's threads: counted, shown in its health, told once in a while."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from alignment.counting import count_of

# A thread that fails again and again is told of once in so long, with the count.
TOLD_EVERY_S = 60.0


class Watched(Protocol):
    """A supervised thread, as `SupervisedThread` and `Worker` are."""

    @property
    def name(self) -> str:
        """Of the thread."""
        ...

    @property
    def alive(self) -> bool:
        """True while it runs."""
        ...

    @property
    def failures(self) -> int:
        """How often it met what nobody foresaw."""
        ...

    @property
    def last_error(self) -> str | None:
        """What it met last, in words."""
        ...


@dataclass(frozen=True)
class ThreadHealth:
    """How one thread is: whether it runs, how often it failed, and how it did last."""

    name: str
    alive: bool
    failures: int
    last_error: str | None

    @property
    def good(self) -> bool:
        """Whether nobody needs to look."""
        return self.alive and self.failures == 0

    def __str__(self) -> str:
        state = "runs on" if self.alive else "has ended"
        last = "" if self.last_error is None else f", the last: {self.last_error}"
        return f"the thread '{self.name}' {state}; {count_of(self.failures, 'failure')}{last}"


class ThreadWatch:
    """Looks after threads that it did not start.

    Parameters
    ----------
    threads
        Started, or about to be.
    """

    def __init__(self, threads: Iterable[Watched]) -> None:
        self._threads = tuple(threads)
        self._told: dict[str, tuple[int, bool, float]] = {}

    @property
    def health(self) -> tuple[ThreadHealth, ...]:
        """Of every thread, now."""
        return tuple(
            ThreadHealth(thread.name, thread.alive, thread.failures, thread.last_error)
            for thread in self._threads
        )

    def news(self, now_s: float) -> list[str]:
        """Sentences about what is worse than when it was last told; at most one a minute for each thread."""
        found = []
        for health in self.health:
            failures, alive, told_s = self._told.get(health.name, (0, True, now_s - TOLD_EVERY_S))
            worse = health.failures > failures or (alive and not health.alive)
            if worse and now_s - told_s >= TOLD_EVERY_S:
                self._told[health.name] = (health.failures, health.alive, now_s)
                found.append(str(health))
        return found
