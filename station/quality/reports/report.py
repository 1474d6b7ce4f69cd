"""What a report is: sections with tables, figures and pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from db.queries import Filter
from station.quality.pictures import Picture

Cell = str | float | int | bool | None
TableRow = Mapping[str, Cell]


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes
    ----------
    name
        As JSON calls it.
    rows
        The table, one mapping per row, all with the same keys; a key carries its unit.
    figures
        The headline numbers.
    text
        What the table says, and what it does not.
    brief
        The columns that a terminal and paper have room for; none means all.
    empty
        What it says that there is no row.
    """

    name: str
    title: str
    rows: Sequence[TableRow]
    figures: Mapping[str, float | int | None] = field(default_factory=dict)
    text: str = ""
    pictures: Sequence[Picture] = ()
    brief: Sequence[str] = ()
    empty: str = "Nothing."

    def as_json(self) -> dict[str, Any]:
        """JSON values; a number that is none is null."""
        return {
            "name": self.name,
            "title": self.title,
            "text": self.text,
            "figures": {name: _finite(value) for name, value in self.figures.items()},
            "rows": [{name: _finite(value) for name, value in row.items()} for row in self.rows],
        }


@dataclass(frozen=True)
class Report:
    """Sections about the results of one filter.

    Attributes
    ----------
    about
        The filter in words.
    made_utc
        When it was asked.
    """

    name: str
    title: str
    about: str
    database: str
    made_utc: datetime
    sections: Sequence[Section]

    def as_json(self) -> dict[str, Any]:
        """What `--json` prints, but for the files."""
        figures: dict[str, Any] = {}
        for section in self.sections:
            figures |= section.as_json()["figures"]
        return {
            "report": self.name,
            "about": self.about,
            "database": self.database,
            "made_utc": self.made_utc.isoformat(),
            "figures": figures,
            "sections": [section.as_json() for section in self.sections],
        }


def in_words(where: Filter) -> str:
    """A filter as a person reads it."""
    said = []
    if where.from_utc is not None:
        said.append(f"from {shown_time(where.from_utc)}")
    if where.until_utc is not None:
        said.append(f"until {shown_time(where.until_utc)}")
    if where.shift is not None:
        said.append(f"shift {where.shift.name} ({where.shift.timezone})")
    for name, values in (
        ("plant", where.plants), ("station", where.stations), ("type", where.vehicle_types),
        ("wheel", where.wheels),
    ):  # fmt: skip
        if values:
            said.append(f"{name} {', '.join(values)}")
    if where.verdict is not None:
        said.append(f"verdict {where.verdict}")
    if where.vin is not None:
        said.append(f"VIN {where.vin}")
    return "; ".join(said) or "all results"


def shown_time(time: datetime | None) -> str:
    """A time as a person reads it; a dash for none."""
    return "–" if time is None else f"{time.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
