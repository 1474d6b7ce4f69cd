"""Stored cycles as rows: one for each angle, with everything that explains it; angles in degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from db.records import StoredCycle, WheelOutcome

VEHICLE = "vehicle"


@dataclass(frozen=True)
class AngleRow:
    """One angle of one cycle.

    Attributes
    ----------
    cycle, station, received_utc, stored_utc
        The cycle: UUID as text, station, time of the trigger, time of the commit.
    vin, vehicle_type
        Empty where the cycle ended before its vehicle was known.
    cycle_outcome
        ``ok``, ``nok``, ``fault`` or ``aborted``.
    part, quantity
        ``front_left`` and ``toe``, ``rear`` and ``total_toe``, ``vehicle`` and ``thrust_angle``.
    outcome
        ``measured``, ``refused`` or ``fault``.
    value_deg, u_deg
        Value and standard uncertainty; None where nothing was measured.
    low_deg, high_deg, guard_band, coverage_factor
        Limits, and how the verdict used them.
    verdict
        ``ok``, ``nok`` or ``none``, of the part the angle belongs to.
    """

    cycle: str
    station: str
    received_utc: datetime
    stored_utc: datetime
    vin: str
    vehicle_type: str
    cycle_outcome: str
    part: str
    quantity: str
    outcome: str
    value_deg: float | None
    u_deg: float | None
    low_deg: float | None
    high_deg: float | None
    guard_band: bool | None
    coverage_factor: float | None
    verdict: str
    reason_code: str | None
    reason_text: str | None
    measured_utc: datetime | None
    method: str | None
    calibration_id: str | None
    zero_measurement_id: str | None
    points_used: int | None
    residual_rms_mm: float | None
    thrust_sign: str | None
    trigger_sequence: int
    software_version: str
    config_hash: str

    @property
    def characteristic(self) -> str:
        """``front_left.toe``."""
        return f"{self.part}.{self.quantity}"

    @property
    def judged_cycle(self) -> bool:
        """Whether the station finished the cycle: neither a fault nor an abort."""
        return self.cycle_outcome in ("ok", "nok")


def angle_rows(stored: StoredCycle) -> Iterator[AngleRow]:
    """Rows of a cycle: wheels by name, then axles, then the vehicle."""
    record = stored.record
    common: dict[str, Any] = {
        "cycle": str(record.uuid),
        "station": record.station,
        "received_utc": record.received_utc,
        "stored_utc": stored.stored_utc,
        "vin": "" if record.vehicle is None else record.vehicle.vin,
        "vehicle_type": "" if record.vehicle is None else record.vehicle.vehicle_type,
        "cycle_outcome": str(record.outcome),
        "trigger_sequence": record.trigger_sequence,
        "software_version": record.software_version,
        "config_hash": record.config_hash,
    }
    nothing: dict[str, Any] = dict.fromkeys(
        (
            "reason_code", "reason_text", "measured_utc", "method", "calibration_id", "zero_measurement_id",
            "points_used", "residual_rms_mm", "thrust_sign",
        )
    )  # fmt: skip
    for wheel in record.wheels:
        own = {
            "part": wheel.wheel,
            "outcome": str(wheel.outcome),
            "reason_code": wheel.reason_code,
            "reason_text": wheel.reason_text,
            "measured_utc": wheel.measured_utc,
            "method": wheel.method,
            "calibration_id": wheel.calibration_id,
            "zero_measurement_id": wheel.zero_measurement_id,
            "points_used": wheel.points_used,
            "residual_rms_mm": wheel.residual_rms_mm,
        }
        for quantity in ("camber", "toe"):
            yield AngleRow(**(common | nothing | own | _angle(wheel, quantity)))
    for axle in record.axles:
        own = {"part": axle.axle, "outcome": str(WheelOutcome.MEASURED)}
        for quantity in ("total_toe", "camber_difference"):
            yield AngleRow(**(common | nothing | own | _angle(axle, quantity)))
    vehicle = record.vehicle_angles
    if vehicle is not None:
        own = {"part": VEHICLE, "outcome": str(WheelOutcome.MEASURED), "thrust_sign": vehicle.thrust_sign}
        for quantity in ("thrust_angle", "front_toe_left_to_thrust", "front_toe_right_to_thrust"):
            yield AngleRow(**(common | nothing | own | _angle(vehicle, quantity)))


def _angle(record: Any, quantity: str) -> dict[str, Any]:
    # Fields of the records are named after the angle.
    return {
        "quantity": quantity,
        "value_deg": _degrees(getattr(record, quantity)),
        "u_deg": _degrees(getattr(record, f"{quantity}_u", None)),
        "low_deg": _degrees(getattr(record, f"{quantity}_low", None)),
        "high_deg": _degrees(getattr(record, f"{quantity}_high", None)),
        "guard_band": record.guard_band,
        "coverage_factor": record.coverage_factor,
        "verdict": str(record.verdict),
    }


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else math.degrees(angle)
