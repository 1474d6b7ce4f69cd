"""Gauge studies with their raw values."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import ColumnElement, func, or_, select

from db.queries.reader import ResultReader, question
from db.records import GaugeStudyRecord, GaugeValueRecord, StoredGaugeStudy, StudyKind, check_text
from db.rows import STUDY_VALUES, record_of
from db.schema import gauge_studies as study_rows
from db.schema import gauge_values


@question
def gauge_studies(
    reader: ResultReader,
    kind: StudyKind | None = None,
    text: str | None = None,
    name: str | None = None,
) -> tuple[GaugeStudyRecord, ...]:
    """Studies as planned, newest first; `text` is looked for in name and comment, `name` is all of it."""
    conditions: list[ColumnElement[bool]] = []
    if kind is not None:
        conditions.append(study_rows.c.kind == kind)
    if text is not None:
        check_text("text", text)
        named = study_rows.c.name.icontains(text, autoescape=True)
        conditions.append(or_(named, study_rows.c.comment.icontains(text, autoescape=True)))
    if name is not None:
        check_text("name", name)
        conditions.append(study_rows.c.name == name)
    query = select(study_rows).where(*conditions)
    query = query.order_by(study_rows.c.created_utc.desc(), study_rows.c.id.desc())
    with reader.transaction() as connection:
        return tuple(record_of(GaugeStudyRecord, row) for row in connection.execute(query).mappings())


@question
def gauge_value_counts(reader: ResultReader) -> dict[UUID, int]:
    """How many values count of each study that has any: one of each part, appraiser and trial."""
    cells = select(
        gauge_values.c.study_id, gauge_values.c.part, gauge_values.c.appraiser, gauge_values.c.trial
    )
    cell = cells.distinct().subquery("cell")
    query = select(study_rows.c.uuid, func.count()).join(cell, cell.c.study_id == study_rows.c.id)
    with reader.transaction() as connection:
        return {row[0]: row[1] for row in connection.execute(query.group_by(study_rows.c.uuid))}


@question
def gauge_study(reader: ResultReader, uuid: UUID) -> StoredGaugeStudy | None:
    """A study with its raw values, or None."""
    with reader.transaction() as connection:
        query = select(study_rows).where(study_rows.c.uuid == uuid)
        row = connection.execute(query).mappings().one_or_none()
        if row is None:
            return None
        of_study = STUDY_VALUES.where(gauge_values.c.study_id == row["id"]).order_by(gauge_values.c.id)
        values = [record_of(GaugeValueRecord, item) for item in connection.execute(of_study).mappings()]
    newest = {(value.part, value.appraiser, value.trial): value for value in values}
    counting = tuple(newest[cell] for cell in sorted(newest))
    return StoredGaugeStudy(record_of(GaugeStudyRecord, row), counting, tuple(values), row["stored_utc"])
