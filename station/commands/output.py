"""What commands have in common: JSON on standard output, everything else on standard error."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any
from uuid import UUID

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


def reason_of_force(force: bool, reason: str, what: str, longest: int = 1000) -> str | None:
    """Return why something is forced; None when it is not.

    Raises
    ------
    ConfigurationError
        When only one of ``--force`` and ``--reason`` is given, or the reason has more than `longest`
        characters; `what` names what is forced.
    """
    if force != bool(reason.strip()):
        raise ConfigurationError(
            field="--force, --reason",
            expected=f"both or neither: a forced {what} says why",
            seen="--force alone" if force else "--reason alone",
            cure='Add --reason "…"' if force else "Add --force, or leave the reason out",
        )
    if len(reason.strip()) > longest:
        raise ConfigurationError(
            field="--reason", expected=f"at most {longest} characters", seen=str(len(reason.strip()))
        )
    return reason.strip() if force else None


def read_uuid(field: str, text: str) -> UUID:
    """Return the UUID that an option or argument says.

    Raises
    ------
    ConfigurationError
        When it is none.
    """
    try:
        return UUID(text)
    except ValueError:
        raise ConfigurationError(field=field, expected="a UUID", seen=ascii(text)) from None
