"""Plants, stations, rigs, dated limits; gauge studies with raw values; references to archived images."""

from typing import Any

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0004"
down_revision = "0003"

# SQLite counts up only in a column that is exactly INTEGER PRIMARY KEY.
COUNTER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
UTC = sa.DateTime(timezone=True)
CHOICE: dict[str, Any] = {"native_enum": False, "create_constraint": True, "length": 16}
DOCUMENT = sa.JSON(none_as_null=True).with_variant(postgresql.JSONB(none_as_null=True), "postgresql")
TABLES = (
    "plants",
    "stations",
    "station_versions",
    "rigs",
    "installations",
    "vehicle_type_limits",
    "gauge_studies",
    "gauge_values",
    "archived_shots",
    "archive_removals",
)
REFUSAL = "stored results are never changed or deleted: write a new record"


def upgrade() -> None:
    """Create the tables, then the triggers that keep what is stored."""
    op.create_table(
        "gauge_studies",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column(
            "kind", sa.Enum("type1", "grr", "linearity", "stability", name="kind", **CHOICE), nullable=False
        ),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("station", sa.Text()),
        sa.Column("characteristic", sa.Text(), nullable=False),
        sa.Column("plan", DOCUMENT, nullable=False),
        sa.Column("comment", sa.Text(), nullable=False),
        sa.Column("software_version", sa.Text(), nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("characteristic <> ''", name=op.f("ck_gauge_studies_characteristic_not_empty")),
        sa.CheckConstraint("name <> ''", name=op.f("ck_gauge_studies_name_not_empty")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_gauge_studies")),
        sa.UniqueConstraint("uuid", name=op.f("uq_gauge_studies_uuid")),
    )
    op.create_index(op.f("ix_gauge_studies_kind_created_utc"), "gauge_studies", ["kind", "created_utc"])
    op.create_table(
        "plants",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.CheckConstraint("name <> ''", name=op.f("ck_plants_name_not_empty")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_plants")),
        sa.UniqueConstraint("name", name=op.f("uq_plants_name")),
    )
    op.create_table(
        "stations",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.CheckConstraint("name <> ''", name=op.f("ck_stations_name_not_empty")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_stations")),
        sa.UniqueConstraint("name", name=op.f("uq_stations_name")),
    )
    op.create_table(
        "gauge_values",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("study_id", COUNTER, nullable=False),
        sa.Column("part", sa.Text(), nullable=False),
        sa.Column("appraiser", sa.Text(), nullable=False),
        sa.Column("trial", sa.Integer(), nullable=False),
        sa.Column("value", sa.Double(), nullable=False),
        sa.Column("utc", UTC),
        sa.Column("cycle", sa.Uuid()),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("trial > 0", name=op.f("ck_gauge_values_trial_positive")),
        sa.CheckConstraint("value BETWEEN -1e300 AND 1e300", name=op.f("ck_gauge_values_possible_value")),
        sa.ForeignKeyConstraint(["study_id"], ["gauge_studies.id"], name=op.f("fk_gauge_values_study_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_gauge_values")),
        sa.UniqueConstraint("uuid", name=op.f("uq_gauge_values_uuid")),
    )
    op.create_index(
        op.f("ix_gauge_values_study_id_part_appraiser_trial"),
        "gauge_values",
        ["study_id", "part", "appraiser", "trial"],
    )
    op.create_table(
        "rigs",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("station_id", COUNTER, nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.CheckConstraint("name <> ''", name=op.f("ck_rigs_name_not_empty")),
        sa.ForeignKeyConstraint(["station_id"], ["stations.id"], name=op.f("fk_rigs_station_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_rigs")),
        sa.UniqueConstraint("station_id", "name", name=op.f("uq_rigs_station_id_name")),
    )
    op.create_table(
        "station_versions",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("station_id", COUNTER, nullable=False),
        sa.Column("plant_id", COUNTER, nullable=False),
        sa.Column("valid_from_utc", UTC, nullable=False),
        sa.Column("label", sa.Text(), nullable=False),
        sa.Column("software_version", sa.Text(), nullable=False),
        sa.Column("config_hash", sa.Text(), nullable=False),
        sa.Column("configuration", DOCUMENT, nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("config_hash <> ''", name=op.f("ck_station_versions_config_hash_not_empty")),
        sa.ForeignKeyConstraint(["plant_id"], ["plants.id"], name=op.f("fk_station_versions_plant_id")),
        sa.ForeignKeyConstraint(["station_id"], ["stations.id"], name=op.f("fk_station_versions_station_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_station_versions")),
        sa.UniqueConstraint("uuid", name=op.f("uq_station_versions_uuid")),
    )
    op.create_index(op.f("ix_station_versions_plant_id"), "station_versions", ["plant_id"])
    op.create_index(
        op.f("ix_station_versions_station_id_config_hash_valid_from_utc"),
        "station_versions",
        ["station_id", "config_hash", "valid_from_utc"],
    )
    op.create_table(
        "vehicle_type_limits",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("station_id", COUNTER, nullable=False),
        sa.Column("vehicle_type", sa.Text(), nullable=False),
        sa.Column("valid_from_utc", UTC, nullable=False),
        sa.Column("guard_band", sa.Boolean(), nullable=False),
        sa.Column("limits", DOCUMENT, nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("vehicle_type <> ''", name=op.f("ck_vehicle_type_limits_vehicle_type_not_empty")),
        sa.ForeignKeyConstraint(
            ["station_id"], ["stations.id"], name=op.f("fk_vehicle_type_limits_station_id")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_vehicle_type_limits")),
        sa.UniqueConstraint("uuid", name=op.f("uq_vehicle_type_limits_uuid")),
    )
    op.create_index(
        op.f("ix_vehicle_type_limits_station_id_vehicle_type_valid_from_utc"),
        "vehicle_type_limits",
        ["station_id", "vehicle_type", "valid_from_utc"],
    )
    op.create_table(
        "archived_shots",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("cycle_id", COUNTER, nullable=False),
        sa.Column("wheel", sa.Text(), nullable=False),
        sa.Column("path", sa.Text(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.Column("archived_utc", UTC, nullable=False),
        sa.Column("retention", sa.Enum("ordinary", "evidence", name="retention", **CHOICE), nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("path <> ''", name=op.f("ck_archived_shots_path_not_empty")),
        sa.CheckConstraint("bytes >= 0", name=op.f("ck_archived_shots_possible_size")),
        sa.ForeignKeyConstraint(["cycle_id"], ["cycles.id"], name=op.f("fk_archived_shots_cycle_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_archived_shots")),
        sa.UniqueConstraint("uuid", name=op.f("uq_archived_shots_uuid")),
    )
    op.create_index(op.f("ix_archived_shots_cycle_id_wheel"), "archived_shots", ["cycle_id", "wheel"])
    op.create_index(
        op.f("ix_archived_shots_retention_archived_utc"), "archived_shots", ["retention", "archived_utc"]
    )
    op.create_table(
        "installations",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("rig_id", COUNTER, nullable=False),
        sa.Column("calibration_id", sa.Text(), nullable=False),
        sa.Column("from_utc", UTC, nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.ForeignKeyConstraint(
            ["calibration_id"], ["calibrations.id"], name=op.f("fk_installations_calibration_id")
        ),
        sa.ForeignKeyConstraint(["rig_id"], ["rigs.id"], name=op.f("fk_installations_rig_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_installations")),
        sa.UniqueConstraint("uuid", name=op.f("uq_installations_uuid")),
    )
    op.create_index(op.f("ix_installations_calibration_id"), "installations", ["calibration_id"])
    op.create_index(op.f("ix_installations_rig_id_from_utc"), "installations", ["rig_id", "from_utc"])
    op.create_table(
        "archive_removals",
        sa.Column("shot_id", COUNTER, nullable=False),
        sa.Column("utc", UTC, nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.CheckConstraint("reason <> ''", name=op.f("ck_archive_removals_reason_not_empty")),
        sa.ForeignKeyConstraint(["shot_id"], ["archived_shots.id"], name=op.f("fk_archive_removals_shot_id")),
        sa.PrimaryKeyConstraint("shot_id", name=op.f("pk_archive_removals")),
    )
    for table in TABLES:
        _keep_rows(table)


def _keep_rows(table: str) -> None:
    if op.get_bind().dialect.name == "sqlite":
        for change in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER {table}_no_{change.lower()} BEFORE {change} ON {table}"
                f" BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
            )
    else:
        op.execute(
            f"CREATE TRIGGER {table}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {table}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
