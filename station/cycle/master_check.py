"""A master wheel that the line had measured, as checks of the calibrations behind it."""

from __future__ import annotations

import math

from alignment.believable import LARGEST_SHIFT, certificate_slip
from alignment.units import in_arcminutes
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
    """Return a check for each wheel that was measured; the vehicle type's limits are the master's.

    None where those are wider than what is believed of a zero: an ordinary vehicle's limits check nothing.
    """
    return tuple(_check(record, wheel) for wheel in _measured(record) if not _is_wide(wheel))


def unfit_master(record: CycleRecord) -> str | None:
    """The sentence that says for which wheels the limits are no master's; None when all are."""
    wide = [wheel.wheel for wheel in _measured(record) if _is_wide(wheel)]
    if not wide:
        return None
    return (
        f"no check of the calibrations of {', '.join(wide)}: the limits of the vehicle type are wider than "
        f"±{in_arcminutes(LARGEST_SHIFT)}; send the number of a type that holds the certified "
        "angles of the master wheels"
    )


def _measured(record: CycleRecord) -> list[WheelRecord]:
    return [
        wheel
        for wheel in record.wheels
        if wheel.outcome is WheelOutcome.MEASURED and wheel.calibration_id is not None
    ]


def _is_wide(wheel: WheelRecord) -> bool:
    return any(
        low is not None and high is not None and high - low > 2.0 * LARGEST_SHIFT * (1.0 + 1e-9)
        for low, high in ((wheel.camber_low, wheel.camber_high), (wheel.toe_low, wheel.toe_high))
    )


def _check(record: CycleRecord, wheel: WheelRecord) -> CalibrationCheckRecord:
    assert wheel.calibration_id is not None
    within = wheel.verdict is Verdict.OK
    slip = None if within else _slip(wheel)
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
        f"'{master}' are {'within' if within else 'out of'} its limits, asked for by the line"
        + ("" if slip is None else f"; they would fit with {slip}: check the vehicle type's limits first"),
        as_found=figures | {"cycle": str(record.uuid)},
    )


def _slip(wheel: WheelRecord) -> str | None:
    """The slip of the pen in the certified angles, the middles of the limits, that would explain a wheel."""
    limits = (wheel.camber_low, wheel.camber_high, wheel.toe_low, wheel.toe_high)
    if wheel.camber is None or wheel.toe is None or None in limits:
        return None
    camber_low, camber_high, toe_low, toe_high = (float(x) for x in limits if x is not None)
    middles = (0.5 * (camber_low + camber_high), 0.5 * (toe_low + toe_high))
    halves = (0.5 * (camber_high - camber_low), 0.5 * (toe_high - toe_low))
    off = max(abs(wheel.camber - middles[0]), abs(wheel.toe - middles[1]))
    return certificate_slip((wheel.camber, wheel.toe), middles, halves) if off > LARGEST_SHIFT else None
