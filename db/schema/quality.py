"""What proves the gauge, and what proves a result: gauge studies with raw values, archived images."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    Table,
    Text,
    UniqueConstraint,
    Uuid,
)

from db.records import RetentionClass, StudyKind
from db.schema.base import JSON_DOCUMENT, UtcDateTime, check, choice, id_column, metadata
from db.schema.results import cycles

gauge_studies = Table(
    "gauge_studies",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    choice("kind", StudyKind),
    Column("name", Text, nullable=False),
    Column("created_utc", UtcDateTime, nullable=False),
    Column("station", Text),
    Column("characteristic", Text, nullable=False),
    # Parts, appraisers, trials, reference values, tolerance: what the method needs.
    Column("plan", JSON_DOCUMENT, nullable=False),
    Column("comment", Text, nullable=False),
    Column("software_version", Text, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    UniqueConstraint("uuid"),
    check("name_not_empty", "name <> ''"),
    check("characteristic_not_empty", "characteristic <> ''"),
    # Serves the study of a name, and the refusal to give one twice.
    Index(None, "name"),
    # Serves "the studies of one kind, newest first".
    Index(None, "kind", "created_utc"),
)

gauge_values = Table(
    "gauge_values",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("study_id", ForeignKey(gauge_studies.c.id), nullable=False),
    Column("part", Text, nullable=False),
    Column("appraiser", Text, nullable=False),
    Column("trial", Integer, nullable=False),
    Column("value", Double, nullable=False),
    Column("utc", UtcDateTime),
    # The live cycle it was taken from. No foreign key: a study may come from a file of another station.
    Column("cycle", Uuid),
    Column("stored_utc", UtcDateTime, nullable=False),
    UniqueConstraint("uuid"),
    check("trial_positive", "trial > 0"),
    # A range also keeps out NaN and infinity.
    check("possible_value", "value BETWEEN -1e300 AND 1e300"),
    # Serves "the values of a study"; a corrected value is a second row of its cell, and the newest counts.
    Index(None, "study_id", "part", "appraiser", "trial"),
)

archived_shots = Table(
    "archived_shots",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("cycle_id", ForeignKey(cycles.c.id), nullable=False),
    Column("wheel", Text, nullable=False),
    # Relative to the archive's folder.
    Column("path", Text, nullable=False),
    Column("bytes", BigInteger, nullable=False),
    Column("archived_utc", UtcDateTime, nullable=False),
    choice("retention", RetentionClass),
    Column("stored_utc", UtcDateTime, nullable=False),
    # Of the record in that folder; empty in archives of earlier programs.
    Column("record_sha256", Text),
    UniqueConstraint("uuid"),
    check("path_not_empty", "path <> ''"),
    check("possible_size", "bytes >= 0"),
    check("possible_hash", "length(record_sha256) = 64"),
    # Serves "the images of this cycle".
    Index(None, "cycle_id", "wheel"),
    # Serves the ring: "the oldest ones that may go".
    Index(None, "retention", "archived_utc"),
)

archive_removals = Table(
    "archive_removals",
    metadata,
    # Serves the refusal to remove twice, and "is it still there".
    Column("shot_id", ForeignKey(archived_shots.c.id), primary_key=True),
    Column("utc", UtcDateTime, nullable=False),
    Column("reason", Text, nullable=False),
    check("reason_not_empty", "reason <> ''"),
)
