"""Zero measurements in the database: dated, in force until revoked, never deleted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta

import pytest

from alignment.errors import InputError, StoreError
from db.connection import current_revision, head_revision, make_engine, migrate, parse_url
from db.records import CalibrationRecord, WheelKind
from db.schema import calibrations, cycles, vehicles, wheel_results
from db.store import ResultStore
from tests.db.example_records import CALIBRATION, NOON, cycle, given, revocation, zero

HOUR = timedelta(hours=1)


def test_the_newest_of_a_rig_and_calibration_is_in_force(store: ResultStore) -> None:
    other = CalibrationRecord("cal-other", "front_left", NOON, {})
    store.record_calibration(other)
    late = zero("zero-2", measured_utc=NOON + HOUR, camber=3e-4)
    elsewhere = zero("zero-3", rig="front_right", measured_utc=NOON - HOUR)
    after_calibration = zero("zero-4", calibration_id=other.id, measured_utc=NOON + 2 * HOUR)
    for record in (late, zero(), elsewhere, after_calibration, late):
        store.record_zero(record)
    assert [stored.record for stored in store.zeros()] == [elsewhere, zero(), late, after_calibration]
    assert set(store.zeros_in_force()) == {late, elsewhere, after_calibration}


def test_a_revoked_one_gives_way_to_the_one_before_and_stays_stored(store: ResultStore) -> None:
    late = zero("zero-2", measured_utc=NOON + HOUR)
    store.record_zero(zero())
    store.record_zero(late)
    ended = revocation("zero-2", utc=NOON + 2 * HOUR)
    for _ in range(2):
        store.revoke_zero(ended)
    assert store.zeros_in_force() == (zero(),)
    assert [(stored.record, stored.revocation) for stored in store.zeros()] == [(zero(), None), (late, ended)]
    store.revoke_zero(revocation("zero-1"))
    assert store.zeros_in_force() == ()
    assert store.counts()["zero_measurements"] == store.counts()["zero_revocations"] == 2


def test_those_of_a_whole_vehicle_are_stored_together_or_not_at_all(store: ResultStore) -> None:
    """They were written one by one: a database that failed at the third corrected half of a vehicle."""
    rigs = ("front_left", "front_right", "rear_left")
    good = [zero(f"zero-{rig}", rig=rig) for rig in rigs]
    with pytest.raises(StoreError):
        store.record_zeros([*good, zero("zero-rear_right", rig="rear_right", calibration_id="unknown")])
    assert store.zeros() == ()
    store.record_zeros([*good, zero("zero-rear_right", rig="rear_right")])
    assert len(store.zeros_in_force()) == 4
    # The same again changes nothing.
    store.record_zeros(good)
    assert len(store.zeros()) == 4


def test_a_forced_one_comes_back_with_its_reason(store: ResultStore) -> None:
    record = zero(forced_reason="the rig was turned on purpose")
    store.record_zero(record)
    assert [kept.record for kept in store.zeros()] == [record]
    assert store.zeros_in_force() == (record,)


def test_what_does_not_fit_is_refused(store: ResultStore) -> None:
    store.record_zero(zero())
    with pytest.raises(StoreError, match="another zero measurement zero-1"):
        store.record_zero(replace(zero(), toe=0.0))
    with pytest.raises(StoreError):
        store.record_zero(zero("zero-2", calibration_id="unknown"))
    with pytest.raises(StoreError, match=r"found 'zero-9'\. See the list of the zero measurements"):
        store.revoke_zero(revocation("zero-9"))
    store.revoke_zero(revocation())
    with pytest.raises(StoreError, match="was revoked on 2026-11-22 already: the master was dropped"):
        store.revoke_zero(revocation(reason="another reason"))
    with pytest.raises(InputError, match="a finite number"):
        zero(camber=float("nan"))


def test_a_database_of_the_first_revision_keeps_its_results_and_takes_zero_measurements(
    empty_database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    migrate(empty_database_url, "0001")
    record = cycle(axles=(), vehicle_angles=None)
    engine = make_engine(parse_url(empty_database_url), timeout_s=5.0)
    with engine.begin() as connection:
        assert record.vehicle is not None
        connection.execute(vehicles.insert().values(id=1, **given(record.vehicle)))
        connection.execute(calibrations.insert().values(**given(CALIBRATION), stored_utc=NOON))
        connection.execute(cycles.insert().values(id=1, vehicle_id=1, **given(record), stored_utc=NOON))
        for wheel in record.wheels:
            connection.execute(wheel_results.insert().values(cycle_id=1, **given(wheel)))
    engine.dispose()

    migrate(empty_database_url)
    assert current_revision(empty_database_url) == head_revision()
    store = open_store(empty_database_url, create=False)
    stored = store.cycle(record.uuid)
    assert stored is not None
    # Told by the method ever since; before it stood in a text.
    kinds = tuple(replace(wheel, kind=WheelKind.TYRE_PLANE) for wheel in record.wheels)
    assert stored.record == replace(record, wheels=kinds)
    store.record_zero(zero())
    assert store.zeros_in_force() == (zero(),)
