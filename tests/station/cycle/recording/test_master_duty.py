"""A master check that is enforced: warned of, owed, refused without, and the same after a restart."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import datetime, time, timedelta
from pathlib import Path
from typing import Any

import pytest

from alignment.errors import CameraTimeoutError, StoreUnavailableError
from db.queries import Filter, ResultReader, doubted_vehicles
from db.records import CheckKind, CheckOutcome
from db.store import ResultStore
from db.upkeep.doubting import MasterBook, Settled, release_doubts
from station.cycle.recording.master_duty import Masters
from station.cycle.words.cycle import ErrorCode, Mode, Prepare, Reset, StationState, Trigger
from station.duty.plan import DutyPlan
from station.duty.words import DutyEvent, MasterState
from tests.db.example_records import check
from tests.station.bench import MASTER, TODAY, VIN, WHEELS, Bench, measurement

OUT = measurement(camber=0.02)
EVERY_3 = DutyPlan(vehicles=3, warn_vehicles=1)
HOURLY = DutyPlan(every=timedelta(hours=1), warn=timedelta(minutes=10))
USED = {wheel: f"cal-{wheel}" for wheel in WHEELS}


class Station:
    """A station with a real database that may be started again."""

    def __init__(self, folder: Path, plan: DutyPlan) -> None:
        self.url, self.plan = f"sqlite:///{folder / 'results.db'}", plan
        self.store = ResultStore(self.url, create=True)
        self.store.open()
        self.reached = dict.fromkeys(WHEELS, 0)
        self.today, self.sequence = TODAY, 0
        self.starts()

    def starts(self, store: Any = None) -> None:
        """As after a restart; what the station was before is forgotten."""
        masters = Masters(self.plan, MasterBook(self.store, "station_1", USED), lambda: self.reached)
        self.bench = Bench(masters=masters, store=store or self.store, today=self.today)
        self.bench.cycle.start()

    def ends(self) -> None:
        self.bench.cycle.close()
        for rig in self.bench.rigs.values():
            rig.close()

    def starts_again(self) -> None:
        self.ends()
        self.today += timedelta(minutes=1)
        self.starts()

    def later(self, by: timedelta) -> None:
        self.today = self.bench.today = self.today + by
        self.bench.cycle.step(0.0)

    def _trigger(self, mode: Mode, kind: int, wheels: tuple[str, ...]) -> ErrorCode | None:
        self.today = self.bench.today = self.today + timedelta(seconds=20)
        self.sequence += 1
        line, before = self.bench.line, len(self.bench.line.refused)
        while line.queue:
            self.bench.cycle.step(0.0)
        for rig in self.bench.rigs.values():
            rig.shot = replace(rig.shot, time_utc=self.today)
        vin = f"TWDEMX{self.sequence:011d}"
        line.queue.append(Trigger(self.sequence, wheels, kind, vin, self.bench.clock.now, mode))
        self.bench.cycle.step(0.0)
        refused = self.bench.line.refused[before:]
        return refused[0][1] if refused else None

    def vehicle(self, *wheels: str) -> ErrorCode | None:
        return self._trigger(Mode.AUTOMATIC, 1, wheels or WHEELS)

    def check(self, good: bool = True, *wheels: str) -> ErrorCode | None:
        of = wheels or WHEELS
        self.bench.found = {} if good else dict.fromkeys(of, OUT)
        found = self._trigger(Mode.MASTER_CHECK, MASTER.number, of)
        self.bench.found = {}
        return found

    @property
    def shown(self) -> MasterState:
        return self.bench.line.masters[-1].state

    @property
    def codes(self) -> list[str]:
        events = self.store.recent_events(200, "station_1")
        codes = [event.code for event in events][::-1]
        # Refusals are events too.
        return [code for code in codes if code.startswith("master_") and code not in set(ErrorCode)]

    @property
    def doubted(self) -> set[tuple[str, bool]]:
        with ResultReader(self.url) as reader:
            return {(each.doubt.record.wheel, each.doubt.open) for each in doubted_vehicles(reader, Filter())}


@contextmanager
def station(folder: Path, plan: DutyPlan) -> Iterator[Station]:
    made = Station(folder, plan)
    with ExitStack() as stack:
        stack.callback(made.store.close)
        stack.callback(made.ends)
        yield made


def test_no_vehicle_is_measured_before_the_first_good_check(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        assert made.shown is MasterState.OVERDUE
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE
        made.bench.line.queue.append(Prepare(9, WHEELS, 1))
        made.bench.cycle.step(0.0)
        assert made.bench.line.refused[-1] == (9, ErrorCode.MASTER_CHECK_OVERDUE)
        assert made.bench.cycle.state is StationState.IDLE
        assert made.check() is None
        assert made.shown is MasterState.GOOD
        assert made.vehicle() is None


def test_the_station_warns_before_it_is_not_ready(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        made.check()
        shown = []
        for _ in range(3):
            assert made.vehicle() is None
            shown.append((made.shown, made.bench.line.masters[-1].vehicles_left))
        assert shown == [(MasterState.GOOD, 2), (MasterState.DUE_SOON, 1), (MasterState.OVERDUE, 0)]
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE
        assert made.codes[-2:] == ["master_check_is_due_soon", "master_check_is_overdue"]


def test_time_runs_out_while_nobody_asks(tmp_path: Path) -> None:
    with station(tmp_path, HOURLY) as made:
        made.check()
        due_s = made.bench.line.masters[-1].due_s
        assert due_s is not None
        assert due_s - made.bench.clock() == pytest.approx(3600, abs=60)
        made.later(timedelta(minutes=52))
        assert made.shown is MasterState.DUE_SOON
        made.later(timedelta(minutes=9))
        assert made.shown is MasterState.OVERDUE
        # A clock that is set back gives no time away.
        made.later(timedelta(hours=-5))
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE


def test_a_clock_set_back_gives_no_time_away_while_the_check_is_good(tmp_path: Path) -> None:
    with station(tmp_path, HOURLY) as made:
        made.check()
        made.later(timedelta(hours=-5))
        made.bench.clock.now += 3700.0
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE
        made.later(timedelta(hours=5))
        made.check()
        made.later(timedelta(hours=-5))
        # Nobody knows how long the computer was off.
        made.starts_again()
        assert made.shown is MasterState.OVERDUE


def test_a_failed_check_lists_the_vehicles_at_once_and_stops_the_station(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with station(tmp_path, EVERY_3) as made:
        made.check()
        made.vehicle()
        made.vehicle("front_left")
        made.check(False, "front_left")
        assert made.shown is MasterState.FAILED
        assert made.bench.line.masters[-1].doubted == 2
        assert made.vehicle() is ErrorCode.MASTER_CHECK_FAILED
        assert made.doubted == {("front_left", True)}
        assert "in doubt: 2 vehicles since the last good master check" in caplog.text
        assert "in doubt: TWDEMX00000000002, TWDEMX00000000003" in caplog.text
        made.check()
        assert made.shown is MasterState.GOOD
        assert made.bench.line.masters[-1].doubted == 0
        assert made.doubted == {("front_left", False)}
        assert made.vehicle() is None


def test_the_answer_does_not_wait_for_the_doubts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of vehicles may be in doubt; the controller waits for the result of the master."""
    with station(tmp_path, EVERY_3) as made:
        made.check()
        made.vehicle()
        settle, log = MasterBook.settle, made.bench.log

        def logged(book: MasterBook, utc: datetime) -> Settled:
            log.append("settled")
            return settle(book, utc)

        monkeypatch.setattr(MasterBook, "settle", logged)
        log.clear()
        made.check(False)
        said = [word for word in log if word in ("commit", "results", "settled", "state idle")]
        assert said.index("results") < said.index("settled") < said.index("state idle")
        assert made.doubted == {(wheel, True) for wheel in WHEELS}


def test_a_restart_finds_every_state_as_it_was(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        for act in (
            made.check, made.vehicle, made.vehicle, made.vehicle,
            made.check, made.vehicle, lambda: made.check(False), made.check,
            lambda: made.vehicle("rear_left"), lambda: made.check(False, "rear_left"),
            lambda: made.check(True, "front_left"),
        ):  # fmt: skip
            act()
            before = made.bench.line.masters[-1]
            made.starts_again()
            assert made.bench.line.masters[-1] == before


@pytest.mark.parametrize("event", [DutyEvent.RESTART, DutyEvent.FAULT])
def test_a_restart_is_not_a_way_around_a_check(tmp_path: Path, event: DutyEvent) -> None:
    with station(tmp_path, DutyPlan(after=frozenset({event}))) as made:
        made.check()
        assert made.shown is MasterState.GOOD
        if event is DutyEvent.FAULT:
            made.bench.rigs["front_left"].shoot_error = CameraTimeoutError(
                "front_left/head_1/left", "no image"
            )
            assert made.vehicle() is None
            assert made.bench.cycle.state is StationState.FAULT
            made.bench.rigs["front_left"].shoot_error = None
            made.bench.line.queue.append(Reset(99))
            made.bench.cycle.step(0.0)
            assert made.bench.cycle.state is StationState.IDLE
            assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE
        made.starts_again()
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE
        assert made.check() is None
        assert made.vehicle() is None


def test_a_camera_that_was_reached_anew_asks_for_a_check_of_its_rig(tmp_path: Path) -> None:
    with station(tmp_path, DutyPlan(after=frozenset({DutyEvent.CAMERA_RESET}))) as made:
        made.check()
        made.reached = made.reached | {"rear_left": 1}
        made.bench.cycle.step(0.0)
        assert made.shown is MasterState.OVERDUE
        made.starts_again()
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE
        made.check(True, "front_left")
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE
        made.check(True, "rear_left")
        assert made.vehicle() is None


def test_a_new_calibration_asks_for_a_check_of_its_rig(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with station(tmp_path, DutyPlan(after=frozenset({DutyEvent.NEW_CALIBRATION}))) as made:
        made.check()
        made.starts_again()
        assert made.shown is MasterState.GOOD
        made.ends()
        monkeypatch.setitem(USED, "rear_left", "cal-new")
        made.starts()
        assert made.shown is MasterState.OVERDUE


def test_a_shift_starts(tmp_path: Path) -> None:
    plan = DutyPlan(shift_starts=(time(14),), zone="Europe/Berlin", warn=timedelta(minutes=15))
    with station(tmp_path, plan) as made:
        made.check()
        assert made.shown is MasterState.GOOD
        made.later(datetime(2026, 3, 2, 12, 50, tzinfo=TODAY.tzinfo) - made.today)
        assert made.shown is MasterState.DUE_SOON
        made.later(timedelta(minutes=10))
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE


def test_a_check_that_brings_no_verdict_leaves_the_station_as_it_was(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        # The limits of an ordinary vehicle check nothing.
        made._trigger(Mode.MASTER_CHECK, 1, WHEELS)  # noqa: SLF001
        assert made.shown is MasterState.OVERDUE
        assert made.codes.count("master_refused") == len(WHEELS)
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE


def test_a_release_answers_for_the_vehicles_and_not_for_the_rig(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        made.check()
        made.vehicle()
        made.check(False)
        release_doubts(made.store, "station_1", "A. Example", "measured again by hand", made.today)
        made.bench.clock.now += 11.0
        asked = made.bench.line
        while asked.masters[-1].state is MasterState.FAILED:
            made.bench.cycle.step(0.01)
        assert (made.shown, asked.masters[-1].doubted) == (MasterState.OVERDUE, 0)
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE
        made.starts_again()
        assert made.vehicle() is ErrorCode.MASTER_CHECK_OVERDUE


def test_a_check_by_hand_beside_the_running_station_is_heeded(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        made.check()
        made.vehicle()
        out = check(USED["rear_left"], utc=made.today, kind=CheckKind.MASTER_WHEEL, outcome=CheckOutcome.OUT)
        made.store.record_check(out)
        made.bench.clock.now += 11.0
        while made.shown is not MasterState.FAILED:
            made.bench.cycle.step(0.01)
        assert made.doubted == {("rear_left", True)}


class CutStore:
    """A store that loses power: what comes after a number of writes never lands."""

    def __init__(self, store: ResultStore, writes: int) -> None:
        self.store, self.left = store, writes

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.store, name)
        if not name.startswith(("write", "record")):
            return found

        def written(*args: Any) -> Any:
            if self.left <= 0:
                raise StoreUnavailableError("the power is gone")
            self.left -= 1
            return found(*args)

        return written


@pytest.mark.parametrize("writes", range(7))
def test_power_lost_around_a_failed_check(tmp_path: Path, writes: int) -> None:
    """Whichever writes landed: a check that is stored has its doubts after the restart, or it never was."""
    with station(tmp_path, EVERY_3) as made:
        made.check()
        made.vehicle()
        made.ends()
        # Calibrations and the start of the program come before.
        cut = CutStore(made.store, 100)
        made.starts(cut)
        masters = made.bench.cycle._duty._masters  # noqa: SLF001
        assert masters is not None
        book = MasterBook(cut, "station_1", USED)  # type: ignore[arg-type]
        made.bench.cycle._duty._masters = replace(masters, book=book)  # noqa: SLF001
        cut.left = writes
        made.check(False)
        made.starts_again()
        stored = made.store.calibration_checks(USED["front_left"])[-1].outcome
        if stored == CheckOutcome.OUT:
            assert made.shown is MasterState.FAILED
            assert made.doubted == {(wheel, True) for wheel in WHEELS}
            assert made.vehicle() is ErrorCode.MASTER_CHECK_FAILED
        else:
            assert made.shown is MasterState.GOOD
            assert made.doubted == set()
        assert stored == (CheckOutcome.OUT if writes else CheckOutcome.WITHIN)


class LateStore:
    """A store whose first commit of a master check lands, and does not say so in time."""

    def __init__(self, store: ResultStore) -> None:
        self.store, self.late = store, True

    def __getattr__(self, name: str) -> Any:
        return getattr(self.store, name)

    def write_master_check(self, *args: Any) -> None:
        self.store.write_master_check(*args)
        if self.late:
            self.late = False
            raise StoreUnavailableError("the database did not answer in time")


def test_a_failed_check_whose_commit_was_not_certain_is_found_before_the_next_start(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        made.check()
        made.vehicle()
        made.ends()
        made.starts(LateStore(made.store))
        made.check(False)
        assert made.bench.cycle.state is StationState.FAULT
        made.bench.line.queue.append(Reset(99))
        while made.bench.cycle.state is not StationState.IDLE:
            made.bench.cycle.step(0.01)
        assert made.vehicle() is ErrorCode.MASTER_CHECK_FAILED
        assert made.doubted == {(wheel, True) for wheel in WHEELS}
        assert made.bench.line.masters[-1].doubted == 1


def test_a_vehicle_of_a_station_that_asked_for_no_checks_meanwhile_is_in_doubt(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        made.check()
        made.check(False)
        made.ends()
        made.plan = DutyPlan()
        made.starts()
        assert made.vehicle() is None
        assert made.doubted == set()
        made.ends()
        made.plan = EVERY_3
        made.starts()
        assert made.shown is MasterState.FAILED
        assert made.doubted == {(wheel, True) for wheel in WHEELS}


def test_a_station_of_today_goes_on_unchanged(tmp_path: Path) -> None:
    with station(tmp_path, DutyPlan()) as made:
        assert made.vehicle() is None
        made.check(False)
        assert made.vehicle() is None
        assert (made.bench.line.masters, made.codes, made.doubted) == ([], [], set())


def test_images_of_a_plate_are_taken_although_a_check_is_overdue(tmp_path: Path) -> None:
    with station(tmp_path, EVERY_3) as made:
        assert made._trigger(Mode.CALIBRATE, 1, WHEELS) is ErrorCode.MODE_NOT_AVAILABLE  # noqa: SLF001
        duty = made.bench.cycle._duty  # noqa: SLF001
        assert duty.refuses(Mode.CALIBRATE) is None
        assert {duty.refuses(mode) for mode in (Mode.AUTOMATIC, Mode.ADJUST, Mode.SWEEP)} == {
            ErrorCode.MASTER_CHECK_OVERDUE
        }
        assert Trigger(1, WHEELS, 1, VIN).mode is Mode.AUTOMATIC
