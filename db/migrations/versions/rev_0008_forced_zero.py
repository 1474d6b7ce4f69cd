"""Zero measurements say why they were stored although larger than what is believed."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Add the reason; what is stored has none."""
    op.add_column("zero_measurements", sa.Column("forced_reason", sa.Text(), nullable=True))
