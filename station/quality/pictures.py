"""Pictures of reports, drawn twice from one description: by plotly for HTML, by matplotlib for PDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any, Literal

from matplotlib.figure import Figure

from db.exports import picture_text

_COLOURS = {
    "ok": "#2a7a2a", "nok": "#b02020", "fault": "#777777", "aborted": "#c9a227", "limit": "#b02020",
    "control": "#d07000", "second": "#d07000", "centre": "#2a7a2a", "signal": "#b02020",
}  # fmt: skip
_NAMES = 16  # names along an axis on paper


@dataclass(frozen=True)
class Trace:
    """One series of a picture.

    Attributes
    ----------
    kind
        Bars, a line through points, or points alone.
    x, y
        As many of each; `x` numbers, aware times or names.
    labels
        Shown beside a point that is pointed at; none or as many as points.
    colour
        A name of the palette, or empty for the next one.
    right
        Whether the axis on the right belongs to it.
    """

    name: str
    kind: Literal["bar", "line", "points"]
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
    limits_on_x
        Whether `levels` are drawn as vertical lines instead, for histograms.
    stacked
        Whether bars stand on each other.
    """

    title: str
    x_label: str
    y_label: str
    traces: tuple[Trace, ...]
    levels: Mapping[str, float] = field(default_factory=dict)
    verticals: Sequence[tuple[Any, str]] = ()
    limits_on_x: bool = False
    stacked: bool = False
    right_label: str = ""


def as_html(picture: Picture) -> str:
    """One ``<div>``; the page holds plotly's program once."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for trace in picture.traces:
        common = {
            "x": [escape(at) if isinstance(at, str) else at for at in trace.x],
            "y": list(trace.y), "name": escape(trace.name),
            "hovertext": [escape(label) for label in trace.labels] or None,
            "yaxis": "y2" if trace.right else "y",
        }  # fmt: skip
        colour = {"color": _COLOURS[trace.colour]} if trace.colour else {}
        if trace.kind == "bar":
            figure.add_trace(go.Bar(**common, marker=colour))
        else:
            mode = "lines+markers" if trace.kind == "line" else "markers"
            figure.add_trace(go.Scatter(**common, mode=mode, marker={"size": 5} | colour))
    for name, value in picture.levels.items():
        line = {"color": _level_colour(name), "width": 1, "dash": "solid" if "centre" in name else "dash"}
        add = figure.add_vline if picture.limits_on_x else figure.add_hline
        add(value, line=line, annotation_text=escape(name), annotation_font_size=10)
    for at, text in picture.verticals:
        # Text of a line at a time is an annotation of its own: plotly averages its ends, which times are not.
        figure.add_shape(
            type="line", x0=at, x1=at, y0=0, y1=1, yref="paper", line={"dash": "dot", "width": 1}
        )
        figure.add_annotation(x=at, y=1, yref="paper", text=escape(text), showarrow=False, font={"size": 9})
    layout: dict[str, Any] = {
        "title": {"text": escape(picture.title)},
        "xaxis": {"title": {"text": escape(picture.x_label)}},
        "yaxis": {"title": {"text": escape(picture.y_label)}},
        "template": "plotly_white",
        "height": 420,
        "barmode": "stack" if picture.stacked else "group",
        "margin": {"t": 60, "b": 50, "l": 70, "r": 60},
    }
    if any(trace.right for trace in picture.traces):
        layout["yaxis2"] = {
            "title": {"text": escape(picture.right_label)},
            "overlaying": "y",
            "side": "right",
            "rangemode": "tozero",
        }
    figure.update_layout(**layout)
    html: str = figure.to_html(full_html=False, include_plotlyjs=False)
    return html


def as_figure(picture: Picture) -> Figure:
    """The same, for paper."""
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    ax = figure.subplots()
    right = ax.twinx() if any(trace.right for trace in picture.traces) else ax
    below: list[float] = []
    for trace in picture.traces:
        on = right if trace.right else ax
        colour = _COLOURS.get(trace.colour)
        if trace.kind == "bar":
            if picture.stacked:
                below = below or [0.0] * len(trace.y)
                on.bar(trace.x, trace.y, bottom=below, label=trace.name, color=colour)
                below = [low + high for low, high in zip(below, trace.y, strict=True)]
            else:
                width = 0.8 if _words(trace.x) else _step(trace.x)
                on.bar(trace.x, trace.y, width, label=trace.name, color=colour)
        else:
            style = ".-" if trace.kind == "line" else "."
            on.plot(trace.x, trace.y, style, linewidth=0.8, markersize=4, label=trace.name, color=colour)
    for name, value in picture.levels.items():
        draw = ax.axvline if picture.limits_on_x else ax.axhline
        draw(value, color=_level_colour(name), linewidth=1, linestyle="-" if "centre" in name else "--")
    for at, text in picture.verticals:
        ax.axvline(at, color="0.4", linewidth=0.8, linestyle=":")
        ax.annotate(
            picture_text(text),
            (at, 1.0),
            xycoords=("data", "axes fraction"),
            fontsize=6,
            rotation=90,
            va="top",
        )
    title, x_label, y_label = map(picture_text, (picture.title, picture.x_label, picture.y_label))
    ax.set(title=title, xlabel=x_label, ylabel=y_label)
    if right is not ax:
        right.set_ylabel(picture.right_label)
        right.set_ylim(bottom=0.0)
    if len(picture.traces) > 1:
        ax.legend(fontsize=8)
    names = next(
        ([picture_text(str(at)) for at in trace.x] for trace in picture.traces if _words(trace.x)), []
    )
    if names:
        # More names than fit are thinned; the table has all.
        every = max(1, -(-len(names) // _NAMES))
        ax.set_xticks(range(0, len(names), every), names[::every], rotation=30, ha="right", fontsize=7)
    return figure


def _level_colour(name: str) -> str:
    return _COLOURS.get(name.split(maxsplit=1)[0], "#666666")


def _words(x: Sequence[Any]) -> bool:
    return any(isinstance(value, str) for value in x)


def _step(x: Sequence[Any]) -> float:
    """Distance of equally spaced bars; one for a single bar, and for times a day."""
    if len(x) < 2 or not isinstance(x[0], int | float):
        return 0.8
    return 0.95 * float(x[1] - x[0])
