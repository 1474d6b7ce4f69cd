"""Pictures of reports in HTML: a mouse can zoom them, and ask a point what it is."""

from __future__ import annotations

import textwrap
from html import escape
from typing import Any

from station.quality.pictures import FEWEST_PLACES, Picture, Trace, colour, level_colour

_HEIGHT_PX, _PAPER_PX = 320, 210
_INK, _LINE, _GRID = "#222222", "#9aa0a6", "#e6e8ea"
_LABEL = 24  # letters of a line beside an axis
_FEW = 8  # a count that ends below has a tick at each number
_AXIS = {
    "linecolor": _LINE, "gridcolor": _GRID, "zeroline": False, "ticks": "outside", "tickcolor": _LINE,
    "automargin": True, "showline": True, "title": {"standoff": 8},
}  # fmt: skip

PROGRAM = (
    f"const SCREEN = {_HEIGHT_PX}, PAPER = {_PAPER_PX};"
    + """
// On paper a picture is as wide as the page, not as the window was; turned texts have no room there.
const all = (change) => document.querySelectorAll('.js-plotly-plot').forEach((p) => {
  const wanted = change(p);
  (p.layout.annotations || []).forEach((text, i) => {
    if (text.textangle) wanted[`annotations[${i}].visible`] = wanted.autosize;
  });
  Plotly.relayout(p, wanted);
});
addEventListener('beforeprint', () => all((p) => (
  {autosize: false, width: p.closest('.pictures') ? 340 : 690, height: PAPER})));
addEventListener('afterprint', () => all(() => ({autosize: true, width: null, height: SCREEN})));
"""
)
"""What a page with pictures runs beside plotly."""


def as_html(picture: Picture) -> str:
    """One ``<div>``; the page holds plotly's program once, and the title beside it."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for number, trace in enumerate(picture.traces):
        _add(figure, trace, colour(trace, number))
    for name, value in picture.levels.items():
        line = {"color": level_colour(name), "width": 1.2, "dash": "solid" if "centre" in name else "dash"}
        add = figure.add_vline if picture.limits_on_x else figure.add_hline
        # Its name stands outside of the data: over a vertical line, to the right of a level one.
        place = "top" if picture.limits_on_x else "right"
        add(value, line=line, annotation_text=escape(name), annotation_font_size=10,
            annotation_position=place)  # fmt: skip
    for at, text in picture.verticals:
        # Text of a line at a time is an annotation of its own: plotly averages its ends, which times are not.
        figure.add_shape(
            type="line", x0=at, x1=at, y0=0, y1=1, yref="paper", line={"dash": "dot", "width": 1}
        )
        figure.add_annotation(
            x=at, y=1, yref="paper", text=escape(text), showarrow=False, font={"size": 9}, textangle=-90,
            xanchor="left", yanchor="top", xshift=1,
        )  # fmt: skip
    figure.update_layout(**_layout(picture))
    html: str = figure.to_html(
        full_html=False, include_plotlyjs=False, config={"responsive": True, "displaylogo": False}
    )
    return html


def _add(figure: Any, trace: Trace, of_colour: str) -> None:
    import plotly.graph_objects as go

    common = {
        "x": [escape(at) if isinstance(at, str) else at for at in trace.x],
        "y": list(trace.y), "name": escape(trace.name),
        "hovertext": [escape(label) for label in trace.labels] or None,
        "yaxis": "y2" if trace.right else "y",
    }  # fmt: skip
    if trace.kind == "bar":
        figure.add_trace(go.Bar(**common, marker={"color": of_colour}))
        return
    mode = {"line": "lines+markers", "curve": "lines", "points": "markers"}[trace.kind]
    figure.add_trace(
        go.Scatter(**common, mode=mode, marker={"size": 5, "color": of_colour}, line={"width": 1.5})
    )


def _lines(label: str) -> str:
    """A long name of an upright axis on two lines."""
    return "<br>".join(map(escape, textwrap.wrap(label, _LABEL)))


def _layout(picture: Picture) -> dict[str, Any]:
    x_axis: dict[str, Any] = _AXIS | {"title": {"text": escape(picture.x_label), "standoff": 8}}
    y_axis: dict[str, Any] = _AXIS | {"title": {"text": _lines(picture.y_label), "standoff": 8}}
    if picture.names:
        places = max(len(picture.names), FEWEST_PLACES)
        x_axis |= {"type": "category", "range": [-0.5, places - 0.5], "showgrid": False}
    if picture.counted:
        y_axis |= {"rangemode": "tozero", "tickformat": ",d"}
        if max((value for trace in picture.traces if not trace.right for value in trace.y), default=0) < _FEW:
            y_axis["dtick"] = 1
    layout: dict[str, Any] = {
        "xaxis": x_axis,
        "yaxis": y_axis,
        "font": {"family": "system-ui, sans-serif", "size": 11, "color": _INK},
        "plot_bgcolor": "white",
        "paper_bgcolor": "white",
        "height": _HEIGHT_PX,
        "barmode": "stack" if picture.stacked else "group",
        "bargap": 0.05 if picture.limits_on_x else 0.3,
        "margin": {"t": 50, "b": 40, "l": 60, "r": 90 if picture.levels and not picture.limits_on_x else 30},
        "showlegend": len(picture.traces) > 1,
        "legend": {
            "orientation": "h", "x": 0, "xanchor": "left", "yref": "container", "y": 1, "yanchor": "top",
        },
    }  # fmt: skip
    if picture.two_axes:
        layout["yaxis2"] = _AXIS | {
            "title": {"text": escape(picture.right_label), "standoff": 8},
            "overlaying": "y", "side": "right", "range": [0, 105], "dtick": 20, "ticksuffix": " %",
            "showgrid": False,
        }  # fmt: skip
    return layout
