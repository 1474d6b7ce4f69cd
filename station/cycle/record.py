"""The record of a cycle: its outcome, why it is so, and everything that explains it."""

from __future__ import annotations

from datetime import datetime
from uuid import uuid4

from db.records import CycleOutcome, CycleRecord, VehicleRecord
from station.configuration.vehicle_types import VehicleType
from station.cycle.answers import axle_records, last_measured, vehicle_record, wheel_records
from station.cycle.judging import Evaluation
from station.cycle.ports import Identity
from station.cycle.verdict import cycle_outcome
from station.cycle.words import Abort, Command, ErrorCode, Trigger


def cycle_record(
    identity: Identity,
    trigger: Trigger,
    kind: VehicleType,
    evaluation: Evaluation,
    interruption: Command | None,
    *,
    received_utc: datetime,
    measured_s: float,
) -> tuple[CycleRecord, ErrorCode, str | None]:
    """Return the record, the error code that the line is told of the cycle, and the wheel it is about.

    Parameters
    ----------
    identity
        Of the program.
    trigger, kind, evaluation
        What was asked and what was found.
    interruption
        The abort or reset that ended the cycle, if one did.
    received_utc
        When the start command came.
    measured_s
        When the last wheel was done, monotonic seconds.
    """
    # A part of the station that failed says more than a wheel that was refused.
    failures = sorted(evaluation.failures, key=lambda failure: not failure.needs_reset)
    outcome = cycle_outcome(evaluation.angles, fault=bool(failures), aborted=interruption is not None)
    error, wheel = ErrorCode.NONE, None
    code: str | None = None
    text: str | None = None
    if failures:
        error, code = failures[0].error_code, failures[0].reason_code
        text = "; ".join(failure.text for failure in failures)
        wheel = next(w.result.wheel for w in evaluation.wheels if w.result.failure is failures[0])
    elif outcome is CycleOutcome.FAULT:
        error = ErrorCode.CALIBRATION_FAULT
        code, text = str(error), "an angle has no valid calibration behind it"
    if outcome is CycleOutcome.ABORTED:
        code, text = "aborted", f"the line sent {interruption}"
        if isinstance(interruption, Abort) and interruption.reason is not ErrorCode.NONE:
            error = interruption.reason
            text = f"the cycle was ended: {error}"
    measured_utc = last_measured(evaluation)
    record = CycleRecord(
        uuid=uuid4(),
        station=identity.station,
        trigger_sequence=trigger.sequence,
        received_utc=received_utc,
        received_monotonic_s=trigger.received_s,
        measured_utc=measured_utc,
        measured_monotonic_s=None if measured_utc is None else measured_s,
        outcome=outcome,
        software_version=identity.software_version,
        config_hash=identity.config_hash,
        vehicle=VehicleRecord(trigger.vin, kind.name),
        reason_code=code,
        reason_text=text,
        wheels=wheel_records(evaluation),
        axles=axle_records(evaluation),
        vehicle_angles=vehicle_record(evaluation),
    )
    return record, error, wheel
