"""The first schema: vehicles, cycles, results of wheels, axles and vehicles, calibrations, events."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

# SQLite counts up only in a column that is exactly INTEGER PRIMARY KEY.
COUNTER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
UTC = sa.DateTime(timezone=True)
CHOICE: dict[str, Any] = {"native_enum": False, "create_constraint": True, "length": 16}
TABLES = (
    "vehicles",
    "calibrations",
    "cycles",
    "wheel_results",
    "axle_results",
    "vehicle_results",
    "events",
)
REFUSAL = "stored results are never changed or deleted: write a new record"


def upgrade() -> None:
    """Create every table, then the triggers that keep what is stored."""
    op.create_table(
        "calibrations",
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("rig", sa.Text(), nullable=False),
        sa.Column("valid_from_utc", UTC, nullable=False),
        sa.Column("valid_until_utc", UTC),
        sa.Column("document", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("id <> ''", name=op.f("ck_calibrations_id_not_empty")),
        sa.CheckConstraint("valid_until_utc > valid_from_utc", name=op.f("ck_calibrations_validity")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_calibrations")),
    )
    op.create_index(op.f("ix_calibrations_rig_valid_from_utc"), "calibrations", ["rig", "valid_from_utc"])
    op.create_table(
        "events",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("utc", UTC, nullable=False),
        sa.Column("monotonic_s", sa.Double()),
        sa.Column("station", sa.Text(), nullable=False),
        sa.Column("severity", sa.Enum("info", "warning", "error", name="severity", **CHOICE), nullable=False),
        sa.Column("source", sa.Text(), nullable=False),
        sa.Column("code", sa.Text(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.CheckConstraint("code <> ''", name=op.f("ck_events_code_not_empty")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_events")),
        sa.UniqueConstraint("uuid", name=op.f("uq_events_uuid")),
    )
    op.create_index(op.f("ix_events_station_utc"), "events", ["station", "utc"])
    op.create_table(
        "vehicles",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("vin", sa.Text(), nullable=False),
        sa.Column("vehicle_type", sa.Text(), nullable=False),
        sa.CheckConstraint("vehicle_type <> ''", name=op.f("ck_vehicles_vehicle_type_not_empty")),
        sa.CheckConstraint("vin <> ''", name=op.f("ck_vehicles_vin_not_empty")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_vehicles")),
        sa.UniqueConstraint("vin", "vehicle_type", name=op.f("uq_vehicles_vin_vehicle_type")),
    )
    op.create_table(
        "cycles",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("station", sa.Text(), nullable=False),
        sa.Column("vehicle_id", COUNTER),
        sa.Column("trigger_sequence", sa.BigInteger(), nullable=False),
        sa.Column("received_utc", UTC, nullable=False),
        sa.Column("received_monotonic_s", sa.Double()),
        sa.Column("measured_utc", UTC),
        sa.Column("measured_monotonic_s", sa.Double()),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.Column("software_version", sa.Text(), nullable=False),
        sa.Column("config_hash", sa.Text(), nullable=False),
        sa.Column(
            "outcome", sa.Enum("ok", "nok", "fault", "aborted", name="outcome", **CHOICE), nullable=False
        ),
        sa.Column("reason_code", sa.Text()),
        sa.Column("reason_text", sa.Text()),
        sa.CheckConstraint(
            "(outcome IN ('fault', 'aborted')) = (reason_code IS NOT NULL)",
            name=op.f("ck_cycles_stop_has_reason"),
        ),
        sa.CheckConstraint("config_hash <> ''", name=op.f("ck_cycles_config_hash_not_empty")),
        sa.CheckConstraint(
            "outcome NOT IN ('ok', 'nok') OR (vehicle_id IS NOT NULL AND measured_utc IS NOT NULL)",
            name=op.f("ck_cycles_verdict_has_vehicle_and_time"),
        ),
        sa.CheckConstraint("software_version <> ''", name=op.f("ck_cycles_software_version_not_empty")),
        sa.CheckConstraint("station <> ''", name=op.f("ck_cycles_station_not_empty")),
        sa.CheckConstraint(
            "(reason_code IS NULL) = (reason_text IS NULL)", name=op.f("ck_cycles_reason_in_words")
        ),
        sa.CheckConstraint(
            "measured_monotonic_s >= received_monotonic_s", name=op.f("ck_cycles_monotonic_order")
        ),
        sa.CheckConstraint("trigger_sequence >= 0", name=op.f("ck_cycles_trigger_sequence_not_negative")),
        sa.ForeignKeyConstraint(["vehicle_id"], ["vehicles.id"], name=op.f("fk_cycles_vehicle_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_cycles")),
        sa.UniqueConstraint("uuid", name=op.f("uq_cycles_uuid")),
    )
    op.create_index(op.f("ix_cycles_station_received_utc"), "cycles", ["station", "received_utc"])
    op.create_index(op.f("ix_cycles_vehicle_id"), "cycles", ["vehicle_id"])
    op.create_table(
        "axle_results",
        sa.Column("cycle_id", COUNTER, nullable=False),
        sa.Column("axle", sa.Text(), nullable=False),
        sa.Column("total_toe", sa.Double(), nullable=False),
        sa.Column("total_toe_u", sa.Double(), nullable=False),
        sa.Column("camber_difference", sa.Double(), nullable=False),
        sa.Column("camber_difference_u", sa.Double(), nullable=False),
        sa.Column("verdict", sa.Enum("ok", "nok", "none", name="verdict", **CHOICE), nullable=False),
        sa.Column("total_toe_low", sa.Double()),
        sa.Column("total_toe_high", sa.Double()),
        sa.Column("camber_difference_low", sa.Double()),
        sa.Column("camber_difference_high", sa.Double()),
        sa.Column("guard_band", sa.Boolean()),
        sa.Column("coverage_factor", sa.Double()),
        sa.CheckConstraint("axle <> ''", name=op.f("ck_axle_results_axle_not_empty")),
        sa.CheckConstraint(
            (
                "verdict <> 'ok' OR ((total_toe_low IS NULL OR total_toe >= total_toe_low) AND"
                " (total_toe_high IS NULL OR total_toe <= total_toe_high) AND (camber_difference_low IS"
                " NULL OR camber_difference >= camber_difference_low) AND (camber_difference_high IS NULL"
                " OR camber_difference <= camber_difference_high))"
            ),
            name=op.f("ck_axle_results_ok_is_within_limits"),
        ),
        sa.CheckConstraint(
            (
                "verdict = 'none' OR (guard_band IS NOT NULL AND coverage_factor IS NOT NULL AND"
                " (total_toe_low IS NOT NULL OR total_toe_high IS NOT NULL OR camber_difference_low IS"
                " NOT NULL OR camber_difference_high IS NOT NULL))"
            ),
            name=op.f("ck_axle_results_verdict_is_explained"),
        ),
        sa.CheckConstraint(
            (
                "(total_toe_u > 0 AND total_toe_u <= 3.2) AND (camber_difference_u > 0 AND"
                " camber_difference_u <= 3.2)"
            ),
            name=op.f("ck_axle_results_possible_uncertainties"),
        ),
        sa.CheckConstraint("coverage_factor > 0", name=op.f("ck_axle_results_coverage_factor_positive")),
        sa.CheckConstraint(
            "total_toe BETWEEN -3.2 AND 3.2 AND camber_difference BETWEEN -3.2 AND 3.2",
            name=op.f("ck_axle_results_possible_angles"),
        ),
        sa.CheckConstraint(
            "total_toe_low <= total_toe_high AND camber_difference_low <= camber_difference_high",
            name=op.f("ck_axle_results_limits_in_order"),
        ),
        sa.ForeignKeyConstraint(["cycle_id"], ["cycles.id"], name=op.f("fk_axle_results_cycle_id")),
        sa.PrimaryKeyConstraint("cycle_id", "axle", name=op.f("pk_axle_results")),
    )
    op.create_table(
        "vehicle_results",
        sa.Column("cycle_id", COUNTER, nullable=False),
        sa.Column("thrust_angle", sa.Double(), nullable=False),
        sa.Column("thrust_angle_u", sa.Double(), nullable=False),
        sa.Column("thrust_sign", sa.Text(), nullable=False),
        sa.Column("front_toe_left_to_thrust", sa.Double(), nullable=False),
        sa.Column("front_toe_right_to_thrust", sa.Double(), nullable=False),
        sa.Column("verdict", sa.Enum("ok", "nok", "none", name="verdict", **CHOICE), nullable=False),
        sa.Column("thrust_angle_low", sa.Double()),
        sa.Column("thrust_angle_high", sa.Double()),
        sa.Column("guard_band", sa.Boolean()),
        sa.Column("coverage_factor", sa.Double()),
        sa.CheckConstraint(
            "thrust_sign IN ('left_positive', 'right_positive')", name=op.f("ck_vehicle_results_thrust_sign")
        ),
        sa.CheckConstraint(
            (
                "verdict <> 'ok' OR ((thrust_angle_low IS NULL OR thrust_angle >= thrust_angle_low) AND"
                " (thrust_angle_high IS NULL OR thrust_angle <= thrust_angle_high))"
            ),
            name=op.f("ck_vehicle_results_ok_is_within_limits"),
        ),
        sa.CheckConstraint(
            (
                "verdict = 'none' OR (guard_band IS NOT NULL AND coverage_factor IS NOT NULL AND"
                " (thrust_angle_low IS NOT NULL OR thrust_angle_high IS NOT NULL))"
            ),
            name=op.f("ck_vehicle_results_verdict_is_explained"),
        ),
        sa.CheckConstraint(
            "(thrust_angle_u > 0 AND thrust_angle_u <= 3.2)",
            name=op.f("ck_vehicle_results_possible_uncertainties"),
        ),
        sa.CheckConstraint("coverage_factor > 0", name=op.f("ck_vehicle_results_coverage_factor_positive")),
        sa.CheckConstraint(
            (
                "thrust_angle BETWEEN -3.2 AND 3.2 AND front_toe_left_to_thrust BETWEEN -3.2 AND 3.2 AND"
                " front_toe_right_to_thrust BETWEEN -3.2 AND 3.2"
            ),
            name=op.f("ck_vehicle_results_possible_angles"),
        ),
        sa.CheckConstraint(
            "thrust_angle_low <= thrust_angle_high", name=op.f("ck_vehicle_results_limits_in_order")
        ),
        sa.ForeignKeyConstraint(["cycle_id"], ["cycles.id"], name=op.f("fk_vehicle_results_cycle_id")),
        sa.PrimaryKeyConstraint("cycle_id", name=op.f("pk_vehicle_results")),
    )
    op.create_table(
        "wheel_results",
        sa.Column("cycle_id", COUNTER, nullable=False),
        sa.Column("wheel", sa.Text(), nullable=False),
        sa.Column(
            "outcome", sa.Enum("measured", "refused", "fault", name="outcome", **CHOICE), nullable=False
        ),
        sa.Column("verdict", sa.Enum("ok", "nok", "none", name="verdict", **CHOICE), nullable=False),
        sa.Column("measured_utc", UTC),
        sa.Column("device_time_s", sa.Double()),
        sa.Column("camber", sa.Double()),
        sa.Column("toe", sa.Double()),
        sa.Column("camber_u", sa.Double()),
        sa.Column("toe_u", sa.Double()),
        sa.Column("coverage_factor", sa.Double()),
        sa.Column("method", sa.Text()),
        sa.Column("calibration_id", sa.Text()),
        sa.Column("zero_measurement_id", sa.Text()),
        sa.Column("reason_code", sa.Text()),
        sa.Column("reason_text", sa.Text()),
        sa.Column("camber_low", sa.Double()),
        sa.Column("camber_high", sa.Double()),
        sa.Column("toe_low", sa.Double()),
        sa.Column("toe_high", sa.Double()),
        sa.Column("guard_band", sa.Boolean()),
        sa.Column("points_used", sa.Integer()),
        sa.Column("residual_rms_mm", sa.Double()),
        sa.Column("duration_s", sa.Double()),
        sa.CheckConstraint(
            (
                "outcome <> 'measured' OR (camber IS NOT NULL AND toe IS NOT NULL AND camber_u IS NOT"
                " NULL AND toe_u IS NOT NULL AND method IS NOT NULL AND calibration_id IS NOT NULL AND"
                " measured_utc IS NOT NULL)"
            ),
            name=op.f("ck_wheel_results_measured_is_complete"),
        ),
        sa.CheckConstraint(
            (
                "outcome = 'measured' OR (camber IS NULL AND toe IS NULL AND camber_u IS NULL AND toe_u"
                " IS NULL)"
            ),
            name=op.f("ck_wheel_results_unmeasured_has_no_angles"),
        ),
        sa.CheckConstraint(
            "outcome = 'measured' OR reason_code IS NOT NULL",
            name=op.f("ck_wheel_results_unmeasured_has_reason"),
        ),
        sa.CheckConstraint(
            "outcome = 'measured' OR verdict = 'none'",
            name=op.f("ck_wheel_results_unmeasured_has_no_verdict"),
        ),
        sa.CheckConstraint(
            (
                "verdict <> 'ok' OR ((camber_low IS NULL OR camber >= camber_low) AND (camber_high IS"
                " NULL OR camber <= camber_high) AND (toe_low IS NULL OR toe >= toe_low) AND (toe_high IS"
                " NULL OR toe <= toe_high))"
            ),
            name=op.f("ck_wheel_results_ok_is_within_limits"),
        ),
        sa.CheckConstraint(
            "verdict <> 'ok' OR reason_code IS NULL", name=op.f("ck_wheel_results_ok_has_no_reason")
        ),
        sa.CheckConstraint(
            (
                "verdict = 'none' OR (guard_band IS NOT NULL AND coverage_factor IS NOT NULL AND"
                " (camber_low IS NOT NULL OR camber_high IS NOT NULL OR toe_low IS NOT NULL OR toe_high"
                " IS NOT NULL))"
            ),
            name=op.f("ck_wheel_results_verdict_is_explained"),
        ),
        sa.CheckConstraint("wheel <> ''", name=op.f("ck_wheel_results_wheel_not_empty")),
        sa.CheckConstraint(
            "(camber_u > 0 AND camber_u <= 3.2) AND (toe_u > 0 AND toe_u <= 3.2)",
            name=op.f("ck_wheel_results_possible_uncertainties"),
        ),
        sa.CheckConstraint(
            "(reason_code IS NULL) = (reason_text IS NULL)", name=op.f("ck_wheel_results_reason_in_words")
        ),
        sa.CheckConstraint(
            (
                "camber BETWEEN -3.2 AND 3.2 AND toe BETWEEN -3.2 AND 3.2 AND camber_low BETWEEN -3.2 AND"
                " 3.2 AND camber_high BETWEEN -3.2 AND 3.2 AND toe_low BETWEEN -3.2 AND 3.2 AND toe_high"
                " BETWEEN -3.2 AND 3.2"
            ),
            name=op.f("ck_wheel_results_possible_angles"),
        ),
        sa.CheckConstraint(
            "camber_low <= camber_high AND toe_low <= toe_high", name=op.f("ck_wheel_results_limits_in_order")
        ),
        sa.CheckConstraint("coverage_factor > 0", name=op.f("ck_wheel_results_coverage_factor_positive")),
        sa.CheckConstraint(
            "points_used >= 0 AND residual_rms_mm >= 0 AND duration_s >= 0",
            name=op.f("ck_wheel_results_possible_quality"),
        ),
        sa.ForeignKeyConstraint(
            ["calibration_id"], ["calibrations.id"], name=op.f("fk_wheel_results_calibration_id")
        ),
        sa.ForeignKeyConstraint(["cycle_id"], ["cycles.id"], name=op.f("fk_wheel_results_cycle_id")),
        sa.PrimaryKeyConstraint("cycle_id", "wheel", name=op.f("pk_wheel_results")),
    )
    op.create_index(op.f("ix_wheel_results_calibration_id"), "wheel_results", ["calibration_id"])
    if op.get_bind().dialect.name == "sqlite":
        _keep_rows_in_sqlite()
    else:
        _keep_rows_in_postgresql()


def _keep_rows_in_sqlite() -> None:
    for table in TABLES:
        for change in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER {table}_no_{change.lower()} BEFORE {change} ON {table}"
                f" BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
            )


def _keep_rows_in_postgresql() -> None:
    op.execute(
        "CREATE FUNCTION refuse_change() RETURNS trigger LANGUAGE plpgsql AS"
        f" $$ BEGIN RAISE EXCEPTION '{REFUSAL}' USING ERRCODE = 'restrict_violation'; END $$"
    )
    for table in TABLES:
        op.execute(
            f"CREATE TRIGGER {table}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {table}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
