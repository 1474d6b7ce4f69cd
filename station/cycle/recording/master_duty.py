"""The master check's duty of a running station: derived from what is stored, kept, shown, and heeded.

What decides is in `station.duty`; what is noted of vehicles is in the book of the store. Nothing is kept
beside the database, so that a restart, also after a loss of power, finds the duty as it was.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from typing import Protocol

from alignment.counting import count_of
from alignment.errors import StoreError
from db.queries import RigSince
from db.records import (
    MASTER_AFTER_CAMERA,
    MASTER_AFTER_FAULT,
    MASTER_GOOD,
    MASTER_OUT,
    MASTER_REFUSED,
    CalibrationCheckRecord,
    CheckOutcome,
    CycleRecord,
    EventRecord,
    Severity,
    master_source,
)
from db.upkeep import Settled
from station.cycle.modes import master_checks, unfit_master
from station.cycle.ports import Line
from station.cycle.recording.ledger import Ledger
from station.cycle.under_way import CycleUnderWay
from station.cycle.words import ErrorCode, MasterShown, Mode, StationState
from station.duty import DoubtDeed, DutyEvent, DutyPlan, MasterState, RigDuty, SinceGood, StationDuty, duty_of
from station.threads import WorkerError

_LOG = logging.getLogger("truewheel.station")
_NEWS_S, _RETRY_S = 10.0, 2.0
_VINS_OF_A_LINE, _MOST_LINES = 10, 500
_AFTER = {MASTER_AFTER_FAULT: DutyEvent.FAULT, MASTER_AFTER_CAMERA: DutyEvent.CAMERA_RESET}
_CODES = {
    MasterState.OVERDUE: ErrorCode.MASTER_CHECK_OVERDUE,
    MasterState.FAILED: ErrorCode.MASTER_CHECK_FAILED,
}
_FREE = (Mode.MASTER_CHECK, Mode.CALIBRATE)
"""Starts that measure no vehicle: what makes the station ready again."""


class Book(Protocol):
    """What is known of master checks; `db.upkeep.MasterBook` is one."""

    @property
    def in_force(self) -> Mapping[str, str]:
        """Id of the calibration of each wheel's rig."""
        ...

    def since(self) -> dict[str, RigSince]:
        """Where each rig stands since its last good check."""
        ...

    def news(self) -> tuple[int, int, int]:
        """Numbers that change when somebody else checked or released; last, how many are in doubt."""
        ...

    def settle(self, utc: datetime) -> Settled:
        """Note and end doubts as far as one transaction each goes."""
        ...


@dataclass(frozen=True)
class Masters:
    """What a station's duty rests on.

    Attributes
    ----------
    reconnected
        How often a camera of each rig was reached anew since the program started.
    """

    plan: DutyPlan
    book: Book
    reconnected: Callable[[], Mapping[str, int]] = dict


class MasterDuty:
    """Keeps the duty; without `masters` it asks for nothing and stores a master check as ever.

    All methods are called from the cycle's thread.
    """

    def __init__(
        self,
        masters: Masters | None,
        line: Line,
        ledger: Ledger,
        clock: Callable[[], float],
        now: Callable[[], datetime],
    ) -> None:
        self._masters = masters if masters is not None and masters.plan.required else None
        self._line, self._ledger, self._clock, self._now = line, ledger, clock, now
        self._anchor = now(), clock()
        self._duty = StationDuty(DutyPlan(), {})
        self._shown: tuple[object, ...] = ()
        self._known: tuple[int, int, int] = (0, 0, 0)
        self._asked: Future[tuple[int, int, int]] | None = None
        self._next_s = self._retry_s = 0.0
        self._stale = self._unsettled = self._at_fault = False
        self._follows: Callable[[], None] | None = None
        self._reached: Mapping[str, int] = {}

    @property
    def state(self) -> MasterState:
        """Where the station stands."""
        return self._duty.state

    def begin(self) -> None:
        """Find where the station stands by what is stored, and note what a loss of power left unnoted.

        Raises
        ------
        StoreError
            When the database cannot be asked.
        """
        if self._masters is None:
            return
        self._reached = dict(self._masters.reconnected())
        self._derive()
        self._duty, _ = self._duty.happened(DutyEvent.RESTART, self._duty.rigs, self._utc())
        self._settle()
        self._known = self._ledger.ask(self._masters.book.news)
        self._next_s = self._clock() + _NEWS_S
        self._show()

    def look(self) -> None:
        """See how late it has become, and whether somebody else has checked, released, or reset a camera."""
        if self._masters is None:
            return
        self._look_at_cameras(self._masters)
        self._look_at_what_landed()
        self._duty = self._duty.passed(self._utc())
        if self._clock() >= self._next_s or self._asked is not None:
            self._look_for_news(self._masters)
        self._show()

    def refuses(self, mode: Mode) -> ErrorCode | None:
        """Why no vehicle is measured; None where the duty does not forbid it."""
        if mode in _FREE:
            return None
        if self._stale:
            # What was stored last is not known, and may be a check that was out.
            return ErrorCode.MASTER_CHECK_OVERDUE
        self._duty = self._duty.passed(self._utc())
        return _CODES.get(self._duty.state)

    def commit(self, cycle: CycleUnderWay, record: CycleRecord) -> float | None:
        """Store a cycle and what it says of the duty; the time, or None when that is not certain."""
        is_master = cycle.trigger.mode is Mode.MASTER_CHECK
        checks = master_checks(record) if is_master else ()
        if is_master and (why := unfit_master(record)) is not None:
            self._ledger.note(Severity.WARNING, "no_master", why, cycle.uuid)
        outcomes = self._outcomes(cycle, record, checks) if is_master and self._masters is not None else ()
        committed_s = self._ledger.commit(record, checks, outcomes)
        if self._masters is not None:
            self._stale |= committed_s is None
            follows = partial(self._checked, outcomes) if is_master else partial(self._measured, record)
            self._follows = None if committed_s is None else follows
        return committed_s

    def after_answer(self) -> None:
        """Heed what the cycle says, once the line was told its results, which must not wait for it."""
        follows, self._follows = self._follows, None
        if follows is not None:
            follows()

    def entered(self, state: StationState) -> None:
        """Heed a fault, which may ask for a check."""
        if state is StationState.FAULT and not self._at_fault:
            self._demand(DutyEvent.FAULT, tuple(self._duty.rigs), MASTER_AFTER_FAULT, "")
        self._at_fault = state is StationState.FAULT

    def _utc(self) -> datetime:
        """UTC that never runs backwards while the program runs."""
        began, began_s = self._anchor
        return max(self._now(), began + timedelta(seconds=self._clock() - began_s))

    def _derive(self) -> None:
        assert self._masters is not None
        plan, book = self._masters.plan, self._masters.book
        found = self._ledger.ask(book.since)
        rigs = {}
        for wheel, since in found.items():
            good = None if since.good is None else since.good.record
            after = [_AFTER[code] for code in since.after]
            if good is not None and good.calibration_id != book.in_force[wheel]:
                after.append(DutyEvent.NEW_CALIBRATION)
            stored = SinceGood(
                None if good is None else good.utc,
                since.vehicles,
                after,
                since.out is not None,
                since.released,
            )
            rigs[wheel] = self._as_strict(wheel, duty_of(plan, stored, self._utc()))
        self._duty, self._stale = StationDuty(plan, rigs), False

    def _as_strict(self, wheel: str, derived: RigDuty) -> RigDuty:
        """What is overdue stays so until a good check, also when the wall clock was set back since."""
        before = self._duty.rigs.get(wheel)
        overdue = before is not None and before.state is MasterState.OVERDUE
        if overdue and before is not None and before.good_utc == derived.good_utc and derived.state.ready:
            return before
        return derived

    def _outcomes(
        self, cycle: CycleUnderWay, record: CycleRecord, checks: Sequence[CalibrationCheckRecord]
    ) -> tuple[EventRecord, ...]:
        """What a master check says of each wheel that was asked for."""
        said = {each.calibration_id: each for each in checks}
        by_wheel = {wheel.wheel: said.get(wheel.calibration_id or "") for wheel in record.wheels}
        return tuple(
            self._ledger.event(
                Severity.WARNING if check is None or check.outcome == CheckOutcome.OUT else Severity.INFO,
                MASTER_REFUSED if check is None else _code_of(check),
                f"{wheel}: no verdict of the master" if check is None else check.reason,
                cycle.uuid,
                source=master_source(wheel),
            )
            for wheel in cycle.trigger.wheels
            for check in (by_wheel.get(wheel),)
        )

    def _checked(self, outcomes: Sequence[EventRecord]) -> None:
        words = {
            MASTER_GOOD: DutyEvent.CHECK_GOOD,
            MASTER_OUT: DutyEvent.CHECK_OUT,
            MASTER_REFUSED: DutyEvent.CHECK_REFUSED,
        }
        for event in outcomes:
            wheel = event.source.rpartition(".")[2]
            self._duty, _ = self._duty.happened(words[event.code], [wheel], self._utc())
        if any(event.code == MASTER_GOOD for event in outcomes):
            # A check has the time of the wall clock, and its age is to begin at nought.
            self._anchor = self._now(), self._clock()
        self._settle()
        # What was stored decides, also about checks that were made by hand meanwhile.
        self._stale = True
        self._refresh()
        self._show()

    def _measured(self, record: CycleRecord) -> None:
        wheels = [wheel.wheel for wheel in record.wheels]
        self._duty, deeds = self._duty.happened(DutyEvent.VEHICLE, wheels, self._utc())
        if DoubtDeed.DOUBT in deeds.values():
            self._settle()
        self._show()

    def _demand(self, event: DutyEvent, wheels: Sequence[str], code: str, wheel: str) -> None:
        if self._masters is None:
            return
        duty, _ = self._duty.happened(event, wheels, self._utc())
        if duty.rigs == self._duty.rigs:
            return
        self._duty = duty
        # Owed: the station is not ready again before it is stored.
        self._ledger.owe(
            self._ledger.event(
                Severity.WARNING, code, f"a master check is due: {event}",
                source=master_source(wheel) if wheel else None,
            )
        )  # fmt: skip
        self._show()

    def _look_at_cameras(self, masters: Masters) -> None:
        reached = dict(masters.reconnected())
        for wheel, times in reached.items():
            if times > self._reached.get(wheel, 0):
                self._demand(DutyEvent.CAMERA_RESET, [wheel], MASTER_AFTER_CAMERA, wheel)
        self._reached = reached

    def _look_at_what_landed(self) -> None:
        """After a commit that was not certain, see what the database holds, before any other start."""
        if self._stale and not self._ledger.owes and self._clock() >= self._retry_s:
            self._retry_s = self._clock() + _RETRY_S
            self._settle()
            self._refresh()

    def _look_for_news(self, masters: Masters) -> None:
        """Ask the database without waiting for it, and look again at what has changed there."""
        if self._asked is None:
            try:
                self._asked = self._ledger.ask_later(masters.book.news)
            except WorkerError:
                self._next_s = self._clock() + _NEWS_S
            return
        if not self._asked.done():
            return
        asked, self._asked = self._asked, None
        self._next_s = self._clock() + _NEWS_S
        if asked.cancelled() or asked.exception() is not None:
            return
        news = asked.result()
        changed = news[:2] != self._known[:2]
        self._known = news
        if changed:
            self._stale = self._unsettled = True
        if self._unsettled:
            self._settle()
        self._refresh()

    def _refresh(self) -> None:
        """Derive the duty anew where what is stored may say otherwise."""
        if self._masters is None or not self._stale or self._ledger.owes:
            return
        try:
            self._derive()
            self._known = self._ledger.ask(self._masters.book.news)
        except StoreError as error:
            _LOG.error("where the master checks stand is not known: %s", error)

    def _settle(self) -> None:
        """Note doubts and their ends; what is left for later goes on in `look`."""
        assert self._masters is not None
        try:
            done = self._ledger.ask(self._masters.book.settle, self._utc())
            self._known = self._ledger.ask(self._masters.book.news)
        except StoreError as error:
            _LOG.error("doubt about vehicles is not noted yet: %s", error)
            done = Settled(more=True)
        self._unsettled = done.more
        if done.more:
            self._next_s = self._clock()
        if done.doubted:
            self._tell_doubted(done.doubted)
        if done.confirmed:
            ended = count_of(done.confirmed, "doubt")
            text = f"a good check has ended {ended}: the rigs measure as they did before"
            self._tell(Severity.INFO, "master_confirmed", text, float(done.confirmed))

    def _tell_doubted(self, vins: Sequence[str]) -> None:
        number = len(vins)
        text = f"in doubt: {count_of(number, 'vehicle')} since the last good master check"
        self._tell(Severity.WARNING, "master_doubted", text, float(number))
        for line in _lines(vins):
            _LOG.warning("in doubt: %s", line)

    def _show(self) -> None:
        """Show where the station stands; a state that is new is told in the log and as an event too."""
        state, due = self._duty.state, self._duty.due
        shown = state, due.vehicles, due.utc, self._known[2]
        if shown == self._shown:
            return
        before = self._shown[0] if self._shown else MasterState.GOOD
        self._shown = shown
        due_s = None if due.utc is None else self._clock() + (due.utc - self._utc()).total_seconds()
        self._line.publish_master(MasterShown(state, due.vehicles, due_s, self._known[2]))
        if state is before:
            return
        wheels = ", ".join(self._duty.wheels_in(state))
        ready = state.ready
        severity = Severity.INFO if state is MasterState.GOOD else Severity.WARNING
        left = _in_words(due.vehicles, due.utc) if ready else "no vehicle is measured before a good one"
        self._tell(
            severity, f"master_check_is_{state}", f"master check {state.replace('_', ' ')}: {wheels}; {left}"
        )

    def _tell(self, severity: Severity, code: str, text: str, value: float | None = None) -> None:
        _LOG.log(logging.INFO if severity is Severity.INFO else logging.WARNING, "%s", text)
        self._ledger.note(severity, code, text, value=value)


def _code_of(check: CalibrationCheckRecord) -> str:
    return MASTER_GOOD if check.outcome == CheckOutcome.WITHIN else MASTER_OUT


def _in_words(vehicles: int | None, due: datetime | None) -> str:
    said = [] if vehicles is None else [count_of(vehicles, "vehicle")]
    said += [] if due is None else [f"until {due:%Y-%m-%d %H:%M} UTC"]
    return f"left: {' or '.join(said)}" if said else "the next one after what the configuration names"


def _lines(vins: Sequence[str]) -> Iterator[str]:
    for start in range(0, min(len(vins), _VINS_OF_A_LINE * _MOST_LINES), _VINS_OF_A_LINE):
        yield ", ".join(vins[start : start + _VINS_OF_A_LINE])
    if len(vins) > _VINS_OF_A_LINE * _MOST_LINES:
        yield f"and {len(vins) - _VINS_OF_A_LINE * _MOST_LINES} more; the report since-check has all"
