"""What a picture of a report shows; drawn twice from this description, for pages and for paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from db.exports import BAD, GOOD, MUTED, REFERENCE, SERIES, WARNING

COLOURS = {
    "ok": GOOD, "nok": BAD, "fault": MUTED, "aborted": "#c9a227", "limit": BAD, "control": WARNING,
    "second": WARNING, "centre": GOOD, "signal": BAD,
}  # fmt: skip
"""Colour of a trace or a level by what it means."""

LEVELS = {"limit": "limit", "control": "control limit", "centre": "centre"}
"""What a legend calls a level, by the first word of its name."""

FEWEST_PLACES = 5
"""Places along an axis of names: two bars are no walls."""


@dataclass(frozen=True)
class Trace:
    """One series of a picture.

    Attributes
    ----------
    kind
        Bars, a line through points, a curve without points, or points alone.
    x, y
        As many of each; `x` numbers, aware times or names.
    labels
        Shown beside a point that is pointed at; none or as many as points.
    colour
        A name of the palette, or empty for the next one.
    right
        Whether the axis on the right belongs to it, which is one of percents.
    """

    name: str
    kind: Literal["bar", "line", "curve", "points"]
    x: Sequence[Any]
    y: Sequence[float]
    labels: Sequence[str] = ()
    colour: str = ""
    right: bool = False


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes
    ----------
    levels
        Horizontal lines: value by name; the colour follows from the name's first word.
    verticals
        Vertical lines: abscissa and text.
    vertical_name
        What they are.
    limits_on_x
        Whether `levels` are drawn as vertical lines instead, for histograms.
    stacked
        Whether bars stand on each other.
    counted
        Whether `y` counts something: its axis has whole numbers.
    """

    title: str
    x_label: str
    y_label: str
    traces: tuple[Trace, ...]
    levels: Mapping[str, float] = field(default_factory=dict)
    verticals: Sequence[tuple[Any, str]] = ()
    vertical_name: str = "change"
    limits_on_x: bool = False
    stacked: bool = False
    counted: bool = False
    right_label: str = ""

    @property
    def names(self) -> list[str]:
        """Names along the axis; none where it is one of numbers or times."""
        return next(([str(at) for at in trace.x] for trace in self.traces if words(trace.x)), [])

    @property
    def two_axes(self) -> bool:
        """Whether there is an axis on the right."""
        return any(trace.right for trace in self.traces)


def words(x: Sequence[Any]) -> bool:
    """Whether an axis is one of names."""
    return any(isinstance(value, str) for value in x)


def colour(trace: Trace, number: int) -> str:
    """Colour of the trace that is the `number`-th of its picture."""
    return COLOURS[trace.colour] if trace.colour else SERIES[number % len(SERIES)]


def level_colour(name: str) -> str:
    """Colour of a level."""
    return COLOURS.get(name.split(maxsplit=1)[0] if name.strip() else "", REFERENCE)
