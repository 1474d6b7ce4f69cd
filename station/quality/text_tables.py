"""Tables for a terminal."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from station.figures import StudyResult

_FILE_WIDTH = 160
_LONG = 40


def table(rows: Sequence[Mapping[str, Any]], title: str | None = None) -> Table:
    """Rows of the same keys; numbers to the right, with as many digits as a person reads."""
    found = Table(title=title, title_justify="left", box=SIMPLE, pad_edge=False)
    names = list(rows[0]) if rows else []
    for name in names:
        number = any(isinstance(row[name], int | float) for row in rows)
        # Only long text is broken into lines: where a table is too wide, numbers must not be the first to go.
        long = max(len(shown(row[name])) for row in rows) > _LONG
        found.add_column(name.replace("_", " "), justify="right" if number else "left", no_wrap=not long)
    for row in rows:
        found.add_row(*(shown(row[name]) for name in names))
    return found


def figure_table(result: StudyResult) -> Table:
    """Figures beside their limits."""
    rows = []
    for name, value in result.figures.items():
        goals = [goal for goal in result.goals if goal.figure == name]
        limit = ", ".join(f"{goal} {goal.said(value)}" for goal in goals)
        rows.append({"figure": name, "value": None if math.isnan(value) else value, "limit": limit})
    return table(rows)


def terminal() -> Console:
    """Standard output; as wide as the tables where it is no terminal but a file or a pipe."""
    return Console(width=None if sys.stdout.isatty() else _FILE_WIDTH)


def shown(value: object) -> str:
    """A cell: five digits of a number, a dash for none."""
    if value is None:
        return "–"
    # Not markup: a name may hold a bracket.
    return f"{value:.5g}" if isinstance(value, float) else str(value).replace("[", "\\[")
