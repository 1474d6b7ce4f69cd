"""The record of a vehicle's steering wheel: how it stood, and whether front toe is that of straight ahead."""

from __future__ import annotations

from collections.abc import Mapping

from db.records import SteeringRecord, StraightAheadWord
from station.cycle.judging import Evaluation, StraightAheadState, combined

_WORDS: Mapping[StraightAheadState, StraightAheadWord] = {
    StraightAheadState.CHECKED: "checked",
    StraightAheadState.NOT_CHECKED: "not_checked",
    StraightAheadState.REFUSED: "refused",
    StraightAheadState.NOT_ASKED: "not_asked",
}


def steering_record(evaluation: Evaluation) -> SteeringRecord | None:
    """Return the record of the steering wheel; None where the vehicle type says nothing of its steering."""
    straight, vehicle = evaluation.corrections.straight, evaluation.vehicle
    if straight.state is StraightAheadState.NOT_ASKED:
        return None
    checked = straight.state is StraightAheadState.CHECKED
    offset = None if vehicle is None else vehicle.steering_wheel_offset
    limits = None if offset is None else offset.limits
    return SteeringRecord(
        straight_ahead=_WORDS[straight.state],
        reason_text=straight.reason,
        verdict=combined(() if offset is None else (offset,)).verdict,
        guard_band=evaluation.guard_band,
        coverage_factor=evaluation.coverage_factor,
        steering_wheel=straight.wheel,
        steering_wheel_u=straight.wheel_u,
        steering_wheel_age_s=straight.age_s,
        steer=straight.steer if checked else None,
        steer_u=straight.steer_u if checked else None,
        steering_wheel_offset=None if offset is None else offset.value,
        steering_wheel_offset_u=None if vehicle is None else vehicle.steering_wheel_offset_u,
        steering_wheel_offset_low=None if limits is None else limits.low,
        steering_wheel_offset_high=None if limits is None else limits.high,
    )
