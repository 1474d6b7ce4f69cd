"""How every picture of this program looks: one palette, one set of sizes, legends beside the data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, Literal, ParamSpec, TypeVar

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

P = ParamSpec("P")
R = TypeVar("R")

SERIES = ("#1f5fa8", "#d07000", "#2a7a2a", "#b02020", "#6a4c93", "#7a5230", "#c2529b", "#5f6b73", "#8a8a1f")
"""Colours of series, in their order; told apart by people who see no red or green, by their lightness too."""

GOOD, BAD, WARNING, MUTED, REFERENCE = "#2a7a2a", "#b02020", "#d07000", "#7a828a", "#3a3a3a"
"""Colours with a meaning: within limits, limits and what is beyond, control limits, set aside, zero lines."""

MINUS = "\u2212"
"""As long as a plus; a hyphen is a third of it."""

PAGE_WIDTH_IN = 7.48
"""Width of the text of a page, inches: a picture of this width stands on paper in its own size."""

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans", "font.size": 8, "text.color": "#222222",
    "figure.facecolor": "white", "savefig.facecolor": "white", "figure.dpi": 110,
    "axes.facecolor": "white", "axes.edgecolor": "#9aa0a6", "axes.linewidth": 0.8,
    "axes.titlesize": 9, "axes.titleweight": "bold", "axes.labelsize": 8, "axes.labelcolor": "#222222",
    "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "axes.axisbelow": True, "grid.color": "#e6e8ea", "grid.linewidth": 0.6,
    "axes.prop_cycle": cycler(color=SERIES),
    "axes.formatter.limits": (-4, 5), "axes.formatter.use_mathtext": True, "axes.unicode_minus": True,
    "xtick.labelsize": 7, "ytick.labelsize": 7, "xtick.color": "#444444", "ytick.color": "#444444",
    "legend.fontsize": 7, "legend.frameon": False, "legend.title_fontsize": 7,
    "lines.linewidth": 1.0, "lines.markersize": 4, "image.cmap": "viridis",
}  # fmt: skip


def signed(value: float, decimals: int) -> str:
    """A number with its sign, and a minus as long as the plus."""
    return f"{value:+.{decimals}f}".replace("-", MINUS)


def in_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Let a function draw in this style, whatever the settings of its caller."""

    @wraps(draw)
    def styled(*arguments: P.args, **named: P.kwargs) -> R:
        # `rc_context` alone keeps what a user's own matplotlibrc says of everything else.
        with mpl.rc_context():
            mpl.rcdefaults()
            mpl.rcParams.update(STYLE)
            return draw(*arguments, **named)

    return styled


def legend_outside(
    figure: Figure | SubFigure,
    axes: Sequence[Axes] = (),
    *,
    title: str = "",
    columns: int = 6,
    where: Literal["outside upper right", "outside right upper"] = "outside upper right",
) -> None:
    """Name what is drawn, each name once, outside of all axes: no legend covers data.

    Parameters
    ----------
    figure
        With the layout ``constrained``.
    axes
        Whose names count; none means all of the figure.
    columns
        Names in one line at most.
    where
        Place, as in `matplotlib.figure.Figure.legend`.
    """
    named: dict[str, Any] = {}
    for ax in axes or figure.axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if named:
        figure.legend(
            list(named.values()), list(named), loc=where, ncols=min(len(named), columns), title=title or None
        )


def whole_numbers(ax: Axes, axis: str = "y") -> None:
    """Let an axis that counts have ticks at whole numbers alone."""
    chosen = ax.yaxis if axis == "y" else ax.xaxis
    chosen.set_major_locator(MaxNLocator(nbins=6, integer=True, min_n_ticks=1))
