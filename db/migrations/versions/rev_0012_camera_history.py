"""How cameras were, per hour and day: temperature, lost frames, sharpness and brightness of the lines."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"

TABLE = "camera_history"
_CONDITIONS = {
    "camera_not_empty": "camera <> ''",
    "figure_not_empty": "figure <> ''",
    "possible_span": "hours IN (0, 1, 24)",
    "possible_figures": "n > 0 AND minimum >= -1e12 AND minimum <= mean AND mean <= maximum"
    " AND maximum <= 1e12",
}


def upgrade() -> None:
    """Make the table; its rows change, so that no trigger keeps them."""
    op.create_table(
        TABLE,
        sa.Column("station_id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("camera", sa.Text(), nullable=False),
        sa.Column("figure", sa.Text(), nullable=False),
        sa.Column("hours", sa.SmallInteger(), nullable=False),
        sa.Column("start", sa.Integer(), nullable=False),
        sa.Column("n", sa.Integer(), nullable=False),
        sa.Column("mean", sa.Double(), nullable=False),
        sa.Column("minimum", sa.Double(), nullable=False),
        sa.Column("maximum", sa.Double(), nullable=False),
        *(sa.CheckConstraint(text, name=op.f(f"ck_{TABLE}_{name}")) for name, text in _CONDITIONS.items()),
        sa.ForeignKeyConstraint(["station_id"], ["stations.id"], name=op.f(f"fk_{TABLE}_station_id")),
        sa.PrimaryKeyConstraint("station_id", "camera", "figure", "hours", "start", name=op.f(f"pk_{TABLE}")),
        sqlite_with_rowid=False,
    )
