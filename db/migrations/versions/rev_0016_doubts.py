"""Doubt about what rigs measured since their last good master check, and the end of it."""

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"

REFUSAL = "stored results are never changed or deleted: write a new record"
KEYS = {"doubts": (("uuid",), ("cycle", "wheel")), "doubt_closings": (("doubt",),)}
_CONDITIONS = {
    "doubts": {
        "station_not_empty": "station <> ''",
        "wheel_not_empty": "wheel <> ''",
        "reason_not_empty": "reason <> ''",
    },
    "doubt_closings": {
        "closed_by": "closed_by IN ('good_check', 'release')",
        "good_check_is_named": "(closed_by = 'good_check') = (check_uuid IS NOT NULL)",
        "person_is_named": "(closed_by = 'release') = (person IS NOT NULL)",
        "person_not_empty": "person <> ''",
        "reason_not_empty": "reason <> ''",
    },
}


def upgrade() -> None:
    """Make the tables; of vehicles that were before there is no doubt on record."""
    time = sa.DateTime(timezone=True)
    op.create_table(
        "doubts",
        sa.Column("uuid", sa.Uuid(), nullable=False),
        sa.Column("station", sa.Text(), nullable=False),
        sa.Column("cycle", sa.Uuid(), nullable=False),
        sa.Column("wheel", sa.Text(), nullable=False),
        sa.Column("check_uuid", sa.Uuid(), nullable=False),
        sa.Column("utc", time, nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("stored_utc", time, nullable=False),
        *_checks("doubts"),
        sa.ForeignKeyConstraint(["cycle"], ["cycles.uuid"], name=op.f("fk_doubts_cycle")),
        sa.ForeignKeyConstraint(
            ["check_uuid"], ["calibration_checks.uuid"], name=op.f("fk_doubts_check_uuid")
        ),
        sa.PrimaryKeyConstraint("uuid", name=op.f("pk_doubts")),
        sa.UniqueConstraint("cycle", "wheel", name=op.f("uq_doubts_cycle_wheel")),
    )
    op.create_index(op.f("ix_doubts_station_wheel"), "doubts", ["station", "wheel"])
    op.create_table(
        "doubt_closings",
        sa.Column("doubt", sa.Uuid(), nullable=False),
        sa.Column("station", sa.Text(), nullable=False),
        sa.Column("utc", time, nullable=False),
        sa.Column("closed_by", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("check_uuid", sa.Uuid()),
        sa.Column("person", sa.Text()),
        sa.Column("stored_utc", time, nullable=False),
        *_checks("doubt_closings"),
        sa.ForeignKeyConstraint(["doubt"], ["doubts.uuid"], name=op.f("fk_doubt_closings_doubt")),
        sa.ForeignKeyConstraint(
            ["check_uuid"], ["calibration_checks.uuid"], name=op.f("fk_doubt_closings_check_uuid")
        ),
        sa.PrimaryKeyConstraint("doubt", name=op.f("pk_doubt_closings")),
    )
    for table in KEYS:
        _guard(table)


def _checks(table: str) -> list[sa.CheckConstraint]:
    return [
        sa.CheckConstraint(text, name=op.f(f"ck_{table}_{name}")) for name, text in _CONDITIONS[table].items()
    ]


def _guard(table: str) -> None:
    """Refuse every change of what is stored."""
    if op.get_bind().dialect.name != "sqlite":
        op.execute(
            f"CREATE TRIGGER {table}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {table}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
        return
    refuse = f"BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
    for change in ("UPDATE", "DELETE"):
        op.execute(f"CREATE TRIGGER {table}_no_{change.lower()} BEFORE {change} ON {table} {refuse}")
    same = " OR ".join(f"({' AND '.join(f'{key} = NEW.{key}' for key in keys)})" for keys in KEYS[table])
    known = f"EXISTS (SELECT 1 FROM {table} WHERE {same})"
    op.execute(f"CREATE TRIGGER {table}_no_replace BEFORE INSERT ON {table} WHEN {known} {refuse}")
