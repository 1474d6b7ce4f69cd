"""One way to read text that others wrote: UTF-8 with or without a mark, else the Windows code page.

Formats that are UTF-8 by definition (JSON, TOML) are read by `utf8_of`, which takes nothing else.
"""

from __future__ import annotations

import codecs

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def text_of(data: bytes) -> str:
    """Return the characters of a text, its byte order mark taken off.

    What is not UTF-8 was written by a program of a western Windows (code page 1252); bytes that have no
    character there become �. Any bytes give some text: whoever reads it judges whether it makes sense.
    """
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return data[len(mark) :].decode(encoding, errors="replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def utf8_of(data: bytes) -> str:
    """Return the characters of a text that must be UTF-8, its byte order mark taken off.

    Raises
    ------
    ValueError
        For anything else; says the line, and what the text may be instead.
    """
    for mark, encoding in _MARKS[1:]:
        if data.startswith(mark):
            raise ValueError(f"text in {encoding.upper()}")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start]
        line = before.count(b"\n") + 1
        column = error.start - (before.rfind(b"\n") + 1) + 1
        raise ValueError(
            f"byte 0x{data[error.start]:02X} in line {line}, column {column}, which is no UTF-8"
        ) from error
