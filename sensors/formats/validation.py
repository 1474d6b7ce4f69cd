"""From a parsed file to a checked model: unknown keys refused, every mistake said in one sentence.

`validate` serves JSON and TOML alike, so that recorded formats and the station's configuration speak the
same language.
"""

from __future__ import annotations

import difflib
import json
import tomllib
import typing
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from alignment.errors import ConfigurationError, FormatError, InputError
from alignment.file_limits import TEXT
from sensors.formats.files import read_bytes
from sensors.formats.text import utf8_of

_M = TypeVar("_M", bound=BaseModel)

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
"""Name of a rig or head: also a part of a file name, on every system."""
FilePath = Annotated[str, Field(min_length=1, max_length=1000)]

_SHOWN = 4
_UTF8_CURE = "Save it as UTF-8"
_MESSAGES = {
    "string_pattern_mismatch": "text of the form {pattern}",
    "too_short": "at least {min_length} items",
    "too_long": "at most {max_length} items",
    "string_too_short": "at least {min_length} characters",
    "string_too_long": "at most {max_length} characters",
    "finite_number": "a finite number",
    "model_type": "a table of fields",
    "tuple_type": "a list",
    "list_type": "a list",
    "timezone_aware": "a time with its zone, such as 2026-03-01T12:00:00Z",
    "missing": "a value",
    "union_tag_invalid": "a table whose schema is {expected_tags}",
    "union_tag_not_found": "a table with its schema",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number from {ge:g} upward",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
}


class StrictModel(BaseModel):
    """Base of every file's model: frozen, no unknown keys, no silent conversion of text to numbers."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def load_json(path: Path, kind: str) -> Any:
    """Read a JSON file as plain values.

    Parameters
    ----------
    path
        The file, UTF-8.
    kind
        What it should be, such as "a calibration", for the message.

    Raises
    ------
    FormatError
        When it is missing, is not UTF-8, has an error of syntax (the line is named), or a key twice.
    """
    content = read_bytes(path, kind)

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table = dict(pairs)
        if len(table) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise FormatError(file=path, field=twice, expected="each key once", seen="the key twice")
        return table

    try:
        text = utf8_of(content)
    except ValueError as error:
        raise FormatError(
            file=path, expected=f"{kind} in JSON, UTF-8", seen=str(error), cure=_UTF8_CURE
        ) from error
    try:
        return json.loads(text, object_pairs_hook=unique)
    except FormatError:
        raise
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}: {error.msg}"
        raise FormatError(file=path, expected=f"{kind} in JSON", seen=f"an error in {where}") from error
    except (ValueError, RecursionError) as error:
        raise FormatError(file=path, expected=f"{kind} in JSON, UTF-8", seen=str(error)) from error


def load_toml(path: Path, kind: str) -> dict[str, Any]:
    """Read a TOML file as plain values.

    Parameters
    ----------
    path
        The file, UTF-8.
    kind
        What it should be, such as "the description of a plate", for the message.

    Raises
    ------
    ConfigurationError
        When it is missing, is not UTF-8, or has an error of syntax (the line is named).
    """
    try:
        text = utf8_of(read_bytes(path, kind, TEXT))
    except FormatError as error:
        raise ConfigurationError(
            file=path, expected=error.expected, seen=error.seen, cure=error.cure, remedy=error.remedy
        ) from error
    except ValueError as error:
        raise ConfigurationError(
            file=path, expected=f"{kind} in TOML, UTF-8", seen=str(error), cure=_UTF8_CURE
        ) from error
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigurationError(file=path, expected=f"{kind} in TOML", seen=f"an error: {error}") from error


def validate(
    model: type[_M],
    data: object,
    *,
    file: str | PathLike[str] | None,
    error: type[InputError] = FormatError,
    cure: str | None = None,
) -> _M:
    """Check plain values, as JSON or TOML yield them, against a model.

    Parameters
    ----------
    model
        A `StrictModel`.
    data
        Tables, lists, texts, numbers, truth values, times.
    file
        Named in the message.
    error
        Class of the error that is raised.
    cure
        What to do, a whole sentence.

    Raises
    ------
    InputError
        One of class `error`: the first mistake with field, expected and seen value, then the others.
    """
    try:
        # Through JSON, where a list may stand for a tuple and text for a time, and nothing else is converted.
        return model.model_validate_json(json.dumps(data, default=_time_as_text))
    except ValidationError as found:
        details = found.errors(include_url=False)
        deeper = {entry["loc"][:length] for entry in details for length in range(len(entry["loc"]))}
        # A list whose items are wrong is reported once more as too short: the items say why.
        told = [entry for entry in details if entry["loc"] not in deeper]
        mistakes = [_mistake(model, entry) for entry in told]
    except (ValueError, TypeError, RecursionError) as unusable:
        raise error(file=file, expected="plain values", seen=str(unusable)) from unusable
    of_version = [mistake for mistake in mistakes if mistake[0] == "schema"]
    # A file of another kind or version is wrong in many fields, of which only this one says why.
    first = (of_version or mistakes)[0]
    field, expected, seen, hint = first
    remedy = getattr(told[mistakes.index(first)].get("ctx", {}).get("error"), "remedy", None)
    others = [] if of_version else mistakes[1:]
    sentences = [sentence for sentence in (hint or cure,) if sentence]
    if others:
        listed = "; ".join(
            (f"field '{f}': " if f else "") + f"expected {e}, found {s}" + (f" ({h})" if h else "")
            for f, e, s, h in others[:_SHOWN]
        )
        more = f"; and {len(others) - _SHOWN} more" if len(others) > _SHOWN else ""
        sentences.insert(0, f"Also {listed}{more}")
    raise error(
        file=file,
        field=field or None,
        expected=expected,
        seen=seen,
        cure=". ".join(sentences) or None,
        remedy=remedy,
    )


def dump_json(model: BaseModel, *, without_none: bool = False) -> bytes:
    """Return the model as JSON, UTF-8, one line per field and per row of a matrix.

    Numbers are written with the fewest digits that read back to the same value. `without_none` leaves out
    what has no value.
    """
    plain = model.model_dump(mode="json", by_alias=True, exclude_none=without_none)
    return (_text(plain, "") + "\n").encode()


def _text(value: object, indent: str) -> str:
    inner = indent + "  "
    if isinstance(value, dict) and value:
        rows = (f"{json.dumps(key)}: {_text(item, inner)}" for key, item in value.items())
        return "{\n" + ",\n".join(inner + row for row in rows) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        return "[\n" + ",\n".join(inner + _text(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _time_as_text(value: object) -> str:
    if hasattr(value, "isoformat"):
        return str(value.isoformat())
    raise TypeError(f"a {type(value).__name__} is no plain value")


def _mistake(model: type[BaseModel], details: ErrorDetails) -> tuple[str, str, str, str | None]:
    """Field, what was expected, what was seen, hint."""
    location = details["loc"]
    kind, context = details["type"], details.get("ctx", {})
    seen = _shown(details["input"])
    if kind == "extra_forbidden":
        known = _fields_at(model, location[:-1])
        close = difflib.get_close_matches(str(location[-1]), known, 1)
        hint = (
            f"Did you mean '{close[0]}'?" if close else f"Known here: {', '.join(known)}" if known else None
        )
        return _dotted(location), "no such field", seen, hint
    if kind == "missing":
        return _dotted(location), _MESSAGES[kind], "none", None
    if kind == "value_error" and isinstance(context.get("error"), InputError):
        inner = context["error"]
        place = ".".join(part for part in (_dotted(location), inner.field) if part)
        return place, inner.expected, inner.seen or seen, inner.cure
    if kind in ("too_short", "too_long"):
        seen = str(context["actual_length"])
    if kind in _MESSAGES:
        return _dotted(location), _MESSAGES[kind].format(**context), seen, None
    expected = details["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    hint = "Another version of this program wrote the file, or it is of another kind"
    return _dotted(location), expected, seen, hint if location == ("schema",) else None


def _dotted(location: Iterable[str | int]) -> str:
    text = ""
    for part in location:
        if _is_schema(part):
            continue
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _is_schema(part: str | int) -> bool:
    """Whether a part of a place is the schema that chose one of several models: no key of the file."""
    return isinstance(part, str) and part.startswith("truewheel.")


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    text = "null" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "…"


def _fields_at(model: type[BaseModel], location: Iterable[str | int]) -> list[str]:
    """Return the keys that the table at this place may hold."""
    choices = [model]
    for part in location:
        if isinstance(part, int):
            continue
        if _is_schema(part):
            choices = [one for one in choices if part in typing.get_args(_schema_of(one))]
        else:
            fields = choices[0].model_fields if choices else {}
            by_key = {field.alias or name: field.annotation for name, field in fields.items()}
            choices = _models_in(by_key.get(str(part)))
        if not choices:
            return []
    model = choices[0]
    return [field.alias or name for name, field in model.model_fields.items()]


def _schema_of(model: type[BaseModel]) -> object:
    field = model.model_fields.get("schema_")
    return None if field is None else field.annotation


def _models_in(annotation: object) -> list[type[BaseModel]]:
    """Return the models in ``Model``, ``tuple[Model, ...]``, ``dict[str, Model]`` or ``Model | Other``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in typing.get_args(annotation) for model in _models_in(argument)]
