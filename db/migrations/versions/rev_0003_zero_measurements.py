"""Zero measurements against master wheels, and their revocations."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"

UTC = sa.DateTime(timezone=True)
TABLES = ("zero_measurements", "zero_revocations")
REFUSAL = "stored results are never changed or deleted: write a new record"


def upgrade() -> None:
    """Create the tables, then the triggers that keep what is stored."""
    op.create_table(
        "zero_measurements",
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("rig", sa.Text(), nullable=False),
        sa.Column("calibration_id", sa.Text(), nullable=False),
        sa.Column("measured_utc", UTC, nullable=False),
        sa.Column("master", sa.Text(), nullable=False),
        sa.Column("method", sa.Text(), nullable=False),
        sa.Column("shots", sa.Integer(), nullable=False),
        sa.Column("camber", sa.Double(), nullable=False),
        sa.Column("toe", sa.Double(), nullable=False),
        sa.Column("certified_camber", sa.Double(), nullable=False),
        sa.Column("certified_toe", sa.Double(), nullable=False),
        sa.Column("camber_u", sa.Double(), nullable=False),
        sa.Column("toe_u", sa.Double(), nullable=False),
        sa.Column("correlation", sa.Double(), nullable=False),
        sa.Column("software_version", sa.Text(), nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("id <> ''", name=op.f("ck_zero_measurements_id_not_empty")),
        sa.CheckConstraint("rig <> ''", name=op.f("ck_zero_measurements_rig_not_empty")),
        sa.CheckConstraint("shots > 0", name=op.f("ck_zero_measurements_shots_positive")),
        sa.CheckConstraint(
            "camber BETWEEN -3.2 AND 3.2 AND toe BETWEEN -3.2 AND 3.2 AND certified_camber BETWEEN -3.2 AND"
            " 3.2 AND certified_toe BETWEEN -3.2 AND 3.2",
            name=op.f("ck_zero_measurements_possible_angles"),
        ),
        sa.CheckConstraint(
            "(camber_u > 0 AND camber_u <= 3.2) AND (toe_u > 0 AND toe_u <= 3.2)",
            name=op.f("ck_zero_measurements_possible_uncertainties"),
        ),
        sa.CheckConstraint(
            "correlation BETWEEN -1 AND 1", name=op.f("ck_zero_measurements_possible_correlation")
        ),
        sa.ForeignKeyConstraint(
            ["calibration_id"], ["calibrations.id"], name=op.f("fk_zero_measurements_calibration_id")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_zero_measurements")),
    )
    op.create_index(
        op.f("ix_zero_measurements_rig_calibration_id_measured_utc"),
        "zero_measurements",
        ["rig", "calibration_id", "measured_utc"],
    )
    op.create_table(
        "zero_revocations",
        sa.Column("zero_id", sa.Text(), nullable=False),
        sa.Column("utc", UTC, nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("reason <> ''", name=op.f("ck_zero_revocations_reason_not_empty")),
        sa.ForeignKeyConstraint(
            ["zero_id"], ["zero_measurements.id"], name=op.f("fk_zero_revocations_zero_id")
        ),
        sa.PrimaryKeyConstraint("zero_id", name=op.f("pk_zero_revocations")),
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
