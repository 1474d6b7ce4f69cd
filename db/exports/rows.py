"""Stored cycles as rows: one for each angle, with everything that explains it; angles in degrees."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from alignment.units import in_degrees
from db.records import AngleVerdict, CycleRecord, LimitSide, StoredCycle, WheelOutcome, judge_angle

VEHICLE = "vehicle"
USUAL_K = 2.0
"""Coverage factor of an expanded uncertainty where a record names none."""
_REASONS: Mapping[AngleVerdict, tuple[str, str]] = {
    AngleVerdict.WITHOUT_LIMITS: ("no_limits", "the vehicle type has no limits for this angle"),
    AngleVerdict.NOT_JUDGED: (
        "not_judged", "the station gave no verdict: no valid calibration or uncertainty stood behind it",
    ),
}  # fmt: skip


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
        Of this angle alone: ``ok``, ``nok``, ``without limits``, ``not measured``, ``not judged``.
    part_verdict
        ``ok``, ``nok`` or ``none``, of the wheel, axle or vehicle the angle belongs to.
    reason_code, reason_text
        Why the angle is not ok, for programs and for people: ``toe_high``, ``no_limits``, ``not_judged``, or
        the reason why its wheel was not measured. None where it is.
    degraded
        Whether a head of its wheel was lost and the others measured alone; None where that is not known.
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
    part_verdict: str
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
    degraded: bool | None

    @property
    def characteristic(self) -> str:
        """``front_left.toe``."""
        return f"{self.part}.{self.quantity}"

    @property
    def u95_deg(self) -> float | None:
        """Expanded uncertainty: the standard one times k, 2 where none is recorded."""
        return None if self.u_deg is None else (self.coverage_factor or USUAL_K) * self.u_deg

    @property
    def name(self) -> str:
        """``front left toe``."""
        return f"{self.part} {self.quantity}".replace("_", " ")

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
            "measured_utc", "method", "calibration_id", "zero_measurement_id", "points_used",
            "residual_rms_mm", "thrust_sign", "degraded",
        )
    )  # fmt: skip
    for wheel in record.wheels:
        own = {
            "part": wheel.wheel,
            "outcome": str(wheel.outcome),
            "measured_utc": wheel.measured_utc,
            "method": wheel.method,
            "calibration_id": wheel.calibration_id,
            "zero_measurement_id": wheel.zero_measurement_id,
            "points_used": wheel.points_used,
            "residual_rms_mm": wheel.residual_rms_mm,
            "degraded": wheel.degraded,
        }
        for quantity in ("camber", "toe"):
            yield AngleRow(**(common | nothing | own | _angle(record, wheel, quantity)))
    for axle in record.axles:
        own = {"part": axle.axle, "outcome": str(WheelOutcome.MEASURED)}
        for quantity in ("total_toe", "camber_difference"):
            yield AngleRow(**(common | nothing | own | _angle(record, axle, quantity)))
    vehicle = record.vehicle_angles
    if vehicle is not None:
        own = {"part": VEHICLE, "outcome": str(WheelOutcome.MEASURED), "thrust_sign": vehicle.thrust_sign}
        for quantity in ("thrust_angle", "front_toe_left_to_thrust", "front_toe_right_to_thrust"):
            yield AngleRow(**(common | nothing | own | _angle(record, vehicle, quantity)))


def _angle(cycle: CycleRecord, part: Any, quantity: str) -> dict[str, Any]:
    # Fields of the records are named after the angle.
    value, u = getattr(part, quantity), getattr(part, f"{quantity}_u", None)
    low, high = getattr(part, f"{quantity}_low", None), getattr(part, f"{quantity}_high", None)
    verdict, missed = judge_angle(
        value,
        u,
        low,
        high,
        guard_band=part.guard_band,
        coverage_factor=part.coverage_factor,
        part=part.verdict,
    )
    found = {
        "quantity": quantity,
        "value_deg": in_degrees(value),
        "u_deg": in_degrees(u),
        "low_deg": in_degrees(low),
        "high_deg": in_degrees(high),
        "guard_band": part.guard_band,
        "coverage_factor": part.coverage_factor,
        "verdict": str(verdict),
        "part_verdict": str(part.verdict),
    }
    if verdict is AngleVerdict.NOT_MEASURED:
        code, text = part.reason_code or cycle.reason_code, part.reason_text or cycle.reason_text
    elif missed is not None:
        code, text = f"{quantity}_{missed}", _why_missed(found, missed)
    else:
        code, text = _REASONS.get(verdict, (None, None))
    return found | {"reason_code": code, "reason_text": text}


def _why_missed(angle: Mapping[str, Any], missed: LimitSide) -> str:
    """Which limit, by how much, and whether only the guard band stood between."""
    value, limit = angle["value_deg"], angle[f"{missed}_deg"]
    beyond = limit - value if missed is LimitSide.LOW else value - limit
    if beyond > 0.0:
        return (
            f"{'below' if missed is LimitSide.LOW else 'above'} the limit {limit:.4f}° by {_shown(beyond)}°"
        )
    expanded = angle["coverage_factor"] * angle["u_deg"]
    return (
        f"only {_shown(-beyond)}° inside the limit {limit:.4f}°, less than the expanded uncertainty "
        f"{_shown(expanded)}°"
    )


def _shown(degrees: float) -> str:
    """Four decimals, or two digits of what is smaller."""
    return f"{degrees:.4f}" if degrees >= 1e-4 or degrees == 0.0 else f"{degrees:.1e}"
