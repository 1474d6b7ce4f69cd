"""What revisions 0010 and 0011 read out of texts, once, to fill columns of rows that were there before.

As fixed as the revisions themselves: the chain of hashes covers the texts of those rows and not what was
filled in, so the check of the chain reads them again by the same rules. Nothing else does; newer rows are
written with their columns, and hashed with them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
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
    """The columns of a wheel's result that its method told 0010; None where it did not."""
    return {"degraded": True if (row["method"] or "").endswith("/degraded") else None}


def kind_told_by_wheel(row: Mapping[str, Any]) -> dict[str, Any]:
    """The column that the same method told 0011."""
    beginning = (row["method"] or "").partition("/")[0]
    return {"kind": beginning if beginning in ("tyre_plane", "spin_axis") else None}


_Rule = Callable[[Mapping[str, Any]], dict[str, Any]]
_RULES: dict[str, dict[str, _Rule]] = {
    "0010": {"events": told_by_event, "wheel_results": told_by_wheel},
    "0011": {"wheel_results": kind_told_by_wheel},
}


def as_before(table: str, row: Mapping[str, Any], revisions: Iterable[str]) -> Mapping[str, Any]:
    """A row as it was before these revisions filled its columns; no such row when they hold anything else."""
    rules = [rule for revision in revisions if (rule := _RULES.get(revision, {}).get(table)) is not None]
    told = {name: value for rule in rules for name, value in rule(row).items()}
    if all(row[name] == value for name, value in told.items()):
        return {name: value for name, value in row.items() if name not in told}
    # Never what was hashed: a column that was emptied counts too.
    return {**row, **{name: value for name, value in told.items() if value is not None}}
