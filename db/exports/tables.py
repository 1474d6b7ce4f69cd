"""CSV and Parquet: one row for each angle of `db.exports.rows`."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import astuple, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from db.exports.rows import AngleRow

# A cell that begins with one of these, wide forms included, is run as a formula by spreadsheets (OWASP).
_RUN = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
TABLE_COLUMNS = tuple(item.name for item in fields(AngleRow))
_ROW_GROUP = 50_000


def write_csv(path: Path, rows: Iterable[AngleRow]) -> int:
    """Write a table in UTF-8 with a header, its cells as `csv_cell`. Returns the number of rows.

    Raises
    ------
    OSError
        When the file cannot be written; one that was there stays.
    """
    count = 0
    with replaced(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(TABLE_COLUMNS)
        for row in rows:
            writer.writerow([csv_cell(value) for value in astuple(row)])
            count += 1
    return count


def write_parquet(path: Path, rows: Iterable[AngleRow]) -> int:
    """Write a Parquet file with typed columns, compressed, in row groups. Returns the number of rows.

    Errors as `write_csv`.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema([(name, _parquet_type(pa, name)) for name in TABLE_COLUMNS])
    count = 0
    with replaced(path) as temporary, pq.ParquetWriter(temporary, schema, compression="zstd") as writer:
        for group in _groups(rows):
            columns = list(zip(*(astuple(row) for row in group), strict=True))
            arrays = [pa.array(column, item.type) for column, item in zip(columns, schema, strict=True)]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
            count += len(group)
    return count


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A file beside `path` that takes its place when all of it is written."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _groups(rows: Iterable[AngleRow]) -> Iterator[list[AngleRow]]:
    group: list[AngleRow] = []
    for row in rows:
        group.append(row)
        if len(group) == _ROW_GROUP:
            yield group
            group = []
    if group:
        yield group


def csv_cell(value: Any) -> Any:
    """A value as it stands in a CSV cell: a number to its last digit, a time in ISO 8601, UTC.

    Text that a spreadsheet would run as a formula begins with an apostrophe, which makes it text there;
    numbers, negative ones too, stay numbers.
    """
    if isinstance(value, datetime):
        return value.astimezone(UTC).isoformat()
    if isinstance(value, str):
        return f"'{value}" if value.startswith(_RUN) else value
    return repr(float(value)) if isinstance(value, float) else value


def _parquet_type(pa: Any, name: str) -> Any:
    # Annotations of the row decide; all of them are text here.
    kind = AngleRow.__dataclass_fields__[name].type.partition(" |")[0]
    return {
        "str": pa.string(),
        "float": pa.float64(),
        "int": pa.int64(),
        "bool": pa.bool_(),
        "datetime": pa.timestamp("us", tz="UTC"),
    }[kind]
