"""How cameras were, per hour and day, and which one stood where when its calibration was used first."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"

TABLE, SERIALS = "camera_history", "camera_serials"
_CONDITIONS = {
    "camera_not_empty": "camera <> ''",
    "figure_not_empty": "figure <> ''",
    "possible_span": "hours IN (0, 1, 24)",
    "possible_figures": "n > 0 AND minimum >= -1e12 AND minimum <= mean AND mean <= maximum"
    " AND maximum <= 1e12",
}


def upgrade() -> None:
    """Make the tables; their rows change, so that no trigger keeps them."""
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
        sa.PrimaryKeyConstraint("station_id", "hours", "start", "camera", "figure", name=op.f(f"pk_{TABLE}")),
        sqlite_with_rowid=False,
    )
    op.create_table(
        SERIALS,
        sa.Column("station_id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("camera", sa.Text(), nullable=False),
        sa.Column("calibration_id", sa.Text(), nullable=False),
        sa.Column("serial", sa.Text(), nullable=False),
        *(
            sa.CheckConstraint(f"{column} <> ''", name=op.f(f"ck_{SERIALS}_{name}_not_empty"))
            for name, column in (
                ("camera", "camera"),
                ("calibration", "calibration_id"),
                ("serial", "serial"),
            )
        ),
        sa.ForeignKeyConstraint(["station_id"], ["stations.id"], name=op.f(f"fk_{SERIALS}_station_id")),
        sa.PrimaryKeyConstraint("station_id", "camera", "calibration_id", name=op.f(f"pk_{SERIALS}")),
        sqlite_with_rowid=False,
    )
