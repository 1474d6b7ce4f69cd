"""Doubt after a failed master check: noted once for each vehicle since the last good one, and ended."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any
from uuid import UUID

import numpy as np
import pytest
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from alignment.errors import InputError
from db.connection import make_engine, parse_url
from db.queries import Filter, ResultReader, doubted_vehicles, doubts_about, since_last_good_check
from db.records import (
    MASTER_AFTER_CAMERA,
    MASTER_AFTER_FAULT,
    MASTER_GOOD,
    MASTER_OUT,
    CalibrationCheckRecord,
    CalibrationRecord,
    CheckKind,
    CheckOutcome,
    ClosedBy,
    DoubtRecord,
    EventRecord,
    Severity,
    VehicleRecord,
    master_source,
)
from db.store import ResultStore
from db.upkeep import doubting
from db.upkeep.check import check_database
from db.upkeep.doubting import MasterBook, release_doubts
from tests.db.example_records import NOON, check, cycle, installation, station, wheel, zero

MINUTE = timedelta(minutes=1)
RIGS = ("front_left", "front_right")
USED = {rig: f"cal-{rig}" for rig in RIGS}


class Plant:
    """A station that measures and is checked, minute by minute."""

    def __init__(self, store: ResultStore) -> None:
        self.store, self.used, self.zeros = store, dict(USED), dict[str, str]()
        self.now, self.numbered = NOON, 0
        for rig, identity in USED.items():
            store.record_calibration(CalibrationRecord(identity, rig, NOON, {}))
        self.installed()

    def installed(self) -> None:
        uses = [
            installation(rig=rig, calibration_id=used, from_utc=self.now) for rig, used in self.used.items()
        ]
        self.store.describe_station(station(rigs=RIGS), (), uses)

    @property
    def book(self) -> MasterBook:
        return MasterBook(self.store, "EOL-1", self.used)

    def later(self) -> datetime:
        self.now += MINUTE
        return self.now

    def cycle_of(self, vin: str, wheels: tuple[str, ...]) -> Any:
        return cycle(
            received_utc=self.later(), measured_utc=self.now, vehicle=VehicleRecord(vin, "compact"),
            wheels=tuple(
                wheel(rig, calibration_id=self.used[rig], zero_measurement_id=self.zeros.get(rig))
                for rig in wheels
            ),
        )  # fmt: skip

    def vehicle(self, *wheels: str) -> str:
        self.numbered += 1
        vin = f"VIN{self.numbered:04d}"
        self.store.write_cycle(self.cycle_of(vin, wheels or RIGS))
        return vin

    def checked(self, good: bool, *wheels: str) -> None:
        record = self.cycle_of("MASTER", wheels or RIGS)
        outcome, code = (CheckOutcome.WITHIN, MASTER_GOOD) if good else (CheckOutcome.OUT, MASTER_OUT)
        found = {"cycle": str(record.uuid)}
        checks = [
            check(self.used[rig], utc=self.later(), kind=CheckKind.MASTER_WHEEL, outcome=outcome,
                  reason=f"{rig}: master is {outcome}", as_found=found)
            for rig in wheels or RIGS
        ]  # fmt: skip
        events = [self.event(code, rig, record.uuid) for rig in wheels or RIGS]
        self.store.write_master_check(record, checks, events)

    def event(self, code: str, rig: str = "", cycle_uuid: UUID | None = None) -> EventRecord:
        source = master_source(rig) if rig else "station.cycle"
        return EventRecord(self.now, "EOL-1", Severity.INFO, source, code, "happened", cycle_uuid=cycle_uuid)

    def settle(self) -> tuple[str, ...]:
        return self.book.settle(self.later()).doubted


@pytest.fixture
def plant(store: ResultStore) -> Plant:
    return Plant(store)


def in_doubt(url: str, **where: Any) -> dict[tuple[str, str], str]:
    with ResultReader(url) as reader:
        found = doubted_vehicles(reader, Filter(**where))
    return {(each.vin, each.doubt.record.wheel): each.doubt.word for each in found}


def test_a_failed_check_puts_every_vehicle_since_the_last_good_one_in_doubt(
    plant: Plant, database_url: str
) -> None:
    plant.vehicle()
    plant.checked(True)
    first, second = plant.vehicle(), plant.vehicle("front_right")
    assert plant.settle() == ()
    plant.checked(False, "front_left")
    assert plant.settle() == (first,)
    plant.checked(False, "front_right")
    # What is in doubt already is told again only for another wheel.
    assert plant.settle() == (first, second)
    assert in_doubt(database_url) == {
        (first, "front_left"): "in doubt", (first, "front_right"): "in doubt",
        (second, "front_right"): "in doubt",
    }  # fmt: skip
    assert plant.settle() == ()
    assert plant.book.news()[-1] == 2
    assert {vin for vin, _ in in_doubt(database_url, wheels=("front_left",))} == {first}
    assert in_doubt(database_url, vin="VIN0009") == {}


def test_neither_the_failed_master_nor_the_good_one_counts_as_a_vehicle(
    plant: Plant, database_url: str
) -> None:
    """The cycle of a failed check was listed among the vehicles since the last good one."""
    plant.checked(True)
    vin = plant.vehicle()
    plant.checked(False)
    plant.settle()
    with ResultReader(database_url) as reader:
        groups = since_last_good_check(reader)
    assert {vehicle.vin for group in groups for vehicle in group.vehicles} == {vin}
    assert {known for known, _ in in_doubt(database_url)} == {vin}
    assert {rig: since.vehicles for rig, since in plant.book.since().items()} == dict.fromkeys(RIGS, 1)


def test_without_any_good_check_everything_that_was_measured_is_in_doubt(
    plant: Plant, database_url: str
) -> None:
    vins = [plant.vehicle() for _ in range(3)]
    plant.checked(False)
    assert plant.settle() == tuple(vins)


def test_a_good_check_ends_doubt_only_where_nothing_was_calibrated(plant: Plant, database_url: str) -> None:
    plant.checked(True)
    vin = plant.vehicle()
    plant.checked(False)
    plant.settle()
    plant.store.record_calibration(CalibrationRecord("cal-new", "front_right", plant.now, {}))
    plant.used["front_right"] = "cal-new"
    plant.installed()
    plant.checked(True)
    assert plant.book.settle(plant.later()).confirmed == 1
    assert in_doubt(database_url) == {
        (vin, "front_left"): "confirmed by a later check", (vin, "front_right"): "in doubt",
    }  # fmt: skip
    # And it stays so, whatever good checks follow.
    plant.checked(True)
    assert plant.book.settle(plant.later()).confirmed == 0
    assert plant.book.news()[-1] == 1


def test_a_new_zero_measurement_says_nothing_of_the_vehicles_before_it(
    plant: Plant, database_url: str
) -> None:
    plant.checked(True)
    vin = plant.vehicle()
    plant.checked(False, "front_left")
    plant.settle()
    plant.store.record_zero(zero(rig="front_left", calibration_id=USED["front_left"]))
    plant.zeros["front_left"] = "zero-1"
    plant.checked(True)
    assert plant.book.settle(plant.later()).confirmed == 0
    assert in_doubt(database_url) == {(vin, "front_left"): "in doubt"}


def test_a_person_answers_for_all_vehicles_or_for_some(plant: Plant, database_url: str) -> None:
    plant.checked(True)
    one, two = plant.vehicle(), plant.vehicle()
    plant.checked(False)
    plant.settle()
    assert not plant.book.since()["front_left"].released
    release = release_doubts(plant.store, "EOL-1", " A.  Example ", "measured again", plant.later(), [two])
    assert release == (two,)
    assert not plant.book.since()["front_left"].released
    assert release_doubts(plant.store, "EOL-1", "A. Example", "by hand", plant.later()) == (one,)
    assert plant.book.since()["front_left"].released
    assert set(in_doubt(database_url).values()) == {"released by A. Example"}
    assert plant.settle() == ()
    # A check that fails later speaks for itself.
    plant.checked(False)
    assert plant.settle() == ()
    assert not plant.book.since()["front_left"].released


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"person": " "}, "person"),
        ({"person": "42"}, "person"),
        ({"person": "A\x07"}, "person"),
        ({"person": "x" * 201}, "person"),
        ({"reason": "  - "}, "reason"),
        ({"station": "EOL-9"}, "vehicles in doubt"),
        ({"vins": ["VIN0099"]}, "VIN0099"),
    ],
)
def test_a_release_that_nobody_can_answer_for_changes_nothing(
    plant: Plant, database_url: str, changes: dict[str, Any], said: str
) -> None:
    plant.checked(True)
    vin = plant.vehicle()
    plant.checked(False, "front_left")
    plant.settle()
    asked = {"station": "EOL-1", "person": "A. Example", "reason": "measured again", "utc": plant.now}
    with pytest.raises(InputError, match=said):
        release_doubts(plant.store, **(asked | changes))  # type: ignore[arg-type]
    assert in_doubt(database_url) == {(vin, "front_left"): "in doubt"}


def test_many_vehicles_are_noted_in_several_goes(plant: Plant, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doubting, "MOST_AT_ONCE", 5)
    plant.checked(True)
    vins = [plant.vehicle() for _ in range(4)]
    plant.checked(False)
    first = plant.book.settle(plant.later())
    assert first.more
    second = plant.book.settle(plant.later())
    assert not second.more
    assert set(first.doubted) | set(second.doubted) == set(vins)
    plant.checked(True)
    assert plant.book.settle(plant.later()).more
    assert plant.book.settle(plant.later()).confirmed == 3
    assert plant.book.news()[-1] == 0


def test_what_asks_for_a_check_is_known_after_a_restart(plant: Plant) -> None:
    plant.store.record_event(plant.event(MASTER_AFTER_FAULT))
    plant.checked(True)
    assert plant.book.since()["front_left"].after == ()
    plant.store.record_event(plant.event(MASTER_AFTER_CAMERA, "front_left"))
    assert plant.book.since()["front_left"].after == (MASTER_AFTER_CAMERA,)
    assert plant.book.since()["front_right"].after == ()
    plant.store.record_event(plant.event(MASTER_AFTER_FAULT))
    assert plant.book.since()["front_right"].after == (MASTER_AFTER_FAULT,)
    plant.checked(True, "front_left")
    assert plant.book.since()["front_left"].after == ()
    assert plant.book.since()["front_right"].after == (MASTER_AFTER_FAULT,)


def test_a_check_by_hand_counts_too(plant: Plant, database_url: str) -> None:
    plant.checked(True)
    vin = plant.vehicle()
    by_hand = check(
        USED["front_left"], utc=plant.later(), kind=CheckKind.MASTER_WHEEL, outcome=CheckOutcome.OUT
    )
    plant.store.record_check(by_hand)
    assert plant.settle() == (vin,)
    assert plant.book.since()["front_left"].out is not None
    release_doubts(plant.store, "EOL-1", "A. Example", "measured again", plant.later())
    assert plant.book.since()["front_left"].released
    plant.store.record_event(plant.event(MASTER_AFTER_FAULT))
    good = check(USED["front_left"], utc=plant.later(), kind=CheckKind.MASTER_WHEEL)
    plant.store.record_check(good)
    since = plant.book.since()["front_left"]
    assert (since.out, since.after) == (None, ())
    assert since.good is not None
    assert since.good.cycle is None


def test_a_doubt_is_in_the_chain_and_cannot_be_changed(plant: Plant, database_url: str) -> None:
    plant.checked(True)
    plant.vehicle()
    plant.checked(False)
    plant.settle()
    release_doubts(plant.store, "EOL-1", "A. Example", "measured again", plant.later())
    engine = make_engine(parse_url(database_url), timeout_s=5.0)
    for change in (
        "UPDATE doubts SET reason = 'none'", "DELETE FROM doubt_closings",
        "UPDATE doubt_closings SET person = 'B. Example'",
    ):  # fmt: skip
        with engine.connect() as connection:
            connection.execution_options(writes=True)
            with pytest.raises(DBAPIError, match="never changed"):
                connection.execute(text(change))
    engine.dispose()
    report = check_database(database_url)
    assert not report.findings


def test_vehicles_agree_with_an_independent_count_over_random_histories(
    open_store: Callable[..., ResultStore], migrated_sqlite_url: str
) -> None:
    """Vehicles, checks, recalibrations and releases as they come, counted beside the store."""
    store = open_store(migrated_sqlite_url)
    plant, rng = Plant(store), np.random.default_rng(16)
    since: dict[str, list[tuple[str, str]]] = {rig: [] for rig in RIGS}
    doubted: dict[tuple[str, str], str] = {}
    before: dict[tuple[str, str], str] = {}
    failed, seen = dict.fromkeys(RIGS, False), set[str]()
    for _ in range(250):
        rigs = RIGS if rng.uniform() < 0.6 else (str(rng.choice(RIGS)),)
        what = rng.choice(["vehicle", "good", "out", "calibrate", "release"], p=[0.6, 0.13, 0.13, 0.07, 0.07])
        if what == "vehicle":
            vin = plant.vehicle(*rigs)
            for rig in rigs:
                since[rig].append((vin, plant.used[rig]))
        elif what in ("good", "out"):
            plant.checked(what == "good", *rigs)
            for rig in rigs:
                failed[rig] = what == "out"
                if what == "good":
                    since[rig] = []
                    same = [k for k, state in doubted.items() if k[1] == rig and state == "open"]
                    doubted |= {k: "confirmed" for k in same if before[k] == plant.used[rig]}
        elif what == "calibrate":
            rig = rigs[0]
            plant.used[rig] = f"cal-{plant.numbered}-{plant.now:%d%H%M}"
            store.record_calibration(CalibrationRecord(plant.used[rig], rig, plant.now, {}))
            plant.installed()
        elif "open" in doubted.values():
            release_doubts(store, "EOL-1", "A. Example", "measured again", plant.later())
            doubted = {k: "released" if v == "open" else v for k, v in doubted.items()}
        plant.settle()
        for rig in RIGS:
            for vin, used in since[rig] if failed[rig] else ():
                doubted.setdefault((vin, rig), "open")
                before[vin, rig] = used
        seen |= set(doubted.values())
        assert {rig: one.vehicles for rig, one in plant.book.since().items() if one.good} == {
            rig: len(since[rig]) for rig, one in plant.book.since().items() if one.good
        }
    words = {
        "open": "in doubt",
        "confirmed": "confirmed by a later check",
        "released": "released by A. Example",
    }
    assert in_doubt(migrated_sqlite_url) == {key: words[state] for key, state in doubted.items()}
    with ResultReader(migrated_sqlite_url) as reader:
        # Nothing is doubted twice.
        assert len(doubted_vehicles(reader)) == len(doubted)
    assert seen == {"open", "confirmed", "released"}


def test_the_same_vehicle_and_wheel_have_one_doubt_for_good() -> None:
    uuid = cycle().uuid
    one, other = (
        DoubtRecord.of("EOL-1", uuid, rig, uuid, NOON, "out") for rig in ("front_left", "rear_left")
    )
    assert one.uuid == DoubtRecord.of("EOL-1", uuid, "front_left", uuid, NOON + MINUTE, "again").uuid
    assert one.uuid != other.uuid
    assert ClosedBy("release") is ClosedBy.RELEASE


def test_doubts_about_cycles(plant: Plant, database_url: str) -> None:
    plant.checked(True)
    record = plant.cycle_of("VIN0001", RIGS)
    plant.store.write_cycle(record)
    plant.checked(False)
    plant.settle()
    with ResultReader(database_url) as reader:
        found = doubts_about(reader, [record.uuid, cycle().uuid])
    assert [doubt.record.wheel for doubt in found[record.uuid]] == list(RIGS)
    assert len(found) == 1
    assert isinstance(plant.book.since()["front_left"].out.record, CalibrationCheckRecord)  # type: ignore[union-attr]
