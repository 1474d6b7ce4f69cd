"""What commands have in common: JSON on standard output, everything else on standard error."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any

import typer

GOAL_MISSED = 1
BAD_INPUT = 2
STATION_FAULT = 3

JsonFlag = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else there.")
]


def print_json(value: Mapping[str, Any]) -> None:
    """Print one object on standard output."""
    typer.echo(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False))
