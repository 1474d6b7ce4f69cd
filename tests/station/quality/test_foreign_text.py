"""Text that others typed, in tables and pictures: it stays text."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from station.figures import StudyResult, write_study
from station.quality.page_pictures import as_html
from station.quality.paper_pictures import as_figure
from station.quality.pictures import Picture, Trace

FORMULAS = ("=1+1", "+1+1", "-2+3+cmd|' /C calc'!A0", "@SUM(1)", "\t=1+1", "\r=1+1", "＝1+1")


def test_table_of_a_study_is_text_too(tmp_path: Path) -> None:
    class Named:
        name, summary = "gauge-grr", "x"

    result = StudyResult(tuple({"part": text, "value": -1.5} for text in FORMULAS), {}, (), "")
    write_study(Named(), result, tmp_path)
    with (tmp_path / "gauge-grr.csv").open(newline="", encoding="utf-8") as stream:
        lines = list(csv.DictReader(stream))
    assert [line["part"] for line in lines] == [f"'{text}" for text in FORMULAS]
    assert {line["value"] for line in lines} == {"-1.5"}


@pytest.mark.parametrize("text", ["A$1$", "$\\frac{", "a $ b", "紧凑 $x$", "_hidden", "line\nbreak"])
def test_pictures_take_any_text(tmp_path: Path, text: str) -> None:
    """Two dollars were mathematics, and an error where it made no sense."""
    traces = (Trace(text, "bar", [text, "b"], [1.0, 2.0]), Trace("second", "line", [text, "b"], [1.0, 2.0]))
    picture = Picture(text, text, text, traces, {text or "x": 1.0}, verticals=[(0, text)])
    figure = as_figure(picture)
    figure.savefig(tmp_path / "p.png")
    shown = figure.axes[0].get_title()
    assert shown == text.replace("$", r"\$").replace("\n", " ").replace("紧凑", "[U+7D27][U+51D1]")


def test_markup_in_a_picture_is_text() -> None:
    nasty = "</script><script>alert(1)</script><b>x"
    picture = Picture(
        nasty, nasty, nasty, (Trace(nasty, "bar", [nasty], [1.0], [nasty], right=True),), {nasty: 1.0},
        [(0, nasty)], right_label=nasty,
    )  # fmt: skip
    page = as_html(picture)
    assert "<script>alert" not in page
    plain = page.replace("\\u003c", "<").replace("\\u003e", ">")
    assert "<script>alert" not in plain
    assert "<b>x" not in plain
