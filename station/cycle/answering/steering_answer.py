"""What the line is told of a vehicle's steering and ride heights: nothing but what the record says."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from alignment.units import in_degrees
from db.records import CycleRecord, SteeringRecord, WheelRecord, judge_angle
from station.cycle.answering.geometry_answer import told_state
from station.cycle.judging import STEERED
from station.cycle.words import (
    AXIS_DIFFERENCES,
    AXIS_LENGTHS,
    AXIS_QUANTITIES,
    AngleCorrection,
    CornerAnswer,
    HeightState,
    QuantityAnswer,
    QuantityState,
    SteeringAnswer,
    SteeringWheelAnswer,
    StraightAhead,
)

_HEIGHTS = {
    "corrected": HeightState.USED,
    "not_known": HeightState.MISSING,
    "missing": HeightState.MISSING,
    "refused": HeightState.ABSURD,
}


def steering_answer(record: CycleRecord) -> SteeringAnswer:
    """Return what is told of steering wheel, axes and ride heights; empty where nothing was asked."""
    differences = AXIS_DIFFERENCES if record.steering_axes and record.steering is not None else ()
    return SteeringAnswer(
        axes=(*_axes(record), *(_quantity(name, name, record.steering) for name in differences)),
        wheel=SteeringWheelAnswer() if record.steering is None else _wheel(record.steering),
        corners=tuple(
            corner for wheel in record.wheels if (corner := _corner(wheel, record.steering)) is not None
        ),
    )


def _axes(record: CycleRecord) -> Iterator[QuantityAnswer]:
    for axis in record.steering_axes:
        for name in AXIS_QUANTITIES:
            yield _quantity(f"{axis.wheel}.{name}", name, axis)


def _quantity(told: str, name: str, part: Any) -> QuantityAnswer:
    """One quantity of a record: a value with its verdict, or that it was not measured though asked for.

    What a sweep that succeeded does not tell, such as toe-out on turns of a small one, was asked for only
    where it has limits.
    """
    value, u = getattr(part, name), getattr(part, f"{name}_u")
    low, high = getattr(part, f"{name}_low"), getattr(part, f"{name}_high")
    verdict, _ = judge_angle(
        value, u, low, high,
        guard_band=part.guard_band, coverage_factor=part.coverage_factor, part=part.verdict,
    )  # fmt: skip
    state, k = told_state(verdict), part.coverage_factor
    if not state.measured or value is None or u is None or k is None:
        asked = low is not None or high is not None or getattr(part, "reason_code", None) is not None
        return QuantityAnswer(told, QuantityState.NOT_MEASURED if asked else QuantityState.NONE)
    factor = 1.0 if name in AXIS_LENGTHS else math.degrees(1.0)
    return QuantityAnswer(told, state, factor * value, factor * k * u)


def _wheel(steering: SteeringRecord) -> SteeringWheelAnswer:
    if steering.straight_ahead == "not_asked":
        return SteeringWheelAnswer()
    if steering.straight_ahead != "checked":
        refused = steering.straight_ahead == "refused"
        state = QuantityState.NOT_MEASURED if refused else QuantityState.NONE
        return SteeringWheelAnswer(StraightAhead.NOT_CHECKED, state)
    offset = _quantity("steering_wheel_offset", "steering_wheel_offset", steering)
    used_deg = in_degrees(steering.steering_wheel)
    return SteeringWheelAnswer(StraightAhead.CHECKED, offset.state, offset.value, used_deg)


def _corner(wheel: WheelRecord, steering: SteeringRecord | None) -> CornerAnswer | None:
    """What is told of a corner; None where nothing was asked of it."""
    corrected = wheel.toe_raw is not None
    straight = corrected and wheel.wheel in STEERED and steering is not None and steering.steer is not None
    at_design = corrected and wheel.ride_height == "corrected"
    if not corrected and wheel.ride_height is None:
        return None
    height = HeightState.NONE if wheel.ride_height is None else _HEIGHTS[wheel.ride_height]
    correction = {
        (True, True): AngleCorrection.BOTH,
        (True, False): AngleCorrection.STEERING,
        (False, True): AngleCorrection.RIDE_HEIGHT,
    }.get((straight, at_design), AngleCorrection.NONE)
    return CornerAnswer(
        wheel.wheel,
        height,
        wheel.ride_height_mm if height is HeightState.USED else None,
        correction,
        in_degrees(wheel.camber_raw) if corrected else None,
        in_degrees(wheel.toe_raw) if corrected else None,
    )
