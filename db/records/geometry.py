"""The geometry of a vehicle as it is stored: its lengths, how it stands, and what its angles refer to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from alignment.vehicle import EndPoints
from db.records.angle_verdicts import Verdict
from db.records.plain import check_values

Reference = Literal["vehicle", "stand"]
"""What individual toe and thrust angle refer to: the vehicle's own centreline, or the stand's axis."""


@dataclass(frozen=True)
class GeometryRecord:
    """What the axes of four wheels in one frame say of the vehicle, beside its angles.

    Lengths are millimetres, `yaw` is radians; names are those of `alignment.vehicle.LENGTHS`, `…_u` standard
    uncertainties, `…_low` and `…_high` the limits used. A vehicle whose lengths have limits and that was not
    wholly measured has a record without values.

    Attributes
    ----------
    reference
        What individual toes and the thrust angle of the cycle refer to.
    end_points
        Between what wheelbase, track and setback were measured; None without values.
    verdict
        Of all that have limits; each one's own follows from its value, limits and guard band.
    guard_band, coverage_factor
        As in `WheelRecord`.
    thrust_angle_tyre_u
        What the spread of tyre widths makes of the thrust angle's standard uncertainty, radians; part of it.
    """

    reference: Reference
    end_points: EndPoints | None = None
    verdict: Verdict = Verdict.NONE
    guard_band: bool | None = None
    coverage_factor: float | None = None
    thrust_angle_tyre_u: float | None = None
    yaw: float | None = None
    yaw_u: float | None = None
    yaw_low: float | None = None
    yaw_high: float | None = None
    wheelbase_left: float | None = None
    wheelbase_left_u: float | None = None
    wheelbase_left_low: float | None = None
    wheelbase_left_high: float | None = None
    wheelbase_right: float | None = None
    wheelbase_right_u: float | None = None
    wheelbase_right_low: float | None = None
    wheelbase_right_high: float | None = None
    wheelbase_difference: float | None = None
    wheelbase_difference_u: float | None = None
    wheelbase_difference_low: float | None = None
    wheelbase_difference_high: float | None = None
    track_front: float | None = None
    track_front_u: float | None = None
    track_front_low: float | None = None
    track_front_high: float | None = None
    track_rear: float | None = None
    track_rear_u: float | None = None
    track_rear_low: float | None = None
    track_rear_high: float | None = None
    setback_front: float | None = None
    setback_front_u: float | None = None
    setback_front_low: float | None = None
    setback_front_high: float | None = None
    setback_rear: float | None = None
    setback_rear_u: float | None = None
    setback_rear_low: float | None = None
    setback_rear_high: float | None = None
    axle_offset: float | None = None
    axle_offset_u: float | None = None
    axle_offset_low: float | None = None
    axle_offset_high: float | None = None
    offset_front: float | None = None
    offset_front_u: float | None = None
    offset_front_low: float | None = None
    offset_front_high: float | None = None
    offset_rear: float | None = None
    offset_rear_u: float | None = None
    offset_rear_low: float | None = None
    offset_rear_high: float | None = None
    sidewall_track_front: float | None = None
    sidewall_track_front_u: float | None = None
    sidewall_track_rear: float | None = None
    sidewall_track_rear_u: float | None = None
    place_x: float | None = None
    place_x_u: float | None = None
    place_y: float | None = None
    place_y_u: float | None = None

    def __post_init__(self) -> None:
        check_values(self)
