"""What commands have in common: JSON on standard output, everything else on standard error."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from alignment.errors import ConfigurationError

GOAL_MISSED = 1
BAD_INPUT = 2
STATION_FAULT = 3

JsonFlag = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else there.")
]


def print_json(value: Mapping[str, Any]) -> None:
    """Print one object on standard output."""
    typer.echo(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False))


def default_config(given: Path | None, name: str = "station.toml") -> Path:
    """Return the configuration to use: the given one, else ``configs/`` here or beside the program.

    Raises
    ------
    ConfigurationError
        When none is given and there is none in either place.
    """
    if given is not None:
        return given
    places = (Path("configs") / name, Path(__file__).parents[2] / "configs" / name)
    for place in places:
        if place.is_file():
            return place
    raise ConfigurationError(
        file=places[0], expected="a configuration", seen="no such file", cure="Name one with --config"
    )
