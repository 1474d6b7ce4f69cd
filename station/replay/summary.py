"""What came of a replay: counts, causes, and those folders of which somebody should know."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from station.replay.values import Replayed, ReplayState

MOST_LACKS = 50
MOST_LISTED = 1000
"""Folders that are listed; the journal holds all."""


@dataclass
class ReplaySummary:
    """Counts of a replay.

    Attributes
    ----------
    archive
        What was replayed.
    states
        How many folders are in each.
    causes
        How often each cause was found, by its kind.
    lacks
        What archives do not hold, and of how many folders; at most `MOST_LACKS`.
    listed
        Those that are not identical, at most `MOST_LISTED`.
    measured
        How many were measured again.
    earlier
        How many of all a run before this one had measured.
    largest
        Largest difference of an angle, radians, by its name.
    measure_s
        Time that the measurements took together, without reading.
    journal
        Where one line of each folder is kept; None when it is not.
    """

    archive: Path
    states: Counter[ReplayState] = field(default_factory=Counter)
    causes: Counter[str] = field(default_factory=Counter)
    lacks: Counter[str] = field(default_factory=Counter)
    listed: list[Replayed] = field(default_factory=list)
    measured: int = 0
    earlier: int = 0
    largest: dict[str, float] = field(default_factory=dict)
    measure_s: float = 0.0
    seconds: float = 0.0
    journal: Path | None = None

    @property
    def folders(self) -> int:
        """All that were looked at."""
        return sum(self.states.values())

    @property
    def identical(self) -> bool:
        """Whether nothing differs, is damaged, or could not be compared."""
        return self.folders == self.states[ReplayState.IDENTICAL]

    def add(self, done: Replayed) -> None:
        """Count a folder."""
        self.states[done.state] += 1
        self.measured += done.measured
        self.measure_s += done.duration_s
        for text in done.causes:
            self.causes[text.partition(":")[0]] += 1
        for text in done.lacks:
            if text in self.lacks or len(self.lacks) < MOST_LACKS:
                self.lacks[text] += 1
        for each in done.differences:
            if each.field in ("camber", "toe", "run_out") and isinstance(each.stored, float):
                apart = abs(each.stored - each.found) if isinstance(each.found, float) else 0.0
                self.largest[each.field] = max(apart, self.largest.get(each.field, 0.0))
        if done.state is not ReplayState.IDENTICAL and len(self.listed) < MOST_LISTED:
            self.listed.append(done)
