"""Configuration files: TOML, checked against a model, every mistake one sentence naming file and field."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from alignment.errors import ConfigurationError
from sensors.formats import StrictModel, load_toml, validate

_M = TypeVar("_M", bound=StrictModel)


def read_toml(model: type[_M], path: Path, kind: str) -> _M:
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
    return validate(model, load_toml(path, kind), file=path, error=ConfigurationError)
