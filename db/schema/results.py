"""What is measured: vehicles, cycles, results, and the calibrations they rest on."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    Table,
    Text,
    UniqueConstraint,
    Uuid,
)

from db.records import CheckKind, CheckOutcome, CycleOutcome, Severity, Verdict, WheelOutcome
from db.schema.base import (
    EVIDENCE,
    UtcDateTime,
    angle,
    check,
    choice,
    explained,
    id_column,
    metadata,
    ordered,
    uncertainty,
    within_limits,
)

vehicles = Table(
    "vehicles",
    metadata,
    id_column(),
    Column("vin", Text, nullable=False),
    Column("vehicle_type", Text, nullable=False),
    # Serves "all results of one VIN". A VIN that comes back as another type is a second row: the type decides
    # the limits, so it is part of what happened.
    UniqueConstraint("vin", "vehicle_type"),
    check("vin_not_empty", "vin <> ''"),
    check("vehicle_type_not_empty", "vehicle_type <> ''"),
)

calibrations = Table(
    "calibrations",
    metadata,
    Column("id", Text, primary_key=True),
    Column("rig", Text, nullable=False),
    Column("valid_from_utc", UtcDateTime, nullable=False),
    Column("valid_until_utc", UtcDateTime),
    Column("document", EVIDENCE, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    check("id_not_empty", "id <> ''"),
    check("validity", "valid_until_utc > valid_from_utc"),
    # Serves "the calibrations of one rig, newest first".
    Index(None, "rig", "valid_from_utc"),
)

calibration_checks = Table(
    "calibration_checks",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("calibration_id", ForeignKey(calibrations.c.id), nullable=False),
    Column("predecessor_id", ForeignKey(calibrations.c.id)),
    Column("utc", UtcDateTime, nullable=False),
    choice("kind", CheckKind),
    choice("outcome", CheckOutcome),
    Column("reason", Text, nullable=False),
    Column("as_found", EVIDENCE),
    Column("as_left", EVIDENCE),
    Column("stored_utc", UtcDateTime, nullable=False),
    # Serves the refusal to store one check twice.
    UniqueConstraint("uuid"),
    check("reason_not_empty", "reason <> ''"),
    check("has_figures", "as_found IS NOT NULL OR as_left IS NOT NULL"),
    check(
        "successor_has_both",
        "predecessor_id IS NULL OR (as_found IS NOT NULL AND as_left IS NOT NULL"
        " AND predecessor_id <> calibration_id)",
    ),
    # Serves "the last good check of this calibration".
    Index(None, "calibration_id", "utc"),
)

zero_measurements = Table(
    "zero_measurements",
    metadata,
    Column("id", Text, primary_key=True),
    Column("rig", Text, nullable=False),
    Column("calibration_id", ForeignKey(calibrations.c.id), nullable=False),
    Column("measured_utc", UtcDateTime, nullable=False),
    Column("master", Text, nullable=False),
    Column("method", Text, nullable=False),
    Column("shots", Integer, nullable=False),
    Column("camber", Double, nullable=False),
    Column("toe", Double, nullable=False),
    Column("certified_camber", Double, nullable=False),
    Column("certified_toe", Double, nullable=False),
    Column("camber_u", Double, nullable=False),
    Column("toe_u", Double, nullable=False),
    Column("correlation", Double, nullable=False),
    Column("software_version", Text, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    # Why it counts although larger than what the station believes; null for all others.
    Column("forced_reason", Text),
    check("id_not_empty", "id <> ''"),
    check("rig_not_empty", "rig <> ''"),
    check("shots_positive", "shots > 0"),
    check("possible_angles", *map(angle, ("camber", "toe", "certified_camber", "certified_toe"))),
    check("possible_uncertainties", uncertainty("camber_u"), uncertainty("toe_u")),
    check("possible_correlation", "correlation BETWEEN -1 AND 1"),
    # Serves "the zero measurement in force of this rig and calibration", asked at every start.
    Index(None, "rig", "calibration_id", "measured_utc"),
)

zero_revocations = Table(
    "zero_revocations",
    metadata,
    # Serves the refusal to revoke twice.
    Column("zero_id", ForeignKey(zero_measurements.c.id), primary_key=True),
    Column("utc", UtcDateTime, nullable=False),
    Column("reason", Text, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    check("reason_not_empty", "reason <> ''"),
)

cycles = Table(
    "cycles",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("station", Text, nullable=False),
    Column("vehicle_id", ForeignKey(vehicles.c.id)),
    # Not unique: the PLC starts again at 1, and two stations may carry the same name by mistake.
    Column("trigger_sequence", BigInteger, nullable=False),
    Column("received_utc", UtcDateTime, nullable=False),
    Column("received_monotonic_s", Double),
    Column("measured_utc", UtcDateTime),
    Column("measured_monotonic_s", Double),
    Column("stored_utc", UtcDateTime, nullable=False),
    Column("software_version", Text, nullable=False),
    Column("config_hash", Text, nullable=False),
    choice("outcome", CycleOutcome),
    Column("reason_code", Text),
    Column("reason_text", Text),
    # Serves the refusal to store one cycle twice, and reading one cycle.
    UniqueConstraint("uuid"),
    check("trigger_sequence_not_negative", "trigger_sequence >= 0"),
    check("station_not_empty", "station <> ''"),
    check("software_version_not_empty", "software_version <> ''"),
    check("config_hash_not_empty", "config_hash <> ''"),
    # Only the monotonic clock is compared: the wall clock may be set back.
    check("monotonic_order", "measured_monotonic_s >= received_monotonic_s"),
    check(
        "verdict_has_vehicle_and_time",
        "outcome NOT IN ('ok', 'nok') OR (vehicle_id IS NOT NULL AND measured_utc IS NOT NULL)",
    ),
    check("stop_has_reason", "(outcome IN ('fault', 'aborted')) = (reason_code IS NOT NULL)"),
    check("reason_in_words", "(reason_code IS NULL) = (reason_text IS NULL)"),
    # Serves "all cycles of one vehicle".
    Index(None, "vehicle_id"),
    # Serves reports of one station over a period.
    Index(None, "station", "received_utc"),
    # Serves the last cycle of one station, asked for at every start.
    Index(None, "station", "id"),
)

RAW_IS_COMPLETE = (
    "(toe_raw IS NULL) = (camber_raw IS NULL)",
    "(camber_raw_u IS NULL) = (camber_raw IS NULL)",
    "(toe_raw_u IS NULL) = (camber_raw IS NULL)",
    "(camber_raw IS NULL OR outcome = 'measured')",
)
POSSIBLE_RIDE_HEIGHT = (
    "ride_height IN ('corrected', 'not_known', 'missing', 'refused')",
    "ride_height_mm BETWEEN 0 AND 10000",
    "ride_height_u_mm BETWEEN 0 AND 1000",
    "design_height_mm BETWEEN 0 AND 10000",
)
CORRECTED_HEIGHT_IS_EXPLAINED = (
    "ride_height <> 'corrected' OR (ride_height_mm IS NOT NULL AND ride_height_u_mm IS NOT NULL"
    " AND design_height_mm IS NOT NULL)"
)
wheel_results = Table(
    "wheel_results",
    metadata,
    # Serves reading one cycle, and keeps a wheel from having two results in it.
    Column("cycle_id", ForeignKey(cycles.c.id), primary_key=True),
    Column("wheel", Text, primary_key=True),
    choice("outcome", WheelOutcome),
    choice("verdict", Verdict),
    Column("measured_utc", UtcDateTime),
    Column("device_time_s", Double),
    Column("camber", Double),
    Column("toe", Double),
    Column("camber_u", Double),
    Column("toe_u", Double),
    Column("coverage_factor", Double),
    Column("method", Text),
    Column("calibration_id", ForeignKey(calibrations.c.id)),
    # One of `zero_measurements`; no foreign key, because older records may name one that was kept elsewhere.
    Column("zero_measurement_id", Text),
    Column("reason_code", Text),
    Column("reason_text", Text),
    Column("camber_low", Double),
    Column("camber_high", Double),
    Column("toe_low", Double),
    Column("toe_high", Double),
    Column("guard_band", Boolean),
    Column("points_used", Integer),
    Column("residual_rms_mm", Double),
    Column("duration_s", Double),
    # Whether the shot fits its calibration; empty in records from before these were judged.
    Column("row_px", Double),
    Column("knock_evidence", Double),
    Column("warning", Text),
    Column("camber_unseen", Double),
    Column("toe_unseen", Double),
    # Whether a head was lost; empty where nothing was measured, and in older records that do not tell.
    Column("degraded", Boolean),
    # Of what the angles are; empty where the method of an older record does not tell.
    Column("kind", Text),
    Column("load_mm", Double),
    # Peak to peak, millimetres, and its highest accepted value.
    Column("run_out", Double),
    Column("run_out_u", Double),
    Column("run_out_high", Double),
    Column("run_out_phase", Double),
    Column("run_out_phase_u", Double),
    # The tyre widths' part of `toe_u`.
    Column("toe_tyre_u", Double),
    # As measured, where the angles above are those of straight ahead or of the design height.
    Column("camber_raw", Double),
    Column("toe_raw", Double),
    Column("camber_raw_u", Double),
    Column("toe_raw_u", Double),
    # What became of its ride height; empty where its vehicle type has no curve of it.
    Column("ride_height", Text),
    Column("ride_height_mm", Double),
    Column("ride_height_u_mm", Double),
    Column("design_height_mm", Double),
    check("wheel_not_empty", "wheel <> ''"),
    check(
        "measured_is_complete",
        "outcome <> 'measured' OR (camber IS NOT NULL AND toe IS NOT NULL AND camber_u IS NOT NULL"
        " AND toe_u IS NOT NULL AND method IS NOT NULL AND calibration_id IS NOT NULL"
        " AND measured_utc IS NOT NULL)",
    ),
    check(
        "unmeasured_has_no_angles",
        "outcome = 'measured' OR (camber IS NULL AND toe IS NULL AND camber_u IS NULL AND toe_u IS NULL)",
    ),
    check("unmeasured_has_no_verdict", "outcome = 'measured' OR verdict = 'none'"),
    check("unmeasured_has_reason", "outcome = 'measured' OR reason_code IS NOT NULL"),
    check("reason_in_words", "(reason_code IS NULL) = (reason_text IS NULL)"),
    check("ok_has_no_reason", "verdict <> 'ok' OR reason_code IS NULL"),
    check("verdict_is_explained", explained("camber", "toe")),
    check("ok_is_within_limits", within_limits("camber", "toe")),
    check("limits_in_order", *ordered("camber", "toe")),
    check(
        "possible_angles",
        *map(angle, ("camber", "toe", "camber_low", "camber_high", "toe_low", "toe_high")),
    ),
    check("possible_uncertainties", uncertainty("camber_u"), uncertainty("toe_u")),
    check("coverage_factor_positive", "coverage_factor > 0"),
    check("possible_quality", "points_used >= 0", "residual_rms_mm >= 0", "duration_s >= 0"),
    check("possible_kind", "kind IN ('tyre_plane', 'spin_axis')"),
    check("possible_load", "load_mm BETWEEN 0 AND 1000"),
    check("possible_run_out", "run_out BETWEEN 0 AND 1000", "run_out_u BETWEEN 0 AND 1000"),
    check("run_out_is_explained", "run_out IS NULL OR run_out_u IS NOT NULL"),
    check("possible_phase", angle("run_out_phase"), "run_out_phase_u BETWEEN 0 AND 3.2"),
    check("possible_tyre_share", "toe_tyre_u BETWEEN 0 AND 3.2"),
    check("raw_is_complete", *RAW_IS_COMPLETE),
    check("possible_raw_angles", angle("camber_raw"), angle("toe_raw")),
    check("possible_raw_uncertainties", uncertainty("camber_raw_u"), uncertainty("toe_raw_u")),
    check("possible_ride_height", *POSSIBLE_RIDE_HEIGHT),
    check("refused_height_has_no_verdict", "ride_height NOT IN ('missing', 'refused') OR verdict = 'none'"),
    check("corrected_height_is_explained", CORRECTED_HEIGHT_IS_EXPLAINED),
    # Serves "which wheels rest on this calibration", asked when one turns out bad.
    Index(None, "calibration_id"),
    # By far the largest table. Cycles count up in time, so each partition is a stretch of time that an
    # administrator can vacuum, back up or detach alone; `db.schema.partitions` makes them ahead of need.
    postgresql_partition_by="RANGE (cycle_id)",
)

axle_results = Table(
    "axle_results",
    metadata,
    Column("cycle_id", ForeignKey(cycles.c.id), primary_key=True),
    Column("axle", Text, primary_key=True),
    Column("total_toe", Double, nullable=False),
    Column("total_toe_u", Double, nullable=False),
    Column("camber_difference", Double, nullable=False),
    Column("camber_difference_u", Double, nullable=False),
    choice("verdict", Verdict),
    Column("total_toe_low", Double),
    Column("total_toe_high", Double),
    Column("camber_difference_low", Double),
    Column("camber_difference_high", Double),
    Column("guard_band", Boolean),
    Column("coverage_factor", Double),
    check("axle_not_empty", "axle <> ''"),
    check("verdict_is_explained", explained("total_toe", "camber_difference")),
    check("ok_is_within_limits", within_limits("total_toe", "camber_difference")),
    check("limits_in_order", *ordered("total_toe", "camber_difference")),
    check("possible_angles", angle("total_toe"), angle("camber_difference")),
    check("possible_uncertainties", uncertainty("total_toe_u"), uncertainty("camber_difference_u")),
    check("coverage_factor_positive", "coverage_factor > 0"),
)

vehicle_results = Table(
    "vehicle_results",
    metadata,
    Column("cycle_id", ForeignKey(cycles.c.id), primary_key=True),
    Column("thrust_angle", Double, nullable=False),
    Column("thrust_angle_u", Double, nullable=False),
    Column("thrust_sign", Text, nullable=False),
    Column("front_toe_left_to_thrust", Double, nullable=False),
    Column("front_toe_right_to_thrust", Double, nullable=False),
    choice("verdict", Verdict),
    Column("thrust_angle_low", Double),
    Column("thrust_angle_high", Double),
    Column("guard_band", Boolean),
    Column("coverage_factor", Double),
    check("thrust_sign", "thrust_sign IN ('left_positive', 'right_positive')"),
    check("verdict_is_explained", explained("thrust_angle")),
    check("ok_is_within_limits", within_limits("thrust_angle")),
    check("limits_in_order", *ordered("thrust_angle")),
    check(
        "possible_angles",
        *map(angle, ("thrust_angle", "front_toe_left_to_thrust", "front_toe_right_to_thrust")),
    ),
    check("possible_uncertainties", uncertainty("thrust_angle_u")),
    check("coverage_factor_positive", "coverage_factor > 0"),
)

events = Table(
    "events",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("utc", UtcDateTime, nullable=False),
    Column("monotonic_s", Double),
    Column("station", Text, nullable=False),
    choice("severity", Severity),
    Column("source", Text, nullable=False),
    Column("code", Text, nullable=False),
    Column("text", Text, nullable=False),
    # The cycle it is of. No foreign key: it may be told of one that was not stored.
    Column("cycle_uuid", Uuid),
    # The number it tells, such as degrees Celsius.
    Column("value", Double),
    # Serves the refusal to store one event twice.
    UniqueConstraint("uuid"),
    check("code_not_empty", "code <> ''"),
    # Serves the events of one station over a period, beside its results.
    Index(None, "station", "utc"),
    # Serves the last events of one kind of a station.
    Index(None, "station", "code", "id"),
    # Serves "what became of this cycle", asked for at every start.
    Index(None, "cycle_uuid"),
)
