"""Tables that people save from a spreadsheet or get with a certificate: one reader for all of them.

Every error names file, line and column. UTF-8 with or without a mark, UTF-16 with one, else code page 1252;
commas, semicolons or tabs; any ends of lines; ``sep=;`` in the first line, as Excel knows it.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path

from alignment.errors import FormatError
from sensors.formats.files import read_bytes
from sensors.formats.text import text_of

_SEPARATORS = (",", ";", "\t")
_SEPARATOR_STATED = re.compile(r'\A\s*"?sep=([,;\t])"?[ \t]*(?:\r\n|\r|\n|\Z)', re.IGNORECASE)
_WHOLE = re.compile(r"[-+]?\d{1,9}")
_LARGEST_COUNT = 1_000_000


@dataclass(frozen=True)
class CsvLine:
    """One line below the header.

    Attributes
    ----------
    path, number
        The file, and the line in it, from 1.
    cells
        By the name of the column, in small letters.
    """

    path: Path
    number: int
    cells: Mapping[str, str]
    separator: str

    def has(self, column: str) -> bool:
        """Whether the column is there and filled."""
        return bool(self.cells.get(column, "").strip())

    def text(self, column: str) -> str:
        """A name: not empty, on one line, printable."""
        found = self.cells[column].strip()
        if not found or not found.isprintable():
            raise self.error(column, "a name", found)
        return found

    def decimal(self, column: str) -> Decimal:
        """A finite number, no digit lost."""
        found = self.cells[column].strip().replace("\N{MINUS SIGN}", "-")
        try:
            value = Decimal(found if self.separator == "," else found.replace(",", "."))
        except InvalidOperation:
            raise self.error(column, "a number", self.cells[column]) from None
        # Beyond these no float64 holds it, nor does any gauge show it.
        if not value.is_finite() or abs(value) > Decimal("1e100"):
            raise self.error(column, "a finite number", self.cells[column])
        return value

    def count(self, column: str) -> int:
        """A whole number from 1."""
        found = self.cells[column].strip()
        if not (found.isascii() and found.isdigit() and 1 <= int(found[:8]) <= _LARGEST_COUNT):
            raise self.error(column, "a whole number from 1", found)
        return int(found)

    def whole(self, column: str) -> int:
        """A whole number of either sign."""
        found = self.cells[column].strip().replace("\N{MINUS SIGN}", "-")
        if not (found.isascii() and _WHOLE.fullmatch(found)):
            raise self.error(column, "a whole number", found)
        return int(found)

    def time(self, column: str) -> datetime:
        """A time; UTC where it names no zone."""
        found = self.cells[column].strip()
        try:
            time = datetime.fromisoformat(found)
            return time.replace(tzinfo=UTC) if time.utcoffset() is None else time.astimezone(UTC)
        except (ValueError, OverflowError):
            raise self.error(column, "a time such as 2026-11-22T08:30:00", found) from None

    def error(self, column: str, expected: str, seen: str) -> FormatError:
        """The error that names this cell."""
        return FormatError(
            file=self.path,
            field=f"line {self.number}, column {column}",
            expected=expected,
            seen=ascii(seen[:60]) if seen.strip() else "nothing",
        )


def read_table(path: Path, required: Sequence[str]) -> list[CsvLine]:
    """Read a table with a header line, separated by commas, semicolons or tabs.

    Columns come in any order and case, and others than the required ones may be there. With semicolons or
    tabs numbers may have a decimal comma. Empty lines are skipped.

    Raises
    ------
    FormatError
        For anything else, for a table without a line below the header, and for a file that cannot be read.
    """
    return table_of(read_bytes(path, "a table"), path, required)


def table_of(
    content: bytes,
    path: Path,
    required: Sequence[str],
    *,
    optional: Sequence[str] | None = None,
    comments: bool = False,
) -> list[CsvLine]:
    """Read the content of a table; `path` names it in messages.

    Parameters
    ----------
    required, optional
        Columns, in any order and case. Where `optional` is given others than both are refused: a misspelt
        name would be a column that is passed over.
    comments
        Whether lines that begin with ``#`` are skipped; in a table of parts "#1" is a part.

    Raises
    ------
    FormatError
        As `read_table`.
    """
    text = text_of(content)
    stated = _SEPARATOR_STATED.match(text)
    first = next((line for line in text.splitlines()[stated is not None :] if _says(line, comments)), "")
    separator = max(_SEPARATORS, key=first.count) if stated is None else stated[1]
    rows = _rows(path, text, separator, comments)
    if stated is not None:
        next(rows, None)
    number, cells = next(rows, (1, []))
    header = _header(path, number, cells, required, optional)
    lines = []
    for number, cells in rows:
        if len(cells) != len(header):
            raise FormatError(
                file=path,
                field=f"line {number}",
                expected=f"{len(header)} cells, as the header has",
                seen=str(len(cells)),
            )
        lines.append(CsvLine(path, number, dict(zip(header, cells, strict=True)), separator))
    if not lines:
        raise FormatError(file=path, expected="at least one line of values below the header", seen="none")
    return lines


def _says(line: str, comments: bool) -> bool:
    return bool(line.strip(" \t,;")) and not (comments and line.lstrip().startswith("#"))


def _rows(path: Path, text: str, separator: str, comments: bool) -> Iterator[tuple[int, list[str]]]:
    """Lines with their numbers that are not empty, and no comments."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells) and not (comments and cells[0].lstrip().startswith("#")):
                yield reader.line_num, cells
    except csv.Error as error:
        raise FormatError(
            file=path, field=f"line {reader.line_num}", expected="a line of CSV", seen=str(error)
        ) from error


def _header(
    path: Path, number: int, cells: Sequence[str], required: Sequence[str], optional: Sequence[str] | None
) -> list[str]:
    names = [name.strip().lower() for name in cells]
    missing = [name for name in required if name not in names]
    if missing:
        raise FormatError(
            file=path,
            field=f"line {number}",
            expected=f"a header with the columns {', '.join(required)}",
            seen=ascii(", ".join(names)[:100]) if any(names) else "nothing",
            cure=f"Missing: {', '.join(missing)}",
        )
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise FormatError(
            file=path, field=f"line {number}", expected="each column once", seen=f"{', '.join(twice)} twice"
        )
    others = [] if optional is None else [name for name in names if name not in {*required, *optional}]
    if others:
        raise FormatError(
            file=path,
            field=f"line {number}",
            expected=f"no other columns than {', '.join([*required, *(optional or ())])}",
            seen=ascii(", ".join(others)[:100]),
        )
    return names
