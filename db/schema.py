"""The tables, as this program expects them; `db/migrations` builds them.

Only migrations create tables, so that a database and its revision never disagree; a test holds this module
and the migrations equal. Every CHECK makes rows impossible that would lie: an OK without a value, a fault
with a verdict. Angles are radians, times UTC. Triggers of the first migration refuse every UPDATE and DELETE.
"""

from __future__ import annotations

import enum
from datetime import UTC, datetime

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    CheckConstraint,
    Column,
    DateTime,
    Dialect,
    Double,
    Enum,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    Table,
    Text,
    TypeDecorator,
    UniqueConstraint,
    Uuid,
)

from db.records import CheckKind, CheckOutcome, CycleOutcome, Severity, Verdict, WheelOutcome

NAMING_CONVENTION = {
    "pk": "pk_%(table_name)s",
    "fk": "fk_%(table_name)s_%(column_0_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
}


class UtcDateTime(TypeDecorator[datetime]):
    """An aware time, kept as UTC; SQLite knows no zones, so it gets the bare UTC time."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """To the database: converted to UTC."""
        if value is None:
            return None
        utc = value.astimezone(UTC)
        return utc.replace(tzinfo=None) if dialect.name == "sqlite" else utc

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """From the database: always aware, always UTC."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if dialect.name == "sqlite" else value.astimezone(UTC)


def _id() -> Column[int]:
    # SQLite counts up only in a column that is exactly INTEGER PRIMARY KEY.
    return Column("id", BigInteger().with_variant(Integer, "sqlite"), primary_key=True)


def _choice(name: str, values: type[enum.StrEnum]) -> Column[str]:
    kind = Enum(
        values, name=name, native_enum=False, create_constraint=True, length=16,
        values_callable=lambda members: [member.value for member in members],
    )  # fmt: skip
    return Column(name, kind, nullable=False)


def _check(name: str, *conditions: str) -> CheckConstraint:
    return CheckConstraint(" AND ".join(conditions), name=name)


def _angle(name: str) -> str:
    # A range also keeps out NaN, which PostgreSQL sorts above every number, and infinity.
    return f"{name} BETWEEN -3.2 AND 3.2"


def _uncertainty(name: str) -> str:
    return f"({name} > 0 AND {name} <= 3.2)"


def _ordered(*names: str) -> list[str]:
    return [f"{name}_low <= {name}_high" for name in names]


def _within(*names: str) -> str:
    bounds = " AND ".join(
        f"({name}_low IS NULL OR {name} >= {name}_low) AND ({name}_high IS NULL OR {name} <= {name}_high)"
        for name in names
    )
    return f"verdict <> 'ok' OR ({bounds})"


def _explained(*names: str) -> str:
    any_limit = " OR ".join(f"{name}_{end} IS NOT NULL" for name in names for end in ("low", "high"))
    return f"verdict = 'none' OR (guard_band IS NOT NULL AND coverage_factor IS NOT NULL AND ({any_limit}))"


metadata = MetaData(naming_convention=NAMING_CONVENTION)

vehicles = Table(
    "vehicles",
    metadata,
    _id(),
    Column("vin", Text, nullable=False),
    Column("vehicle_type", Text, nullable=False),
    # Serves "all results of one VIN". A VIN that comes back as another type is a second row: the type decides
    # the limits, so it is part of what happened.
    UniqueConstraint("vin", "vehicle_type"),
    _check("vin_not_empty", "vin <> ''"),
    _check("vehicle_type_not_empty", "vehicle_type <> ''"),
)

calibrations = Table(
    "calibrations",
    metadata,
    Column("id", Text, primary_key=True),
    Column("rig", Text, nullable=False),
    Column("valid_from_utc", UtcDateTime, nullable=False),
    Column("valid_until_utc", UtcDateTime),
    # JSON and not JSONB: evidence is kept to the letter, and JSONB rewrites large numbers.
    Column("document", JSON(none_as_null=True), nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    _check("id_not_empty", "id <> ''"),
    _check("validity", "valid_until_utc > valid_from_utc"),
    # Serves "the calibrations of one rig, newest first".
    Index(None, "rig", "valid_from_utc"),
)

calibration_checks = Table(
    "calibration_checks",
    metadata,
    _id(),
    Column("uuid", Uuid, nullable=False),
    Column("calibration_id", ForeignKey(calibrations.c.id), nullable=False),
    Column("predecessor_id", ForeignKey(calibrations.c.id)),
    Column("utc", UtcDateTime, nullable=False),
    _choice("kind", CheckKind),
    _choice("outcome", CheckOutcome),
    Column("reason", Text, nullable=False),
    Column("as_found", JSON(none_as_null=True)),
    Column("as_left", JSON(none_as_null=True)),
    Column("stored_utc", UtcDateTime, nullable=False),
    # Serves the refusal to store one check twice.
    UniqueConstraint("uuid"),
    _check("reason_not_empty", "reason <> ''"),
    _check("has_figures", "as_found IS NOT NULL OR as_left IS NOT NULL"),
    _check(
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
    _check("id_not_empty", "id <> ''"),
    _check("rig_not_empty", "rig <> ''"),
    _check("shots_positive", "shots > 0"),
    _check("possible_angles", *map(_angle, ("camber", "toe", "certified_camber", "certified_toe"))),
    _check("possible_uncertainties", _uncertainty("camber_u"), _uncertainty("toe_u")),
    _check("possible_correlation", "correlation BETWEEN -1 AND 1"),
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
    _check("reason_not_empty", "reason <> ''"),
)

cycles = Table(
    "cycles",
    metadata,
    _id(),
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
    _choice("outcome", CycleOutcome),
    Column("reason_code", Text),
    Column("reason_text", Text),
    # Serves the refusal to store one cycle twice, and reading one cycle.
    UniqueConstraint("uuid"),
    _check("trigger_sequence_not_negative", "trigger_sequence >= 0"),
    _check("station_not_empty", "station <> ''"),
    _check("software_version_not_empty", "software_version <> ''"),
    _check("config_hash_not_empty", "config_hash <> ''"),
    # Only the monotonic clock is compared: the wall clock may be set back.
    _check("monotonic_order", "measured_monotonic_s >= received_monotonic_s"),
    _check(
        "verdict_has_vehicle_and_time",
        "outcome NOT IN ('ok', 'nok') OR (vehicle_id IS NOT NULL AND measured_utc IS NOT NULL)",
    ),
    _check("stop_has_reason", "(outcome IN ('fault', 'aborted')) = (reason_code IS NOT NULL)"),
    _check("reason_in_words", "(reason_code IS NULL) = (reason_text IS NULL)"),
    # Serves "all cycles of one vehicle".
    Index(None, "vehicle_id"),
    # Serves reports of one station over a period.
    Index(None, "station", "received_utc"),
)

wheel_results = Table(
    "wheel_results",
    metadata,
    # Serves reading one cycle, and keeps a wheel from having two results in it.
    Column("cycle_id", ForeignKey(cycles.c.id), primary_key=True),
    Column("wheel", Text, primary_key=True),
    _choice("outcome", WheelOutcome),
    _choice("verdict", Verdict),
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
    _check("wheel_not_empty", "wheel <> ''"),
    _check(
        "measured_is_complete",
        "outcome <> 'measured' OR (camber IS NOT NULL AND toe IS NOT NULL AND camber_u IS NOT NULL"
        " AND toe_u IS NOT NULL AND method IS NOT NULL AND calibration_id IS NOT NULL"
        " AND measured_utc IS NOT NULL)",
    ),
    _check(
        "unmeasured_has_no_angles",
        "outcome = 'measured' OR (camber IS NULL AND toe IS NULL AND camber_u IS NULL AND toe_u IS NULL)",
    ),
    _check("unmeasured_has_no_verdict", "outcome = 'measured' OR verdict = 'none'"),
    _check("unmeasured_has_reason", "outcome = 'measured' OR reason_code IS NOT NULL"),
    _check("reason_in_words", "(reason_code IS NULL) = (reason_text IS NULL)"),
    _check("ok_has_no_reason", "verdict <> 'ok' OR reason_code IS NULL"),
    _check("verdict_is_explained", _explained("camber", "toe")),
    _check("ok_is_within_limits", _within("camber", "toe")),
    _check("limits_in_order", *_ordered("camber", "toe")),
    _check(
        "possible_angles",
        *map(_angle, ("camber", "toe", "camber_low", "camber_high", "toe_low", "toe_high")),
    ),
    _check("possible_uncertainties", _uncertainty("camber_u"), _uncertainty("toe_u")),
    _check("coverage_factor_positive", "coverage_factor > 0"),
    _check("possible_quality", "points_used >= 0", "residual_rms_mm >= 0", "duration_s >= 0"),
    # Serves "which wheels rest on this calibration", asked when one turns out bad.
    Index(None, "calibration_id"),
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
    _choice("verdict", Verdict),
    Column("total_toe_low", Double),
    Column("total_toe_high", Double),
    Column("camber_difference_low", Double),
    Column("camber_difference_high", Double),
    Column("guard_band", Boolean),
    Column("coverage_factor", Double),
    _check("axle_not_empty", "axle <> ''"),
    _check("verdict_is_explained", _explained("total_toe", "camber_difference")),
    _check("ok_is_within_limits", _within("total_toe", "camber_difference")),
    _check("limits_in_order", *_ordered("total_toe", "camber_difference")),
    _check("possible_angles", _angle("total_toe"), _angle("camber_difference")),
    _check("possible_uncertainties", _uncertainty("total_toe_u"), _uncertainty("camber_difference_u")),
    _check("coverage_factor_positive", "coverage_factor > 0"),
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
    _choice("verdict", Verdict),
    Column("thrust_angle_low", Double),
    Column("thrust_angle_high", Double),
    Column("guard_band", Boolean),
    Column("coverage_factor", Double),
    _check("thrust_sign", "thrust_sign IN ('left_positive', 'right_positive')"),
    _check("verdict_is_explained", _explained("thrust_angle")),
    _check("ok_is_within_limits", _within("thrust_angle")),
    _check("limits_in_order", *_ordered("thrust_angle")),
    _check(
        "possible_angles",
        *map(_angle, ("thrust_angle", "front_toe_left_to_thrust", "front_toe_right_to_thrust")),
    ),
    _check("possible_uncertainties", _uncertainty("thrust_angle_u")),
    _check("coverage_factor_positive", "coverage_factor > 0"),
)

events = Table(
    "events",
    metadata,
    _id(),
    Column("uuid", Uuid, nullable=False),
    Column("utc", UtcDateTime, nullable=False),
    Column("monotonic_s", Double),
    Column("station", Text, nullable=False),
    _choice("severity", Severity),
    Column("source", Text, nullable=False),
    Column("code", Text, nullable=False),
    Column("text", Text, nullable=False),
    # Serves the refusal to store one event twice.
    UniqueConstraint("uuid"),
    _check("code_not_empty", "code <> ''"),
    # Serves the events of one station over a period, beside its results.
    Index(None, "station", "utc"),
)
