"""The life of a calibration in the database: in force, checked, replaced."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import pytest

from alignment.errors import InputError, StoreError
from db.records import CalibrationRecord, CheckKind, CheckOutcome
from db.store import ResultStore
from tests.db.example_records import CALIBRATION, NOON, check

DAY = timedelta(days=1)
LATER = CalibrationRecord("cal-2026-12", "front_left", NOON + 10 * DAY, {"fx": 2.5e3}, NOON + 40 * DAY)


def test_checks_come_back_once_and_in_the_order_of_their_times(store: ResultStore) -> None:
    late = check(
        utc=NOON + DAY,
        kind=CheckKind.MASTER_WHEEL,
        outcome=CheckOutcome.OUT,
        reason="toe 0.4′ from its certificate",
        as_found={"toe_deviation_arcmin": 0.4, "limits": (0.1, 0.2)},
    )
    early = check()
    for record in (late, early, late):
        store.record_check(record)
    assert store.calibration_checks(CALIBRATION.id) == (early, late)
    assert store.calibration_checks("another") == ()
    with pytest.raises(StoreError, match="another calibration check"):
        store.record_check(replace(late, outcome=CheckOutcome.WITHIN))


def test_a_check_needs_its_calibration_in_the_database(store: ResultStore) -> None:
    with pytest.raises(StoreError):
        store.record_check(check("unknown"))


def test_the_newest_calibration_is_in_force_until_it_ends(store: ResultStore) -> None:
    store.record_calibration(LATER)
    for at, expected in (
        (NOON - DAY, None),
        (NOON, CALIBRATION),
        (NOON + 9 * DAY, CALIBRATION),
        (NOON + 10 * DAY, LATER),
        (NOON + 39 * DAY, LATER),
        # The older one was replaced: it does not come back.
        (NOON + 40 * DAY, None),
    ):
        assert store.calibration_in_force("front_left", at) == expected
    assert store.calibration_in_force("rear_left", NOON) is None


def test_an_accepted_calibration_is_stored_with_its_figures_or_not_at_all(store: ResultStore) -> None:
    figures = check(LATER.id, as_left={"residual_rms_px": 0.01}, predecessor_id=CALIBRATION.id)
    for _ in range(2):
        store.accept_calibration(LATER, figures)
    assert store.calibration_checks(LATER.id) == (figures,)
    other = replace(LATER, id="cal-2027-01")
    with pytest.raises(StoreError, match="expected a check of calibration cal-2027-01"):
        store.accept_calibration(other, figures)
    with pytest.raises(StoreError):
        store.accept_calibration(other, check(other.id, as_left={}, predecessor_id="unknown"))
    assert store.calibration(other.id) is None


def test_figures_that_are_no_json_are_refused() -> None:
    with pytest.raises(InputError, match=r"CalibrationCheckRecord\.as_found"):
        check(as_found={"rms": float("nan")})


def test_the_calibration_in_force_is_the_newest_whenever_it_was_stored(store: ResultStore) -> None:
    """One that is stored late, such as out of an older file, does not take the place of a newer one."""
    newest = CalibrationRecord("cal-newest", "front_left", NOON + 2 * DAY, {})
    between = CalibrationRecord("cal-between", "front_left", NOON + DAY, {})
    of_another_rig = CalibrationRecord("cal-other", "rear_left", NOON + 3 * DAY, {})
    for record in (newest, between, of_another_rig):
        store.record_calibration(record)
    assert store.calibration_in_force("front_left", NOON + 5 * DAY) == newest
    assert store.calibration_in_force("front_left", NOON + 1.5 * DAY) == between
    assert store.calibration_in_force("front_left", NOON + 0.5 * DAY) == CALIBRATION
    assert store.calibration_in_force("front_left", NOON - DAY) is None
    # Of two from the same moment the one that was stored last.
    again = CalibrationRecord("cal-again", "front_left", NOON + 2 * DAY, {})
    store.record_calibration(again)
    assert store.calibration_in_force("front_left", NOON + 5 * DAY) == again
