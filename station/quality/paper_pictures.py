"""Pictures of reports on paper: those of one section share a sheet, so that they can be compared."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator, PercentFormatter

from db.exports import PAGE_WIDTH_IN, REFERENCE, in_style, legend_outside, picture_text, whole_numbers
from station.quality.pictures import FEWEST_PLACES, LEVELS, Picture, Trace, colour, level_colour, words

_ACROSS = 4  # pictures beside each other at most
_ROWS = 7  # and below each other on one sheet
_HEIGHTS_IN = {1: 1.6, 2: 1.5, 3: 1.25, 4: 1.05}  # of a picture, by how many stand beside each other
_TURNED_IN = 0.7
_BESIDES_IN = 0.4  # of the legend and the names of the axes
_SIZES = {1: (9.0, 7.0), 2: (8.0, 6.5), 3: (7.0, 6.0), 4: (6.5, 5.5)}  # of titles and ticks, points
_LETTERS = 100  # of ticks beside each other over the width of a page, each with its gap
_LONGEST_NAME, _KEPT = 28, 13  # along an axis; the table below has all of it


def as_figure(picture: Picture) -> Figure:
    """One picture, as wide as a page."""
    return _sheet([picture], 1)


def sheets(pictures: Sequence[Picture], room_in: Callable[[], float]) -> Iterator[Figure]:
    """Yield pictures of one kind beside and below each other, on as many sheets as they take.

    Parameters
    ----------
    pictures
        Any number.
    room_in
        Asked for the height that is left on the page, inches, before each sheet: it has the rows that fit
        there. Where none does it has those of a new page.
    """
    across = min(max(1, len(pictures)), _ACROSS)
    height = _height_in(pictures, across)
    first = 0
    while first < len(pictures):
        fitting = int((room_in() - _BESIDES_IN) / height)
        last = first + across * (fitting if fitting > 0 else _ROWS)
        yield _sheet(pictures[first:last], across)
        first = last


def _height_in(pictures: Sequence[Picture], across: int) -> float:
    """Height of one picture: those with names that must turn are higher by them."""
    turned = any(picture.names and not _level(picture.names, across) for picture in pictures)
    return _HEIGHTS_IN[across] + (_TURNED_IN if turned else 0.0)


@in_style
def _sheet(pictures: Sequence[Picture], across: int) -> Figure:
    title, tick = _SIZES[across]
    mpl.rcParams.update(
        {"axes.titlesize": title, "axes.labelsize": tick + 0.5, "legend.fontsize": tick + 0.5}
    )
    mpl.rcParams.update({"xtick.labelsize": tick, "ytick.labelsize": tick})
    down = math.ceil(len(pictures) / across)
    figure = Figure(
        figsize=(PAGE_WIDTH_IN, _height_in(pictures, across) * down + _BESIDES_IN), layout="constrained"
    )
    axes = list(figure.subplots(down, across, squeeze=False).ravel())
    for spare in axes[len(pictures) :]:
        spare.set_axis_off()
    for picture, ax in zip(pictures, axes, strict=False):
        _draw(picture, ax, across)
    _label(figure, pictures, axes)
    if any(len(picture.traces) > 1 or picture.levels or picture.verticals for picture in pictures):
        legend_outside(figure)
    return figure


def _draw(picture: Picture, ax: Axes, across: int) -> None:
    right = ax.twinx() if picture.two_axes else ax
    below: list[float] = []
    for number, trace in enumerate(picture.traces):
        on = right if trace.right else ax
        if trace.kind == "bar" and picture.stacked:
            below = below or [0.0] * len(trace.y)
            on.bar(trace.x, trace.y, bottom=below, label=_name(trace), color=colour(trace, number))
            below = [low + high for low, high in zip(below, trace.y, strict=True)]
        else:
            _draw_trace(on, trace, colour(trace, number))
    for name, value in picture.levels.items():
        draw = ax.axvline if picture.limits_on_x else ax.axhline
        first = name.split(maxsplit=1)[0] if name.strip() else ""
        draw(value, color=level_colour(name), linewidth=0.9, linestyle="-" if "centre" in name else "--",
             label=_legend_text(LEVELS.get(first, name)))  # fmt: skip
    for at, _ in picture.verticals:
        ax.axvline(
            at, color=REFERENCE, linewidth=0.8, linestyle=":", label=_legend_text(picture.vertical_name)
        )
    width = int(_LETTERS * 1.15 / across)
    ax.set_title("\n".join(picture_text(line) for line in textwrap.wrap(picture.title, width)))
    if picture.counted:
        whole_numbers(ax)
    else:
        ax.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    if right is not ax:
        _percents(right, picture)
    if picture.names:
        _name_places(ax, picture.names, across)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(nbins=max(4, 10 // across), steps=[1, 2, 5, 10]))


def _draw_trace(ax: Axes, trace: Trace, of_colour: str) -> None:
    if trace.kind == "bar":
        ax.bar(trace.x, trace.y, _step(trace.x), label=_name(trace), color=of_colour)
        return
    style = {"line": ".-", "curve": "-", "points": "."}[trace.kind]
    size = 6 if trace.kind == "points" else 3
    ax.plot(trace.x, trace.y, style, linewidth=0.8, markersize=size, label=_name(trace), color=of_colour)


def _percents(ax: Axes, picture: Picture) -> None:
    ax.set_ylabel(picture_text(picture.right_label))
    ax.set_ylim(0.0, 105.0)
    ax.yaxis.set_major_locator(MultipleLocator(20.0))
    ax.yaxis.set_major_formatter(PercentFormatter(decimals=0))
    ax.spines["right"].set_visible(True)
    ax.grid(visible=False)


def _name_places(ax: Axes, names: Sequence[str], across: int) -> None:
    """Names along an axis, level where they have room; more than fit are thinned, the table has all."""
    cut = [name if len(name) <= _LONGEST_NAME else f"{name[:_KEPT]}…{name[-_KEPT:]}" for name in names]
    shown = [picture_text(name) for name in cut]
    room, longest = _LETTERS // across, max(map(len, cut)) + 2
    level = _level(names, across)
    most = max(2, room // longest) if level else max(4, 16 // across)
    every = max(1, -(-len(names) // most))
    turned: dict[str, Any] = {} if level else {"rotation": 30, "ha": "right", "rotation_mode": "anchor"}
    ax.set_xticks(range(0, len(names), every), shown[::every], **turned)
    ax.set_xlim(-0.6, max(len(names), FEWEST_PLACES) - 0.4)
    ax.grid(visible=False, axis="x")


def _level(names: Sequence[str], across: int) -> bool:
    """Whether names stand level along an axis: days always do, thinned; others where they have room."""
    days = all(name[:4].isdigit() for name in names)
    return days or len(names) * (max(map(len, names)) + 2) <= _LETTERS // across


def _label(figure: Figure, pictures: Sequence[Picture], axes: Sequence[Axes]) -> None:
    """Axes are named: once for the sheet where all have the same name."""
    for axis in ("x", "y"):
        labels = [picture_text(getattr(picture, f"{axis}_label")) for picture in pictures]
        if len(labels) > 1 and len(set(labels)) == 1:
            size = mpl.rcParams["axes.labelsize"]
            getattr(figure, f"sup{axis}label")(labels[0], fontsize=size)
            continue
        for label, ax in zip(labels, axes, strict=False):
            # In small pictures a long one takes two lines.
            lines = textwrap.wrap(label, 20) if len(pictures) > 1 else [label]
            getattr(ax, f"set_{axis}label")("\n".join(lines))


def _name(trace: Trace) -> str:
    return _legend_text(trace.name)


def _legend_text(text: str) -> str:
    # A name that begins with an underscore would be no name.
    shown = picture_text(text)
    return f" {shown}" if shown.startswith("_") else shown


def _step(x: Sequence[Any]) -> float:
    """Width of equally spaced bars."""
    if words(x) or len(x) < 2 or not isinstance(x[0], int | float):
        return 0.7
    return 0.95 * float(x[1] - x[0])
