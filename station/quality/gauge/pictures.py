"""Pictures of gauge studies and control charts."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.statistics import ControlChart, GaugeData, GrrResult, LinearityResult, Track, UncertaintyBudget
from db.exports import (
    BAD,
    GOOD,
    MUTED,
    PAGE_WIDTH_IN,
    REFERENCE,
    SERIES,
    WARNING,
    in_style,
    legend_outside,
    picture_text,
    whole_numbers,
)

_LETTERS = 95  # of ticks beside each other over the width of a picture


@in_style
def grr_components(found: GrrResult) -> Figure:
    """Bars of the components: share of the variance, of the study variation, of the tolerance."""
    names = {
        "GRR": found.grr,
        "repeatability": found.repeatability,
        "reproducibility": found.reproducibility,
        "parts": found.part_variation,
    }
    percents = {
        "contribution": [
            (found.percent_study_variation(value) or 0.0) ** 2 / 100 for value in names.values()
        ],
        "study variation": [found.percent_study_variation(value) or 0.0 for value in names.values()],
    }
    if found.tolerance is not None:
        percents["tolerance"] = [found.percent_tolerance(value) or 0.0 for value in names.values()]
    figure = Figure(figsize=(PAGE_WIDTH_IN, 2.7), layout="constrained")
    ax = figure.subplots()
    width = 0.8 / len(percents)
    for number, (label, values) in enumerate(percents.items()):
        at = np.arange(len(names)) + (number - (len(percents) - 1) / 2) * width
        ax.bar(at, values, width, label=f"% {label}")
    ax.axhline(10, color=GOOD, linestyle="--", label="10 %")
    ax.axhline(30, color=BAD, linestyle="--", label="30 %")
    ax.set(xticks=range(len(names)), xticklabels=list(names), ylabel="percent")
    ax.grid(visible=False, axis="x")
    legend_outside(figure)
    return figure


@in_style
def grr_values(data: GaugeData, unit: str) -> Figure:
    """All values by part, and the ranges of the trials, one colour per appraiser."""
    parts = list(dict.fromkeys(data.parts))
    owners = data.appraisers if data.appraisers is not None else [""] * len(data.parts)
    appraisers = list(dict.fromkeys(owners))
    figure = Figure(figsize=(PAGE_WIDTH_IN, 4.4), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    place = {part: number for number, part in enumerate(parts)}
    for number, appraiser in enumerate(appraisers):
        at = (number - (len(appraisers) - 1) / 2) * 0.6 / len(appraisers)
        cells: dict[str, list[float]] = {part: [] for part in parts}
        for part, owner, value in zip(data.parts, owners, data.values, strict=True):
            if owner == appraiser:
                cells[part].append(data.offset + float(value))
        for part, values in cells.items():
            top.plot([place[part] + at] * len(values), values, ".", color=SERIES[number % len(SERIES)])
        known = [part for part in parts if cells[part]]
        x = [place[part] + at for part in known]
        means = [float(np.mean(cells[part])) for part in known]
        top.plot(
            x,
            means,
            "-",
            linewidth=0.8,
            color=SERIES[number % len(SERIES)],
            label=picture_text(appraiser) or None,
        )
        bottom.plot(
            x,
            [float(np.ptp(cells[part])) for part in known],
            "o-",
            markersize=3,
            color=SERIES[number % len(SERIES)],
        )
    top.set_ylabel(_labelled("value", unit))
    bottom.set_ylabel(_labelled("range of trials", unit))
    bottom.set_ylim(bottom=0.0)
    # Names turn where they have no room beside each other.
    turned: dict[str, Any] = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}
    level = sum(len(part) + 2 for part in parts) <= _LETTERS
    bottom.set_xticks(range(len(parts)), [picture_text(part) for part in parts], **({} if level else turned))
    bottom.set_xlabel("part")
    if any(appraisers):
        legend_outside(figure, title="appraiser")
    return figure


@in_style
def type1_run(values: Array, reference: float, width: float, unit: str) -> Figure:
    """Run of the repetitions between the reference ± half the allowed width."""
    figure = Figure(figsize=(PAGE_WIDTH_IN, 2.8), layout="constrained")
    run, histogram = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    run.plot(np.arange(1, len(values) + 1), values, ".-", linewidth=0.8)
    for ax in (run, histogram):
        ax.axhline(reference, color=GOOD, label="reference")
        for sign in (-1, 1):
            ax.axhline(reference + sign * width / 2, color=BAD, linestyle="--", label="allowed")
    histogram.hist(values, bins="auto" if np.ptp(values) > 0 else 1, orientation="horizontal")
    run.set(xlabel="repetition", ylabel=_labelled("value", unit))
    histogram.set_xlabel("count")
    whole_numbers(run, "x")
    whole_numbers(histogram, "x")
    legend_outside(figure)
    return figure


@in_style
def linearity_line(found: LinearityResult, values: Array, references: Array, unit: str) -> Figure:
    """Single errors, biases, line and confidence band."""
    figure = Figure(figsize=(PAGE_WIDTH_IN, 3.4), layout="constrained")
    ax = figure.subplots()
    ax.plot(references, values - references, ".", color=MUTED, label="single errors")
    ax.plot([b.reference for b in found.biases], [b.bias for b in found.biases], "D", label="biases")
    x = np.linspace(references.min(), references.max(), 100)
    low, high = found.band(x)
    ax.plot(x, found.intercept + found.slope * x, color=WARNING, label="line")
    ax.fill_between(x, low, high, alpha=0.2, color=WARNING, label=f"{100 * found.confidence:g} % band")
    ax.axhline(0.0, color=REFERENCE)
    ax.set(xlabel=_labelled("certified value", unit), ylabel=_labelled("error", unit))
    legend_outside(figure)
    return figure


@in_style
def chart_picture(chart: ControlChart, offset: float = 0.0, unit: str = "") -> Figure:
    """Both tracks of a control chart, signals in red with the number of their rule."""
    figure = Figure(figsize=(PAGE_WIDTH_IN, 3.8), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    first = 1 if chart.size > 1 or not len(chart.spread.points) else 2
    _draw_track(top, chart.location, 1, offset, unit)
    _draw_track(bottom, chart.spread, first, 0.0, unit)
    bottom.set_xlabel("subgroup" if chart.size > 1 else "value")
    whole_numbers(bottom, "x")
    legend_outside(figure)
    return figure


@in_style
def budget_bars(found: UncertaintyBudget) -> Figure:
    """Standard uncertainties of the budget, those that another one stands for in grey."""
    figure = Figure(figsize=(PAGE_WIDTH_IN, 0.28 * len(found.lines) + 1.0), layout="constrained")
    ax = figure.subplots()
    names = [picture_text(f"{line.component.kind} {line.component.source}".strip()) for line in found.lines]
    colours = [SERIES[0] if line.counted else MUTED for line in found.lines]
    at = np.arange(len(names))
    ax.barh(at, [line.component.u for line in found.lines], color=colours)
    ax.set(yticks=at, yticklabels=names, xlabel="standard uncertainty")
    ax.axvline(found.u_mp, color=BAD, label="u_MP, the whole process")
    ax.grid(visible=False, axis="y")
    legend_outside(figure)
    ax.invert_yaxis()
    return figure


def _draw_track(ax: Axes, track: Track, first: int, offset: float, unit: str) -> None:
    x = np.arange(first, first + len(track.points))
    ax.plot(x, offset + track.points, ".-", linewidth=0.8, markersize=4)
    ax.axhline(offset + track.centre, color=GOOD, label="centre")
    for limit in (track.lower, track.upper):
        ax.axhline(offset + limit, color=WARNING, linestyle="--", label="control limit")
    for signal in track.signals:
        point = (x[signal.index], offset + track.points[signal.index])
        ax.plot(*point, "o", color=BAD, markersize=5, label="signal and its rule")
        ax.annotate(str(signal.rule), point, textcoords="offset points", xytext=(3, 4), fontsize=7)
    ax.set_ylabel(_labelled(track.name, unit))


def _labelled(name: str, unit: str) -> str:
    return picture_text(f"{name} [{unit}]" if unit else name)
