"""Where the line was told otherwise than a cycle says: the record that then has the vehicle's last word.

A record is never changed. What the line was told is stored behind it, as a cycle of its own: of the same
start and vehicle, with every wheel as it was told and the reason in words.
"""

from __future__ import annotations

from dataclasses import replace
from uuid import uuid4

from db.records import CycleOutcome, CycleRecord, Verdict, WheelOutcome, WheelRecord
from station.cycle.answering.answers import Standing
from station.cycle.words import ErrorCode

_TOLD = {
    Standing.NOT_COMMITTED: (CycleOutcome.FAULT, str(ErrorCode.STORE_FAULT)),
    Standing.ABORTED: (CycleOutcome.ABORTED, "aborted"),
}


def contradicts(record: CycleRecord, standing: Standing) -> bool:
    """Whether a record says of any part of the vehicle otherwise than the line was told."""
    if standing is Standing.COMMITTED:
        return False
    if standing is Standing.ABORTED:
        return record.outcome is not CycleOutcome.ABORTED
    return record.outcome is not CycleOutcome.FAULT or bool(set(record.verdicts) - {Verdict.NONE})


def as_told(record: CycleRecord, standing: Standing, why: str) -> CycleRecord:
    """Return the record of what the line was told; it rests on no calibration: nothing was measured in it.

    Parameters
    ----------
    record
        The cycle that says otherwise, stored or not.
    standing
        NOT_COMMITTED or ABORTED.
    why
        How it came to that, a sentence.
    """
    outcome, code = _TOLD[standing]
    text = f"the line was told '{outcome}' of this vehicle, whatever cycle {record.uuid} says: {why}"
    wheels = tuple(
        WheelRecord(wheel.wheel, WheelOutcome.FAULT, reason_code=code, reason_text=text)
        for wheel in record.wheels
    )
    return replace(
        record,
        uuid=uuid4(),
        outcome=outcome,
        measured_utc=None,
        measured_monotonic_s=None,
        reason_code=code,
        reason_text=text,
        wheels=wheels,
        axles=(),
        vehicle_angles=None,
        geometry=None,
        steering=None,
        steering_axes=(),
        adjustings=(),
    )
