"""What a certificate says of straight ahead and ride heights: the angles as measured and as judged."""

from __future__ import annotations

import math

from db.exports.drawing import signed
from db.exports.rows import USUAL_K
from db.records import CycleRecord, WheelRecord

CORRECTED_HEAD = (
    "wheel", "ride height [mm]", "design height [mm]", "camber measured", "camber judged", "toe measured",
    "toe judged", "remark",
)  # fmt: skip


def straight_ahead_words(record: CycleRecord) -> str | None:
    """Whether front toe is that of straight ahead; None where its vehicle type says nothing of it."""
    steering = record.steering
    if steering is None or steering.straight_ahead == "not_asked":
        return None
    if steering.straight_ahead != "checked":
        judged = "is as the wheels stood" if steering.straight_ahead == "not_checked" else "is not judged"
        return f"{steering.reason_text}; front toe {judged}"
    k = steering.coverage_factor or USUAL_K
    text = f"checked, the steering wheel stood at {_shown(steering.steering_wheel, 2)}"
    return f"{text} ± {math.degrees(k * (steering.steering_wheel_u or 0.0)):.2f}°, positive to the left"


def corrected_rows(record: CycleRecord) -> list[tuple[str, ...]]:
    """Rows of the wheels whose angles were corrected, or that should have been."""
    return [_row(wheel) for wheel in record.wheels if wheel.toe_raw is not None or wheel.ride_height]


def _row(wheel: WheelRecord) -> tuple[str, ...]:
    raw = wheel.toe_raw is not None
    heights = (wheel.ride_height_mm, wheel.design_height_mm)
    return (
        wheel.wheel.replace("_", " "),
        *("" if height is None else f"{height:.1f}" for height in heights),
        _shown(wheel.camber_raw if raw else wheel.camber),
        _shown(wheel.camber) if raw else "as measured",
        _shown(wheel.toe_raw if raw else wheel.toe),
        _shown(wheel.toe) if raw else "as measured",
        wheel.reason_text or wheel.warning or "",
    )


def _shown(value: float | None, decimals: int = 4) -> str:
    return "–" if value is None else f"{signed(math.degrees(value), decimals)}°"
