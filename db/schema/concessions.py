"""Vehicles that were released although they were not ok, and releases that were taken back."""

from __future__ import annotations

from sqlalchemy import Column, ForeignKey, Index, Table, Text, UniqueConstraint, Uuid

from db.schema.base import JSON_DOCUMENT, UtcDateTime, check, id_column, metadata
from db.schema.results import cycles

concessions = Table(
    "concessions",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("cycle_id", ForeignKey(cycles.c.id), nullable=False),
    Column("utc", UtcDateTime, nullable=False),
    Column("person", Text, nullable=False),
    Column("reason", Text, nullable=False),
    # What is out of its limits, as the results hold it.
    Column("exceeded", JSON_DOCUMENT, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    UniqueConstraint("uuid"),
    check("person_not_empty", "person <> ''"),
    check("reason_not_empty", "reason <> ''"),
    # Serves "was this vehicle released", and the refusal to release it twice.
    Index(None, "cycle_id"),
)

concession_withdrawals = Table(
    "concession_withdrawals",
    metadata,
    # Serves the refusal to withdraw twice.
    Column("concession_id", ForeignKey(concessions.c.id), primary_key=True),
    Column("utc", UtcDateTime, nullable=False),
    Column("person", Text, nullable=False),
    Column("reason", Text, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    check("person_not_empty", "person <> ''"),
    check("reason_not_empty", "reason <> ''"),
)
