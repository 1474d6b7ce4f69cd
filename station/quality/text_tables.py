"""Tables and names for a terminal."""

from __future__ import annotations

import math
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from station.figures import StudyResult
from station.quality.cells import heading, is_number_column, shown

_FILE_WIDTH = 160
_LONG = 40
_LEAST_OF_LONG = 24
_BETWEEN = 3  # blanks between two columns


def print_table(console: Console, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print rows of the same keys; numbers to the right, with as many digits as a person reads.

    A table that is wider than the console continues below, its first column repeated: no text is cut.
    """
    names = list(rows[0]) if rows else []
    if not names:
        return
    needed = {name: _least_width(name, rows) + _BETWEEN for name in names}
    blocks = [[names[0]]]
    for name in names[1:]:
        block = blocks[-1]
        if len(block) > 1 and sum(needed[other] for other in (*block, name)) > console.width:
            blocks.append(block := [names[0]])
        block.append(name)
    for block in blocks:
        console.print(_table(block, rows))


def figure_rows(result: StudyResult) -> list[dict[str, Any]]:
    """Figures beside their limits, as rows of a table."""
    rows = []
    for name, value in result.figures.items():
        goals = [goal for goal in result.goals if goal.figure == name]
        limit = ", ".join(f"{goal} {goal.said(value)}" for goal in goals)
        rows.append({"figure": name, "value": None if math.isnan(value) else value, "limit": limit})
    return rows


def print_names(console: Console, title: str, names: Sequence[str]) -> None:
    """Print a list of names, broken between them alone, so that each can be marked and copied."""
    console.print(
        textwrap.fill(
            f"{title}: {', '.join(names) or 'none'}",
            console.width,
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        ),
        soft_wrap=True,
        markup=False,
        highlight=False,
    )


def terminal() -> Console:
    """Standard output; as wide as the tables where it is no terminal but a file or a pipe."""
    return Console(width=None if sys.stdout.isatty() else _FILE_WIDTH)


def _table(names: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> Table:
    found = Table(box=SIMPLE, pad_edge=False)
    for name in names:
        number = is_number_column(row[name] for row in rows)
        # Only long text is broken into lines: where a table is too wide, numbers must not be the first to go.
        found.add_column(
            heading(name),
            justify="right" if number else "left",
            no_wrap=_longest(name, rows) <= _LONG,
            min_width=_least_width(name, rows),
            overflow="fold",
        )
    for row in rows:
        # Text, not markup: a name may hold a bracket.
        found.add_row(*(Text(shown(name, row[name])) for name in names))
    return found


def _longest(name: str, rows: Sequence[Mapping[str, Any]]) -> int:
    return max(cell_len(shown(name, row[name])) for row in rows)


def _least_width(name: str, rows: Sequence[Mapping[str, Any]]) -> int:
    """Letters that a column needs: its heading, and all of a short text, the longest word of a long one."""
    longest = _longest(name, rows)
    if longest > _LONG:
        words = {word for row in rows for word in shown(name, row[name]).split()}
        longest = max(_LEAST_OF_LONG, *map(cell_len, words))
    return max(longest, cell_len(heading(name)))
