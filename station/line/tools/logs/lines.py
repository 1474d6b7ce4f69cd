"""Numbered lines of a log that is text, however it is encoded."""

from __future__ import annotations

import codecs
import contextlib
import io
from collections.abc import Iterator
from typing import BinaryIO

from sensors.formats import text_of
from station.line.tools.logs.notes import DamageError, Notes

_LONGEST = 65_536


def numbered_lines(binary: BinaryIO, notes: Notes) -> Iterator[tuple[int, str]]:
    """Number and text of every line, without its end and the blanks around it.

    A last line without an end is given and remarked upon: what is cut there may look like a whole frame.

    Raises
    ------
    DamageError
        For bytes of zero, or a line that is longer than any log has.
    """
    for number, row in enumerate(_rows(binary), start=1):
        where = f"line {number}"
        if "\0" in row:
            raise DamageError(where, "bytes of zero, which no log has")
        if len(row) >= _LONGEST:
            raise DamageError(where, f"a line of {_LONGEST} characters and more, which no log has")
        if not row.endswith(("\n", "\r")):
            notes.remark("the last line has no end: the file may be cut")
        yield number, row.strip()


def _rows(binary: BinaryIO) -> Iterator[str]:
    start = binary.read(2)
    binary.seek(0)
    if start not in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        yield from map(text_of, iter(lambda: binary.readline(_LONGEST), b""))
        return
    wide = io.TextIOWrapper(binary, encoding="utf-16", errors="replace")
    try:
        yield from iter(lambda: wide.readline(_LONGEST), "")
    finally:
        # The file is the caller's to close, and is closed already when a reader gave up amid it.
        with contextlib.suppress(ValueError):
            wide.detach()
