"""What a study is, what it yields, and the files it leaves."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from db.exports import csv_cell

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, str | float | int | None]
Progress = Callable[[float, str], None]
"""Told the fraction that is done, 0 … 1, and what goes on."""


@dataclass(frozen=True)
class Goal:
    """A limit that a figure must keep.

    Attributes
    ----------
    figure
        Name of the figure.
    sense
        ``at_most`` or ``at_least``.
    limit
        In the figure's unit.
    """

    figure: str
    sense: Literal["at_most", "at_least"]
    limit: float

    def __str__(self) -> str:
        return f"{'≤' if self.sense == 'at_most' else '≥'} {self.limit:g}"

    def met(self, value: float) -> bool:
        """Whether a value keeps the limit; not a number keeps none."""
        return value <= self.limit if self.sense == "at_most" else value >= self.limit

    def said(self, value: float, met: str = "met", missed: str = "MISSED") -> str:
        """The same in a word; where there is no number there is no verdict."""
        return "no verdict" if math.isnan(value) else met if self.met(value) else missed


@dataclass(frozen=True, eq=False)
class StudyResult:
    """What a study found.

    Attributes
    ----------
    rows
        The table, one mapping per row, all with the same keys.
    figures
        The headline numbers; a name carries its unit.
    goals
        Limits of some of them.
    text
        A few sentences: what was done, what came out, beside what was published.
    plots
        By name; the file's name follows from it.
    """

    rows: tuple[Row, ...]
    figures: Mapping[str, float]
    goals: tuple[Goal, ...]
    text: str
    plots: Mapping[str, Figure] = field(default_factory=dict)

    @property
    def missed(self) -> tuple[Goal, ...]:
        """Goals that were not met."""
        return tuple(goal for goal in self.goals if not goal.met(self.figures[goal.figure]))

    def as_json(self) -> dict[str, Any]:
        """Figures and goals as JSON values; a figure that is no number is null."""
        return {
            "figures": {name: _finite(value) for name, value in self.figures.items()},
            "goals": [
                {
                    "figure": goal.figure,
                    "value": _finite(self.figures[goal.figure]),
                    "sense": goal.sense,
                    "limit": goal.limit,
                    "met": goal.met(self.figures[goal.figure]),
                }
                for goal in self.goals
            ],
        }


class RunStudy(Protocol):
    """The work of a study."""

    def __call__(self, seed: int, quick: bool, progress: Progress) -> StudyResult:
        """Run it.

        Parameters
        ----------
        seed
            Of all random choices; the same seed gives the same result.
        quick
            Fewer repetitions: a minute at most, and figures that scatter more.
        progress
            Told how far it is.

        Raises
        ------
        TruewheelError
            When what it needs is not there.
        """
        ...


@dataclass(frozen=True)
class Study:
    """A study; its module has it under the name `STUDY`.

    Attributes
    ----------
    name
        As the command line calls it.
    summary
        What it shows, one line.
    run
        Does it.
    """

    name: str
    summary: str
    run: RunStudy


class Titled(Protocol):
    """What files are called after: a name, and one line of what it is."""

    @property
    def name(self) -> str:
        """As the files are called."""
        ...

    @property
    def summary(self) -> str:
        """One line."""
        ...


def write_study(study: Titled, result: StudyResult, folder: Path) -> list[Path]:
    """Write the table (CSV), the plots (PNG) and the text (Markdown) of a study; returns the files.

    Raises
    ------
    OSError
        When the folder or a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / f"{study.name}.csv"
    with table.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fieldnames=list(result.rows[0]) if result.rows else [])
        writer.writeheader()
        writer.writerows({name: csv_cell(value) for name, value in row.items()} for row in result.rows)
    files = [table]
    for name, figure in result.plots.items():
        files.append(folder / f"{name}.png")
        figure.savefig(files[-1], dpi=120)
    text = folder / f"{study.name}.md"
    text.write_text(_text(study, result), encoding="utf-8")
    return [*files, text]


def _text(study: Titled, result: StudyResult) -> str:
    lines = [f"# {study.name}", "", study.summary, "", result.text.strip(), ""]
    lines += ["| figure | value | goal | met |", "|---|---|---|---|"]
    for name, value in result.figures.items():
        goals = [goal for goal in result.goals if goal.figure == name]
        limits = " and ".join(str(goal) for goal in goals)
        # The first limit that is missed speaks for all.
        worst = next((goal for goal in goals if not goal.met(value)), goals[0]) if goals else None
        met = "" if worst is None else worst.said(value, "yes", "**no**")
        shown = "–" if math.isnan(value) else f"{value:.4g}"
        lines.append(f"| {name} | {shown} | {limits} | {met} |")
    lines += ["", *(f"![{name}]({name}.png)" for name in result.plots)]
    return "\n".join(lines) + "\n"


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
