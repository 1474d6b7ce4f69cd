"""Archived images are known by the hash of their record, so that a change of them is noticed."""

from alembic import op

revision = "0013"
down_revision = "0012"


def upgrade() -> None:
    """Add the column; archives of earlier programs have no such record and leave it empty."""
    op.execute(
        "ALTER TABLE archived_shots ADD COLUMN record_sha256 TEXT"
        " CONSTRAINT ck_archived_shots_possible_hash CHECK (length(record_sha256) = 64)"
    )
