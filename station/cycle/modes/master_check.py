"""Master wheels, or a master vehicle, that the line had measured, as checks of the calibrations behind them.

A master vehicle or frame has certified lengths besides: they tell whether the rigs stand in their common
frame as the gauge frame found them, which no master wheel does. One that is out speaks against all rigs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from alignment.believable import LARGEST_LENGTH_SHIFT_MM, LARGEST_SHIFT, certificate_slip
from alignment.units import in_arcminutes
from db.records import (
    GEOMETRY_LIMITED,
    AngleVerdict,
    CalibrationCheckRecord,
    CheckKind,
    CheckOutcome,
    CycleRecord,
    Quantity,
    Verdict,
    WheelOutcome,
    WheelRecord,
    judge_angle,
)

_OF_A_STANDING = (Quantity.YAW, Quantity.OFFSET_FRONT, Quantity.OFFSET_REAR)
"""How a vehicle stands is no property of it."""


@dataclass(frozen=True)
class _Length:
    """A certified length as it was found, millimetres."""

    name: Quantity
    value: float
    low: float
    high: float
    verdict: AngleVerdict

    @property
    def is_wide(self) -> bool:
        return self.high - self.low > 2.0 * LARGEST_LENGTH_SHIFT_MM * (1.0 + 1e-9)

    def __str__(self) -> str:
        return f"{self.name.replace('_', ' ')} {self.value:.3f} mm"


def master_checks(record: CycleRecord) -> tuple[CalibrationCheckRecord, ...]:
    """Return a check for each wheel that was measured; the vehicle type's limits are the master's.

    None where those are wider than what is believed of a zero: an ordinary vehicle's limits check nothing.
    The lengths of a master vehicle count for each of its wheels, by the same rule.
    """
    lengths = [length for length in _lengths(record) if not length.is_wide]
    return tuple(_check(record, wheel, lengths) for wheel in _measured(record) if not _is_wide(wheel))


def unfit_master(record: CycleRecord) -> str | None:
    """The sentence that says for which wheels the limits are no master's; None when all are."""
    wide = [wheel.wheel for wheel in _measured(record) if _is_wide(wheel)]
    if not wide:
        lengths = [length.name.replace("_", " ") for length in _lengths(record) if length.is_wide]
        return (
            f"no check of {', '.join(lengths)}: the limits of the vehicle type are wider than "
            f"±{LARGEST_LENGTH_SHIFT_MM:g} mm; send the number of a type that holds the certified lengths of "
            "the master vehicle"
            if lengths
            else None
        )
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


def _lengths(record: CycleRecord) -> list[_Length]:
    """The lengths that were measured and have limits."""
    found, geometry = [], record.geometry
    for name in GEOMETRY_LIMITED if geometry is not None and geometry.end_points is not None else ():
        value, u, low, high = (getattr(geometry, f"{name}{end}") for end in ("", "_u", "_low", "_high"))
        if low is None or high is None or name in _OF_A_STANDING:
            continue
        assert geometry is not None
        verdict, _ = judge_angle(
            value, u, low, high, guard_band=geometry.guard_band, coverage_factor=geometry.coverage_factor,
            part=geometry.verdict,
        )  # fmt: skip
        found.append(_Length(name, value, low, high, verdict))
    return found


def _check(record: CycleRecord, wheel: WheelRecord, lengths: list[_Length]) -> CalibrationCheckRecord:
    assert wheel.calibration_id is not None
    good = wheel.verdict is Verdict.OK
    missed = [length for length in lengths if length.verdict is not AngleVerdict.OK]
    within = good and not missed
    slip = None if good else _slip(wheel)
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
    for length in lengths:
        figures |= {
            f"{length.name}_mm": length.value,
            f"{length.name}_low_mm": length.low,
            f"{length.name}_high_mm": length.high,
        }
    return CalibrationCheckRecord(
        utc=wheel.measured_utc or record.received_utc,
        calibration_id=wheel.calibration_id,
        kind=CheckKind.MASTER_WHEEL,
        outcome=CheckOutcome.WITHIN if within else CheckOutcome.OUT,
        reason=f"{wheel.wheel}: camber {figures['camber_deg']:.4f}°, toe {figures['toe_deg']:.4f}° of master "
        f"'{master}' are {'within' if good else 'out of'} its limits, asked for by the line"
        + _of_lengths(lengths, missed)
        + ("" if slip is None else f"; they would fit with {slip}: check the vehicle type's limits first"),
        as_found=figures | {"cycle": str(record.uuid)},
    )


def _of_lengths(lengths: list[_Length], missed: list[_Length]) -> str:
    if not lengths:
        return ""
    if not missed:
        return f"; so are the {len(lengths)} certified lengths of the vehicle"
    said = ", ".join(f"{each}, certified {each.low:g} to {each.high:g} mm" for each in missed)
    return f"; {said}: the rigs stand no longer as the gauge frame found them, or it is another master"


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
