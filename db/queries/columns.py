"""Columns as the database has them: converting so many times and UUIDs costs more than the query."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import (
    BigInteger,
    Column,
    ColumnElement,
    Connection,
    Double,
    Select,
    Text,
    cast,
    func,
    type_coerce,
)

_PORTION = 500


def columns_of(connection: Connection, query: Select[Any]) -> list[list[Any]]:
    """What a query of plain columns gives, column by column, as the driver has it."""
    found = connection.execute(query)
    columns: list[list[Any]] = [[] for _ in query.selected_columns]
    # Few rows at a time: Python's search for garbage would look at all of them again and again.
    while rows := found.cursor.fetchmany(_PORTION):
        for column, part in zip(columns, zip(*rows, strict=True), strict=True):
            column.extend(part)
    found.close()
    return columns


def plain_time(connection: Connection, time: Any) -> ColumnElement[Any]:
    """A time as numpy reads it into ``datetime64[us]``: text of SQLite, microseconds of PostgreSQL."""
    if connection.dialect.name == "sqlite":
        return type_coerce(time, Text)
    # Not `extract`, which computes with decimal numbers; a double holds microseconds for 285 years.
    return cast(func.date_part("epoch", time, type_=Double()) * 1e6, BigInteger)


def times(column: Sequence[Any]) -> NDArray[np.datetime64]:
    """What `plain_time` gives, (N,) datetime64[us]."""
    if column and isinstance(column[0], int):
        return np.array(column, dtype=np.int64).view("datetime64[us]")
    return np.array(column, dtype="datetime64[us]")


def plain_uuid(uuid: Column[Any]) -> ColumnElement[str]:
    """A UUID as text that `uuid.UUID` reads."""
    return cast(type_coerce(uuid, Text), Text)


def objects(values: Sequence[Any]) -> NDArray[np.object_]:
    """Values as they are, (N,)."""
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array
