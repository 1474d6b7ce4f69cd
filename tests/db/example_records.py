"""Records of a plausible vehicle, and one variation of each bad moment."""

import math
from datetime import UTC, datetime, timedelta
from typing import Any
from uuid import UUID, uuid4

from db.records import (
    AdjustingRecord,
    ArchivedShotRecord,
    AxleRecord,
    CalibrationCheckRecord,
    CalibrationRecord,
    CheckKind,
    CheckOutcome,
    ClosedBy,
    ConcessionRecord,
    ConcessionWithdrawal,
    CycleOutcome,
    CycleRecord,
    DoubtClosing,
    DoubtRecord,
    GaugeStudyRecord,
    GaugeValueRecord,
    GeometryRecord,
    InstallationRecord,
    RetentionClass,
    StationRecord,
    SteeringAxisRecord,
    SteeringRecord,
    StudyKind,
    VehicleAnglesRecord,
    VehicleRecord,
    VehicleTypeRecord,
    Verdict,
    WheelOutcome,
    WheelRecord,
    ZeroRecord,
    ZeroRevocation,
)
from db.rows import flat_values

NOON = datetime(2026, 11, 22, 12, 0, 0, 123456, tzinfo=UTC)
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
CALIBRATION = CalibrationRecord(
    id="cal-2026-11", rig="front_left", valid_from_utc=NOON, document={"schema": "calibration", "fx": 2.5e3}
)


def check(calibration_id: str = CALIBRATION.id, **changes: Any) -> CalibrationCheckRecord:
    values: dict[str, Any] = {
        "utc": NOON,
        "calibration_id": calibration_id,
        "kind": CheckKind.PLATE_SESSION,
        "outcome": CheckOutcome.WITHIN,
        "reason": "all cameras within tolerance",
        "as_found": {"residual_rms_px": 0.031},
    }
    return CalibrationCheckRecord(**(values | changes))


def zero(zero_id: str = "zero-1", **changes: Any) -> ZeroRecord:
    values: dict[str, Any] = {
        "id": zero_id,
        "rig": "front_left",
        "calibration_id": CALIBRATION.id,
        "measured_utc": NOON,
        "master": "M-17",
        "method": "spin_axis",
        "shots": 8,
        "camber": 1e-4,
        "toe": -2e-4,
        "certified_camber": 0.0,
        "certified_toe": 1e-5,
        "camber_u": 3e-6,
        "toe_u": 4e-6,
        "correlation": -0.1,
        "software_version": "0.1.0",
    }
    return ZeroRecord(**(values | changes))


def revocation(zero_id: str = "zero-1", **changes: Any) -> ZeroRevocation:
    values: dict[str, Any] = {"zero_id": zero_id, "utc": NOON, "reason": "the master was dropped"}
    return ZeroRevocation(**(values | changes))


def wheel(name: str = "front_left", **changes: Any) -> WheelRecord:
    values: dict[str, Any] = {
        "wheel": name,
        "outcome": WheelOutcome.MEASURED,
        "verdict": Verdict.OK,
        "measured_utc": NOON + timedelta(seconds=1),
        "device_time_s": 12.25,
        "camber": -math.radians(0.5),
        "toe": math.radians(0.1),
        "camber_u": 1e-5,
        "toe_u": 1e-5,
        "coverage_factor": 2.0,
        "method": "tyre_plane/revolution",
        "calibration_id": CALIBRATION.id,
        "camber_low": -math.radians(1.0),
        "camber_high": math.radians(0.0),
        "toe_low": -math.radians(0.2),
        "toe_high": math.radians(0.2),
        "guard_band": True,
        "points_used": 4321,
        "residual_rms_mm": 0.021,
        "duration_s": 0.19,
    }
    return WheelRecord(**(values | changes))


def refused_wheel(name: str = "rear_left", **changes: Any) -> WheelRecord:
    values: dict[str, Any] = {
        "wheel": name,
        "outcome": WheelOutcome.REFUSED,
        "reason_code": "head_dark",
        "reason_text": "head 2 sees no light: clean its window",
    }
    return WheelRecord(**(values | changes))


def axle(name: str = "front", **changes: Any) -> AxleRecord:
    values: dict[str, Any] = {
        "axle": name,
        "total_toe": math.radians(0.2),
        "total_toe_u": 1.4e-5,
        "camber_difference": 0.0,
        "camber_difference_u": 1.4e-5,
    }
    return AxleRecord(**(values | changes))


ANGLES = VehicleAnglesRecord(
    thrust_angle=1e-4,
    thrust_angle_u=7e-6,
    thrust_sign="left_positive",
    front_toe_left_to_thrust=2e-3,
    front_toe_right_to_thrust=1e-3,
)


def geometry(**changes: Any) -> GeometryRecord:
    """A vehicle of which every length is inside of its limits, those of the front track narrow."""
    lengths = {
        "wheelbase_left": 2701.25, "wheelbase_right": 2699.5, "wheelbase_difference": 1.75,
        "track_front": 1512.5, "track_rear": 1508.0625, "sidewall_track_front": 1707.5,
        "sidewall_track_rear": 1703.0625, "setback_front": -1.0, "setback_rear": 0.75, "axle_offset": 0.5,
        "offset_front": 12.0, "offset_rear": 10.0, "place_x": 3.0, "place_y": 11.0,
    }  # fmt: skip
    values: dict[str, Any] = {
        "reference": "vehicle", "end_points": "contact_centres", "verdict": Verdict.OK, "guard_band": True,
        "coverage_factor": 2.0, "thrust_angle_tyre_u": 3e-6, "yaw": math.radians(0.1), "yaw_u": 2e-6,
        "track_front_low": 1510.0, "track_front_high": 1515.0, "yaw_low": -0.01, "yaw_high": 0.01,
        **lengths, **{f"{name}_u": 0.0625 for name in lengths},
    }  # fmt: skip
    return GeometryRecord(**(values | changes))


def steering(**changes: Any) -> SteeringRecord:
    """A steering wheel held a little to the left, its offset inside of the limits; a sweep's differences."""
    values: dict[str, Any] = {
        "straight_ahead": "checked", "verdict": Verdict.OK, "guard_band": True, "coverage_factor": 2.0,
        "steering_wheel": 0.05, "steering_wheel_u": 0.003, "steering_wheel_age_s": 0.125, "steer": 0.003125,
        "steer_u": 2e-4, "steering_wheel_offset": 0.0125, "steering_wheel_offset_u": 0.004,
        "steering_wheel_offset_low": -0.03125, "steering_wheel_offset_high": 0.03125,
        "caster_difference": 0.005, "caster_difference_u": 3e-5, "caster_difference_low": -0.0125,
        "caster_difference_high": 0.0125, "kpi_difference": -0.0025, "kpi_difference_u": 4e-4,
    }  # fmt: skip
    return SteeringRecord(**(values | changes))


def steering_axis(name: str = "front_left", **changes: Any) -> SteeringAxisRecord:
    """An axis of which all is inside of its limits."""
    values: dict[str, Any] = {
        "wheel": name, "verdict": Verdict.OK, "guard_band": True, "coverage_factor": 2.0,
        "method": "steering_axis", "positions": 41, "residual": 1.0625, "caster": 0.105, "caster_u": 2e-5,
        "caster_low": 0.0875, "caster_high": 0.125, "kpi": 0.2125, "kpi_u": 3e-4, "included_angle": 0.205,
        "included_angle_u": 3e-4, "toe_out": 0.025, "toe_out_u": 1e-4, "trail": 22.5, "trail_u": 0.25,
        "trail_low": 15.0, "trail_high": 30.0, "scrub": -8.5, "scrub_u": 0.5, "lock_left": 0.6,
        "lock_left_u": 1e-4, "warning": "it moved a little",
    }  # fmt: skip
    return SteeringAxisRecord(**(values | changes))


def adjusting(name: str = "front_left", **changes: Any) -> AdjustingRecord:
    """A tie rod that was turned twice, inside after that; only the second nut was seen before and after."""
    values: dict[str, Any] = {
        "wheel": name, "adjuster": "tie_rod", "outcome": "done", "corrections": 2, "turns": -1.25,
        "turns_made": 1.75, "found_camber": -0.004, "found_toe": 0.02, "left_camber": -0.0041,
        "left_toe": 5e-4, "begun_s": 2.5, "ended_s": 31.0, "nuts_locked": 1, "drift": 1.5e-3,
    }  # fmt: skip
    return AdjustingRecord(**(values | changes))


def corrected_wheel(name: str = "front_left", **changes: Any) -> WheelRecord:
    """A wheel whose toe is that of straight ahead, and its angles those of the design height."""
    values: dict[str, Any] = {
        "camber_raw": -0.004, "toe_raw": -0.001, "camber_raw_u": 9e-6, "toe_raw_u": 9e-6,
        "ride_height": "corrected", "ride_height_mm": 391.5, "ride_height_u_mm": 1.0,
        "design_height_mm": 380.0,
    }  # fmt: skip
    return wheel(name, **(values | changes))


def not_ok(**changes: Any) -> CycleRecord:
    """A vehicle whose front left wheel has too much toe."""
    bad = wheel(WHEELS[0], toe=0.02, verdict=Verdict.NOK)
    wheels = (bad, *(wheel(name) for name in WHEELS[1:]))
    given: dict[str, Any] = {"outcome": CycleOutcome.NOK, "wheels": wheels} | changes
    return cycle(given.pop("uuid", None), **given)


def bad_vehicle(uuid: UUID | None = None) -> CycleRecord:
    """Of another VIN than `cycle`, so that nothing came after it."""
    return not_ok(uuid=uuid or uuid4(), vehicle=VehicleRecord("TRUEWHEEL00000077", "compact"))


def concession(cycle: UUID, **changes: Any) -> ConcessionRecord:
    values: dict[str, Any] = {
        "cycle": cycle,
        "utc": NOON,
        "person": "A. Example",
        "reason": "goes to the test track, not to a customer",
        "exceeded": {
            "front_left.toe": {"value": 0.4, "u95": 0.001, "low": -0.1, "high": None, "unit": "deg"}
        },
    }
    return ConcessionRecord(**(values | changes))


def withdrawal(concession: UUID, **changes: Any) -> ConcessionWithdrawal:
    values: dict[str, Any] = {
        "concession": concession,
        "utc": NOON,
        "person": "B. Example",
        "reason": "it was another vehicle",
    }
    return ConcessionWithdrawal(**(values | changes))


def cycle(uuid: UUID | None = None, **changes: Any) -> CycleRecord:
    values: dict[str, Any] = {
        "uuid": uuid or uuid4(),
        "station": "EOL-1",
        "trigger_sequence": 7,
        "received_utc": NOON,
        "received_monotonic_s": 100.0,
        "measured_utc": NOON + timedelta(seconds=2),
        "measured_monotonic_s": 102.0,
        "outcome": CycleOutcome.OK,
        "software_version": "0.1.0",
        "config_hash": "sha256:00",
        "vehicle": VehicleRecord("TRUEWHEEL00000001", "compact"),
        "wheels": tuple(wheel(name) for name in WHEELS),
        "axles": (axle("front"), axle("rear")),
        "vehicle_angles": ANGLES,
    }
    return CycleRecord(**(values | changes))


def station(**changes: Any) -> StationRecord:
    values: dict[str, Any] = {
        "station": "EOL-1",
        "plant": "Werk Süd",
        "label": "Achsvermessung 1",
        "valid_from_utc": NOON,
        "software_version": "0.1.0",
        "config_hash": "sha256:00",
        "configuration": {"station": {"id": "EOL-1"}},
        "rigs": WHEELS,
    }
    return StationRecord(**(values | changes))


def limits(**changes: Any) -> VehicleTypeRecord:
    values: dict[str, Any] = {
        "station": "EOL-1",
        "vehicle_type": "compact",
        "valid_from_utc": NOON,
        "guard_band": True,
        "limits": {"front": {"toe": [-math.radians(0.2), math.radians(0.2)]}},
    }
    return VehicleTypeRecord(**(values | changes))


def installation(**changes: Any) -> InstallationRecord:
    values: dict[str, Any] = {
        "station": "EOL-1",
        "rig": "front_left",
        "calibration_id": CALIBRATION.id,
        "from_utc": NOON,
    }
    return InstallationRecord(**(values | changes))


def study(**changes: Any) -> GaugeStudyRecord:
    values: dict[str, Any] = {
        "kind": StudyKind.GRR,
        "name": "Abnahme 2026",
        "created_utc": NOON,
        "characteristic": "front_left.toe",
        "plan": {"parts": 10, "trials": 3, "tolerance": math.radians(0.4)},
        "software_version": "0.1.0",
        "station": "EOL-1",
        "comment": "nach Umbau",
    }
    return GaugeStudyRecord(**(values | changes))


def study_value(study_uuid: UUID, **changes: Any) -> GaugeValueRecord:
    values: dict[str, Any] = {"part": "1", "appraiser": "EOL-1", "trial": 1, "value": 1.25e-3, "utc": NOON}
    return GaugeValueRecord(study_uuid, **(values | changes))


def shot(cycle_uuid: UUID, **changes: Any) -> ArchivedShotRecord:
    values: dict[str, Any] = {
        "wheel": "front_left",
        "path": "2026-11-22/0001",
        "bytes": 18_000_000,
        "archived_utc": NOON,
        "retention": RetentionClass.ORDINARY,
    }
    return ArchivedShotRecord(cycle_uuid, **(values | changes))


def doubt(cycle_uuid: UUID, check_uuid: UUID, wheel_name: str = "front_left") -> DoubtRecord:
    return DoubtRecord.of("EOL-1", cycle_uuid, wheel_name, check_uuid, NOON, "front_left: the master is out")


def doubt_closing(doubt_uuid: UUID, **changes: Any) -> DoubtClosing:
    values: dict[str, Any] = {
        "station": "EOL-1",
        "doubt": doubt_uuid,
        "utc": NOON,
        "closed_by": ClosedBy.RELEASE,
        "reason": "measured again",
        "person": "A. Example",
    }
    return DoubtClosing(**(values | changes))


def given(record: object) -> dict[str, object]:
    """Its values; columns that came later are empty, and an earlier table does not have them."""
    return {name: value for name, value in flat_values(record).items() if value is not None}
