"""What the cycle writes down; the one place that makes the database say what the line was told."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from datetime import datetime
from functools import partial
from typing import TypeVar
from uuid import UUID

from alignment.errors import InputError, StoreError
from db.records import (
    MASTER_OUTCOMES,
    MASTER_REFUSED,
    AdjustingRecord,
    CalibrationCheckRecord,
    CalibrationRecord,
    CycleOutcome,
    CycleRecord,
    EventRecord,
    Severity,
    ZeroRecord,
)
from station.cycle.answering import Standing, answers_of, as_told, contradicts
from station.cycle.ports import Identity, Line, Store
from station.cycle.recording.held import Closing, Held, closing_id, closing_text, unacknowledged
from station.cycle.recording.owed import Owed
from station.cycle.recording.store_thread import StoreThread
from station.cycle.words import StationState
from station.threads import Worker

_T = TypeVar("_T")
_LOG = logging.getLogger("truewheel.station")


class Ledger:
    """Writes cycles and events, each within a bound, and owes what must be stored in the end.

    Parameters
    ----------
    store
        Open.
    identity
        For the events.
    store_s
        Longest wait for one call.
    clock, now
        Monotonic seconds, and aware UTC time.
    """

    def __init__(
        self,
        store: Store,
        identity: Identity,
        store_s: float,
        clock: Callable[[], float],
        now: Callable[[], datetime],
    ) -> None:
        self._store = store
        self._identity = identity
        self._clock = clock
        self._now = now
        self._thread = StoreThread(store_s)
        self._owed = Owed(self._thread, clock)
        # The last cycle, where it measured a master.
        self._master: UUID | None = None

    @property
    def worker(self) -> Worker:
        """The thread of the store."""
        return self._thread.worker

    @property
    def owes(self) -> bool:
        """Whether something is not stored that must be; the station is not ready before it is."""
        return bool(self._owed)

    def begin(self, calibrations: Iterable[CalibrationRecord]) -> None:
        """Record calibrations and the start.

        Raises
        ------
        StoreError
            When they cannot be recorded.
        """
        for record in calibrations:
            self._thread.call(self._store.record_calibration, record)
        text = f"version {self._identity.software_version} started"
        self._thread.call(self._store.record_event, self.event(Severity.INFO, "started", text))

    def zeros(self, installed: Sequence[tuple[str, str]]) -> tuple[ZeroRecord, ...]:
        """Return the zero measurements in force of these rigs and calibrations; raises `StoreError`."""
        return self._thread.call(self._store.zeros_in_force, installed)

    def adjustings(self, vehicle_type: str, n: int) -> tuple[AdjustingRecord, ...]:
        """Return the last `n` adjusters whose nuts were locked on vehicles of a type; raises `StoreError`."""
        station = self._identity.station
        return self._thread.call(self._store.recent_adjustings, station, vehicle_type, n)

    def ask(self, question: Callable[..., _T], *about: datetime) -> _T:
        """Ask the database something, or let it note something, within the bound; raises `StoreError`."""
        return self._thread.call(question, *about)

    def ask_later(self, question: Callable[[], _T]) -> Future[_T]:
        """Ask it without waiting; raises `WorkerError` when the thread takes no more."""
        return self._thread.submit(question)

    def owe(self, event: EventRecord) -> None:
        """Owe an event, which is stored before the station is ready again."""
        self._owed.add(f"event {event.code}", partial(self._store.record_event, event))

    def commit(
        self,
        record: CycleRecord,
        checks: Sequence[CalibrationCheckRecord] = (),
        outcomes: Sequence[EventRecord] = (),
    ) -> float | None:
        """Store a cycle, and that the line is to be told it; the time, or None when that is not certain.

        Two commits: only the second tells a program that starts after this one that the first was in time.
        With outcomes of a master check, they, its checks and the cycle are one.
        """
        self._master = record.uuid if outcomes else None
        offered = self._closing(record.uuid, record.trigger_sequence, Closing.OFFERED)
        try:
            if outcomes:
                self._thread.call(self._store.write_master_check, record, checks, outcomes)
            else:
                self._thread.call(self._store.write_cycle, record)
                for check in checks:
                    self._thread.call(self._store.record_check, check)
            self._thread.call(self._store.record_event, offered)
        except (StoreError, InputError) as error:
            _LOG.error("cycle %s was not stored: %s", record.uuid, error)
            return None
        return self._clock()

    def tell(self, record: CycleRecord, standing: Standing, *, committed: bool, why: str) -> UUID:
        """Owe what the line is about to be told of a cycle; the UUID of the cycle that says it.

        Parameters
        ----------
        record
            Stored, or perhaps stored.
        standing
            How the line is told it.
        committed
            Whether it is certain that the record is stored.
        why
            The reason, a sentence, where the line is told otherwise than the record says.
        """
        if not contradicts(record, standing):
            if not committed:
                self._owed.add(f"cycle {record.uuid}", partial(self._store.write_cycle, record))
            return record.uuid
        told, event = as_told(record, standing, why), list[EventRecord]()
        what = f"what the line was told of cycle {record.uuid}"
        self._owed.add(what, partial(self._contradict, record, told, event))
        return told.uuid

    def end(self, cycle: UUID, sequence: int, how: Closing) -> bool:
        """Store what became of a cycle's results; false while that, or anything before it, is not stored."""
        event = self._closing(cycle, sequence, how)
        self._owed.add(f"event {event.code} of cycle {cycle}", partial(self._store.record_event, event))
        return self._owed.settle()

    def settle(self) -> bool:
        """Wait within the bound for all that is owed; false when some of it is not stored."""
        return self._owed.settle()

    def look(self) -> bool:
        """Try again to store what is owed, without waiting; true when nothing is."""
        return self._owed.look()

    def offer_again(self, line: Line) -> Held | None:
        """Hold the last cycle's results when the program ended before the line acknowledged them.

        Raises
        ------
        StoreError
            When the database fails.
        """
        found = self.unacknowledged()
        if found is None:
            return None
        record, standing = found
        answers = answers_of(record, standing)
        line.restore_results(record.trigger_sequence, answers.wheels, answers.axles, answers.vehicle)
        _LOG.warning("results of cycle %s were not acknowledged and are offered again", record.uuid)
        return Held(record.trigger_sequence, record.uuid, StationState.IDLE)

    def unacknowledged(self) -> tuple[CycleRecord, Standing] | None:
        """Return the last cycle whose results nobody took over, and how the line is to be told it.

        When it is to be told otherwise than it was stored, a record that says so is stored first.

        Raises
        ------
        StoreError
            When the database fails.
        """
        found = self._thread.call(unacknowledged, self._store, self._identity.station)
        if found is None:
            return None
        record, standing = found
        if not contradicts(record, standing):
            return record, standing
        why = "the station ended before it was certain that the results were stored in time"
        told = as_told(record, standing, why)
        self._thread.call(self._contradict, record, told, [])
        return told, standing

    def note(
        self,
        severity: Severity,
        code: str,
        text: str,
        cycle: UUID | None = None,
        value: float | None = None,
    ) -> bool:
        """Record an event, of a cycle if it is of one, with the number it tells.

        False when the database did not take it.
        The next commit will meet what kept it from that, too.
        """
        try:
            self._thread.call(self._store.record_event, self.event(severity, code, text, cycle, value))
        except StoreError as error:
            _LOG.error("event %s was not stored: %s (%s)", code, text, error)
            return False
        return True

    def note_run_outs(self, notes: Iterable[tuple[Severity, float, str]], cycle: UUID) -> None:
        """Record what there is to say of the run-outs of a cycle."""
        for severity, value_mm, text in notes:
            self.note(severity, "run_out", text, cycle, value_mm)

    def close(self) -> None:
        """Wait within the bound for what is owed, and end the thread; a call that hangs is left to itself."""
        if self._owed:
            self._owed.settle()
        self._thread.close()

    def _contradict(self, record: CycleRecord, told: CycleRecord, event: list[EventRecord]) -> None:
        """Store what the line was told, behind the cycle that says otherwise when that did land.

        `event` keeps the events from one attempt to the next: only the same ones may be written twice.
        """
        if not event:
            how = Closing.ABORTED_LATE if told.outcome is CycleOutcome.ABORTED else Closing.CONTRADICTED
            found = (
                "not stored" if self._store.cycle(record.uuid) is None else f"stored as '{record.outcome}'"
            )
            text = f"{closing_text(record.uuid, record.trigger_sequence)} are {found}; {told.reason_text}"
            said = self.event(Severity.WARNING, how, f"{text}; see cycle {told.uuid}", record.uuid)
            of_master = record.uuid == self._master or self._store.cycle_events(record.uuid, MASTER_OUTCOMES)
            # What was told instead of a master's results is no vehicle either.
            beside = [self.event(Severity.WARNING, MASTER_REFUSED, text, told.uuid)] if of_master else []
            event += [replace(said, uuid=closing_id(record.uuid, how)), *beside]
        if event[1:]:
            self._store.write_master_check(told, (), event[1:])
        else:
            self._store.write_cycle(told)
        self._store.record_event(event[0])

    def _closing(self, cycle: UUID, sequence: int, how: Closing) -> EventRecord:
        taken = how in (Closing.OFFERED, Closing.ACKNOWLEDGED)
        severity = Severity.INFO if taken else Severity.WARNING
        event = self.event(severity, how, closing_text(cycle, sequence), cycle)
        return replace(event, uuid=closing_id(cycle, how))

    def event(
        self,
        severity: Severity,
        code: str,
        text: str,
        cycle: UUID | None = None,
        value: float | None = None,
        source: str | None = None,
    ) -> EventRecord:
        """An event of now, not stored yet."""
        return EventRecord(
            self._now(),
            self._identity.station,
            severity,
            source or "station.cycle",
            code,
            text,
            self._clock(),
            cycle_uuid=cycle,
            value=value,
        )
