"""The chain of hashes over everything stored: what was changed, taken out or put in later is found."""

from __future__ import annotations

from sqlalchemy import BigInteger, Column, PrimaryKeyConstraint, Table, Text

from db.schema.base import check, metadata

# One row per stored record, written in the record's own transaction; `db.rows.chain` says what is hashed.
chain_links = Table(
    "chain_links",
    metadata,
    # The station that the record is of; empty for what belongs to none, and for the start of the database.
    Column("chain", Text, nullable=False),
    # From 1, without gaps.
    Column("number", BigInteger, nullable=False),
    # As in the outbox.
    Column("kind", Text, nullable=False),
    Column("key", Text, nullable=False),
    # A JSON object: for each row of the record the first half of its SHA-256.
    Column("rows", Text, nullable=False),
    # SHA-256 of the link before and of this one, 64 digits.
    Column("previous", Text, nullable=False),
    Column("hash", Text, nullable=False),
    # Serves the end of a chain, asked for at every write, and its links in their order.
    PrimaryKeyConstraint("chain", "number"),
    check("counts_from_one", "number >= 1"),
    check("whole_hashes", "length(previous) = 64 AND length(hash) = 64"),
)
