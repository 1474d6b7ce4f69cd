"""What a record may hold: values that SQLite and PostgreSQL store alike, and give back as they were."""

from __future__ import annotations

import json
import math
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import fields
from datetime import datetime
from functools import cache
from types import UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

from alignment.errors import InputError


def check_text(name: str, text: str) -> None:
    """Refuse text that no database stores: PostgreSQL takes no NUL, and neither takes a lone surrogate."""
    if "\0" in text or any("\ud800" <= character <= "\udfff" for character in text):
        raise InputError(field=name, expected="text without NUL and lone surrogates", seen=ascii(text))


def check_values(record: Any) -> None:
    """Refuse what SQLite and PostgreSQL would store differently, or not at all."""
    allowed = _allowed(cast(Hashable, type(record)))
    for item in fields(record):
        value = getattr(record, item.name)
        name = f"{type(record).__name__}.{item.name}"
        if not isinstance(value, allowed[item.name]) or (
            isinstance(value, bool) and bool not in allowed[item.name]
        ):
            # A numpy integer would reach SQLite as a blob; and SQLite keeps text in a column of numbers.
            raise InputError(field=name, expected="a plain Python value", seen=type(value).__name__)
        if isinstance(value, str):
            check_text(name, value)
        elif isinstance(value, float):
            # SQLite turns NaN into NULL without a word.
            if not math.isfinite(value):
                raise InputError(field=name, expected="a finite number", seen=str(value))
        elif isinstance(value, int):
            if not -(2**63) <= value < 2**63:
                raise InputError(field=name, expected="a whole number of 64 bits", seen=str(value))
        elif isinstance(value, datetime) and value.utcoffset() is None:
            raise InputError(field=name, expected="a time with its time zone", seen=str(value))


@cache
def _allowed(record: Any) -> dict[str, tuple[type, ...]]:
    """The plain types of each field: SQLite keeps whatever it is given, and gives it back."""
    return {name: tuple(_plain_types(hint)) for name, hint in get_type_hints(record).items()}


def _plain_types(hint: Any) -> Iterator[type]:
    origin = get_origin(hint)
    if origin in (Union, UnionType):
        for part in get_args(hint):
            yield from _plain_types(part)
    elif origin is Literal or (isinstance(hint, type) and issubclass(hint, str)):
        # Text of an enumeration may come as plain text.
        yield str
    elif hint is float:
        yield from (float, int)
    else:
        yield origin or hint


def as_read_back(name: str, document: Mapping[str, Any]) -> Any:
    """The JSON document as the database gives it back: lists for tuples, text for every key."""
    try:
        return json.loads(json.dumps(document, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InputError(field=name, expected="a JSON document", seen=str(error)) from error
