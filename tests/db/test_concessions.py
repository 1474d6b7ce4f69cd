"""Concessions: one beside the newest verdict of a vehicle that is not ok, and nothing in place of it."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from tempfile import TemporaryDirectory
from uuid import uuid4

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.errors import InputError
from db.exports import angle_rows
from db.queries import ResultReader, vin_history
from db.records import CycleOutcome, CycleRecord, VehicleRecord
from db.store import ResultStore
from tests.db.example_records import CALIBRATION, NOON, bad_vehicle, concession, cycle, not_ok, withdrawal

HOUR = timedelta(hours=1)


def stored_bad(store: ResultStore) -> CycleRecord:
    record = bad_vehicle()
    store.write_cycle(record)
    return record


def test_a_released_vehicle_keeps_its_verdict(store: ResultStore, database_url: str) -> None:
    bad = stored_bad(store)
    granted = concession(bad.uuid)
    for _ in range(2):
        store.grant_concession(granted)
    stored = store.cycle(bad.uuid)
    assert stored is not None
    assert (stored.record, stored.record.outcome) == (bad, CycleOutcome.NOK)
    assert stored.concession == granted
    assert {row.cycle_outcome for row in angle_rows(stored)} == {"nok"}
    assert {
        (row.concession_person, row.concession_reason, row.concession_utc) for row in angle_rows(stored)
    } == {(granted.person, granted.reason, granted.utc)}
    with ResultReader(database_url) as reader:
        assert bad.vehicle is not None
        history = vin_history(reader, bad.vehicle.vin)
    assert [each.record for each in history.concessions] == [granted]
    assert history.cycles[0].concession == granted


def test_a_withdrawn_one_releases_nothing_and_stays_stored(store: ResultStore) -> None:
    bad = stored_bad(store)
    granted, again = concession(bad.uuid), concession(bad.uuid, person="C. Example")
    store.grant_concession(granted)
    ended = withdrawal(granted.uuid)
    for _ in range(2):
        store.withdraw_concession(ended)
    with pytest.raises(InputError, match=r"withdrawn by B\. Example"):
        store.withdraw_concession(replace(ended, reason="for another reason"))
    stored = store.cycle(bad.uuid)
    assert stored is not None
    assert stored.concession is None
    store.grant_concession(again)
    found = store.concessions([bad.uuid])
    assert [(each.record, each.withdrawal) for each in found] == [(granted, ended), (again, None)]
    assert [each.in_force for each in found] == [False, True]


def test_the_same_vehicle_is_not_released_twice(store: ResultStore) -> None:
    bad = stored_bad(store)
    store.grant_concession(concession(bad.uuid))
    with pytest.raises(InputError, match=r"with one by A\. Example"):
        store.grant_concession(concession(bad.uuid, person="C. Example"))
    assert store.counts()["concessions"] == 1


@pytest.mark.parametrize("outcome", ["ok", "fault", "aborted"])
def test_only_what_was_found_not_ok_can_be_released(store: ResultStore, outcome: str) -> None:
    why = {"reason_code": "store", "reason_text": "the disk is full"}
    record = cycle() if outcome == "ok" else cycle(outcome=CycleOutcome(outcome), **why)
    store.write_cycle(record)
    with pytest.raises(InputError, match=f"with the result {outcome}"):
        store.grant_concession(concession(record.uuid))


def test_what_was_measured_again_is_not_released_by_what_it_was(store: ResultStore) -> None:
    """As it was left counts, not as it was found."""
    bad = stored_bad(store)
    store.write_cycle(cycle(vehicle=bad.vehicle, received_utc=NOON + HOUR))
    with pytest.raises(InputError, match="the newest cycle of its vehicle"):
        store.grant_concession(concession(bad.uuid))


def test_a_cycle_that_nobody_knows_is_not_released(store: ResultStore) -> None:
    with pytest.raises(InputError, match="none with UUID"):
        store.grant_concession(concession(uuid4()))
    with pytest.raises(InputError, match="none with UUID"):
        store.withdraw_concession(withdrawal(uuid4()))


STEPS = st.lists(st.sampled_from(["nok", "ok", "grant", "withdraw"]), min_size=1, max_size=12)


@settings(max_examples=60, deadline=None)
@given(STEPS)
def test_whatever_happens_each_concession_stands_beside_the_verdict_it_was_granted_for(
    steps: list[str],
) -> None:
    vehicle = VehicleRecord("TRUEWHEEL00000042", "compact")
    outcomes: list[CycleRecord] = []
    in_force = None
    with TemporaryDirectory() as folder, ResultStore(f"sqlite:///{folder}/results.db", create=True) as store:
        store.record_calibration(CALIBRATION)
        for number, step in enumerate(steps):
            if step in ("ok", "nok"):
                made = cycle if step == "ok" else not_ok
                record = made(vehicle=vehicle, received_utc=NOON + number * HOUR)
                store.write_cycle(record)
                outcomes.append(record)
                in_force = None
            elif step == "grant" and outcomes:
                granted = concession(outcomes[-1].uuid, reason=f"at step {number}, by hand")
                may = outcomes[-1].outcome is CycleOutcome.NOK and in_force is None
                if may:
                    store.grant_concession(granted)
                    in_force = granted
                else:
                    with pytest.raises(InputError):
                        store.grant_concession(granted)
            elif step == "withdraw" and in_force is not None:
                store.withdraw_concession(withdrawal(in_force.uuid))
                in_force = None
        for record in outcomes:
            stored = store.cycle(record.uuid)
            assert stored is not None
            assert stored.record == record
            assert stored.concession is None or stored.concession.cycle == record.uuid
            assert stored.concession is None or record.outcome is CycleOutcome.NOK
        if outcomes:
            last = store.cycle(outcomes[-1].uuid)
            assert last is not None
            assert last.concession == in_force
