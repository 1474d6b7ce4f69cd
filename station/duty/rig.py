"""The duty of one rig: its state, and what was measured since its last good check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

from station.duty.plan import DutyPlan
from station.duty.table import DUTY, DoubtDeed
from station.duty.words import DutyEvent, MasterState

# A good check so far in the future shows that the clock was set back, and nobody knows by how much.
_AHEAD = timedelta(minutes=10)


@dataclass(frozen=True)
class RigDuty:
    """Where one rig stands. Times are given, aware, and never run backwards.

    Attributes
    ----------
    good_utc
        Of the last good check; None when there was none.
    vehicles
        Measured since.
    """

    state: MasterState
    good_utc: datetime | None = None
    vehicles: int = 0

    def happened(self, plan: DutyPlan, event: DutyEvent, utc: datetime) -> tuple[RigDuty, DoubtDeed]:
        """Where it stands after an event, and what becomes of the vehicles.

        An event after which the plan asks for no check changes nothing.
        """
        if event in _BY_PLAN and event not in plan.after:
            return self, DoubtDeed.NOTHING
        rule = DUTY[self.state][event]
        duty = self
        if event is DutyEvent.CHECK_GOOD and self.state is not MasterState.NOT_REQUIRED:
            duty = replace(duty, good_utc=max(utc, self.good_utc or utc), vehicles=0)
        elif event is DutyEvent.VEHICLE:
            duty = replace(duty, vehicles=self.vehicles + 1)
        if rule.counted:
            duty = replace(duty, state=duty.counted(plan, utc))
        elif rule.target is not None:
            duty = replace(duty, state=rule.target)
        return duty, rule.deed

    def passed(self, plan: DutyPlan, utc: datetime) -> RigDuty:
        """Where it stands when it has become so late; a shift may have started meanwhile."""
        shift = None if self.good_utc is None else plan.shift_after(self.good_utc)
        event = DutyEvent.TIME if shift is None or shift > utc else DutyEvent.SHIFT_START
        return self.happened(plan, event, utc)[0]

    def vehicles_left(self, plan: DutyPlan) -> int | None:
        """How many vehicles may be measured before the next check; None when they are not counted."""
        return None if plan.vehicles is None else max(0, plan.vehicles - self.vehicles)

    def due_utc(self, plan: DutyPlan) -> datetime | None:
        """When the next check is due at the latest; None when no time is asked for, or it never was good."""
        return None if self.good_utc is None else plan.due_utc(self.good_utc)

    def counted(self, plan: DutyPlan, utc: datetime) -> MasterState:
        """The state by what is left."""
        if self.good_utc is None or self.good_utc - utc > _AHEAD:
            return MasterState.OVERDUE
        left, due = self.vehicles_left(plan), self.due_utc(plan)
        time_left = None if due is None else due - utc
        if left == 0 or (time_left is not None and time_left <= timedelta(0)):
            return MasterState.OVERDUE
        near = left is not None and left <= plan.warn_vehicles
        near |= time_left is not None and time_left <= plan.warn
        return MasterState.DUE_SOON if near else MasterState.GOOD


_BY_PLAN = frozenset({DutyEvent.FAULT, DutyEvent.RESTART, DutyEvent.CAMERA_RESET, DutyEvent.NEW_CALIBRATION})


@dataclass(frozen=True)
class SinceGood:
    """What is stored of a rig since its last good check.

    Attributes
    ----------
    good_utc
        Of that check; None when there was none.
    vehicles
        Measured since.
    happened
        What asks for a check, as far as it was stored.
    failed, released
        Whether the newest check was out, and whether a person released all vehicles after it.
    """

    good_utc: datetime | None = None
    vehicles: int = 0
    happened: Sequence[DutyEvent] = ()
    failed: bool = False
    released: bool = False


def duty_of(plan: DutyPlan, since: SinceGood, utc: datetime) -> RigDuty:
    """Where a rig stands by what is stored, by the same table as while the station runs."""
    if not plan.required:
        return RigDuty(MasterState.NOT_REQUIRED, since.good_utc, since.vehicles)
    duty = RigDuty(MasterState.OVERDUE, None, since.vehicles)
    if since.good_utc is not None:
        # As it was after the check, and then so many vehicles.
        duty = replace(duty, good_utc=since.good_utc)
        duty = replace(duty, state=duty.counted(plan, since.good_utc))
    for event in since.happened:
        duty = duty.happened(plan, event, utc)[0]
    if since.failed:
        duty = duty.happened(plan, DutyEvent.CHECK_OUT, utc)[0]
        if since.released:
            duty = duty.happened(plan, DutyEvent.RELEASE, utc)[0]
    return duty.passed(plan, utc)
