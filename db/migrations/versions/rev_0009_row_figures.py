"""Whether a wheel's shot fits its calibration: rows of the cameras, evidence of a knock, a warning, and what
movements no image shows."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    """Add columns that older records leave empty; on PostgreSQL the partitions follow their table."""
    op.add_column("wheel_results", sa.Column("row_px", sa.Double()))
    op.add_column("wheel_results", sa.Column("knock_evidence", sa.Double()))
    op.add_column("wheel_results", sa.Column("warning", sa.Text()))
    op.add_column("wheel_results", sa.Column("camber_unseen", sa.Double()))
    op.add_column("wheel_results", sa.Column("toe_unseen", sa.Double()))
