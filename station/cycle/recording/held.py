"""Results that the line was told and did not acknowledge: found again after a restart of the station.

What became of a cycle's results is an event of the database: it is only ever added, names the cycle, and has
a UUID made of the cycle's and of what became of it. So it is stored once, and found whatever the clocks said.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol
from uuid import UUID, uuid5

from db.records import CycleOutcome, CycleRecord, EventRecord, StoredCycle
from station.cycle.answering import Standing
from station.cycle.under_way import NO_TROUBLE, Trouble
from station.cycle.words import StationState


class Closing(enum.StrEnum):
    """Event codes that say what became of a cycle's results.

    OFFERED: the commit was confirmed in time, and the line is told what is stored. Without it nobody knows
    after a restart what the line was told, so it can have been nothing but a fault. ACKNOWLEDGED: the
    controller took the results over. DISCARDED: it reset the station instead. CONTRADICTED: the line was told
    otherwise than the cycle says; a cycle that says what it was told follows. ABORTED_LATE: the same, because
    an abort or a reset came after the commit.
    """

    OFFERED = "offered"
    ACKNOWLEDGED = "acknowledged"
    DISCARDED = "discarded"
    CONTRADICTED = "contradicted"
    ABORTED_LATE = "aborted_late"


@dataclass(frozen=True)
class Held:
    """Results that wait for their acknowledgement: of which start and cycle, the state after it, and why.

    `cycle` is None when no record of one is in the database.
    """

    sequence: int
    cycle: UUID | None
    after: StationState
    trouble: Trouble = NO_TROUBLE


class History(Protocol):
    """What is needed of the database."""

    def recent_cycles(self, n: int, station: str | None = None) -> tuple[StoredCycle, ...]:
        """Return the last cycles of a station, newest first."""
        ...

    def cycle_events(self, cycle: UUID, codes: Sequence[str]) -> tuple[EventRecord, ...]:
        """Return the newest event of each of these codes that is of this cycle."""
        ...


def closing_id(cycle: UUID, how: Closing) -> UUID:
    """Return the UUID of a closing event: writing it twice stores it once."""
    return uuid5(cycle, str(how))


def closing_text(cycle: UUID, sequence: int) -> str:
    """Return the text of a closing event, for people."""
    return f"{cycle}: results of start {sequence}"


def unacknowledged(history: History, station: str) -> tuple[CycleRecord, Standing] | None:
    """Return the station's last cycle when nobody acknowledged its results, and how the line was told it.

    A cycle whose offer was not confirmed counts as not committed: the program may have ended while the commit
    outlasted its bound, after the line had been told of a fault.

    Raises
    ------
    StoreError
        When the database fails.
    """
    record = _last_cycle(history, station)
    if record is None:
        return None
    codes = _closings(history, record)
    if codes & {Closing.ACKNOWLEDGED, Closing.DISCARDED}:
        return None
    if record.outcome is CycleOutcome.ABORTED or Closing.ABORTED_LATE in codes:
        return record, Standing.ABORTED
    return record, Standing.COMMITTED if Closing.OFFERED in codes else Standing.NOT_COMMITTED


def _last_cycle(history: History, station: str) -> CycleRecord | None:
    """Stations may share a database, so the last cycle of all may be another's."""
    return next((stored.record for stored in history.recent_cycles(1, station)), None)


def _closings(history: History, record: CycleRecord) -> set[str]:
    """Codes of the events of this cycle."""
    return {event.code for event in history.cycle_events(record.uuid, tuple(Closing))}
