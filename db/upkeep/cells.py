"""Looks at every cell of an SQLite file: SQLite keeps whatever it is given, and damage asks for no type."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Connection,
    Double,
    Enum,
    Integer,
    String,
    Table,
    Uuid,
    func,
    select,
    text,
)

from db.schema import UtcDateTime, metadata

# Nobody stored a result before, and no limit of validity is later.
_FIRST, _LAST = datetime(2000, 1, 1), datetime(2200, 1, 1)
_SHOWN = 3


def cell_findings(connection: Connection) -> Iterator[str]:
    """Sentences for cells that are no value of their column's kind: table, column, row, what is there."""
    for table in metadata.sorted_tables:
        looks = {column.name: found for column in table.c if (found := _wrong(column)) is not None}
        # One pass over the table for all of its columns.
        counted = ", ".join(f"coalesce(sum({condition}), 0)" for condition, _ in looks.values())
        numbers = connection.exec_driver_sql(f"SELECT {counted} FROM {table.name}").one()
        for number, (name, (condition, what)) in zip(numbers, looks.items(), strict=True):
            if number:
                places = _places(connection, table, name, condition)
                yield f"{table.name}: {number} values of column {name} are no {what} ({places})"


def impossible_times(connection: Connection) -> Iterator[str]:
    """Sentences for times before 2000 or after 2199, on a server."""
    for table in metadata.sorted_tables:
        for column in table.c:
            if not isinstance(column.type, UtcDateTime):
                continue
            query = select(func.count()).select_from(table).where(
                (column < text(f"timestamptz '{_FIRST}+00'")) | (column >= text(f"timestamptz '{_LAST}+00'"))
            )  # fmt: skip
            number = connection.execute(query).scalar_one()
            if number:
                yield f"{table.name}: {number} impossible times in column {column.name}"


def _places(connection: Connection, table: Table, name: str, condition: str) -> str:
    """Some of the rows with what stands there."""
    rowid = ", ".join(table.primary_key.columns.keys()) if table.name in _WITHOUT_ROWID else "rowid"
    # As bytes: what is text by its type may be no text.
    seen = f"substr(quote(CAST({name} AS BLOB)), 1, 60)"
    shown = connection.exec_driver_sql(
        f"SELECT {rowid}, typeof({name}), {seen} FROM {table.name} WHERE {condition} LIMIT {_SHOWN}"
    ).all()
    return "; ".join(f"row {row[0]}: {row[-2]} {row[-1]}" for row in shown)


_WITHOUT_ROWID = frozenset(("value_sums", "result_counts"))


def _wrong(column: Column[object]) -> tuple[str, str] | None:
    """The SQL condition of a cell that is none of its column, and what it ought to be."""
    name, kind = column.name, column.type
    if isinstance(kind, Enum):
        given = ", ".join(f"'{value}'" for value in kind.enums)
        condition, what = f"typeof({name}) <> 'text' OR {name} NOT IN ({given})", f"one of {given}"
    elif isinstance(kind, Uuid):
        digits = f"length({name}) <> 32 OR {name} GLOB '*[^0-9a-f]*'"
        condition, what = f"typeof({name}) <> 'text' OR {digits}", "UUID"
    elif isinstance(kind, UtcDateTime):
        condition = (
            f"typeof({name}) <> 'text' OR julianday({name}) IS NULL OR {name} NOT GLOB"
            f" '[12][0-9][0-9][0-9]-[01][0-9]-[0-3][0-9] [0-2][0-9]:[0-5][0-9]:[0-5][0-9].[0-9]*'"
            f" OR {name} < '{_FIRST}' OR {name} >= '{_LAST}'"
        )
        what = "possible time"
    elif isinstance(kind, JSON):
        condition, what = f"typeof({name}) <> 'text' OR NOT json_valid({name})", "JSON document"
    elif isinstance(kind, Boolean):
        condition, what = f"typeof({name}) <> 'integer' OR {name} NOT IN (0, 1)", "yes or no"
    elif isinstance(kind, Double):
        condition, what = f"typeof({name}) NOT IN ('real', 'integer')", "number"
    elif isinstance(kind, Integer):
        condition, what = f"typeof({name}) <> 'integer'", "whole number"
    elif isinstance(kind, String):
        condition, what = f"typeof({name}) <> 'text'", "text"
    else:
        return None
    missing = f"{name} IS NULL" if not column.nullable else "0"
    return f"{missing} OR ({name} IS NOT NULL AND ({condition}))", what
