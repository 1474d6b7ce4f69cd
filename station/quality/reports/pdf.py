"""A report on paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from db.exports import Document
from station.quality.pictures import as_figure
from station.quality.reports.report import Report, Section, shown_cell

_LONGEST_TABLE = 500
_COLUMNS = 9
_NARROWEST, _WIDEST = 13, 24  # characters of a column


def write_pdf(path: Path, report: Report) -> None:
    """Write the report; a file of that name is replaced.

    Raises
    ------
    OSError
        When the file cannot be written.
    """
    made = f"{report.made_utc:%Y-%m-%d %H:%M:%S} UTC"
    document = Document(report.title, f"{report.database}    {made}", report.made_utc)
    document.paragraph(f"{report.about}.")
    for section in report.sections:
        _section(document, section)
    document.save(path)


def _section(document: Document, section: Section) -> None:
    document.heading(section.title)
    document.facts([(name.replace("_", " "), _shown(value)) for name, value in section.figures.items()])
    if section.text:
        document.paragraph(section.text)
    for picture in section.pictures:
        document.picture(as_figure(picture))
    rows = section.rows[:_LONGEST_TABLE]
    if not rows:
        document.paragraph("Nothing.")
        return
    names = list(section.brief or rows[0])
    # A page is as wide as it is: a wide table continues below, its first column repeated.
    for first in range(1, max(len(names), 2), _COLUMNS - 1):
        shown = [names[0], *names[first : first + _COLUMNS - 1]]
        cells = [[_shown(row[name]) for name in shown] for row in rows]
        heads = [name.replace("_", " ") for name in shown]
        document.rows(heads, cells, widths=_widths(heads, cells))
    left_out = []
    if len(section.rows) > _LONGEST_TABLE:
        left_out.append(f"{len(section.rows) - _LONGEST_TABLE} more rows")
    if len(names) < len(rows[0]):
        left_out.append(f"{len(rows[0]) - len(names)} more columns")
    if left_out:
        document.paragraph(f"{' and '.join(left_out)}: in HTML and JSON.")


def _widths(heads: Sequence[str], cells: Sequence[Sequence[str]]) -> list[int]:
    """Shares of the page: what the longest text of a column asks for, within reason."""
    columns = zip(heads, *cells, strict=True)
    return [min(max(_NARROWEST, *map(len, column)), _WIDEST) for column in columns]


def _shown(value: object) -> str:
    return shown_cell(value, 5)
