"""The record of a cycle: its outcome, why it is so, and everything that explains it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from alignment.errors import together
from db.records import CycleOutcome, CycleRecord, Severity, VehicleRecord
from station.cycle.answering import axle_records, last_measured, vehicle_record, wheel_records
from station.cycle.judging import (
    NO_AXES,
    STEERED,
    Evaluation,
    Status,
    cycle_outcome,
    evaluate,
    geometry_record,
    sweep_found,
)
from station.cycle.modes import as_left
from station.cycle.ports import Identity
from station.cycle.recording.steering_axis_record import axis_records, with_differences
from station.cycle.recording.steering_record import steering_record
from station.cycle.under_way import NO_TROUBLE, CycleUnderWay, Trouble
from station.cycle.wheels import CommonFrame, frame_for
from station.cycle.words import Abort, ErrorCode, Mode


def evaluated(cycle: CycleUnderWay, coverage_factor: float, frame: CommonFrame | None) -> Evaluation:
    """Judge what came of a cycle by the limits of its vehicle type.

    Masters are certified as they stand: neither straight ahead nor a design height is asked for.
    """
    assert cycle.kind is not None
    mode, kind = cycle.trigger.mode, cycle.kind
    if mode is Mode.MASTER_CHECK:
        kind = kind.model_copy(update={"steering": None, "ride_height": None})
    of_mode = frame_for(mode, frame, kind, cycle.trigger.wheels)
    if mode is Mode.SWEEP:
        results = {result.wheel: result for result in cycle.wheels}
        rigs = {
            position.name: position.steered_rig for position in cycle.positions if position.name in STEERED
        }
        cycle.axes = sweep_found(kind, results, cycle.swept, rigs, of_mode, coverage_factor)
    return evaluate(kind, cycle.wheels, coverage_factor, of_mode, cycle.said)


def cycle_record(
    identity: Identity, cycle: CycleUnderWay, evaluation: Evaluation
) -> tuple[CycleRecord, Trouble]:
    """Return the record, and what the line is told of the cycle beside its answers.

    Parameters
    ----------
    identity
        Of the program.
    cycle
        Measured; its vehicle type is known.
    evaluation
        Of its results.
    """
    assert cycle.kind is not None
    # A part of the station that failed says more than a wheel that was refused.
    failures = sorted(evaluation.failures, key=lambda failure: not failure.needs_reset)
    axes, k, guarded = cycle.axes or NO_AXES, evaluation.coverage_factor, evaluation.guard_band
    judged = [*evaluation.judged, *axes.judged]
    fault = bool(failures) or bool(axes.refusals)
    outcome = cycle_outcome(judged, fault=fault, aborted=cycle.interrupted)
    trouble = NO_TROUBLE
    code: str | None = None
    text: str | None = None
    if failures:
        code, text = failures[0].reason_code, together(failure.text for failure in failures)
        wheel = next(w.result.wheel for w in evaluation.wheels if w.result.failure is failures[0])
        trouble = Trouble(failures[0].error_code, wheel)
    elif axes.refusals:
        trouble = Trouble(ErrorCode.SWEEP_FAULT)
        code, text = str(trouble.code), together(axes.refusals)
    elif outcome is CycleOutcome.FAULT:
        trouble = Trouble(_why_unjudged(evaluation))
        code, text = str(trouble.code), _unjudged_in_words(evaluation)
    if outcome is CycleOutcome.ABORTED:
        code, text = "aborted", f"the line sent {cycle.interruption}"
        if isinstance(cycle.interruption, Abort) and cycle.interruption.reason is not ErrorCode.NONE:
            trouble = Trouble(cycle.interruption.reason, trouble.wheel)
            text = f"the cycle was ended: {trouble.code}"
    measured_utc = last_measured(evaluation)
    record = CycleRecord(
        uuid=cycle.uuid,
        station=identity.station,
        trigger_sequence=cycle.sequence,
        received_utc=cycle.received_utc,
        received_monotonic_s=cycle.trigger.received_s,
        measured_utc=measured_utc,
        measured_monotonic_s=None if measured_utc is None else cycle.measured_s,
        outcome=outcome,
        software_version=identity.software_version,
        config_hash=identity.config_hash,
        vehicle=VehicleRecord(cycle.trigger.vin, cycle.kind.name),
        reason_code=code,
        reason_text=text,
        wheels=wheel_records(evaluation),
        axles=axle_records(evaluation),
        vehicle_angles=vehicle_record(evaluation),
        geometry=geometry_record(evaluation),
        steering=with_differences(steering_record(evaluation), axes, guard_band=guarded, coverage_factor=k),
        steering_axes=axis_records(axes, guard_band=guarded, coverage_factor=k),
        adjustings=as_left(cycle.adjusted, evaluation),
    )
    return record, trouble


def _why_unjudged(evaluation: Evaluation) -> ErrorCode:
    """Why measured wheels have no verdict."""
    if evaluation.problem is None and evaluation.corrections.straight.refused:
        return ErrorCode.STEERING_FAULT
    if evaluation.problem is None and evaluation.corrections.refusals:
        return ErrorCode.MEASUREMENT_REFUSED
    return ErrorCode.CALIBRATION_FAULT


def _unjudged_in_words(evaluation: Evaluation) -> str:
    said = [] if evaluation.problem is None else [evaluation.problem]
    return (
        "; ".join([*said, *evaluation.corrections.refusals]) or "an angle has no valid calibration behind it"
    )


def run_out_notes(evaluation: Evaluation) -> Iterator[tuple[Severity, float, str]]:
    """What is recorded of the run-out of each wheel: how much it matters, millimetres, and words."""
    for wheel in evaluation.wheels:
        found = wheel.run_out
        if found is None:
            continue
        beyond = found.size.status is Status.NOK
        text = f"{wheel.result.wheel}: run-out {found.value_mm:.3f} mm ± {found.u95_mm:.3f} mm peak to peak"
        text += f" at {found.radius_mm:g} mm"
        if found.high_spot is not None and found.high_spot_u is not None:
            k = evaluation.coverage_factor
            text += (
                f", high spot at {math.degrees(found.high_spot):.0f}° ± "
                f"{math.degrees(k * found.high_spot_u):.1f}° of the top"
            )
        text += "; more than its limit" if beyond else ""
        yield Severity.WARNING if beyond else Severity.INFO, found.value_mm, text
