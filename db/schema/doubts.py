"""Doubt about what rigs measured, noted after a failed master check, and the ends of it."""

from __future__ import annotations

from sqlalchemy import Column, ForeignKey, Index, Table, Text, UniqueConstraint, Uuid

from db.schema.base import UtcDateTime, check, metadata
from db.schema.results import calibration_checks, cycles

doubts = Table(
    "doubts",
    metadata,
    Column("uuid", Uuid, primary_key=True),
    Column("station", Text, nullable=False),
    Column("cycle", ForeignKey(cycles.c.uuid), nullable=False),
    Column("wheel", Text, nullable=False),
    # The failed check.
    Column("check_uuid", ForeignKey(calibration_checks.c.uuid), nullable=False),
    Column("utc", UtcDateTime, nullable=False),
    Column("reason", Text, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    # Serves "is this vehicle in doubt", and the refusal to doubt twice.
    UniqueConstraint("cycle", "wheel"),
    check("station_not_empty", "station <> ''"),
    check("wheel_not_empty", "wheel <> ''"),
    check("reason_not_empty", "reason <> ''"),
    # Serves the vehicles of a station that are in doubt.
    Index(None, "station", "wheel"),
)

doubt_closings = Table(
    "doubt_closings",
    metadata,
    # Serves "is it closed", and the refusal to close twice.
    Column("doubt", ForeignKey(doubts.c.uuid), primary_key=True),
    Column("station", Text, nullable=False),
    Column("utc", UtcDateTime, nullable=False),
    Column("closed_by", Text, nullable=False),
    Column("reason", Text, nullable=False),
    # The good check, where that closed it; the person, where one did.
    Column("check_uuid", ForeignKey(calibration_checks.c.uuid)),
    Column("person", Text),
    Column("stored_utc", UtcDateTime, nullable=False),
    check("closed_by", "closed_by IN ('good_check', 'release')"),
    check("good_check_is_named", "(closed_by = 'good_check') = (check_uuid IS NOT NULL)"),
    check("person_is_named", "(closed_by = 'release') = (person IS NOT NULL)"),
    check("person_not_empty", "person <> ''"),
    check("reason_not_empty", "reason <> ''"),
)
