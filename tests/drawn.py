"""What can be asked of a picture without looking at it."""

from __future__ import annotations

from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text


def assert_clear(figure: Figure) -> None:
    """No legend over data, no tick label over its neighbour, no text cut by the picture's edge."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    for ax in figure.axes:
        assert ax.get_legend() is None, "a legend stands in its axes"
        for axis in (ax.xaxis, ax.yaxis):
            if axis.get_visible():
                _assert_apart([label for label in axis.get_ticklabels() if _seen(label, ax)], renderer)
    for legend in figure.legends:
        place = legend.get_window_extent(renderer)
        for ax in figure.axes:
            assert not place.shrunk(0.98, 0.98).overlaps(ax.get_window_extent(renderer)), "legend over data"
    for text in figure.findobj(Text):
        if isinstance(text, Text) and text.get_visible() and text.get_text().strip():
            box = text.get_window_extent(renderer)
            if box.width > 0 and _is_shown(text, figure):
                assert box.x0 >= -2, f"{text.get_text()!r} begins before the picture"
                assert box.x1 <= figure.bbox.x1 + 2, f"{text.get_text()!r} ends beyond the picture"
                assert box.y0 >= -2, f"{text.get_text()!r} ends below the picture"
                assert box.y1 <= figure.bbox.y1 + 2, f"{text.get_text()!r} begins above the picture"


def _assert_apart(labels: list[Text], renderer: object) -> None:
    if any(label.get_rotation() for label in labels):
        return
    boxes = [label.get_window_extent(renderer) for label in labels]  # type: ignore[arg-type]
    for (one, first), (other, second) in pairwise(zip(labels, boxes, strict=True)):
        assert not first.shrunk(0.98, 0.98).overlaps(second), f"{one.get_text()} over {other.get_text()}"


def _seen(label: Text, ax: Axes) -> bool:
    x, y = label.get_position()
    (left, right), (low, high) = sorted(ax.get_xlim()), sorted(ax.get_ylim())
    inside = left <= x <= right if label in ax.get_xticklabels() else low <= y <= high
    return bool(label.get_visible() and label.get_text() and inside)


def _is_shown(text: Text, figure: Figure) -> bool:
    """Ticks beyond the limits of an axis have texts that nobody draws."""
    for ax in figure.axes:
        if text in ax.get_xticklabels() + ax.get_yticklabels():
            return _seen(text, ax)
        for axis in (ax.xaxis, ax.yaxis):
            for tick in axis.get_major_ticks() + axis.get_minor_ticks():
                if text in (tick.label1, tick.label2):
                    return False
    return True
