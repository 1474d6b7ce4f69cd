"""What is stored of a cycle, and what the line is told: nothing but what the record says."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from alignment.units import in_degrees
from alignment.values import SIDES
from db.records import (
    AxleRecord,
    CycleRecord,
    VehicleAnglesRecord,
    Verdict,
    WheelKind,
    WheelOutcome,
    WheelRecord,
)
from station.cycle.answering.geometry_answer import geometry_answer, told_state
from station.cycle.answering.steering_answer import steering_answer
from station.cycle.judging import (
    STEERED,
    Angle,
    Evaluation,
    HeightOutcome,
    JudgedWheel,
    StraightAheadState,
    axle_of,
    combined,
    tyre_u,
)
from station.cycle.words import (
    NO_GEOMETRY,
    NO_STEERING,
    AxisKind,
    AxleAnswer,
    GeometryAnswer,
    Outcome,
    Quality,
    QuantityState,
    SteeringAnswer,
    VehicleAnswer,
    WheelAnswer,
)


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
        verdict=combined(vehicle.angles).verdict,
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
    values = wheel.values
    refusal = _refusal(wheel, evaluation) if failure is None else None
    unseen = (None, None) if found is None or found.unseen is None else found.unseen
    return WheelRecord(
        wheel=result.wheel,
        outcome=WheelOutcome.MEASURED if failure is None else failure.outcome,
        verdict=combined(wheel.angles).verdict,
        measured_utc=result.measured_utc,
        device_time_s=result.device_time_s,
        camber=None if values is None else float(values.camber),
        toe=None if values is None else float(values.toe),
        camber_u=None if values is None else values.camber_u,
        toe_u=None if values is None else values.toe_u,
        coverage_factor=evaluation.coverage_factor,
        method=None if found is None else found.method,
        calibration_id=result.calibration_id,
        zero_measurement_id=result.zero_id,
        reason_code=failure.reason_code if failure is not None else refusal and refusal[0],
        reason_text=failure.text if failure is not None else refusal and refusal[1],
        camber_low=_low(wheel.camber),
        camber_high=_high(wheel.camber),
        toe_low=_low(wheel.toe),
        toe_high=_high(wheel.toe),
        guard_band=evaluation.guard_band,
        points_used=None if found is None else int(found.points_used),
        residual_rms_mm=None if found is None else float(found.residual_rms_mm),
        duration_s=result.duration_s,
        row_px=None
        if found is None
        else max((h.row_px for h in found.heads if h.row_px is not None), default=None),
        knock_evidence=None if found is None else found.knock_evidence,
        warning=_warning(wheel, evaluation),
        camber_unseen=unseen[0],
        toe_unseen=unseen[1],
        degraded=None if found is None else bool(found.degraded),
        kind=None if found is None else WheelKind.of_method(found.method),
        load_mm=None if found is None or found.load_mm is None else float(found.load_mm),
        toe_tyre_u=_toe_tyre_u(wheel, evaluation),
        **_run_out(wheel),
        **_uncorrected(wheel, evaluation),
    )


def _refusal(wheel: JudgedWheel, evaluation: Evaluation) -> tuple[str, str] | None:
    """Why a wheel that was measured is not judged: its ride height, or straight ahead; code and words."""
    name, corrections = wheel.result.wheel, evaluation.corrections
    height = corrections.height(name)
    if height.refused and height.reason is not None:
        return "ride_height", height.reason
    if corrections.toe_refused(name) and corrections.straight.reason is not None:
        return "straight_ahead", corrections.straight.reason
    return None


def _uncorrected(wheel: JudgedWheel, evaluation: Evaluation) -> dict[str, Any]:
    """The ride height of a wheel, and its angles as measured where others were judged."""
    name = wheel.result.wheel
    height, raw = evaluation.corrections.height(name), wheel.raw
    found: dict[str, Any] = {}
    if height.outcome is not HeightOutcome.NOT_ASKED:
        found |= {
            "ride_height": height.outcome.value,
            "ride_height_mm": height.height_mm,
            "ride_height_u_mm": height.height_u_mm,
            "design_height_mm": height.design_mm,
        }
    if raw is not None and evaluation.corrections.changes(name):
        found |= {
            "camber_raw": float(raw.camber),
            "toe_raw": float(raw.toe),
            "camber_raw_u": raw.camber_u,
            "toe_raw_u": raw.toe_u,
        }
    return found


def _run_out(wheel: JudgedWheel) -> dict[str, Any]:
    """The run-out of a wheel that was turned, millimetres, with its limit and where its high spot was."""
    found = wheel.run_out
    if found is None:
        return {}
    return {
        "run_out": found.value_mm,
        "run_out_u": found.u_mm,
        "run_out_high": found.most_mm,
        "run_out_phase": found.high_spot,
        "run_out_phase_u": found.high_spot_u,
    }


def _toe_tyre_u(wheel: JudgedWheel, evaluation: Evaluation) -> float | None:
    """The tyre widths' part of the uncertainty of a toe against the vehicle's centreline."""
    geometry = None if evaluation.vehicle is None else evaluation.vehicle.geometry
    if evaluation.reference == "stand" or geometry is None or wheel.values is None:
        return None
    return tyre_u(geometry, f"{wheel.result.wheel}.toe")


def _warning(wheel: JudgedWheel, evaluation: Evaluation) -> str | None:
    """What is suspect of a wheel, and that its toe refers to the stand where the vehicle is not known."""
    found = wheel.result.measurement
    if found is None:
        return None
    said = [] if found.warning is None else [found.warning]
    name, corrections = wheel.result.wheel, evaluation.corrections
    if corrections.straight.state is StraightAheadState.NOT_CHECKED and name in STEERED:
        said.append(f"{corrections.straight.reason}; toe is as the wheels stood")
    if corrections.height(name).outcome is HeightOutcome.NOT_KNOWN:
        said.append(f"{corrections.height(name).reason}; camber and toe are as the wheel stood")
    known = evaluation.vehicle is not None and evaluation.vehicle.geometry is not None
    if evaluation.reference == "vehicle" and wheel.toe.value is None and not known:
        said.append("its toe is against the stand's axis and not judged: the vehicle's own is not known")
    return "; ".join(said) or None


class Standing(enum.Enum):
    """What became of the record, which decides what the line may be told."""

    COMMITTED = "committed"
    NOT_COMMITTED = "not committed"
    ABORTED = "aborted"


@dataclass(frozen=True)
class Answers:
    """What the line is told of a vehicle; `vehicle` is None when nothing of it as a whole was asked for."""

    wheels: tuple[WheelAnswer, ...]
    axles: tuple[AxleAnswer, ...]
    vehicle: VehicleAnswer | None


def answers_of(record: CycleRecord, standing: Standing) -> Answers:
    """Return what the line is told of a cycle, after its end or after a restart of the station.

    Of a vehicle whose record was not committed, or that was aborted, geometry and steering are not told
    either.
    """
    geometry, steering = geometry_answer(record), steering_answer(record)
    if standing is not Standing.COMMITTED:
        geometry, steering = geometry.withdrawn(), steering.withdrawn()
    wheels = {wheel.wheel: wheel for wheel in record.wheels}
    axles = {axle.axle: axle for axle in record.axles}
    asked = [
        axle
        for axle in dict.fromkeys(axle_of(wheel) for wheel in wheels)
        if all(f"{axle}_{side}" in wheels for side in SIDES)
    ]
    whole = {"front", "rear"} <= set(asked)
    return Answers(
        tuple(_wheel_answer(wheel, standing) for wheel in record.wheels),
        tuple(_axle_answer(axle, axles.get(axle), standing) for axle in asked),
        replace(_vehicle_answer(record.vehicle_angles, standing), geometry=geometry, steering=steering)
        if whole
        else _part_of_a_vehicle(geometry, steering),
    )


def _wheel_answer(wheel: WheelRecord, standing: Standing) -> WheelAnswer:
    told = _told(wheel.verdict, standing)
    if not told.judged:
        return WheelAnswer(wheel.wheel, told)
    k = wheel.coverage_factor
    return WheelAnswer(
        wheel.wheel,
        told,
        camber_deg=in_degrees(wheel.camber),
        toe_deg=in_degrees(wheel.toe),
        camber_u95_deg=_expanded_deg(wheel.camber_u, k),
        toe_u95_deg=_expanded_deg(wheel.toe_u, k),
        quality=Quality.DEGRADED if wheel.degraded else Quality.FULL,
        residual_mm=wheel.residual_rms_mm,
        kind=AxisKind.of_method(wheel.method),
        **_told_run_out(wheel),
    )


def _told_run_out(wheel: WheelRecord) -> dict[str, Any]:
    """The run-out of a wheel that was turned, as `WheelAnswer` has it."""
    if AxisKind.of_method(wheel.method) is not AxisKind.SPIN_AXIS:
        return {}
    state, k = told_state(wheel.run_out_verdict), wheel.coverage_factor
    if not state.measured or wheel.run_out_u is None or k is None:
        return {"run_out_state": QuantityState.NOT_MEASURED}
    spot = None if wheel.run_out_phase is None else math.degrees(wheel.run_out_phase) % 360.0
    return {
        "run_out_state": state,
        "run_out_mm": wheel.run_out,
        "run_out_u95_mm": k * wheel.run_out_u,
        "high_spot_deg": spot,
    }


def _axle_answer(name: str, axle: AxleRecord | None, standing: Standing) -> AxleAnswer:
    if axle is None:
        return AxleAnswer(name, _told(Verdict.NONE, standing))
    judged = axle.total_toe_low is not None or axle.camber_difference_low is not None
    told = _told(axle.verdict, standing, judged)
    if not told.judged:
        return AxleAnswer(name, told)
    return AxleAnswer(
        name,
        told,
        total_toe_deg=in_degrees(axle.total_toe),
        camber_difference_deg=in_degrees(axle.camber_difference),
        total_toe_u95_deg=_expanded_deg(axle.total_toe_u, axle.coverage_factor),
        camber_difference_u95_deg=_expanded_deg(axle.camber_difference_u, axle.coverage_factor),
    )


def _vehicle_answer(angles: VehicleAnglesRecord | None, standing: Standing) -> VehicleAnswer:
    if angles is None:
        return VehicleAnswer(_told(Verdict.NONE, standing))
    told = _told(angles.verdict, standing, judged=angles.thrust_angle_low is not None)
    if not told.judged:
        return VehicleAnswer(told)
    return VehicleAnswer(
        told,
        thrust_angle_deg=in_degrees(angles.thrust_angle),
        thrust_angle_u95_deg=_expanded_deg(angles.thrust_angle_u, angles.coverage_factor),
        thrust_sign=angles.thrust_sign,
    )


def _part_of_a_vehicle(geometry: GeometryAnswer, steering: SteeringAnswer) -> VehicleAnswer | None:
    """Wheels that are no whole vehicle still say what their toes refer to, and how they were corrected."""
    if (geometry, steering) == (NO_GEOMETRY, NO_STEERING):
        return None
    return VehicleAnswer(Outcome.NOT_REQUESTED, geometry=geometry, steering=steering)


def _told(verdict: Verdict, standing: Standing, judged: bool = True) -> Outcome:
    """Outcome of a part of the vehicle, as the line is told it.

    A value whose record was not committed is not a result. What has no limits (`judged` False) was not asked
    to be judged.
    """
    if standing is Standing.ABORTED:
        return Outcome.ABORTED
    if standing is Standing.NOT_COMMITTED:
        return Outcome.FAULT
    unjudged = Outcome.FAULT if judged else Outcome.NOT_REQUESTED
    return {Verdict.OK: Outcome.OK, Verdict.NOK: Outcome.NOK}.get(verdict, unjudged)


def _expanded_deg(standard: float | None, factor: float | None) -> float | None:
    return None if standard is None or factor is None else math.degrees(factor * standard)


def _low(angle: Angle) -> float | None:
    return None if angle.limits is None else angle.limits.low


def _high(angle: Angle) -> float | None:
    return None if angle.limits is None else angle.limits.high
