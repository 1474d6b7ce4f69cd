"""What goes in comes out, once, on both databases."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from uuid import UUID, uuid4

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import db.store
from alignment.errors import StoreError
from db.records import (
    CalibrationRecord,
    CycleOutcome,
    EventRecord,
    Severity,
    VehicleRecord,
    Verdict,
    WheelOutcome,
)
from db.store import ResultStore
from tests.db.example_records import CALIBRATION, NOON, WHEELS, adjusting, axle, cycle, refused_wheel, wheel

CYCLE = UUID(int=7)
on_one_database = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
storable_text = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"))
names = storable_text.filter(bool)
numbers = st.floats(allow_nan=False, allow_infinity=False)
angles = st.floats(-3.1, 3.1)
uncertainties = st.floats(5e-324, 3.1)
times = st.datetimes(
    datetime(1970, 1, 2),
    datetime(2999, 1, 1),
    timezones=st.sampled_from([UTC, timezone(timedelta(hours=5.5))]),
)


def test_a_good_vehicle_reads_back_equal_with_its_commit_time(
    database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(database_url, now=lambda: NOON + timedelta(minutes=1))
    store.record_calibration(CALIBRATION)
    record = cycle()
    store.write_cycle(record)
    stored = store.cycle(record.uuid)
    assert stored is not None
    assert stored.record == record
    assert stored.stored_utc == NOON + timedelta(minutes=1)
    assert stored.stored_utc.tzinfo is UTC
    assert [type(w.outcome) for w in stored.record.wheels] == [WheelOutcome] * 4
    assert {name: count for name, count in store.counts().items() if count} == {
        "vehicles": 1,
        "cycles": 1,
        "wheel_results": 4,
        "axle_results": 2,
        "vehicle_results": 1,
        "calibrations": 1,
    }


def test_the_second_write_of_the_same_cycle_changes_nothing(store: ResultStore) -> None:
    record = cycle()
    store.write_cycle(record)
    before = store.counts()
    store.write_cycle(replace(record, wheels=tuple(reversed(record.wheels))))
    assert store.counts() == before


@pytest.mark.parametrize(
    "changes",
    [
        {"config_hash": "sha256:01"},
        {"vehicle": VehicleRecord("TRUEWHEEL00000002", "compact")},
        {"wheels": tuple(wheel(name, toe=0.0) for name in WHEELS)},
        {"axles": (axle("front"),)},
        {"vehicle_angles": None},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_another_cycle_of_a_stored_uuid_is_refused_and_leaves_no_trace(
    store: ResultStore, changes: dict[str, object]
) -> None:
    record = cycle()
    store.write_cycle(record)
    before = store.counts()
    with pytest.raises(StoreError, match=f"already holds another cycle {record.uuid}"):
        store.write_cycle(replace(record, **changes))
    stored = store.cycle(record.uuid)
    assert stored is not None
    assert stored.record == record
    assert store.counts() == before


def test_a_cycle_that_cannot_be_stored_whole_is_not_stored_at_all(store: ResultStore) -> None:
    record = cycle(
        wheels=(*(wheel(name) for name in WHEELS[:3]), wheel("rear_right", calibration_id="unknown"))
    )
    with pytest.raises(StoreError, match="no calibration of that id"):
        store.write_cycle(record)
    assert store.cycle(record.uuid) is None
    assert store.counts()["vehicles"] == 0


def test_faults_and_aborts_are_kept_apart_from_bad_vehicles(store: ResultStore) -> None:
    bad = wheel(verdict=Verdict.NOK, toe=0.1, reason_code="toe_high", reason_text="toe above its limit")
    records = [
        cycle(outcome=CycleOutcome.NOK, wheels=(bad,), axles=(), vehicle_angles=None),
        cycle(
            outcome=CycleOutcome.FAULT,
            reason_code="wheel_refused",
            reason_text="a wheel was not measured",
            wheels=(wheel(), refused_wheel()),
        ),
        cycle(
            outcome=CycleOutcome.FAULT,
            reason_code="no_vin",
            reason_text="the PLC gave no vehicle",
            vehicle=None,
            measured_utc=None,
            measured_monotonic_s=None,
            wheels=(),
            axles=(),
            vehicle_angles=None,
        ),
        cycle(outcome=CycleOutcome.ABORTED, reason_code="operator", reason_text="aborted at the panel"),
    ]
    for record in records:
        store.write_cycle(record)
    assert [stored.record for stored in store.recent_cycles(10)] == records[::-1]
    assert [stored.record for stored in store.recent_cycles(2)] == records[:1:-1]


def test_all_results_of_one_vehicle_are_found_whatever_its_type(store: ResultStore) -> None:
    first, again, other = (
        cycle(),
        cycle(vehicle=VehicleRecord("TRUEWHEEL00000001", "estate"), station="EOL-2"),
        cycle(vehicle=VehicleRecord("TRUEWHEEL00000002", "compact")),
    )
    for record in (first, again, other):
        store.write_cycle(record)
    found = store.wheel_results("TRUEWHEEL00000001")
    assert {(item.cycle, item.station, item.received_utc, item.wheel) for item in found} == {
        (record.uuid, record.station, NOON, w) for record in (first, again) for w in record.wheels
    }
    assert [item.cycle for item in found] == [first.uuid] * 4 + [again.uuid] * 4
    assert store.wheel_results("' OR 1=1 --") == ()


def test_an_unknown_cycle_is_none(store: ResultStore) -> None:
    assert store.cycle(uuid4()) is None
    assert store.recent_cycles(5) == ()
    assert store.calibration("unknown") is None


def test_a_clock_set_back_during_a_cycle_does_not_lose_it(store: ResultStore) -> None:
    record = cycle(measured_utc=NOON - timedelta(hours=1))
    store.write_cycle(record)
    assert [stored.record for stored in store.recent_cycles(1)] == [record]


def test_more_cycles_than_a_statement_takes_parameters(
    store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(db.rows.reading, "PORTION", 3)
    records = [cycle() for _ in range(7)]
    for record in records:
        store.write_cycle(record)
    assert [stored.record for stored in store.recent_cycles(10)] == records[::-1]


def test_calibrations_and_events_are_stored_once(store: ResultStore) -> None:
    calibration = CalibrationRecord("cal-2", "rear_left", NOON, {"poses": (1, 2)}, NOON + timedelta(days=30))
    event = EventRecord(NOON, "EOL-1", Severity.WARNING, "clock", "set_back", "clock set back 1 h", 5.5)
    for _ in range(2):
        store.record_calibration(calibration)
        store.record_event(event)
    assert store.calibration("cal-2") == calibration
    assert store.recent_events(5) == (event,)
    of_cycle = [replace(event, uuid=uuid4(), cycle_uuid=CYCLE, code=code) for code in ("a", "b", "a")]
    for one in of_cycle:
        store.record_event(one)
    assert set(store.cycle_events(CYCLE, ("a", "b", "c"))) == set(of_cycle[1:])
    assert store.cycle_events(CYCLE, ("c",)) == store.cycle_events(uuid4(), ("a",)) == ()
    with pytest.raises(StoreError, match="another calibration cal-2"):
        store.record_calibration(replace(calibration, document={}))
    with pytest.raises(StoreError, match="another event"):
        store.record_event(replace(event, text="something else"))
    assert store.calibration("cal-2") == calibration


@on_one_database
@given(
    name=names,
    text=storable_text,
    number=numbers,
    angle=angles,
    uncertainty=uncertainties,
    time=times,
    count=st.integers(0, 2**31 - 1),
)
def test_extreme_values_and_any_script_survive(
    store: ResultStore,
    name: str,
    text: str,
    number: float,
    angle: float,
    uncertainty: float,
    time: datetime,
    count: int,
) -> None:
    extreme = wheel(
        name,
        device_time_s=number,
        camber=angle,
        toe=-angle,
        camber_u=uncertainty,
        toe_u=uncertainty,
        camber_low=-3.2,
        camber_high=None,
        toe_low=None,
        toe_high=3.2,
        points_used=count,
        residual_rms_mm=abs(number),
        method=text,
        measured_utc=time,
    )
    record = cycle(
        station=name,
        vehicle=VehicleRecord(name, name),
        received_utc=time,
        trigger_sequence=count,
        received_monotonic_s=number,
        measured_monotonic_s=None,
        wheels=(extreme,),
        axles=(axle(name, total_toe=angle, total_toe_u=uncertainty),),
    )
    store.write_cycle(record)
    stored = store.cycle(record.uuid)
    assert stored is not None
    assert stored.record == record
    assert stored.record.received_utc.tzinfo is UTC


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | numbers | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


@on_one_database
@given(document=st.dictionaries(st.text(), json_values, max_size=4))
def test_a_calibration_document_survives_to_the_letter(
    store: ResultStore, document: dict[str, object]
) -> None:
    record = CalibrationRecord(str(uuid4()), "front_left", NOON, document)
    store.record_calibration(record)
    store.record_calibration(record)
    stored = store.calibration(record.id)
    assert stored == record
    assert stored is not None
    assert repr(stored.document) == repr(record.document)


def test_one_thread_writes_while_another_reads(store: ResultStore) -> None:
    records = [cycle() for _ in range(10)]
    written = threading.Event()
    seen: list[int] = []

    def read() -> None:
        while not written.is_set():
            for stored in store.recent_cycles(3):
                seen.append(len(stored.record.wheels))

    reader = threading.Thread(target=read)
    reader.start()
    try:
        for record in records:
            store.write_cycle(record)
    finally:
        written.set()
        reader.join()
    assert set(seen) <= {4}, "a reader saw half a cycle"
    assert store.counts()["cycles"] == 10


def test_two_writers_of_one_cycle_store_it_once(
    database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    stores = [open_store(database_url), open_store(database_url)]
    stores[0].record_calibration(CALIBRATION)
    records = [cycle() for _ in range(5)]
    together = threading.Barrier(2)
    failures: list[BaseException] = []

    def write(store: ResultStore) -> None:
        try:
            for record in records:
                together.wait(10)
                store.write_cycle(record)
        except BaseException as error:  # noqa: BLE001  (any failure of the thread fails the test)
            failures.append(error)
            together.abort()

    threads = [threading.Thread(target=write, args=(store,)) for store in stores]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert stores[0].counts()["wheel_results"] == 20


def test_a_store_that_is_not_open_says_so(sqlite_url: str) -> None:
    store = ResultStore(sqlite_url, create=True)
    with pytest.raises(StoreError, match="is not open"):
        store.counts()
    with store, pytest.raises(StoreError, match="open already"):
        store.open()
    store.close()
    with store:
        assert store.counts()["cycles"] == 0


def test_what_locking_added_lately_is_that_of_the_station_and_the_type_newest_first(
    database_url: str, open_store: Callable[..., ResultStore], monkeypatch: pytest.MonkeyPatch
) -> None:
    store = open_store(database_url)
    store.record_calibration(CALIBRATION)
    unlocked = adjusting("rear_right", nuts_locked=0, drift=None)
    first, second = adjusting(drift=0.001), adjusting("front_right", drift=0.002)
    van = VehicleRecord("TRUEWHEEL00000002", "van")
    store.write_cycle(cycle(adjustings=(first, unlocked)))
    store.write_cycle(cycle(vehicle=van, adjustings=(adjusting(drift=0.003),)))
    store.write_cycle(cycle(station="EOL-2", adjustings=(adjusting(drift=0.004),)))
    store.write_cycle(cycle())
    store.write_cycle(cycle(adjustings=(second,)))
    assert store.recent_adjustings("EOL-1", "compact", 9) == (second, first)
    assert store.recent_adjustings("EOL-1", "compact", 1) == (second,)
    assert store.recent_adjustings("EOL-1", "truck", 9) == ()
    # However rare a type is, only so much is looked through.
    monkeypatch.setattr("db.rows.adjusting.LOOKED_AT", 3)
    assert store.recent_adjustings("EOL-1", "compact", 9) == (second,)
