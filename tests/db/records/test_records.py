"""What a record refuses before a database sees it."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import uuid4

import numpy as np
import pytest

from alignment.errors import InputError
from db.records import CalibrationRecord, CycleOutcome, EventRecord, Severity, Verdict
from tests.db.example_records import NOON, WHEELS, axle, cycle, refused_wheel, steering, steering_axis, wheel

NOT_STRAIGHT: dict[str, Any] = {
    "straight_ahead": "refused", "reason_text": "no angle", "verdict": Verdict.NONE, "steer": None,
    "steer_u": None,
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"camber": float("nan")}, "WheelRecord.camber': expected a finite number, found nan"),
        ({"toe_u": float("inf")}, "WheelRecord.toe_u': expected a finite number"),
        ({"method": "a\0b"}, "WheelRecord.method': expected text without NUL"),
        ({"method": "\ud800"}, "lone surrogates"),
        ({"measured_utc": datetime(2026, 1, 1)}, "expected a time with its time zone"),
        ({"points_used": 2**63}, "expected a whole number of 64 bits"),
        ({"points_used": np.int64(3)}, "expected a plain Python value, found int64"),
    ],
    ids=["nan", "infinity", "nul", "surrogate", "naive_time", "too_long", "numpy_integer"],
)
def test_a_value_that_databases_would_change_is_refused(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        wheel(**changes)
    assert sentence in str(caught.value)


def test_a_numpy_float_is_a_float() -> None:
    assert wheel(camber=np.float64(-0.001)).camber == -0.001


@pytest.mark.parametrize(
    "wheels",
    [
        (),
        (wheel(), refused_wheel()),
        (wheel(), wheel("front_right", verdict=Verdict.NOK)),
        (wheel(verdict=Verdict.NONE),),
    ],
    ids=["no_wheel", "one_refused", "one_nok", "nothing_compared"],
)
def test_no_ok_for_a_vehicle_that_was_not_measured_good(wheels: tuple[Any, ...]) -> None:
    with pytest.raises(InputError, match="for 'ok' every wheel measured"):
        cycle(wheels=wheels, axles=(), vehicle_angles=None)


def test_a_bad_axle_is_no_ok_either() -> None:
    with pytest.raises(InputError, match="for 'ok'"):
        cycle(axles=(axle(verdict=Verdict.NOK),))


@pytest.mark.parametrize(
    "changes",
    [
        {"steering": steering(**NOT_STRAIGHT)},
        {"steering": steering(verdict=Verdict.NOK)},
        {"steering_axes": (steering_axis(verdict=Verdict.NOK),)},
        {"steering_axes": (steering_axis(caster=None, caster_u=None, verdict=Verdict.NONE),)},
        {"wheels": (wheel(), wheel("front_right", verdict=Verdict.NONE, ride_height="refused"))},
        {"wheels": (wheel(), wheel("front_right", verdict=Verdict.NONE, ride_height="missing"))},
    ],
    ids=["not_straight", "offset", "axis", "no_axis", "height", "no_height"],
)
def test_no_ok_where_straight_ahead_a_height_or_an_axis_forbids_it(changes: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="for 'ok'"):
        cycle(**changes)
    assert cycle(steering=steering(), steering_axes=(steering_axis(),)).verdicts[-2:] == (Verdict.OK,) * 2


def test_a_wheel_has_one_steering_axis() -> None:
    with pytest.raises(InputError, match="each name once"):
        cycle(steering_axes=(steering_axis(), steering_axis()))


def test_nok_needs_something_that_is_not_good() -> None:
    with pytest.raises(InputError, match="for 'nok' a verdict 'nok'"):
        cycle(outcome=CycleOutcome.NOK)


def test_a_wheel_without_limits_does_not_spoil_an_ok() -> None:
    free = wheel("front_right", verdict=Verdict.NONE)
    assert cycle(wheels=(wheel(), free)).verdicts[:2] == (Verdict.OK, Verdict.NONE)


def test_a_wheel_has_one_result_in_a_cycle() -> None:
    with pytest.raises(InputError, match=r"CycleRecord\.wheels.*expected each name once"):
        cycle(wheels=(wheel(), wheel()))


def test_the_order_of_wheels_carries_no_meaning() -> None:
    uuid = uuid4()
    forwards = cycle(uuid, wheels=tuple(wheel(name) for name in WHEELS))
    assert forwards == cycle(uuid, wheels=tuple(wheel(name) for name in reversed(WHEELS)))


@pytest.mark.parametrize("value", [float("nan"), {1, 2}, object()], ids=["nan", "set", "object"])
def test_a_calibration_is_a_json_document(value: object) -> None:
    with pytest.raises(InputError, match="expected a JSON document"):
        CalibrationRecord("cal", "front_left", NOON, {"value": value})


def test_every_event_has_an_identity_of_its_own() -> None:
    first, second = (EventRecord(NOON, "EOL-1", Severity.INFO, "station", "start", "") for _ in range(2))
    assert first.uuid != second.uuid
