"""A chain of hashes over what is stored; rows of SQLite that cannot be replaced; indexes for a start."""

import hashlib
import json

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"

REFUSAL = "stored results are never changed or deleted: write a new record"
# What makes a row of SQLite the same row; PostgreSQL has no INSERT that replaces.
KEYS = {
    "archive_removals": ("shot_id",),
    "archived_shots": ("uuid",),
    "arrivals": ("origin, sequence",),
    "axle_results": ("cycle_id, axle",),
    "calibration_checks": ("uuid",),
    "calibrations": ("id",),
    "chain_links": ("chain, number",),
    "cycles": ("uuid",),
    "events": ("uuid",),
    "gauge_studies": ("uuid",),
    "gauge_values": ("uuid",),
    "installations": ("uuid",),
    "outbox": (),
    "plants": ("name",),
    "rigs": ("station_id, name",),
    "station_versions": ("uuid",),
    "stations": ("name",),
    "vehicle_results": ("cycle_id",),
    "vehicle_type_limits": ("uuid",),
    "vehicles": ("vin, vehicle_type",),
    "wheel_results": ("cycle_id, wheel",),
    "zero_measurements": ("id",),
    "zero_revocations": ("zero_id",),
}
# Tables that hold records, by the kind that the outbox names.
COUNTED = {
    "calibration": "calibrations",
    "check": "calibration_checks",
    "cycle": "cycles",
    "event": "events",
    "installation": "installations",
    "limits": "vehicle_type_limits",
    "removal": "archive_removals",
    "revocation": "zero_revocations",
    "shot": "archived_shots",
    "station": "station_versions",
    "study": "gauge_studies",
    "study_value": "gauge_values",
    "zero": "zero_measurements",
}
INDEXES = (
    ("cycles", "station", "id"),
    ("events", "station", "code", "id"),
    ("installations", "rig_id", "id"),
    ("station_versions", "station_id", "id"),
    ("vehicle_type_limits", "station_id", "vehicle_type", "id"),
)


def upgrade() -> None:
    """Create the chain; its first link counts what was stored before, which it does not cover."""
    op.create_table(
        "chain_links",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("key", sa.Text(), nullable=False),
        sa.Column("rows", sa.Text(), nullable=False),
        sa.Column("previous", sa.Text(), nullable=False),
        sa.Column("hash", sa.Text(), nullable=False),
        sa.CheckConstraint("number >= 1", name=op.f("ck_chain_links_counts_from_one")),
        sa.CheckConstraint(
            "length(previous) = 64 AND length(hash) = 64", name=op.f("ck_chain_links_whole_hashes")
        ),
        sa.PrimaryKeyConstraint("chain", "number", name=op.f("pk_chain_links")),
    )
    for table, *columns in INDEXES:
        op.create_index(op.f(f"ix_{table}_{'_'.join(columns)}"), table, columns)
    _add_start()
    if op.get_bind().dialect.name == "sqlite":
        _keep_rows_in_sqlite()
    else:
        op.execute(
            "CREATE TRIGGER chain_links_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON chain_links"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )


def _add_start() -> None:
    connection = op.get_bind()
    counted = {
        kind: connection.execute(sa.text(f"SELECT count(*) FROM {table}")).scalar_one()
        for kind, table in COUNTED.items()
    }
    previous, rows = 64 * "0", _json(counted)
    link = ["", 1, "start", revision, rows]
    links = sa.table(
        "chain_links", *map(sa.column, ("chain", "number", "kind", "key", "rows", "previous", "hash"))
    )
    values = dict(zip(("chain", "number", "kind", "key", "rows"), link, strict=True))
    found = hashlib.sha256(_json([previous, *link]).encode()).hexdigest()
    op.bulk_insert(links, [values | {"previous": previous, "hash": found}])


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def _keep_rows_in_sqlite() -> None:
    for table, keys in KEYS.items():
        same = ["rowid = NEW.rowid"]
        same += [" AND ".join(f"{name} = NEW.{name}" for name in key.split(", ")) for key in keys]
        known = " OR ".join(f"EXISTS (SELECT 1 FROM {table} WHERE {one})" for one in same)
        op.execute(
            f"CREATE TRIGGER {table}_no_replace BEFORE INSERT ON {table} WHEN {known}"
            f" BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
        )
    for change in ("UPDATE", "DELETE"):
        op.execute(
            f"CREATE TRIGGER chain_links_no_{change.lower()} BEFORE {change} ON chain_links"
            f" BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
        )
