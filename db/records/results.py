"""What the station hands to the result store: frozen values, one per row.

Angles are radians, times are aware datetimes (UTC in the database), `…_monotonic_s` is seconds on the
station's monotonic clock and only comparable within one run of the program, `device_time_s` is seconds on
the camera's own clock.

Three kinds of outcome are kept apart: the vehicle's (`ok`, `nok`), the station's (`fault`) and the
operator's (`aborted`). What one row alone must fulfil is checked by the database (`db.schema`); the records
check what a database cannot see in one row: text, finite numbers, aware times, the outcome's parts.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from datetime import datetime
from uuid import UUID, uuid4

from alignment.errors import InputError
from alignment.vehicle import ThrustSign
from db.records.adjusting import AdjustingRecord
from db.records.angle_verdicts import AngleVerdict, Verdict, judge_angle
from db.records.concessions import ConcessionRecord
from db.records.doubts import StoredDoubt
from db.records.geometry import GeometryRecord
from db.records.plain import check_values
from db.records.steering import RideHeightWord, SteeringAxisRecord, SteeringRecord

UNJUDGED_HEIGHTS = ("missing", "refused")


class CycleOutcome(enum.StrEnum):
    """How a cycle ended: the vehicle is good or not, or the station failed, or the operator stopped it."""

    OK = "ok"
    NOK = "nok"
    FAULT = "fault"
    ABORTED = "aborted"


class WheelOutcome(enum.StrEnum):
    """Whether a wheel was measured, was refused by the measurement, or never got that far."""

    MEASURED = "measured"
    REFUSED = "refused"
    FAULT = "fault"


class WheelKind(enum.StrEnum):
    """What a wheel's angles are of: the plane of its tyre as it stood, or the axis about which it turned."""

    TYRE_PLANE = "tyre_plane"
    SPIN_AXIS = "spin_axis"

    @classmethod
    def of_method(cls, method: str) -> WheelKind | None:
        """That of a method, which begins with it: ``tyre_plane/revolution``; None for any other text."""
        return next((kind for kind in cls if method.partition("/")[0] == kind), None)


class Severity(enum.StrEnum):
    """How much an event matters."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True)
class VehicleRecord:
    """A vehicle: its identification number and the type whose limits apply."""

    vin: str
    vehicle_type: str

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class WheelRecord:
    """The result of one wheel.

    Attributes
    ----------
    wheel
        Name of the wheel, which is its rig's: ``front_left``.
    outcome, verdict
        A wheel that was not measured has the verdict `none`, no angles, and a reason.
    measured_utc, device_time_s
        When its images were taken: host time, and the camera's own clock.
    camber, toe, camber_u, toe_u
        Radians, with standard uncertainties (greater than zero).
    coverage_factor
        k of the expanded uncertainty that the verdict used.
    method
        How, and of what, for people: ``tyre_plane/revolution``; a spin axis says so here.
    calibration_id
        The calibration it rests on; recorded before the cycle is written.
    zero_measurement_id
        The zero measurement that was subtracted, when there was one.
    reason_code, reason_text
        Why it was not measured or not good, for programs and for people.
    camber_low, camber_high, toe_low, toe_high
        The limits used, radians; None where there is none.
    guard_band
        Whether the limits were narrowed by the expanded uncertainty; None without limits.
    points_used, residual_rms_mm, duration_s
        Quality of the fit, and the time the measurement took.
    row_px
        Largest epipolar residual of a head, pixels; None where none was seen.
    knock_evidence
        2 ln of the evidence that a camera or head moved since its calibration; see `WheelMeasurement`.
    warning
        What was suspect, for people; None where nothing was.
    camber_unseen, toe_unseen
        By how much a movement since the calibration that no image shows may change them, radians; not part of
        the uncertainties. None where the shot was not judged.
    degraded
        Whether a head was lost and the others measured alone. None where nothing was measured, and in records
        of earlier programs that do not tell of a lost head.
    kind
        Of what the angles are: of the plane of the tyre, or of the axis about which it turned.
    load_mm
        Most by which the weight that the tyre carries moved its sidewall where the heads see it, which was
        taken off, millimetres; None where the wheel showed no load.
    run_out, run_out_u
        Run-out of the tyre plane at the vehicle type's radius, peak to peak, and its standard uncertainty,
        millimetres; None where the wheel was not turned, or it cannot be told from noise.
    run_out_high
        The limit used, millimetres.
    run_out_phase, run_out_phase_u
        Where the tyre stood out farthest at the last exposure, and standard uncertainty, radians: 0 at the
        top, growing counter-clockwise seen from outboard.
    toe_tyre_u
        What the spread of tyre widths makes of `toe_u`, radians; part of it. None where toe refers to the
        stand.
    camber_raw, toe_raw, camber_raw_u, toe_raw_u
        The angles as measured, where `camber` and `toe` are those of straight ahead or of the design height;
        None where nothing was corrected.
    ride_height
        What became of its ride height; None where its vehicle type has no curve of it.
    ride_height_mm, ride_height_u_mm, design_height_mm
        As it was told, its standard uncertainty, and that at which the angles are judged.
    """

    wheel: str
    outcome: WheelOutcome
    verdict: Verdict = Verdict.NONE
    measured_utc: datetime | None = None
    device_time_s: float | None = None
    camber: float | None = None
    toe: float | None = None
    camber_u: float | None = None
    toe_u: float | None = None
    coverage_factor: float | None = None
    method: str | None = None
    calibration_id: str | None = None
    zero_measurement_id: str | None = None
    reason_code: str | None = None
    reason_text: str | None = None
    camber_low: float | None = None
    camber_high: float | None = None
    toe_low: float | None = None
    toe_high: float | None = None
    guard_band: bool | None = None
    points_used: int | None = None
    residual_rms_mm: float | None = None
    duration_s: float | None = None
    row_px: float | None = None
    knock_evidence: float | None = None
    warning: str | None = None
    camber_unseen: float | None = None
    toe_unseen: float | None = None
    degraded: bool | None = None
    kind: WheelKind | None = None
    load_mm: float | None = None
    run_out: float | None = None
    run_out_u: float | None = None
    run_out_high: float | None = None
    run_out_phase: float | None = None
    run_out_phase_u: float | None = None
    toe_tyre_u: float | None = None
    camber_raw: float | None = None
    toe_raw: float | None = None
    camber_raw_u: float | None = None
    toe_raw_u: float | None = None
    ride_height: RideHeightWord | None = None
    ride_height_mm: float | None = None
    ride_height_u_mm: float | None = None
    design_height_mm: float | None = None

    def __post_init__(self) -> None:
        check_values(self)

    @property
    def run_out_verdict(self) -> AngleVerdict:
        """Verdict of the run-out, which that of the wheel does not hold."""
        return judge_angle(
            self.run_out, self.run_out_u, None, self.run_out_high,
            guard_band=self.guard_band, coverage_factor=self.coverage_factor, part=self.verdict,
        )[0]  # fmt: skip


@dataclass(frozen=True)
class AxleRecord:
    """The angles of one axle (``front``, ``rear``), radians; an axle with an unmeasured wheel has no record.

    Limits, `guard_band` and `coverage_factor` as in `WheelRecord`.
    """

    axle: str
    total_toe: float
    total_toe_u: float
    camber_difference: float
    camber_difference_u: float
    verdict: Verdict = Verdict.NONE
    total_toe_low: float | None = None
    total_toe_high: float | None = None
    camber_difference_low: float | None = None
    camber_difference_high: float | None = None
    guard_band: bool | None = None
    coverage_factor: float | None = None

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class VehicleAnglesRecord:
    """The angles that need all wheels, radians; `thrust_sign` says which side is positive.

    Limits, `guard_band` and `coverage_factor` as in `WheelRecord`.
    """

    thrust_angle: float
    thrust_angle_u: float
    thrust_sign: ThrustSign
    front_toe_left_to_thrust: float
    front_toe_right_to_thrust: float
    verdict: Verdict = Verdict.NONE
    thrust_angle_low: float | None = None
    thrust_angle_high: float | None = None
    guard_band: bool | None = None
    coverage_factor: float | None = None

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class CycleRecord:
    """One measuring cycle, from the trigger to the outcome, with everything that explains it.

    Attributes
    ----------
    uuid
        Made when the trigger is received; writing the same cycle twice stores it once.
    trigger_sequence
        The PLC's own number of the trigger; it may start again, so it identifies nothing.
    received_utc, received_monotonic_s
        When the trigger came.
    measured_utc, measured_monotonic_s
        When the last wheel was done; None where the cycle ended before. The wall clock may be set back in
        between, so durations come from the monotonic pair.
    reason_code, reason_text
        Why the station failed or the operator aborted; None for `ok` and `nok`, which the wheels explain.
    wheels, axles
        Kept sorted by name; their order carries no meaning.
    geometry
        Lengths of the vehicle and how it stood; None where its rigs stand in no common frame, and in records
        of earlier programs.
    steering
        Its steering wheel, and straight ahead; None where its type says nothing of its steering.
    steering_axes
        Of a sweep; kept sorted by name.
    adjustings
        What was turned before it was measured; kept sorted by wheel and adjuster.

    Raises
    ------
    InputError
        When the outcome does not follow from the parts: `ok` needs every wheel and axis measured, nothing
        refused for straight ahead or a ride height, at least one verdict `ok` and none `nok`; `nok` needs a
        verdict `nok`.
    """

    uuid: UUID
    station: str
    trigger_sequence: int
    received_utc: datetime
    outcome: CycleOutcome
    software_version: str
    config_hash: str
    vehicle: VehicleRecord | None = None
    received_monotonic_s: float | None = None
    measured_utc: datetime | None = None
    measured_monotonic_s: float | None = None
    reason_code: str | None = None
    reason_text: str | None = None
    wheels: tuple[WheelRecord, ...] = ()
    axles: tuple[AxleRecord, ...] = ()
    vehicle_angles: VehicleAnglesRecord | None = None
    geometry: GeometryRecord | None = None
    steering: SteeringRecord | None = None
    steering_axes: tuple[SteeringAxisRecord, ...] = ()
    adjustings: tuple[AdjustingRecord, ...] = ()

    def __post_init__(self) -> None:
        check_values(self)
        by_wheel = tuple(sorted(self.steering_axes, key=lambda axis: axis.wheel))
        object.__setattr__(self, "steering_axes", by_wheel)
        turned = tuple(sorted(self.adjustings, key=lambda each: (each.wheel, each.adjuster)))
        object.__setattr__(self, "adjustings", turned)
        object.__setattr__(self, "wheels", tuple(sorted(self.wheels, key=lambda wheel: wheel.wheel)))
        object.__setattr__(self, "axles", tuple(sorted(self.axles, key=lambda axle: axle.axle)))
        for name, names in (
            ("wheels", [wheel.wheel for wheel in self.wheels]),
            ("axles", [axle.axle for axle in self.axles]),
            ("steering_axes", [axis.wheel for axis in self.steering_axes]),
            ("adjustings", [f"{each.wheel} {each.adjuster}" for each in self.adjustings]),
        ):
            if len(set(names)) != len(names):
                raise InputError(
                    field=f"CycleRecord.{name}", expected="each name once", seen=", ".join(names)
                )
        self._check_outcome()

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdicts of wheels, axles, vehicle, geometry and steering, and of run-outs beyond their limits."""
        single = (self.vehicle_angles, self.geometry, self.steering)
        whole = [part.verdict for part in single if part is not None]
        whole += [axis.verdict for axis in self.steering_axes]
        whole += [Verdict.NOK for wheel in self.wheels if wheel.run_out_verdict is AngleVerdict.NOK]
        return (*(wheel.verdict for wheel in self.wheels), *(axle.verdict for axle in self.axles), *whole)

    def _check_outcome(self) -> None:
        verdicts = self.verdicts
        if self.outcome is CycleOutcome.OK:
            unmeasured = [w.wheel for w in self.wheels if w.outcome is not WheelOutcome.MEASURED]
            unmeasured += [axis.wheel for axis in self.steering_axes if not axis.measured]
            unmeasured += [wheel.wheel for wheel in self.wheels if wheel.ride_height in UNJUDGED_HEIGHTS]
            if self.steering is not None and self.steering.straight_ahead == "refused":
                unmeasured.append("straight ahead")
            if unmeasured or Verdict.NOK in verdicts or Verdict.OK not in verdicts:
                raise InputError(
                    field="CycleRecord.outcome",
                    expected="for 'ok' every wheel measured, at least one verdict 'ok' and none 'nok'",
                    seen=f"verdicts {', '.join(verdicts) or 'none at all'}"
                    + (f"; not measured: {', '.join(unmeasured)}" if unmeasured else ""),
                )
        if self.outcome is CycleOutcome.NOK and Verdict.NOK not in verdicts:
            raise InputError(
                field="CycleRecord.outcome",
                expected="for 'nok' a verdict 'nok'",
                seen=f"verdicts {', '.join(verdicts) or 'none at all'}",
            )


@dataclass(frozen=True)
class EventRecord:
    """Something that happened at a station and explains results: a start, a fault, a clock that was set.

    Attributes
    ----------
    code, text
        What happened: for programs, and for people. No program reads the text.
    cycle_uuid
        The cycle it is of; None where it is of none.
    value
        The number it tells: degrees Celsius of a temperature. None where it tells none.
    """

    utc: datetime
    station: str
    severity: Severity
    source: str
    code: str
    text: str
    monotonic_s: float | None = None
    uuid: UUID = field(default_factory=uuid4)
    cycle_uuid: UUID | None = None
    value: float | None = None

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class StoredCycle:
    """A cycle read back: what was written, when the store committed it, and what was said of it since.

    Attributes
    ----------
    concession
        That which is in force of a vehicle that is not ok; the verdict in the record stays.
    doubts
        Of failed master checks about its wheels.
    """

    record: CycleRecord
    stored_utc: datetime
    concession: ConcessionRecord | None = None
    doubts: tuple[StoredDoubt, ...] = ()


@dataclass(frozen=True)
class StoredWheel:
    """One wheel result of a vehicle, with the cycle it belongs to."""

    cycle: UUID
    station: str
    received_utc: datetime
    wheel: WheelRecord
