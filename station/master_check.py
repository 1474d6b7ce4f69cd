"""A master wheel that the line had measured, as checks of the calibrations behind it."""

from __future__ import annotations

import math

from db.records import (
    CalibrationCheckRecord,
    CheckKind,
    CheckOutcome,
    CycleRecord,
    Verdict,
    WheelOutcome,
    WheelRecord,
)


def master_checks(record: CycleRecord) -> tuple[CalibrationCheckRecord, ...]:
    """Return a check for each wheel that was measured; the vehicle type's limits are the master's."""
    return tuple(
        _check(record, wheel)
        for wheel in record.wheels
        if wheel.outcome is WheelOutcome.MEASURED and wheel.calibration_id is not None
    )


def _check(record: CycleRecord, wheel: WheelRecord) -> CalibrationCheckRecord:
    assert wheel.calibration_id is not None
    within = wheel.verdict is Verdict.OK
    master = record.vehicle.vehicle_type if record.vehicle else "unknown"
    figures = {
        name: None if value is None else math.degrees(value)
        for name, value in (
            ("camber_deg", wheel.camber),
            ("camber_low_deg", wheel.camber_low),
            ("camber_high_deg", wheel.camber_high),
            ("toe_deg", wheel.toe),
            ("toe_low_deg", wheel.toe_low),
            ("toe_high_deg", wheel.toe_high),
        )
    }
    return CalibrationCheckRecord(
        utc=wheel.measured_utc or record.received_utc,
        calibration_id=wheel.calibration_id,
        kind=CheckKind.MASTER_WHEEL,
        outcome=CheckOutcome.WITHIN if within else CheckOutcome.OUT,
        reason=f"{wheel.wheel}: camber {figures['camber_deg']:.4f}°, toe {figures['toe_deg']:.4f}° of master "
        f"'{master}' are {'within' if within else 'out of'} its limits, asked for by the line",
        as_found=figures | {"cycle": str(record.uuid)},
    )
