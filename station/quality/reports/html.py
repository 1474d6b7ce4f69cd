"""A report as one HTML file: tables, and pictures that a mouse can zoom; it needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from db.exports.tables import replaced
from station.quality.pictures import as_html
from station.quality.reports.report import Report, Row, Section

LONGEST_TABLE = 5000
_LONG = 40
_STYLE = """
body { font-family: system-ui, sans-serif; max-width: 80rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
table { border-collapse: collapse; margin: 0.5rem 0 1.5rem; font-size: 0.85rem }
th, td { border: 1px solid #ccc; padding: 0.2rem 0.6rem; text-align: left }
td.number { text-align: right; font-variant-numeric: tabular-nums }
td { white-space: nowrap }
td.long { white-space: normal; min-width: 24rem }
.scroll { overflow-x: auto; max-height: 40rem }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 0.1rem 1rem }
dd { margin: 0 }
"""


def write_html(path: Path, report: Report) -> None:
    """Write the report; a file of that name is replaced.

    Raises
    ------
    OSError
        When the file cannot be written.
    """
    from plotly.offline import get_plotlyjs

    body = "\n".join(_section(section) for section in report.sections)
    pictures = any(section.pictures for section in report.sections)
    program = f"<script>{get_plotlyjs()}</script>" if pictures else ""
    page = (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(report.title)}</title><style>{_STYLE}</style>{program}</head>\n<body>\n"
        f"<h1>{escape(report.title)}</h1>\n<p>{escape(report.about)}. {escape(report.database)}, "
        f"{report.made_utc:%Y-%m-%d %H:%M:%S} UTC.</p>\n{body}\n</body></html>\n"
    )
    with replaced(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _section(section: Section) -> str:
    figures = "".join(
        f"<dt>{escape(name.replace('_', ' '))}</dt><dd>{shown(value)}</dd>"
        for name, value in section.figures.items()
    )
    pictures = "".join(as_html(picture) for picture in section.pictures)
    return (
        f"<h2>{escape(section.title)}</h2>"
        + (f"<dl>{figures}</dl>" if figures else "")
        + (f"<p>{escape(section.text)}</p>" if section.text else "")
        + pictures
        + _table(section.rows)
    )


def _table(rows: Sequence[Row]) -> str:
    if not rows:
        return "<p>Nothing.</p>"
    head = "".join(f"<th>{escape(name.replace('_', ' '))}</th>" for name in rows[0])
    lines = "".join(
        "<tr>"
        + "".join(
            f'<td class="number">{shown(cell)}</td>'
            if isinstance(cell, int | float) and not isinstance(cell, bool)
            else f"<td{' class=long' if len(str(cell)) > _LONG else ''}>{shown(cell)}</td>"
            for cell in row.values()
        )
        + "</tr>"
        for row in rows[:LONGEST_TABLE]
    )
    more = len(rows) - LONGEST_TABLE
    rest = f"<p>{more} more rows; --json has all.</p>" if more > 0 else ""
    return f'<div class="scroll"><table><tr>{head}</tr>{lines}</table></div>{rest}'


def shown(value: object) -> str:
    """A cell: six digits of a number, a dash for none."""
    if value is None or value == "":
        return "–"
    return f"{value:.6g}" if isinstance(value, float) else escape(str(value))
