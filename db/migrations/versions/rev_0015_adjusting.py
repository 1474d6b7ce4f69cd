"""What was turned on a vehicle: as found, as left, corrections, turns, times, what locking added."""

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"

REFUSAL = "stored results are never changed or deleted: write a new record"
TABLE = "adjusting_results"
KEYS = ("cycle_id", "wheel", "adjuster")
_CONDITIONS = {
    "wheel_not_empty": "wheel <> ''",
    "adjuster": "adjuster IN ('tie_rod', 'camber_bolt')",
    "outcome": "outcome IN ('done', 'unreachable', 'unfinished')",
    "reason": "(outcome = 'unreachable') = (reason IS NOT NULL) AND"
    " (reason IS NULL OR reason IN ('no_adjuster', 'range', 'reaction'))",
    "was_turned": "corrections > 0 AND nuts_locked BETWEEN 0 AND corrections",
    "drift_of_locked_nuts": "(nuts_locked > 0) = (drift IS NOT NULL)",
    "left_is_complete": "(left_camber IS NULL) = (left_toe IS NULL)",
    "possible_angles": "found_camber BETWEEN -3.2 AND 3.2 AND found_toe BETWEEN -3.2 AND 3.2 AND"
    " left_camber BETWEEN -3.2 AND 3.2 AND left_toe BETWEEN -3.2 AND 3.2 AND drift BETWEEN -3.2 AND 3.2",
    "possible_turns": "turns BETWEEN -1000000 AND 1000000 AND turns_made BETWEEN 0 AND 1000000",
    "possible_times": "begun_s BETWEEN 0 AND 1000000 AND ended_s BETWEEN begun_s AND 1000000",
    "operator_not_empty": "operator <> ''",
}


def upgrade() -> None:
    """Make the table; of cycles that were before, events `adjusted` tell what was turned."""
    number = sa.BigInteger().with_variant(sa.Integer, "sqlite")
    op.create_table(
        TABLE,
        sa.Column("cycle_id", number, nullable=False),
        sa.Column("wheel", sa.Text(), nullable=False),
        sa.Column("adjuster", sa.Text(), nullable=False),
        sa.Column("outcome", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text()),
        sa.Column("corrections", sa.Integer(), nullable=False),
        sa.Column("turns", sa.Double(), nullable=False),
        sa.Column("turns_made", sa.Double(), nullable=False),
        sa.Column("found_camber", sa.Double(), nullable=False),
        sa.Column("found_toe", sa.Double(), nullable=False),
        sa.Column("left_camber", sa.Double()),
        sa.Column("left_toe", sa.Double()),
        sa.Column("begun_s", sa.Double(), nullable=False),
        sa.Column("ended_s", sa.Double(), nullable=False),
        sa.Column("nuts_locked", sa.Integer(), nullable=False),
        sa.Column("drift", sa.Double()),
        sa.Column("operator", sa.Text()),
        *(sa.CheckConstraint(text, name=op.f(f"ck_{TABLE}_{name}")) for name, text in _CONDITIONS.items()),
        sa.ForeignKeyConstraint(["cycle_id"], ["cycles.id"], name=op.f(f"fk_{TABLE}_cycle_id")),
        sa.PrimaryKeyConstraint(*KEYS, name=op.f(f"pk_{TABLE}")),
    )
    if op.get_bind().dialect.name != "sqlite":
        op.execute(
            f"CREATE TRIGGER {TABLE}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {TABLE}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
        return
    refuse = f"BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
    for change in ("UPDATE", "DELETE"):
        op.execute(f"CREATE TRIGGER {TABLE}_no_{change.lower()} BEFORE {change} ON {TABLE} {refuse}")
    same = " AND ".join(f"{key} = NEW.{key}" for key in KEYS)
    known = f"EXISTS (SELECT 1 FROM {TABLE} WHERE {same})"
    op.execute(f"CREATE TRIGGER {TABLE}_no_replace BEFORE INSERT ON {TABLE} WHEN {known} {refuse}")
