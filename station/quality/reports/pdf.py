"""A report on paper."""

from __future__ import annotations

from pathlib import Path

from db.exports import Document
from station.quality.cells import heading, on_paper
from station.quality.paper_pictures import sheets
from station.quality.reports.report import Report, Section

_LONGEST_TABLE = 500


def write_pdf(path: Path, report: Report) -> None:
    """Write the report; a file of that name is replaced.

    Raises
    ------
    OSError
        When the file cannot be written.
    """
    made = f"{report.made_utc:%Y-%m-%d %H:%M:%S} UTC"
    document = Document(report.title, f"{report.database}    {made}", report.made_utc)
    document.paragraph(f"{report.about[:1].upper()}{report.about[1:]}.")
    for section in report.sections:
        _section(document, section)
    document.save(path)


def _section(document: Document, section: Section) -> None:
    document.heading(section.title)
    if section.rows:
        document.figures([(heading(name), on_paper(name, value)) for name, value in section.figures.items()])
    if section.text:
        document.paragraph(section.text)
    if not section.rows:
        document.paragraph(section.empty)
        return
    rows = section.rows[:_LONGEST_TABLE]
    names = list(section.brief or rows[0])
    document.rows(
        [heading(name) for name in names], [[on_paper(name, row[name]) for name in names] for row in rows]
    )
    left_out = []
    if len(section.rows) > _LONGEST_TABLE:
        left_out.append(f"{len(section.rows) - _LONGEST_TABLE} more rows")
    if len(names) < len(rows[0]):
        left_out.append(f"{len(rows[0]) - len(names)} more columns")
    if left_out:
        document.paragraph(f"{' and '.join(left_out)}: in HTML and JSON.")
    for sheet in sheets(section.pictures, lambda: document.room_in):
        document.picture(sheet)
