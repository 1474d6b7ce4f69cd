"""What is stored of a cycle and what is told to the line, both from the same evaluation."""

from __future__ import annotations

import enum
import math
from datetime import datetime

from db.records import (
    AxleRecord,
    VehicleAnglesRecord,
    WheelOutcome,
    WheelRecord,
)
from station.evaluation import Evaluation, JudgedAxle, JudgedVehicle, JudgedWheel
from station.line.messages import AxleAnswer, Outcome, VehicleAnswer, WheelAnswer
from station.verdict import Angle, Status, combined


def wheel_records(evaluation: Evaluation) -> tuple[WheelRecord, ...]:
    """Return the records of all wheels."""
    return tuple(_wheel_record(wheel, evaluation) for wheel in evaluation.wheels)


def axle_records(evaluation: Evaluation) -> tuple[AxleRecord, ...]:
    """Return the records of all axles of which both wheels were measured."""
    return tuple(
        AxleRecord(
            axle=axle.name,
            total_toe=axle.values.total_toe,
            total_toe_u=axle.values.total_toe_u,
            camber_difference=axle.values.camber_difference,
            camber_difference_u=axle.values.camber_difference_u,
            verdict=combined(axle.angles).verdict,
            total_toe_low=_low(axle.total_toe),
            total_toe_high=_high(axle.total_toe),
            camber_difference_low=_low(axle.camber_difference),
            camber_difference_high=_high(axle.camber_difference),
            guard_band=evaluation.guard_band,
            coverage_factor=evaluation.coverage_factor,
        )
        for axle in evaluation.axles
        if axle.values is not None
    )


def vehicle_record(evaluation: Evaluation) -> VehicleAnglesRecord | None:
    """Return the record of the vehicle's angles; None when they were not measured."""
    vehicle = evaluation.vehicle
    if vehicle is None or vehicle.values is None:
        return None
    values = vehicle.values
    return VehicleAnglesRecord(
        thrust_angle=values.thrust_angle,
        thrust_angle_u=values.thrust_angle_u,
        thrust_sign=values.thrust_sign,
        front_toe_left_to_thrust=values.front_toe_left_to_thrust,
        front_toe_right_to_thrust=values.front_toe_right_to_thrust,
        verdict=vehicle.thrust_angle.status.verdict,
        thrust_angle_low=_low(vehicle.thrust_angle),
        thrust_angle_high=_high(vehicle.thrust_angle),
        guard_band=evaluation.guard_band,
        coverage_factor=evaluation.coverage_factor,
    )


def last_measured(evaluation: Evaluation) -> datetime | None:
    """Return when the last images were taken; None when there are none."""
    times = [w.result.measured_utc for w in evaluation.wheels if w.result.measured_utc is not None]
    return max(times, default=None)


def _wheel_record(wheel: JudgedWheel, evaluation: Evaluation) -> WheelRecord:
    result, found, failure = wheel.result, wheel.result.measurement, wheel.result.failure
    return WheelRecord(
        wheel=result.wheel,
        outcome=WheelOutcome.MEASURED if failure is None else failure.outcome,
        verdict=combined(wheel.angles).verdict,
        measured_utc=result.measured_utc,
        device_time_s=result.device_time_s,
        camber=None if found is None else float(found.camber),
        toe=None if found is None else float(found.toe),
        camber_u=None if found is None else found.camber_u,
        toe_u=None if found is None else found.toe_u,
        coverage_factor=evaluation.coverage_factor,
        method=None if found is None else found.method,
        calibration_id=result.calibration_id,
        zero_measurement_id=result.zero_id,
        reason_code=None if failure is None else failure.reason_code,
        reason_text=None if failure is None else failure.text,
        camber_low=_low(wheel.camber),
        camber_high=_high(wheel.camber),
        toe_low=_low(wheel.toe),
        toe_high=_high(wheel.toe),
        guard_band=evaluation.guard_band,
        points_used=None if found is None else int(found.points_used),
        residual_rms_mm=None if found is None else float(found.residual_rms_mm),
        duration_s=result.duration_s,
    )


class Standing(enum.Enum):
    """What became of the record, which decides what the line may be told."""

    COMMITTED = "committed"
    NOT_COMMITTED = "not committed"
    ABORTED = "aborted"


def wheel_answers(evaluation: Evaluation, standing: Standing) -> tuple[WheelAnswer, ...]:
    """Return what the line is told of each wheel."""
    return tuple(_wheel_answer(wheel, standing) for wheel in evaluation.wheels)


def axle_answers(evaluation: Evaluation, standing: Standing) -> tuple[AxleAnswer, ...]:
    """Return what the line is told of each axle."""
    return tuple(_axle_answer(axle, standing) for axle in evaluation.axles)


def vehicle_answer(evaluation: Evaluation, standing: Standing) -> VehicleAnswer | None:
    """Return what the line is told of the thrust angle; None when it was not asked for."""
    return None if evaluation.vehicle is None else _vehicle_answer(evaluation.vehicle, standing)


def _wheel_answer(wheel: JudgedWheel, standing: Standing) -> WheelAnswer:
    told = _told(wheel.angles, standing)
    if not told.judged:
        return WheelAnswer(wheel.result.wheel, told)
    return WheelAnswer(
        wheel.result.wheel,
        told,
        camber_deg=_degrees(wheel.camber.value),
        toe_deg=_degrees(wheel.toe.value),
        camber_u95_deg=_degrees(wheel.camber.expanded_uncertainty),
        toe_u95_deg=_degrees(wheel.toe.expanded_uncertainty),
    )


def _axle_answer(axle: JudgedAxle, standing: Standing) -> AxleAnswer:
    told = _told(axle.angles, standing)
    if not told.judged:
        return AxleAnswer(axle.name, told)
    return AxleAnswer(
        axle.name,
        told,
        total_toe_deg=_degrees(axle.total_toe.value),
        camber_difference_deg=_degrees(axle.camber_difference.value),
        total_toe_u95_deg=_degrees(axle.total_toe.expanded_uncertainty),
        camber_difference_u95_deg=_degrees(axle.camber_difference.expanded_uncertainty),
    )


def _vehicle_answer(vehicle: JudgedVehicle, standing: Standing) -> VehicleAnswer:
    told = _told(vehicle.angles, standing)
    if not told.judged or vehicle.values is None:
        return VehicleAnswer(told)
    return VehicleAnswer(
        told,
        thrust_angle_deg=_degrees(vehicle.thrust_angle.value),
        thrust_angle_u95_deg=_degrees(vehicle.thrust_angle.expanded_uncertainty),
        thrust_sign=vehicle.values.thrust_sign,
    )


def _told(angles: tuple[Angle, ...], standing: Standing) -> Outcome:
    """Outcome of a part of the vehicle, as the line is told it.

    A value whose record was not committed is not a result. What has no limits was not asked to be judged.
    """
    if standing is Standing.ABORTED:
        return Outcome.ABORTED
    if standing is Standing.NOT_COMMITTED:
        return Outcome.FAULT
    return {
        Status.OK: Outcome.OK,
        Status.NOK: Outcome.NOK,
        Status.UNJUDGED: Outcome.NOT_REQUESTED,
    }.get(combined(angles), Outcome.FAULT)


def _degrees(value: float | None) -> float | None:
    return None if value is None else math.degrees(value)


def _low(angle: Angle) -> float | None:
    return None if angle.limits is None else angle.limits.low


def _high(angle: Angle) -> float | None:
    return None if angle.limits is None else angle.limits.high
