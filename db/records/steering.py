"""The steering of a vehicle as it is stored: its steering wheel, straight ahead, and its steering axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from db.records.angle_verdicts import Verdict
from db.records.plain import check_values

StraightAheadWord = Literal["checked", "not_checked", "refused", "not_asked"]
"""Whether front toe is that of straight ahead. Not checked: no angle counted, and the vehicle type lets toe
be judged as it stood; refused: toe was not judged; not asked: the vehicle type says nothing of it."""
RideHeightWord = Literal["corrected", "not_known", "missing", "refused"]
"""What became of the ride height of a wheel: its angles are those at the design height; none was known, and
the vehicle type lets it be judged as it stood; none was known, and it was not judged; it cannot be or was too
far from the design height, and the wheel was not judged."""


@dataclass(frozen=True)
class SteeringRecord:
    """The steering wheel of a vehicle, and what is compared between its steering axes; angles are radians.

    Angles of steering wheel and front wheels are positive to the left. Names of quantities are those of
    `db.records.QUANTITIES`, `…_u` standard uncertainties, `…_low` and `…_high` the limits used.

    Attributes
    ----------
    straight_ahead
        Whether front toe is that of straight ahead.
    reason_text
        Why it is not, for people; None where it is, or was not asked for.
    verdict
        Of all that have limits; each one's own follows from its value, limits and guard band.
    guard_band, coverage_factor
        As in `WheelRecord`.
    steering_wheel
        How it stood from straight while the wheels were measured; None where no angle counted.
    steering_wheel_age_s
        How old the oldest angle was.
    steer, steer_u
        Turn of the front wheels from straight ahead, which was taken off their toe.
    steering_wheel_offset
        How the steering wheel stands when the vehicle drives straight ahead.
    caster_difference, kpi_difference
        Left minus right, of a sweep.
    """

    straight_ahead: StraightAheadWord
    reason_text: str | None = None
    verdict: Verdict = Verdict.NONE
    guard_band: bool | None = None
    coverage_factor: float | None = None
    steering_wheel: float | None = None
    steering_wheel_u: float | None = None
    steering_wheel_age_s: float | None = None
    steer: float | None = None
    steer_u: float | None = None
    steering_wheel_offset: float | None = None
    steering_wheel_offset_u: float | None = None
    steering_wheel_offset_low: float | None = None
    steering_wheel_offset_high: float | None = None
    caster_difference: float | None = None
    caster_difference_u: float | None = None
    caster_difference_low: float | None = None
    caster_difference_high: float | None = None
    kpi_difference: float | None = None
    kpi_difference_u: float | None = None
    kpi_difference_low: float | None = None
    kpi_difference_high: float | None = None

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class SteeringAxisRecord:
    """The steering axis of one front wheel, of a sweep: angles radians, lengths millimetres.

    Caster is positive when the top leans rearward, kingpin inclination (`kpi`) when it leans inboard. Names
    as in `SteeringRecord`. An axis that was refused has a reason and no values.

    Attributes
    ----------
    wheel
        Name of the wheel.
    verdict, guard_band, coverage_factor
        As in `SteeringRecord`.
    method, positions
        How it was measured, for people, and at how many positions of the steering.
    residual
        Scatter about one axis that stands still, over what the measurements' uncertainties say: about 1.
    warning
        What speaks against one axis that stands still, for people; None where nothing does.
    reason_code, reason_text
        Why there is no axis, for programs and for people.
    caster, kpi, included_angle, toe_out, trail, scrub
        Values; None where not measured. `toe_out`: steered angle of the inner less that of the outer wheel.
    lock_left, lock_right
        Farthest steered angle to each side, positive, where the lock was reached.
    """

    wheel: str
    verdict: Verdict = Verdict.NONE
    guard_band: bool | None = None
    coverage_factor: float | None = None
    method: str | None = None
    positions: int | None = None
    residual: float | None = None
    warning: str | None = None
    reason_code: str | None = None
    reason_text: str | None = None
    caster: float | None = None
    caster_u: float | None = None
    caster_low: float | None = None
    caster_high: float | None = None
    kpi: float | None = None
    kpi_u: float | None = None
    kpi_low: float | None = None
    kpi_high: float | None = None
    included_angle: float | None = None
    included_angle_u: float | None = None
    included_angle_low: float | None = None
    included_angle_high: float | None = None
    toe_out: float | None = None
    toe_out_u: float | None = None
    toe_out_low: float | None = None
    toe_out_high: float | None = None
    trail: float | None = None
    trail_u: float | None = None
    trail_low: float | None = None
    trail_high: float | None = None
    scrub: float | None = None
    scrub_u: float | None = None
    scrub_low: float | None = None
    scrub_high: float | None = None
    lock_left: float | None = None
    lock_left_u: float | None = None
    lock_right: float | None = None
    lock_right_u: float | None = None

    def __post_init__(self) -> None:
        check_values(self)

    @property
    def measured(self) -> bool:
        """Whether there is an axis."""
        return self.caster is not None
