"""Vehicles that are released although they are not ok: who, why, beyond what; and releases taken back."""

from typing import Any

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0017"
down_revision = "0016"

REFUSAL = "stored results are never changed or deleted: write a new record"
COUNTER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
UTC = sa.DateTime(timezone=True)
DOCUMENT: Any = sa.JSON(none_as_null=True).with_variant(postgresql.JSONB(none_as_null=True), "postgresql")
# Columns that tell a row from every other of its table, in SQLite.
KEYS = {"concessions": ("rowid", "uuid"), "concession_withdrawals": ("concession_id",)}


def upgrade() -> None:
    """Make both tables; nothing of before is a concession."""
    op.create_table(
        "concessions",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("cycle_id", COUNTER, nullable=False),
        sa.Column("utc", UTC, nullable=False),
        sa.Column("person", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("exceeded", DOCUMENT, nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        *_said("concessions"),
        sa.ForeignKeyConstraint(["cycle_id"], ["cycles.id"], name=op.f("fk_concessions_cycle_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_concessions")),
        sa.UniqueConstraint("uuid", name=op.f("uq_concessions_uuid")),
    )
    op.create_index(op.f("ix_concessions_cycle_id"), "concessions", ["cycle_id"])
    op.create_table(
        "concession_withdrawals",
        sa.Column("concession_id", COUNTER, nullable=False),
        sa.Column("utc", UTC, nullable=False),
        sa.Column("person", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("stored_utc", UTC, nullable=False),
        *_said("concession_withdrawals"),
        sa.ForeignKeyConstraint(
            ["concession_id"], ["concessions.id"], name=op.f("fk_concession_withdrawals_concession_id")
        ),
        sa.PrimaryKeyConstraint("concession_id", name=op.f("pk_concession_withdrawals")),
    )
    for table, keys in KEYS.items():
        _keep_rows(table, keys)


def _said(table: str) -> list[sa.CheckConstraint]:
    return [
        sa.CheckConstraint(f"{name} <> ''", name=op.f(f"ck_{table}_{name}_not_empty"))
        for name in ("person", "reason")
    ]


def _keep_rows(table: str, keys: tuple[str, ...]) -> None:
    if op.get_bind().dialect.name != "sqlite":
        op.execute(
            f"CREATE TRIGGER {table}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {table}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
        return
    refuse = f"BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
    for change in ("UPDATE", "DELETE"):
        op.execute(f"CREATE TRIGGER {table}_no_{change.lower()} BEFORE {change} ON {table} {refuse}")
    known = " OR ".join(f"EXISTS (SELECT 1 FROM {table} WHERE {key} = NEW.{key})" for key in keys)
    op.execute(f"CREATE TRIGGER {table}_no_replace BEFORE INSERT ON {table} WHEN {known} {refuse}")
