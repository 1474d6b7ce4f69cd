"""A report as one HTML file: tables, and pictures that a mouse can zoom; it needs no network."""

from __future__ import annotations

from pathlib import Path

from markupsafe import Markup

from db.exports import replaced
from station.pages import page
from station.quality.cells import heading, is_number_column, on_paper
from station.quality.page_pictures import PROGRAM, as_html
from station.quality.reports.report import Report

_LONGEST_TABLE = 5000
_LONG = 40


def write_html(path: Path, report: Report) -> None:
    """Write the report; a file of that name is replaced.

    Raises
    ------
    OSError
        When the file cannot be written.
    """
    from plotly.offline import get_plotlyjs

    pictures = any(section.pictures for section in report.sections)
    text = page(
        __package__,
        "report.html",
        title=report.title,
        report=report,
        program=Markup(get_plotlyjs() + PROGRAM) if pictures else "",
        shown=on_paper,
        heading=heading,
        numbers_of=lambda rows: [name for name in rows[0] if is_number_column(row[name] for row in rows)],
        drawn=lambda picture: Markup(as_html(picture)),
        longest_table=_LONGEST_TABLE,
        longest_line=_LONG,
    )
    with replaced(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
