"""What the line is told of steering and ride heights: what the record says, and nothing else."""

from __future__ import annotations

import math
from typing import Any

import pytest

from db.records import CycleOutcome, CycleRecord, Verdict
from station.cycle.answering.steering_answer import steering_answer
from station.cycle.words.geometry import QuantityState
from station.cycle.words.steering import NO_STEERING, AngleCorrection, HeightState, StraightAhead
from tests.db.example_records import corrected_wheel, cycle, steering, steering_axis, wheel

FAULT: dict[str, Any] = {"outcome": CycleOutcome.FAULT, "reason_code": "x", "reason_text": "y"}
NOTHING: dict[str, Any] = {
    "steering_wheel": None, "steering_wheel_u": None, "steering_wheel_age_s": None, "steer": None,
    "steer_u": None, "steering_wheel_offset": None, "steering_wheel_offset_u": None, "verdict": Verdict.NONE,
    "reason_text": "no angle",
}  # fmt: skip


def told(**changes: Any) -> CycleRecord:
    return cycle(axles=(), vehicle_angles=None, **changes)


def test_nothing_is_told_of_a_vehicle_of_which_nothing_was_asked() -> None:
    assert steering_answer(told()) == NO_STEERING


def test_a_checked_steering_wheel_is_told_with_its_offset_and_verdict() -> None:
    answer = steering_answer(told(steering=steering())).wheel
    assert (answer.straight_ahead, answer.state) == (StraightAhead.CHECKED, QuantityState.OK)
    assert answer.used_deg == pytest.approx(math.degrees(0.05))
    assert answer.offset_deg == pytest.approx(math.degrees(0.0125))
    # Differences belong to a sweep.
    assert steering_answer(told(steering=steering())).axes == ()


@pytest.mark.parametrize(
    ("word", "straight", "state"),
    [
        ("not_checked", StraightAhead.NOT_CHECKED, QuantityState.NONE),
        ("refused", StraightAhead.NOT_CHECKED, QuantityState.NOT_MEASURED),
        ("not_asked", StraightAhead.NONE, QuantityState.NONE),
    ],
)
def test_a_straight_ahead_that_was_not_checked_is_told_as_such(
    word: str, straight: StraightAhead, state: QuantityState
) -> None:
    reason = {"reason_text": None} if word == "not_asked" else {}
    found = steering(**(NOTHING | reason), straight_ahead=word)
    answer = steering_answer(told(steering=found, **(FAULT if word == "refused" else {}))).wheel
    assert (answer.straight_ahead, answer.state) == (straight, state)
    assert (answer.used_deg, answer.offset_deg) == (None, None)


def test_axes_and_differences_are_told_in_degrees_and_millimetres() -> None:
    answer = steering_answer(told(steering=steering(), steering_axes=(steering_axis(),)))
    caster, trail, kpi = (answer.of(f"front_left.{name}") for name in ("caster", "trail", "kpi"))
    assert (caster.state, caster.value) == (QuantityState.OK, pytest.approx(math.degrees(0.105)))
    assert caster.u95 == pytest.approx(math.degrees(2.0 * 2e-5))
    assert (trail.state, trail.value, trail.u95) == (QuantityState.OK, 22.5, 0.5)
    assert kpi.state is QuantityState.UNJUDGED
    assert answer.of("caster_difference").state is QuantityState.OK
    assert answer.of("kpi_difference").state is QuantityState.UNJUDGED


def test_an_axis_that_was_refused_was_asked_for_and_not_measured() -> None:
    lost = {
        name: None for name in vars(steering_axis()) if name.startswith(("caster", "kpi", "trail", "scrub"))
    }
    axis = steering_axis(
        **lost, verdict=Verdict.NONE, reason_code="no_steering_axis", reason_text="too small"
    )
    answer = steering_answer(told(steering_axes=(axis,), **FAULT))
    assert answer.of("front_left.caster").state is QuantityState.NOT_MEASURED
    assert "front_left.caster" in answer.missed


def test_what_a_sweep_that_succeeded_does_not_know_was_asked_for_only_with_limits() -> None:
    small = {"toe_out": None, "toe_out_u": None}
    answer = steering_answer(told(steering_axes=(steering_axis(**small),)))
    assert answer.of("front_left.toe_out").state is QuantityState.NONE


@pytest.mark.parametrize(
    ("found", "height", "height_mm", "correction"),
    [
        (corrected_wheel(), HeightState.USED, 391.5, AngleCorrection.BOTH),
        (corrected_wheel("rear_left"), HeightState.USED, 391.5, AngleCorrection.RIDE_HEIGHT),
        (
            corrected_wheel(ride_height=None, ride_height_mm=None), HeightState.NONE, None,
            AngleCorrection.STEERING,
        ),
        (wheel(ride_height="not_known"), HeightState.MISSING, None, AngleCorrection.NONE),
    ],
    ids=["both", "height alone", "steering alone", "not known"],
)  # fmt: skip
def test_a_corner_says_its_height_and_for_what_its_angles_were_corrected(
    found: Any, height: HeightState, height_mm: float | None, correction: AngleCorrection
) -> None:
    corner = steering_answer(told(wheels=(found,), steering=steering())).corner(found.wheel)
    assert (corner.height, corner.height_mm, corner.correction) == (height, height_mm, correction)
    raw = found.toe_raw
    assert corner.raw_toe_deg == (None if raw is None else pytest.approx(math.degrees(raw)))


@pytest.mark.parametrize(
    ("word", "height"), [("missing", HeightState.MISSING), ("refused", HeightState.ABSURD)]
)
def test_a_height_with_which_a_wheel_is_not_judged_is_told(word: str, height: HeightState) -> None:
    bad = wheel(verdict=Verdict.NONE, ride_height=word, reason_code="ride_height", reason_text="no height")
    corner = steering_answer(told(wheels=(bad,), **FAULT)).corner("front_left")
    assert (corner.height, corner.height_mm, corner.raw_toe_deg) == (height, None, None)
