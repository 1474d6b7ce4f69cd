"""Checks of calibrations: what a plate or a master wheel said of one, as found and as left."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

# SQLite counts up only in a column that is exactly INTEGER PRIMARY KEY.
COUNTER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
UTC = sa.DateTime(timezone=True)
CHOICE: dict[str, Any] = {"native_enum": False, "create_constraint": True, "length": 16}
TABLE = "calibration_checks"
REFUSAL = "stored results are never changed or deleted: write a new record"


def upgrade() -> None:
    """Create the table, then the triggers that keep what is stored."""
    op.create_table(
        TABLE,
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("calibration_id", sa.Text(), nullable=False),
        sa.Column("predecessor_id", sa.Text()),
        sa.Column("utc", UTC, nullable=False),
        sa.Column("kind", sa.Enum("plate_session", "master_wheel", name="kind", **CHOICE), nullable=False),
        sa.Column("outcome", sa.Enum("within", "out", name="outcome", **CHOICE), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("as_found", sa.JSON(none_as_null=True)),
        sa.Column("as_left", sa.JSON(none_as_null=True)),
        sa.Column("stored_utc", UTC, nullable=False),
        sa.CheckConstraint("reason <> ''", name=op.f("ck_calibration_checks_reason_not_empty")),
        sa.CheckConstraint(
            "as_found IS NOT NULL OR as_left IS NOT NULL", name=op.f("ck_calibration_checks_has_figures")
        ),
        sa.CheckConstraint(
            "predecessor_id IS NULL OR (as_found IS NOT NULL AND as_left IS NOT NULL AND predecessor_id <>"
            " calibration_id)",
            name=op.f("ck_calibration_checks_successor_has_both"),
        ),
        sa.ForeignKeyConstraint(
            ["calibration_id"], ["calibrations.id"], name=op.f("fk_calibration_checks_calibration_id")
        ),
        sa.ForeignKeyConstraint(
            ["predecessor_id"], ["calibrations.id"], name=op.f("fk_calibration_checks_predecessor_id")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_calibration_checks")),
        sa.UniqueConstraint("uuid", name=op.f("uq_calibration_checks_uuid")),
    )
    op.create_index(op.f("ix_calibration_checks_calibration_id_utc"), TABLE, ["calibration_id", "utc"])
    if op.get_bind().dialect.name == "sqlite":
        for change in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER {TABLE}_no_{change.lower()} BEFORE {change} ON {TABLE}"
                f" BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
            )
    else:
        op.execute(
            f"CREATE TRIGGER {TABLE}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {TABLE}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
