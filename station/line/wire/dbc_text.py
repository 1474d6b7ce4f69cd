"""Reads a DBC file as untrusted text: sizes, numbers and attributes are looked at first.

The library builds a message of whatever length the file claims, and says of a word where a number belongs
only that something was wrong somewhere. `station.line.wire.dbc` checks what the messages mean.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from cantools.database.can import Database
from cantools.errors import Error as CantoolsError
from textparser import ParseError

from alignment.errors import ConfigurationError, FormatError
from alignment.file_limits import TEXT
from sensors.formats import read_bytes, text_of

# A frame of CAN FD; the line itself uses eight.
_MOST_LENGTH, _MOST_BIT = 64, 511
_TYPES = "INT|HEX|FLOAT"
_NUMBER = re.compile(r"-?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?\Z")
_DECLARED = re.compile(
    rf'^\s*BA_DEF_\s+(?:(?:BU|BO|SG|EV)_\s+)?"(\w+)"\s+(?:{_TYPES})\s*([^;]*);', re.MULTILINE
)
_VALUE = re.compile(
    r'^\s*BA_(?:DEF_DEF_)?\s+"(\w+)"\s+'
    r'(?:(?:BU_\s+\w+|BO_\s+\d+|SG_\s+\d+\s+\w+|EV_\s+\w+)\s+)?("[^"]*"|[^;"\s][^;]*?|)\s*;',
    re.MULTILINE,
)
_LENGTH = re.compile(r"^\s*BO_\s+([^\s:]+)\s+([^\s:]+)\s*:\s*([^\s:]+)", re.MULTILINE)
_PLACE = re.compile(r"^\s*SG_\s+([^\s:]+)\s*(?:\w+\s*)?:\s*([^\s|]+)\s*\|\s*([^\s@]+)\s*@", re.MULTILINE)
# What the parser and the library raise on files that are not what they claim to be.
DAMAGED = (
    CantoolsError,
    ParseError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    ArithmeticError,
    AssertionError,
    RecursionError,
    MemoryError,
)


def read_dbc(file: Path) -> Database:
    """Read a DBC.

    Raises
    ------
    ConfigurationError
        When it is no file or too large, or its text is no valid DBC; with the line where one is at fault.
    """
    text = _text(file)
    for line, field, expected, seen in _faults(text):
        raise ConfigurationError(file=file, field=f"line {line}, {field}", expected=expected, seen=seen)
    try:
        return _parsed(text)
    except DAMAGED as error:
        raise ConfigurationError(file=file, expected="a valid DBC", seen=str(error) or repr(error)) from error


@lru_cache(maxsize=4)
def _parsed(text: str) -> Database:
    """What the library makes of a text; nobody changes it, so opening a line again takes no time."""
    database = Database()
    # Two of the same name or identifier are told of in a log line; they are refused instead.
    library_log = logging.getLogger("cantools.database.can.database")
    level = library_log.level
    library_log.setLevel(logging.CRITICAL)
    try:
        database.add_dbc_string(text)
    finally:
        library_log.setLevel(level)
    return database


def _text(file: Path) -> str:
    try:
        data = read_bytes(file, "a DBC", TEXT)
    except FormatError as error:
        raise ConfigurationError(
            file=file, expected=error.expected, seen=error.seen, cure=error.cure, remedy=error.remedy
        ) from error
    # Code page 1252 by habit; a DBC that was edited elsewhere is UTF-8, and a degree sign stays one.
    text = text_of(data)
    if "\0" in text:
        raise ConfigurationError(file=file, expected="a valid DBC", seen="a binary file, with bytes of zero")
    if "\N{REPLACEMENT CHARACTER}" in text:
        raise ConfigurationError(
            file=file, expected="a valid DBC", seen="bytes that are text in neither UTF-8 nor code page 1252"
        )
    return text.replace("\r\n", "\n")


def _faults(text: str) -> Iterator[tuple[int, str, str, str]]:
    """Line, field, what was expected and what was seen, of what the library would take or not explain."""

    def line(match: re.Match[str]) -> int:
        # Of what was found, not of the blank lines before it.
        return text.count("\n", 0, match.end()) + 1

    for match in _LENGTH.finditer(text):
        if not _within(match[3], 0, _MOST_LENGTH):
            yield line(match), match[2], f"a length of 0 to {_MOST_LENGTH} bytes", match[3]
        if not _within(match[1], 0, 2**32 - 1):
            yield line(match), match[2], "an identifier", match[1]
    for match in _PLACE.finditer(text):
        if not (_within(match[2], 0, _MOST_BIT) and _within(match[3], 1, _MOST_BIT)):
            place = f"{match[2]}|{match[3]}"
            yield (
                line(match),
                match[1],
                f"a start bit and a length of bits within {_MOST_LENGTH} bytes",
                place,
            )
    ranges: dict[str, tuple[float, float] | None] = {}
    for match in _DECLARED.finditer(text):
        ends = match[2].split()
        if ends and not (len(ends) == 2 and all(_NUMBER.match(end) for end in ends)):
            yield line(match), f"attribute {match[1]}", "its lowest and highest number", match[2].strip()
        lowest, highest = (float(ends[0]), float(ends[1])) if len(ends) == 2 else (0.0, 0.0)
        # Many programs write 0 0 where they set no range.
        ranges[match[1]] = (lowest, highest) if lowest < highest else None
    for match in _VALUE.finditer(text):
        name, value = match[1], match[2]
        if name not in ranges:
            continue
        if not _NUMBER.match(value):
            yield line(match), f"attribute {name}", "a number", value or "nothing"
        limits = ranges[name]
        if limits is not None and not limits[0] <= float(value) <= limits[1]:
            yield line(match), f"attribute {name}", f"{limits[0]:g} to {limits[1]:g}", value


def _within(text: str, lowest: int, highest: int) -> bool:
    """Whether a text is an integer in this range."""
    return len(text) <= 10 and text.isascii() and text.isdigit() and lowest <= int(text) <= highest
