"""What holds in every history of a rig's master checks: 1,000 of them, drawn by chance and counted again."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, time, timedelta
from typing import Any

import numpy as np
import pytest

from alignment.errors import InputError
from station.duty.plan import DutyPlan
from station.duty.rig import RigDuty, SinceGood, duty_of
from station.duty.station import Due, StationDuty
from station.duty.table import DUTY, EVENTS_SAID, STATES_SAID, DoubtDeed
from station.duty.words import DEMANDS, DutyEvent, MasterState

NOW = datetime(2026, 3, 2, 5, tzinfo=UTC)
HISTORIES, LONGEST = 1000, 60
E = DutyEvent
_ASKED = list(DEMANDS.values())


def drawn_plan(rng: np.random.Generator) -> DutyPlan:
    after = frozenset(event for event in _ASKED if rng.uniform() < 0.4)
    vehicles = int(rng.integers(1, 9)) if rng.uniform() < 0.7 else None
    every = timedelta(minutes=int(rng.integers(30, 600))) if rng.uniform() < 0.5 else None
    starts = (time(6), time(14), time(22)) if rng.uniform() < 0.3 else ()
    if not (after or vehicles or every or starts):
        vehicles = 3
    warn = timedelta(minutes=int(rng.integers(0, 30)))
    return DutyPlan(vehicles, every, starts, "Europe/Berlin", after, int(rng.integers(0, 3)), warn)


@dataclass
class History:
    """A rig, and beside it what happened, kept as lists and judged in another way than by a table."""

    plan: DutyPlan
    now: datetime = NOW
    since_good: list[int] = field(default_factory=list)
    measured: int = 0
    good_utc: datetime | None = None
    asked: list[DutyEvent] = field(default_factory=list)
    last_check_out: bool = False
    released: bool = False
    doubted: set[int] = field(default_factory=set)
    open: set[int] = field(default_factory=set)

    @property
    def overdue(self) -> bool:
        """Whether a check is due, by the words of the configuration."""
        if self.good_utc is None or self.asked:
            return True
        counted = self.plan.vehicles is not None and len(self.since_good) >= self.plan.vehicles
        late = self.plan.every is not None and self.now >= self.good_utc + self.plan.every
        hours = [self.good_utc + timedelta(minutes=n) for n in range(1, 1 + self._minutes())]
        # 06:00, 14:00 and 22:00 of Berlin in winter.
        shift = any((at.hour, at.minute) in ((5, 0), (13, 0), (21, 0)) for at in hours)
        return counted or late or (bool(self.plan.shift_starts) and shift)

    def _minutes(self) -> int:
        assert self.good_utc is not None
        return int((self.now - self.good_utc) / timedelta(minutes=1))

    def happened(self, event: DutyEvent) -> None:
        if event is E.VEHICLE:
            self.measured += 1
            self.since_good.append(self.measured)
        elif event is E.CHECK_GOOD:
            self.good_utc, self.since_good, self.asked = self.now, [], []
            self.last_check_out = self.released = False
        elif event is E.CHECK_OUT:
            self.last_check_out, self.released = True, False
        elif event is E.RELEASE:
            self.released |= self.last_check_out
        elif event in self.plan.after:
            self.asked.append(event)

    def done(self, deed: DoubtDeed) -> None:
        """What the deed does to the vehicles, as the store does it."""
        if deed is DoubtDeed.DOUBT:
            # As the store does it: what is in doubt is not doubted again, and what was released stays so.
            self.open |= set(self.since_good) - self.doubted
            self.doubted |= set(self.since_good)
        elif deed in (DoubtDeed.CONFIRM, DoubtDeed.RELEASE):
            self.open.clear()


_DRAWN = [E.VEHICLE, E.TIME, E.CHECK_GOOD, E.CHECK_OUT, E.CHECK_REFUSED, E.RELEASE, *_ASKED]
_CHANCE = np.array([0.42, 0.2, 0.12, 0.07, 0.03, 0.04, *[0.03] * len(_ASKED)])


def test_a_thousand_histories() -> None:
    """Never ready when overdue, no vehicle after a failed check without doubt, none left when closed."""
    seen: set[tuple[MasterState, DutyEvent]] = set()
    for seed in range(HISTORIES):
        rng = np.random.default_rng(seed)
        plan = drawn_plan(rng)
        told, duty = History(plan), duty_of(plan, SinceGood(), NOW)
        for _ in range(int(rng.integers(5, LONGEST))):
            told.now += timedelta(minutes=int(rng.integers(0, 40)))
            duty = duty.passed(plan, told.now)
            event = _DRAWN[int(rng.choice(len(_DRAWN), p=_CHANCE / _CHANCE.sum()))]
            # Refused where the station is not ready, but for one in ten that was under way already.
            if event is E.VEHICLE and not duty.state.ready and rng.uniform() < 0.9:
                continue
            seen.add((duty.state, event))
            told.happened(event)
            duty, deed = duty.happened(plan, event, told.now)
            told.done(deed)
            duty = duty.passed(plan, told.now)
            assert duty.state.ready is not (told.overdue or told.last_check_out)
            assert (duty.state is MasterState.FAILED) is (told.last_check_out and not told.released)
            assert duty.vehicles == len(told.since_good) or duty.good_utc is None
            if told.last_check_out and not told.released:
                assert set(told.since_good) <= told.doubted
            elif not told.last_check_out:
                # A good check has answered for all of them.
                assert not told.open
            # A restart finds it as it is, by what is stored.
            stored = SinceGood(
                told.good_utc, len(told.since_good), tuple(told.asked), told.last_check_out, told.released
            )
            again = duty_of(plan, stored, told.now)
            assert (again.state, again.good_utc) == (duty.state, duty.good_utc)
    reachable = {(state, event) for state in MasterState if state != "not_required" for event in _DRAWN}
    assert seen == reachable


def test_every_state_has_its_row_and_every_event_its_cell() -> None:
    assert set(DUTY) == set(MasterState) == set(STATES_SAID)
    assert all(set(row) == set(DutyEvent) for row in DUTY.values())
    assert set(EVENTS_SAID) == set(DutyEvent)
    for state, row in DUTY.items():
        for event, rule in row.items():
            assert not (rule.counted and rule.target)
            if not state.ready and event is not E.CHECK_GOOD:
                # Nothing but a good check makes a station ready again.
                assert not rule.counted
                assert rule.target is None or not rule.target.ready
            assert (rule.deed is DoubtDeed.DOUBT) is (
                state is not MasterState.NOT_REQUIRED
                and (event is E.CHECK_OUT or (state is MasterState.FAILED and event is E.VEHICLE))
            )


def test_nothing_is_ever_asked_of_a_station_that_asks_for_no_checks() -> None:
    plan = DutyPlan()
    duty = duty_of(plan, SinceGood(vehicles=7, failed=True, happened=[E.FAULT]), NOW)
    for event in DutyEvent:
        duty, deed = duty.happened(plan, event, NOW)
        assert deed in (DoubtDeed.NOTHING, DoubtDeed.RELEASE)
        assert duty.passed(plan, NOW + timedelta(days=400)).state is MasterState.NOT_REQUIRED
    assert StationDuty(plan, {"front_left": duty}).due == Due(None, None)


@pytest.mark.parametrize(
    ("good", "due"),
    [
        # An ordinary day: the next start by the plant's clock.
        ("2026-03-02T05:00:00", "2026-03-02T13:00:00"),
        ("2026-03-02T04:59:59", "2026-03-02T05:00:00"),
        ("2026-03-02T22:00:00", "2026-03-03T05:00:00"),
        # The night in which the clock is put forward, and the one in which it is put back.
        ("2026-03-28T21:30:00", "2026-03-29T04:00:00"),
        ("2026-10-24T21:30:00", "2026-10-25T05:00:00"),
    ],
)
def test_shifts_start_by_the_clock_of_the_plant(good: str, due: str) -> None:
    plan = DutyPlan(shift_starts=(time(6), time(14), time(22)), zone="Europe/Berlin")
    at = datetime.fromisoformat(good).replace(tzinfo=UTC)
    assert plan.due_utc(at) == datetime.fromisoformat(due).replace(tzinfo=UTC)


def test_a_shift_at_the_hour_that_is_left_out_starts_once_all_the_same() -> None:
    plan = DutyPlan(shift_starts=(time(2, 30),), zone="Europe/Berlin")
    evening = datetime(2026, 3, 28, 20, tzinfo=UTC)
    first = plan.shift_after(evening)
    assert first == datetime(2026, 3, 29, 1, 30, tzinfo=UTC)
    assert first is not None
    assert plan.shift_after(first) == datetime(2026, 3, 30, 0, 30, tzinfo=UTC)


def test_the_earliest_of_hours_and_shift_counts() -> None:
    plan = DutyPlan(every=timedelta(hours=2), shift_starts=(time(6),))
    assert plan.due_utc(NOW) == NOW + timedelta(hours=1)
    assert plan.due_utc(NOW + timedelta(hours=1)) == NOW + timedelta(hours=3)


def test_a_good_check_from_the_future_is_not_believed() -> None:
    """The clock was set back while the computer was off: how long that was is not known."""
    plan = DutyPlan(every=timedelta(hours=1))
    for ahead, state in ((5, MasterState.GOOD), (30, MasterState.OVERDUE)):
        stored = SinceGood(NOW + timedelta(minutes=ahead))
        assert duty_of(plan, stored, NOW).state is state


def test_the_worst_rig_is_the_station() -> None:
    plan = DutyPlan(vehicles=5, every=timedelta(hours=1), warn_vehicles=1)
    states: dict[str, Any] = {
        "front_left": RigDuty(MasterState.GOOD, NOW, 1),
        "front_right": RigDuty(MasterState.GOOD, NOW - timedelta(minutes=10), 2),
    }
    duty = StationDuty(plan, states)
    assert duty.state is MasterState.GOOD
    assert duty.due == Due(3, NOW + timedelta(minutes=50))
    late = duty.passed(NOW + timedelta(minutes=55))
    assert {wheel: rig.state for wheel, rig in late.rigs.items()} == {
        "front_left": MasterState.GOOD,
        "front_right": MasterState.OVERDUE,
    }
    duty, deeds = duty.happened(E.CHECK_OUT, ["front_right", "rear_left"], NOW)
    assert (duty.state, deeds) == (MasterState.FAILED, {"front_right": DoubtDeed.DOUBT})
    assert duty.wheels_in(MasterState.FAILED) == ("front_right",)
    assert duty.due.vehicles == 0


def test_a_plan_asks_only_after_what_a_configuration_can_name() -> None:
    with pytest.raises(InputError, match="after"):
        DutyPlan(after=frozenset({E.VEHICLE}))
