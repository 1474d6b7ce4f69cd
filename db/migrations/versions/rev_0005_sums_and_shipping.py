"""Sums per hour and day; the outbox of a station and what the central database knows of its senders."""

from uuid import uuid4

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"

# SQLite counts up only in a column that is exactly INTEGER PRIMARY KEY.
COUNTER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
UTC = sa.DateTime(timezone=True)
KEPT = ("outbox", "arrivals")
REFUSAL = "stored results are never changed or deleted: write a new record"


def upgrade() -> None:
    """Create the tables; what a station stored before stands in its outbox from the start."""
    op.create_table(
        "arrivals",
        sa.Column("origin", sa.Uuid(), nullable=False),
        sa.Column("sequence", sa.BigInteger(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("key", sa.Text(), nullable=False),
        sa.Column("station", sa.Text(), nullable=False),
        sa.Column("arrived_utc", UTC, nullable=False),
        sa.PrimaryKeyConstraint("origin", "sequence", name=op.f("pk_arrivals")),
    )
    op.create_table(
        "counted_categories",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("level", sa.Text(), nullable=False),
        sa.Column("part", sa.Text(), nullable=False),
        sa.Column("vehicle_type", sa.Text()),
        sa.Column("outcome", sa.Text(), nullable=False),
        sa.Column("verdict", sa.Text()),
        sa.Column("reason_code", sa.Text()),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_counted_categories")),
    )
    op.create_table(
        "outbox",
        sa.Column("sequence", COUNTER, nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("key", sa.Text(), nullable=False),
        sa.CheckConstraint("kind <> ''", name=op.f("ck_outbox_kind_not_empty")),
        sa.PrimaryKeyConstraint("sequence", name=op.f("pk_outbox")),
    )
    op.create_table(
        "shipments",
        sa.Column("id", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("origin", sa.Uuid(), nullable=False),
        sa.Column("shipped_sequence", sa.BigInteger(), nullable=False),
        sa.Column("shipped_utc", UTC),
        sa.CheckConstraint("id = 1", name=op.f("ck_shipments_one_row")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_shipments")),
    )
    op.create_table(
        "station_leases",
        sa.Column("station", sa.Text(), nullable=False),
        sa.Column("origin", sa.Uuid(), nullable=False),
        sa.Column("instance", sa.Uuid(), nullable=False),
        sa.Column("host", sa.Text(), nullable=False),
        sa.Column("renewed_utc", sa.DateTime(timezone=True), nullable=False),
        sa.Column("lasts_s", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("station", name=op.f("pk_station_leases")),
    )
    op.create_table(
        "summed_characteristics",
        sa.Column("id", COUNTER, nullable=False),
        sa.Column("part", sa.Text(), nullable=False),
        sa.Column("quantity", sa.Text(), nullable=False),
        sa.Column("vehicle_type", sa.Text()),
        sa.Column("low", sa.Double()),
        sa.Column("high", sa.Double()),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_summed_characteristics")),
    )
    op.create_table(
        "sums_state",
        sa.Column("id", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("last_cycle_id", sa.BigInteger(), nullable=False),
        sa.Column("whole_days_until", sa.Integer(), nullable=False),
        sa.Column("summed_utc", UTC),
        sa.CheckConstraint("id = 1", name=op.f("ck_sums_state_one_row")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_sums_state")),
    )
    op.create_table(
        "result_counts",
        sa.Column("category_id", COUNTER, nullable=False),
        sa.Column("hours", sa.SmallInteger(), nullable=False),
        sa.Column("start", sa.Integer(), nullable=False),
        sa.Column("station_id", COUNTER, nullable=False),
        sa.Column("n", sa.Integer(), nullable=False),
        sa.CheckConstraint("hours IN (1, 24)", name=op.f("ck_result_counts_possible_span")),
        sa.CheckConstraint("n > 0", name=op.f("ck_result_counts_possible_count")),
        sa.ForeignKeyConstraint(
            ["category_id"], ["counted_categories.id"], name=op.f("fk_result_counts_category_id")
        ),
        sa.ForeignKeyConstraint(["station_id"], ["stations.id"], name=op.f("fk_result_counts_station_id")),
        sa.PrimaryKeyConstraint("category_id", "hours", "start", "station_id", name=op.f("pk_result_counts")),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "value_sums",
        sa.Column("characteristic_id", COUNTER, nullable=False),
        sa.Column("hours", sa.SmallInteger(), nullable=False),
        sa.Column("start", sa.Integer(), nullable=False),
        sa.Column("station_id", COUNTER, nullable=False),
        sa.Column("n", sa.Integer(), nullable=False),
        sa.Column("mean", sa.Double(), nullable=False),
        sa.Column("m2", sa.Double(), nullable=False),
        sa.Column("minimum", sa.Double(), nullable=False),
        sa.Column("maximum", sa.Double(), nullable=False),
        sa.Column("n_low", sa.Integer(), nullable=False),
        sa.Column("n_high", sa.Integer(), nullable=False),
        sa.Column("m2_within", sa.Double(), nullable=False),
        sa.Column("dof_within", sa.Integer(), nullable=False),
        sa.CheckConstraint("hours IN (1, 24)", name=op.f("ck_value_sums_possible_span")),
        sa.CheckConstraint(
            "n > 0 AND m2 >= 0 AND minimum <= maximum AND n_low >= 0 AND n_high >= 0",
            name=op.f("ck_value_sums_possible_sums"),
        ),
        sa.ForeignKeyConstraint(
            ["characteristic_id"], ["summed_characteristics.id"], name=op.f("fk_value_sums_characteristic_id")
        ),
        sa.ForeignKeyConstraint(["station_id"], ["stations.id"], name=op.f("fk_value_sums_station_id")),
        sa.PrimaryKeyConstraint(
            "characteristic_id", "hours", "start", "station_id", name=op.f("pk_value_sums")
        ),
        sqlite_with_rowid=False,
    )
    op.execute("INSERT INTO sums_state (id, last_cycle_id, whole_days_until) VALUES (1, 0, 0)")
    shipments = sa.table(
        "shipments", sa.column("id"), sa.column("origin", sa.Uuid()), sa.column("shipped_sequence")
    )
    op.bulk_insert(shipments, [{"id": 1, "origin": uuid4(), "shipped_sequence": 0}])
    if op.get_bind().dialect.name == "sqlite":
        _fill_outbox()
    for table in KEPT:
        _keep_rows(table)


def _fill_outbox() -> None:
    # In an order in which each record finds what it refers to.
    for kind, table, key, order in (
        ("station", "station_versions", "uuid", "id"),
        ("limits", "vehicle_type_limits", "uuid", "id"),
        ("calibration", "calibrations", "id", "stored_utc, valid_from_utc"),
        ("installation", "installations", "uuid", "id"),
        ("check", "calibration_checks", "uuid", "id"),
        ("zero", "zero_measurements", "id", "stored_utc, measured_utc"),
        ("revocation", "zero_revocations", "zero_id", "stored_utc"),
        ("event", "events", "uuid", "id"),
        ("cycle", "cycles", "uuid", "id"),
        ("study", "gauge_studies", "uuid", "id"),
        ("study_value", "gauge_values", "uuid", "id"),
        ("shot", "archived_shots", "uuid", "id"),
        ("removal", "archive_removals JOIN archived_shots ON id = shot_id", "uuid", "id"),
    ):
        op.execute(f"INSERT INTO outbox (kind, key) SELECT '{kind}', {key} FROM {table} ORDER BY {order}")


def _keep_rows(table: str) -> None:
    if op.get_bind().dialect.name == "sqlite":
        for change in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER {table}_no_{change.lower()} BEFORE {change} ON {table}"
                f" BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
            )
    else:
        op.execute(
            f"CREATE TRIGGER {table}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {table}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
