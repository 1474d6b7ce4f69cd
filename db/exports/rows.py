"""Stored cycles as rows: one for each angle and length, with what explains it; degrees and millimetres."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from db.records import (
    OF_AXLE,
    OF_GEOMETRY,
    OF_STEERING,
    OF_STEERING_AXIS,
    OF_VEHICLE,
    QUANTITIES,
    VEHICLE,
    AngleVerdict,
    CycleRecord,
    LimitSide,
    Quantity,
    StoredCycle,
    StoredDoubt,
    Unit,
    WheelOutcome,
    WheelRecord,
    judge_angle,
)

STEERED_WHEELS = ("front_left", "front_right")
USUAL_K = 2.0
"""Coverage factor of an expanded uncertainty where a record names none."""
_REASONS: Mapping[AngleVerdict, tuple[str, str]] = {
    AngleVerdict.WITHOUT_LIMITS: ("no_limits", "the vehicle type has no limits for this {kind}"),
    AngleVerdict.NOT_JUDGED: (
        "not_judged", "the station gave no verdict: no valid calibration or uncertainty stood behind it",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class AngleRow:
    """One angle or length of one cycle.

    Attributes
    ----------
    cycle, station, received_utc, stored_utc
        The cycle: UUID as text, station, time of the trigger, time of the commit.
    vin, vehicle_type
        Empty where the cycle ended before its vehicle was known.
    cycle_outcome
        ``ok``, ``nok``, ``fault`` or ``aborted``.
    part, quantity
        ``front_left`` and ``toe``, ``rear`` and ``total_toe``, ``vehicle`` and ``track_front``.
    outcome
        ``measured``, ``refused`` or ``fault``.
    value_deg, u_deg
        Value and standard uncertainty of an angle; None where nothing was measured, and of a length.
    low_deg, high_deg, guard_band, coverage_factor
        Limits, and how the verdict used them.
    verdict
        Of this value alone: ``ok``, ``nok``, ``without limits``, ``not measured``, ``not judged``.
    part_verdict
        ``ok``, ``nok`` or ``none``, of the wheel, axle or vehicle the value belongs to.
    reason_code, reason_text
        Why the value is not ok, for programs and for people: ``toe_high``, ``no_limits``, ``not_judged``, or
        the reason why its wheel was not measured. None where it is.
    degraded
        Whether a head of its wheel was lost and the others measured alone; None where that is not known.
    unit
        ``deg`` or ``mm``: which of the columns hold the value.
    value_mm, u_mm, low_mm, high_mm
        The same of a length; None of an angle.
    kind, load_mm
        Of its wheel: ``tyre_plane`` or ``spin_axis``, and the load's lift of the sidewall that was taken off.
    run_out_phase_deg
        Of run-out: where the tyre stood out farthest.
    tyre_u_deg
        Of toe and thrust angle: the part of `u_deg` that comes from the spread of tyre widths.
    reference
        What toe and thrust angle refer to: ``vehicle`` or ``stand``; None where the record does not tell.
    end_points
        Of a length: between what it was measured.
    raw_deg, raw_u_deg
        Of camber and toe that were corrected: as measured, and the standard uncertainty of that. What was
        added is `value_deg` less `raw_deg`.
    ride_height, ride_height_mm, design_height_mm
        Of its wheel: ``corrected``, ``not_known``, ``missing`` or ``refused``, the height it stood at, and
        that at which it is judged.
    straight_ahead
        Of front toe and the steering wheel: ``checked``, ``not_checked`` or ``refused``.
    concession_person, concession_reason, concession_utc
        Of its cycle, where that is not ok and was released: by whom, why, and when; the verdict stays.
    doubt
        Whether a failed master check spoke against what it rests on, and who or what has answered for it:
        ``in doubt``, ``confirmed by a later check``, ``released by`` a person. None where none did. The
        verdict is as it was.
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
    unit: str = Unit.DEGREES.value
    value_mm: float | None = None
    u_mm: float | None = None
    low_mm: float | None = None
    high_mm: float | None = None
    kind: str | None = None
    load_mm: float | None = None
    run_out_phase_deg: float | None = None
    tyre_u_deg: float | None = None
    reference: str | None = None
    end_points: str | None = None
    raw_deg: float | None = None
    raw_u_deg: float | None = None
    ride_height: str | None = None
    ride_height_mm: float | None = None
    design_height_mm: float | None = None
    straight_ahead: str | None = None
    concession_person: str | None = None
    concession_reason: str | None = None
    concession_utc: datetime | None = None
    doubt: str | None = None

    @property
    def value(self) -> float | None:
        """Value in its own unit."""
        return self.value_mm if self.unit == Unit.MILLIMETRES else self.value_deg

    @property
    def u(self) -> float | None:
        """Standard uncertainty in its own unit."""
        return self.u_mm if self.unit == Unit.MILLIMETRES else self.u_deg

    @property
    def low(self) -> float | None:
        """Lowest accepted value in its own unit."""
        return self.low_mm if self.unit == Unit.MILLIMETRES else self.low_deg

    @property
    def high(self) -> float | None:
        """Highest accepted value in its own unit."""
        return self.high_mm if self.unit == Unit.MILLIMETRES else self.high_deg

    @property
    def u95(self) -> float | None:
        """Expanded uncertainty in its own unit: the standard one times k, 2 where none is recorded."""
        return None if self.u is None else (self.coverage_factor or USUAL_K) * self.u

    @property
    def characteristic(self) -> str:
        """``front_left.toe``."""
        return f"{self.part}.{self.quantity}"

    @property
    def u95_deg(self) -> float | None:
        """Expanded uncertainty of an angle."""
        return self.u95 if self.unit == Unit.DEGREES else None

    @property
    def u95_mm(self) -> float | None:
        """Expanded uncertainty of a length."""
        return self.u95 if self.unit == Unit.MILLIMETRES else None

    @property
    def name(self) -> str:
        """``front left toe``."""
        label = QUANTITIES[Quantity(self.quantity)].label
        return f"{self.part.replace('_', ' ')} {label[0].lower()}{label[1:]}"

    @property
    def judged_cycle(self) -> bool:
        """Whether the station finished the cycle: neither a fault nor an abort."""
        return self.cycle_outcome in ("ok", "nok")


def angle_rows(stored: StoredCycle) -> Iterator[AngleRow]:
    """Rows of a cycle: wheels by name, then axles, then the vehicle and its geometry."""
    for row in _rows(stored):
        yield replace(row, doubt=_doubt(stored, row.part)) if stored.doubts else row


def _doubt(stored: StoredCycle, part: str) -> str | None:
    """Doubt about a part: about its wheel, or about any wheel of the axle or vehicle; what is open first."""
    found = stored.doubts
    wheels = [each for each in found if part == VEHICLE or f"{each.record.wheel}_".startswith(f"{part}_")]
    return min(wheels, key=_openness).word if wheels else None


def _openness(doubt: StoredDoubt) -> int:
    if doubt.closing is None:
        return 0
    return 1 if doubt.closing.person is not None else 2


def _rows(stored: StoredCycle) -> Iterator[AngleRow]:
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
    if stored.concession is not None:
        released = ("person", "reason", "utc")
        common |= {f"concession_{name}": getattr(stored.concession, name) for name in released}
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
            "kind": None if wheel.kind is None else str(wheel.kind),
            "load_mm": wheel.load_mm,
            "ride_height": wheel.ride_height,
            "ride_height_mm": wheel.ride_height_mm,
            "design_height_mm": wheel.design_height_mm,
        }
        for quantity in _asked_of(wheel):
            yield AngleRow(**(common | nothing | own | _angle(record, wheel, quantity)))
    for axle in record.axles:
        own = {"part": axle.axle, "outcome": str(WheelOutcome.MEASURED)}
        for quantity in OF_AXLE:
            yield AngleRow(**(common | nothing | own | _angle(record, axle, quantity)))
    vehicle = record.vehicle_angles
    if vehicle is not None:
        own = {"part": VEHICLE, "outcome": str(WheelOutcome.MEASURED), "thrust_sign": vehicle.thrust_sign}
        for quantity in OF_VEHICLE:
            yield AngleRow(**(common | nothing | own | _angle(record, vehicle, quantity)))
    geometry = record.geometry
    if geometry is not None:
        measured = geometry.end_points is not None
        own = {"part": VEHICLE, "outcome": str(WheelOutcome.MEASURED if measured else WheelOutcome.FAULT)}
        for quantity in _asked_of_part(geometry, OF_GEOMETRY):
            yield AngleRow(**(common | nothing | own | _angle(record, geometry, quantity)))
    for fields, part, quantity in _of_steering(record):
        yield AngleRow(**(common | nothing | fields | _angle(record, part, quantity)))


def _of_steering(record: CycleRecord) -> Iterator[tuple[dict[str, Any], Any, Quantity]]:
    """Values of the steering wheel, then of the axes of a sweep: fields, record, quantity."""
    steering = record.steering
    if steering is not None:
        own = {"part": VEHICLE, "straight_ahead": steering.straight_ahead}
        for quantity in _asked_of_part(steering, OF_STEERING):
            measured = getattr(steering, quantity) is not None
            outcome = WheelOutcome.MEASURED if measured else WheelOutcome.FAULT
            yield own | {"outcome": str(outcome)}, steering, quantity
    for axis in record.steering_axes:
        outcome = WheelOutcome.MEASURED if axis.measured else WheelOutcome.REFUSED
        fields = {"part": axis.wheel, "outcome": str(outcome), "method": axis.method}
        for quantity in _asked_of_part(axis, OF_STEERING_AXIS):
            yield fields, axis, quantity


def _asked_of(wheel: WheelRecord) -> Iterator[Quantity]:
    """Camber and toe; run-out where it was measured or has a limit."""
    yield from (Quantity.CAMBER, Quantity.TOE)
    if wheel.run_out is not None or wheel.run_out_high is not None:
        yield Quantity.RUN_OUT


def _asked_of_part(part: Any, quantities: Sequence[Quantity]) -> Iterator[Quantity]:
    """All of a part that was measured; else what has limits."""
    for quantity in quantities:
        names = (quantity, f"{quantity}_low", f"{quantity}_high")
        if any(getattr(part, name, None) is not None for name in names):
            yield quantity


def _angle(cycle: CycleRecord, part: Any, quantity: Quantity) -> dict[str, Any]:
    # Fields of the records are named after the quantity.
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
    unit = QUANTITIES[quantity].unit
    numbers = {"value": value, "u": u, "low": low, "high": high}
    found: dict[str, Any] = {
        **{f"{name}_{each}": None for name in numbers for each in Unit},
        **{f"{name}_{unit}": _in(unit, number) for name, number in numbers.items()},
        "unit": str(unit),
        **_beside(cycle, part, quantity),
        "quantity": str(quantity),
        "guard_band": part.guard_band,
        "coverage_factor": part.coverage_factor,
        "verdict": str(verdict),
        "part_verdict": str(part.verdict),
    }
    own = getattr(part, "reason_code", None), getattr(part, "reason_text", None)
    if verdict is AngleVerdict.NOT_MEASURED:
        code, text = own[0] or cycle.reason_code, own[1] or cycle.reason_text
    elif verdict is AngleVerdict.NOT_JUDGED and own[0] is not None:
        code, text = own
    elif missed is not None:
        code, text = f"{quantity}_{missed}", _why_missed(found, missed, unit)
    else:
        code, text = _REASONS.get(verdict, (None, None))
        if text is not None:
            text = text.format(kind="angle" if unit is Unit.DEGREES else "length")
    return found | {"reason_code": code, "reason_text": text}


def _in(unit: Unit, value: float | None) -> float | None:
    return None if value is None else unit.factor * value


def _beside(cycle: CycleRecord, part: Any, quantity: Quantity) -> dict[str, Any]:
    """What explains a value of this quantity alone."""
    geometry, told = cycle.geometry, QUANTITIES[quantity]
    found: dict[str, Any] = {}
    if quantity in (Quantity.TOE, *OF_VEHICLE):
        found["reference"] = None if geometry is None else geometry.reference
    if quantity in (Quantity.CAMBER, Quantity.TOE):
        found["raw_deg"] = _in(Unit.DEGREES, getattr(part, f"{quantity}_raw"))
        found["raw_u_deg"] = _in(Unit.DEGREES, getattr(part, f"{quantity}_raw_u"))
    if quantity is Quantity.TOE and cycle.steering is not None and part.wheel in STEERED_WHEELS:
        found["straight_ahead"] = cycle.steering.straight_ahead
    if quantity is Quantity.TOE:
        found["tyre_u_deg"] = _in(Unit.DEGREES, part.toe_tyre_u)
    elif quantity is Quantity.THRUST_ANGLE and geometry is not None and geometry.reference == "vehicle":
        found["tyre_u_deg"] = _in(Unit.DEGREES, geometry.thrust_angle_tyre_u)
    elif quantity is Quantity.RUN_OUT:
        found["run_out_phase_deg"] = _in(Unit.DEGREES, part.run_out_phase)
    elif told.level == "geometry" and told.unit is Unit.MILLIMETRES:
        found["end_points"] = part.end_points
    return found


def _why_missed(found: Mapping[str, Any], missed: LimitSide, unit: Unit) -> str:
    """Which limit, by how much, and whether only the guard band stood between."""
    value, limit = found[f"value_{unit}"], found[f"{missed}_{unit}"]
    shown = f"{limit:.{unit.decimals}f}{unit.sign}"
    beyond = limit - value if missed is LimitSide.LOW else value - limit
    if beyond > 0.0:
        side = "below" if missed is LimitSide.LOW else "above"
        return f"{side} the limit {shown} by {_shown(beyond, unit)}"
    expanded = found["coverage_factor"] * found[f"u_{unit}"]
    return (
        f"only {_shown(-beyond, unit)} inside the limit {shown}, less than the expanded uncertainty "
        f"{_shown(expanded, unit)}"
    )


def _shown(value: float, unit: Unit) -> str:
    """The decimals of its unit, or two digits of what is smaller."""
    plain = value >= 10.0**-unit.decimals or value == 0.0
    return f"{value:.{unit.decimals}f}{unit.sign}" if plain else f"{value:.1e}{unit.sign}"
