"""What revision 0010 read out of texts, once, to fill columns of rows that were there before.

As fixed as the revision itself: the chain of hashes covers the texts of those rows and not what was filled
in, so the check of the chain reads them again by the same rules. Nothing else does; newer rows are written
with their columns, and hashed with them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any
from uuid import UUID

_UUID = r"([0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12})"
# Of each code, how its text names one cycle.
_CYCLE: dict[str, re.Pattern[str]] = {
    "offered": re.compile(_UUID),
    "acknowledged": re.compile(_UUID),
    "discarded": re.compile(_UUID),
    "contradicted": re.compile(_UUID),
    "aborted_late": re.compile(_UUID),
    "not_reported": re.compile(f"cycle {_UUID}:"),
    "images_not_archived": re.compile(f"images of cycle {_UUID} are not archived"),
}
_TEMPERATURE = "temperature"
_DEGREES = re.compile(r"\s*([-+]?[0-9]+(?:[.,][0-9]+)?)")
CODES = (*_CYCLE, _TEMPERATURE)
"""Codes of events whose texts may tell something."""


def told_by_event(row: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of an event that its code and text tell; None where they do not."""
    named = _CYCLE.get(row["code"])
    cycle = None if named is None else named.match(row["text"])
    degrees = _DEGREES.match(row["text"]) if row["code"] == _TEMPERATURE else None
    value = None if degrees is None else float(degrees[1].replace(",", "."))
    return {
        "cycle_uuid": None if cycle is None else UUID(cycle[1]),
        "value": value if value is not None and math.isfinite(value) else None,
    }


def told_by_wheel(row: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of a wheel's result that its method tells; None where it does not."""
    return {"degraded": True if (row["method"] or "").endswith("/degraded") else None}


_RULES: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
    "events": told_by_event,
    "wheel_results": told_by_wheel,
}


def as_before(table: str, row: Mapping[str, Any]) -> Mapping[str, Any]:
    """A row as it was before its columns were filled; no such row when they hold anything else."""
    rule = _RULES.get(table)
    if rule is None:
        return row
    told = rule(row)
    if all(row[name] == value for name, value in told.items()):
        return {name: value for name, value in row.items() if name not in told}
    # Never what was hashed: a column that was emptied counts too.
    return {**row, **{name: value for name, value in told.items() if value is not None}}
