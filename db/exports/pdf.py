"""A page description for certificates: headings, tables, pictures, page numbers; any European script."""

from __future__ import annotations

import io
import unicodedata
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from fpdf import FPDF, FontFace, XPos, YPos
from fpdf.enums import TableCellFillMode
from matplotlib.figure import Figure

from db.exports.fonts import BOLD, REGULAR, font_with, glyphs_of, named, printable
from db.exports.tables import replaced

_FAMILY = "DejaVu"
_GREY = 245
_DPI = 150
_MOST_NAMED = 30


class Document(FPDF):
    """A4, one column; add in order, then `save`."""

    def __init__(self, title: str, footer: str, created: datetime) -> None:
        super().__init__(format="A4")
        self.add_font(_FAMILY, "", REGULAR)
        self.add_font(_FAMILY, "B", BOLD)
        self._known = set(glyphs_of(REGULAR) & glyphs_of(BOLD))
        self._families: dict[Path, str] = {}
        self._named: dict[str, None] = {}
        self._footer = self._shown(footer)
        self.set_title(title)
        self.set_creator("Truewheel")
        self.set_creation_date(created)
        self.set_auto_page_break(True, margin=18)
        self.alias_nb_pages()
        self.add_page()
        self.set_font(_FAMILY, "B", 16)
        self.multi_cell(0, 9, self._shown(title), new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.ln(1)

    def footer(self) -> None:
        """Every page: where it comes from, which page it is."""
        self.set_y(-13)
        self.set_font(_FAMILY, "", 7)
        self.cell(0, 4, f"{self._footer}    {self.page_no()} / {{nb}}", align="C")

    def heading(self, text: str) -> None:
        """A heading that stays with what follows."""
        if self.get_y() > self.h - 50:
            self.add_page()
        self.ln(2)
        self.set_font(_FAMILY, "B", 11)
        self.multi_cell(0, 6, self._shown(text), new_x=XPos.LMARGIN, new_y=YPos.NEXT)

    def paragraph(self, text: str) -> None:
        """A paragraph."""
        self.set_font(_FAMILY, "", 9)
        self.multi_cell(0, 4.6, self._shown(text), new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.ln(1)

    def facts(self, pairs: Sequence[tuple[str, str]]) -> None:
        """Names and values, one pair a line."""
        self.rows((), pairs, widths=(28, 72))

    def rows(
        self, head: Sequence[str], rows: Sequence[Sequence[str]], widths: Sequence[int] | None = None
    ) -> None:
        """A table; the head is repeated on every page."""
        if not rows:
            return
        # Before the table begins: another font may have to be added for them.
        shown = {cell: self._shown(cell) for cells in (head, *rows) for cell in cells}
        self.set_font(_FAMILY, "", 8)
        with self.table(
            col_widths=tuple(widths) if widths else None,
            first_row_as_headings=bool(head),
            headings_style=FontFace(emphasis="BOLD"),
            cell_fill_color=_GREY,
            cell_fill_mode=TableCellFillMode.ROWS,
            borders_layout="SINGLE_TOP_LINE" if head else "NONE",
            line_height=4.4,
            text_align="LEFT",
        ) as table:
            for cells in ([head] if head else []) + list(rows):
                line = table.row()
                for cell in cells:
                    line.cell(shown[cell])
        self.ln(1)

    def picture(self, figure: Figure) -> None:
        """A picture over the width of the page."""
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=_DPI)
        width, height = figure.get_size_inches()
        tall = self.epw * float(height) / float(width)
        if self.get_y() + tall > self.h - 18:
            self.add_page()
        self.image(stream, w=self.epw)
        self.ln(1)

    def save(self, path: Path) -> None:
        """Write the file; one that was there stays when it cannot be written.

        Raises
        ------
        OSError
            When the file cannot be written.
        """
        if self._named:
            names = [
                f"{named(character)} {unicodedata.name(character, 'without a name')}"
                for character in self._named
            ]
            more = "" if len(names) <= _MOST_NAMED else f", and {len(names) - _MOST_NAMED} more"
            self.paragraph(
                "Characters that no font of this machine shows are named: "
                f"{', '.join(names[:_MOST_NAMED])}{more}."
            )
        with replaced(path) as temporary:
            self.output(str(temporary))

    def _shown(self, text: str) -> str:
        """The text with another font at hand for what the usual one lacks; what none has is named."""
        return "".join(
            character if self._has(character) else named(character) for character in printable(text)
        )

    def _has(self, character: str) -> bool:
        if ord(character) in self._known:
            return True
        if character in self._named:
            return False
        path = font_with(character)
        if path is None:
            self._named[character] = None
            return False
        self._families[path] = family = f"other{len(self._families) + 1}"
        self.add_font(family, "", path)
        self.set_fallback_fonts(list(self._families.values()), exact_match=False)
        self._known |= glyphs_of(path)
        return True
