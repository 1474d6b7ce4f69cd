"""Results that the line was told and did not acknowledge: found again after a restart of the station.

What became of a cycle's results is an event of the database: it is only ever added, and names the cycle.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol
from uuid import UUID

from db.records import CycleOutcome, CycleRecord, EventRecord, StoredCycle
from station.line.messages import StationState
from station.records import Standing

# Of each code the newest few: the last cycle's are among them.
_NEWEST = 20


class Closing(enum.StrEnum):
    """Event codes that say what became of a cycle's results; the event's text begins with the cycle.

    ACKNOWLEDGED: the controller took them over. DISCARDED: it reset the station instead. ABORTED_LATE: it was
    told 'aborted', because the abort came after the commit; not an end by itself.
    """

    ACKNOWLEDGED = "acknowledged"
    DISCARDED = "discarded"
    ABORTED_LATE = "aborted_late"


@dataclass(frozen=True)
class Held:
    """Results that wait for their acknowledgement: of which start and cycle, and the state after it.

    `cycle` is None when no record of one is in the database.
    """

    sequence: int
    cycle: UUID | None
    after: StationState


class History(Protocol):
    """What is needed of the database."""

    def recent_cycles(self, n: int, station: str | None = None) -> tuple[StoredCycle, ...]:
        """Return the last cycles of a station, newest first."""
        ...

    def recent_events(
        self, n: int, station: str | None = None, codes: Sequence[str] = ()
    ) -> tuple[EventRecord, ...]:
        """Return the last events of a station, of each code so many, newest first."""
        ...


def closing_text(cycle: UUID, sequence: int) -> str:
    """Return the text of a closing event."""
    return f"{cycle}: results of start {sequence}"


def unacknowledged(history: History, station: str) -> tuple[CycleRecord, Standing] | None:
    """Return the station's last cycle when nobody acknowledged its results, and how the line was told it.

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
    aborted = record.outcome is CycleOutcome.ABORTED or Closing.ABORTED_LATE in codes
    return record, Standing.ABORTED if aborted else Standing.COMMITTED


def _last_cycle(history: History, station: str) -> CycleRecord | None:
    """Stations may share a database, so the last cycle of all may be another's."""
    return next((stored.record for stored in history.recent_cycles(1, station)), None)


def _closings(history: History, record: CycleRecord) -> set[str]:
    """Codes of the events of this cycle."""
    events = history.recent_events(_NEWEST, record.station, tuple(Closing))
    return {event.code for event in events if event.text.startswith(str(record.uuid))}
