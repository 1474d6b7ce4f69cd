"""The way from a station's own database to the central one."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Column,
    Double,
    Integer,
    PrimaryKeyConstraint,
    Table,
    Text,
    Uuid,
)

from db.schema.base import UtcDateTime, check, metadata

# One row per stored record, in the order of storing, written in the record's own transaction. Only in a
# station's own SQLite database.
outbox = Table(
    "outbox",
    metadata,
    # Counts without gaps: one writer at a time, and a transaction that is rolled back takes its number back.
    Column("sequence", BigInteger().with_variant(Integer, "sqlite"), primary_key=True),
    Column("kind", Text, nullable=False),
    # The record's id or UUID.
    Column("key", Text, nullable=False),
    check("kind_not_empty", "kind <> ''"),
)

# How far the outbox is shipped; one row, changed by the shipper.
shipments = Table(
    "shipments",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    # Names this database in the central one. A new one is taken when the file turns out to be a copy.
    Column("origin", Uuid, nullable=False),
    Column("shipped_sequence", BigInteger, nullable=False),
    Column("shipped_utc", UtcDateTime),
    check("one_row", "id = 1"),
)

# In the central database: one row per record that came, proof that none is missing, doubled or out of order.
arrivals = Table(
    "arrivals",
    metadata,
    Column("origin", Uuid, nullable=False),
    Column("sequence", BigInteger, nullable=False),
    Column("kind", Text, nullable=False),
    Column("key", Text, nullable=False),
    Column("station", Text, nullable=False),
    Column("arrived_utc", UtcDateTime, nullable=False),
    # Serves the refusal to take a record twice, and the search for gaps.
    PrimaryKeyConstraint("origin", "sequence"),
)

# In the central database: who ships under a station's name at present. Changed by the shippers.
station_leases = Table(
    "station_leases",
    metadata,
    Column("station", Text, primary_key=True),
    Column("origin", Uuid, nullable=False),
    # A running program.
    Column("instance", Uuid, nullable=False),
    Column("host", Text, nullable=False),
    # By the clock of the central database.
    Column("renewed_utc", UtcDateTime, nullable=False),
    Column("lasts_s", Double, nullable=False),
)
