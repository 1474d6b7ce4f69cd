"""Configuration files: TOML, checked against a model, every mistake one sentence naming file and field."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TypeVar

from alignment.errors import ConfigurationError
from sensors.formats.validation import StrictModel, validate

M = TypeVar("M", bound=StrictModel)


def read_toml(model: type[M], path: Path, kind: str) -> M:
    """Read a TOML file as a model.

    Parameters
    ----------
    model
        A `StrictModel`: unknown keys are refused.
    path
        The file, UTF-8.
    kind
        What it should be, such as "a station's configuration", for the message.

    Raises
    ------
    ConfigurationError
        When the file is missing, is no TOML (the line is named), or a field is missing, unknown or out of
        range.
    """
    try:
        data = tomllib.loads(path.read_text("utf-8-sig"))
    except OSError as error:
        seen = "no such file" if isinstance(error, FileNotFoundError) else error.strerror or str(error)
        raise ConfigurationError(
            file=path, expected=kind, seen=seen, cure="Check the name and the path"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigurationError(file=path, expected=f"{kind} in TOML", seen=f"an error: {error}") from error
    return validate(model, data, file=path, error=ConfigurationError)
