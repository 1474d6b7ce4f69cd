"""One way to read text that others wrote: UTF-8 with or without a mark, else the Windows code page."""

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
