"""PostgreSQL: wheel results in partitions of half a million cycles; what is stored becomes the first one."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"

CYCLES_PER_PARTITION = 500_000
CHANGES = "BEFORE UPDATE OR DELETE OR TRUNCATE"


def upgrade() -> None:
    """Put a partitioned table around the one that is there; no row is copied."""
    connection = op.get_bind()
    if connection.dialect.name != "postgresql":
        return
    last = connection.execute(sa.text("SELECT coalesce(max(id), 0) FROM cycles")).scalar_one()
    end = (last // CYCLES_PER_PARTITION + 1) * CYCLES_PER_PARTITION
    for statement in (
        "ALTER TABLE wheel_results RENAME TO wheel_results_0",
        "ALTER TABLE wheel_results_0 RENAME CONSTRAINT pk_wheel_results TO pk_wheel_results_0",
        "ALTER INDEX ix_wheel_results_calibration_id RENAME TO ix_wheel_results_0_calibration_id",
        "ALTER TRIGGER wheel_results_no_change ON wheel_results_0 RENAME TO wheel_results_0_no_change",
        "CREATE TABLE wheel_results (LIKE wheel_results_0 INCLUDING DEFAULTS INCLUDING CONSTRAINTS,"
        " CONSTRAINT pk_wheel_results PRIMARY KEY (cycle_id, wheel),"
        " CONSTRAINT fk_wheel_results_cycle_id FOREIGN KEY (cycle_id) REFERENCES cycles (id),"
        " CONSTRAINT fk_wheel_results_calibration_id FOREIGN KEY (calibration_id)"
        " REFERENCES calibrations (id)) PARTITION BY RANGE (cycle_id)",
        "CREATE INDEX ix_wheel_results_calibration_id ON wheel_results (calibration_id)",
        f"ALTER TABLE wheel_results ATTACH PARTITION wheel_results_0 FOR VALUES FROM (MINVALUE) TO ({end})",
        "CREATE TABLE wheel_results_default PARTITION OF wheel_results DEFAULT",
    ):
        op.execute(statement)
    for table in ("wheel_results", "wheel_results_default"):
        op.execute(
            f"CREATE TRIGGER {table}_no_change {CHANGES} ON {table}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
