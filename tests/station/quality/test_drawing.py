"""Pictures as a quality manager shows them: round ticks, legends beside the data, names that can be read."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from alignment.statistics import (
    ChartKind,
    GaugeData,
    GrrMethod,
    RuleSet,
    control_chart,
    grr,
    linearity,
)
from station.quality.gauge import pictures as gauge
from station.quality.page_pictures import as_html
from station.quality.paper_pictures import as_figure, sheets
from station.quality.pictures import Picture, Trace
from tests.drawn import assert_clear

ROOT = Path(__file__).resolve().parents[3]
LONG = "Achsvermessung-Halle-Sued-Linie-2-Platz-1"


def pareto(names: list[str]) -> Picture:
    counts = [float(count) for count in range(len(names), 0, -1)]
    shares = (100 * np.cumsum(counts) / sum(counts)).tolist()
    traces = (
        Trace("count", "bar", names, counts),
        Trace("cumulative", "line", names, shares, colour="second", right=True),
    )
    return Picture("Pareto of reasons", "reason", "count", traces, counted=True, right_label="cumulative")


def chart(title: str, n: int = 40) -> Picture:
    values = np.random.default_rng(3).normal(0.1, 0.02, n).tolist()
    traces = (
        Trace("value", "line", list(range(1, n + 1)), values),
        Trace("signal", "points", [5], [values[4]], colour="signal"),
    )
    levels = {"centre": 0.1, "control upper": 0.16, "control lower": 0.04}
    return Picture(title, "value", "degrees from the middle of the limits", traces, levels)


def days(n: int) -> Picture:
    names = [f"2026-{1 + day // 28:02d}-{1 + day % 28:02d}" for day in range(n)]
    traces = tuple(Trace(name, "bar", names, [float(n)] * n, colour=name) for name in ("ok", "nok", "fault"))
    return Picture("Vehicles by day", "day (UTC)", "vehicles", traces, stacked=True, counted=True)


def histogram(title: str) -> Picture:
    x = np.linspace(0.02, 0.18, 9).tolist()
    traces = (
        Trace("values", "bar", x, [1.0, 2, 4, 7, 9, 7, 3, 1, 1]),
        Trace("normal", "curve", np.linspace(0, 0.2, 50).tolist(), [4.0] * 50, colour="second"),
    )
    levels = {"limit low": 0.0, "limit high": 0.2, "centre mean": 0.1}
    return Picture(title, "degrees", "vehicles", traces, levels, limits_on_x=True, counted=True)


def one_sheet(pictures: list[Picture]) -> Figure:
    [sheet] = sheets(pictures, lambda: 10.0)
    return sheet


@pytest.mark.parametrize(
    "figure",
    [
        lambda: as_figure(pareto(["head_dark rear_left", "toe_high front_left", "refused"])),
        lambda: as_figure(pareto([f"a_reason_with_a_long_name_{n} {LONG}" for n in range(20)])),
        lambda: as_figure(days(2)),
        lambda: as_figure(days(90)),
        lambda: one_sheet([histogram(f"front_left.toe, {LONG}")] * 8),
        lambda: one_sheet([histogram("front_left.toe")] * 3),
        lambda: one_sheet([chart("front_left.camber: moving range")] * 16),
        lambda: one_sheet([days(14)] * 4),
        lambda: one_sheet([chart("front_left.toe: value"), histogram("rear")]),
    ],
)
def test_pictures_of_reports_are_clear(figure: object) -> None:
    """The legend stood on the data, and names of days on each other."""
    assert_clear(figure())  # type: ignore[operator]


def test_pareto_has_round_percents_on_the_right_and_whole_numbers_on_the_left() -> None:
    """The right axis had ticks at 25.4, 50.7 and 76.1, under the legend."""
    picture = pareto(["a", "b", "c"])
    left, right = as_figure(picture).axes
    assert [tick for tick in right.get_yticks() if 0 <= tick <= 100] == [0, 20, 40, 60, 80, 100]
    assert all(tick == int(tick) for tick in left.get_yticks())
    layout = layout_of(as_html(picture))
    assert (layout["yaxis2"]["dtick"], layout["yaxis2"]["range"]) == (20, [0, 105])
    assert layout["yaxis"]["dtick"] == 1
    # Above the plot, so away from the axis on the right.
    assert layout["legend"]["orientation"] == "h"
    assert layout["legend"]["yref"] == "container"


def test_days_are_names_in_a_page_and_not_midnights() -> None:
    assert layout_of(as_html(days(1)))["xaxis"]["type"] == "category"


def test_a_single_bar_is_no_wall() -> None:
    low, high = as_figure(pareto(["only"])).axes[0].get_xlim()
    assert high - low > 4


def test_pictures_of_a_section_share_sheets_and_fill_what_is_left_of_a_page() -> None:
    rooms = iter([0.9, 3.0, 9.0])
    found = list(sheets([histogram("x")] * 40, lambda: next(rooms)))
    assert [len(sheet.axes) for sheet in found] == [28, 8, 4]
    assert sum(1 for _ in sheets([], lambda: 9.0)) == 0


def gauge_figures() -> Iterator[Figure]:
    rng = np.random.default_rng(1)
    parts = [f"WVWZZZ1JZXW{part:06d}" for part in range(10) for _ in range(6)]
    owners = [name for _ in range(10) for name in ("A. Müller", "B. Schmidt") for _ in range(3)]
    values = np.repeat(rng.normal(0.1, 0.05, 10), 6) + rng.normal(0, 0.003, 60)
    data = GaugeData(parts, values, owners)
    yield gauge.grr_values(data, "°")
    yield gauge.grr_components(grr(data, GrrMethod.ANOVA, tolerance=0.4))
    yield gauge.type1_run(rng.normal(0.1, 0.003, 50), 0.1, 0.04, "°")
    masters = np.repeat([-1.0, -0.5, 0.0, 0.5, 1.0], 10)
    measured = masters + rng.normal(0, 0.004, 50)
    yield gauge.linearity_line(linearity(measured, masters, 0.95), measured, masters, "°")
    yield gauge.chart_picture(control_chart(ChartKind.INDIVIDUALS, values, RuleSet.NELSON), 0.0, "°")


def test_pictures_of_gauge_studies_are_clear() -> None:
    """VINs stood on each other below the parts; legends covered bars."""
    for figure in gauge_figures():
        assert_clear(figure)


def test_all_pictures_are_drawn_in_one_style() -> None:
    """Each had sizes, colours and a legend of its own."""
    for path in [*ROOT.glob("station/**/*.py"), *ROOT.glob("db/**/*.py")]:
        text = path.read_text(encoding="utf-8")
        if path.name == "drawing.py" or "matplotlib" not in text:
            continue
        assert not re.search(r"\.legend\(|tab:|color=f?\"C\d|fontsize=9", text), path
        for function in ast.walk(ast.parse(text)):
            if isinstance(function, ast.FunctionDef) and "Figure(" in ast.unparse(function):
                assert _styled(function, text), f"{path}: {function.name} draws without the style"


def _styled(function: ast.FunctionDef, text: str) -> bool:
    """Decorated, or a helper of what is."""
    return any(ast.unparse(each) == "in_style" for each in function.decorator_list) or (
        function.name.startswith("_") and f"= {function.name}(" in text
    )


def test_the_style_of_a_caller_is_left_alone_and_has_no_say() -> None:
    with mpl.rc_context({"font.size": 31.0, "axes.facecolor": "black", "text.usetex": True}):
        figure = as_figure(days(3))
        assert mpl.rcParams["font.size"] == 31.0
    assert figure.axes[0].get_facecolor() == (1.0, 1.0, 1.0, 1.0)
    assert figure.axes[0].xaxis.label.get_fontsize() < 10


def layout_of(page: str) -> dict[str, dict[str, object]]:
    """The layout that a page hands to plotly."""
    call = page[page.index("Plotly.newPlot(") :]
    decoder = json.JSONDecoder()
    at = call.index("[", call.index(","))
    _, end = decoder.raw_decode(call, at)
    found: dict[str, dict[str, object]] = decoder.raw_decode(call, call.index("{", end))[0]
    return found
