"""A page description for certificates: headings, tables, pictures, page numbers; any European script."""

from __future__ import annotations

import io
import re
import textwrap
import unicodedata
from collections.abc import Sequence
from datetime import datetime
from functools import partial
from pathlib import Path

from fpdf import FPDF, FontFace, XPos, YPos
from fpdf.enums import Align, TableCellFillMode
from matplotlib.figure import Figure

from db.exports.column_widths import asked_widths, column_blocks, fitted_widths
from db.exports.drawing import PAGE_WIDTH_IN
from db.exports.fonts import BOLD, REGULAR, font_with, glyphs_of, named, printable
from db.exports.tables import replaced

_FAMILY = "DejaVu"
_GREY = 245
_DPI = 200
_MOST_NAMED = 30
_SIZES_PT = (8.0, 7.0, 6.0)  # of a table: smaller where it is wide
_LINE = 1.42  # height of a line over the size of its letters
_MM_PER_PT = 25.4 / 72
_LONGEST_WORD = 0.4  # of the page's width; a longer one is broken where names have their joints
_LONGEST_CELL = 900  # characters of one row: a row is never broken over a page, so it must fit on one
_BESIDE = 5  # figures beside each other
_NUMBER = re.compile(r"[+\u2212-]?<?\d+(\.\d+)?(e[+-]?\d+)?( ?(°|′|%|mm|ppm))?( ± [\d.]+)?")
_JOINT = re.compile(r"(?<=[-_./:@])(?=\w)")


class Document(FPDF):
    """A4, one column; add in order, then `save`."""

    def __init__(self, title: str, footer: str, created: datetime) -> None:
        super().__init__(format="A4")
        self.add_font(_FAMILY, "", REGULAR)
        self.add_font(_FAMILY, "B", BOLD)
        self._known = set(glyphs_of(REGULAR) & glyphs_of(BOLD))
        self._families: dict[Path, str] = {}
        self._named: dict[str, None] = {}
        self._footer, self._head = self._shown(footer), ""
        self.set_title(title)
        self.set_creator("Truewheel")
        self.set_creation_date(created)
        self.set_margins(10, 14, 10)
        self.set_auto_page_break(True, margin=18)
        self.alias_nb_pages()
        self.add_page()
        self.set_font(_FAMILY, "B", 16)
        self.multi_cell(0, 8, self._shown(title), align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.ln(1)
        # Only now: the first page has its title.
        self._head = self._shown(title)

    def header(self) -> None:
        """Every page but the first: what it belongs to."""
        if self._head:
            self.set_y(7)
            self._one_line(self._head, self.epw, 7)
            self.set_y(self.t_margin)

    def footer(self) -> None:
        """Every page: where it comes from, which page of how many it is."""
        self.set_y(-13)
        self._one_line(self._footer, self.epw - 22, 7)
        self.set_font(_FAMILY, "", 7)
        self.set_xy(-self.r_margin - 22, -13)
        self.cell(22, 4, f"{self.page_no()} of {{nb}}", align="R")

    def heading(self, text: str) -> None:
        """A heading that stays with what follows."""
        if self.get_y() > self.h - 50:
            self.add_page()
        self.ln(2)
        self.set_font(_FAMILY, "B", 11)
        self.multi_cell(0, 6, self._shown(text), align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)

    def paragraph(self, text: str) -> None:
        """A paragraph."""
        self.set_font(_FAMILY, "", 8)
        text = self._shown(text).replace(" %", "\u00a0%")
        self.multi_cell(0, 4, text, align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.ln(1)

    def facts(self, pairs: Sequence[tuple[str, str]]) -> None:
        """Names and values, one pair a line."""
        self.rows((), pairs)

    def figures(self, pairs: Sequence[tuple[str, str]]) -> None:
        """Headline numbers, several beside each other: the name small, the value large below it."""
        wide = self.epw / _BESIDE
        for first in range(0, len(pairs), _BESIDE):
            if self.will_page_break(11):
                self.add_page()
            top = self.get_y() + 1
            for place, (name, value) in enumerate(pairs[first : first + _BESIDE]):
                left = self.l_margin + place * wide
                self.set_fill_color(_GREY)
                self.rect(left, top, wide - 1.5, 9.5, style="F")
                self.set_xy(left, top + 0.6)
                self._one_line(self._shown(name), wide - 2, 6.5)
                self.set_xy(left, top + 4)
                self._one_line(self._shown(value), wide - 2, 10, "B")
            self.set_xy(self.l_margin, top + 10)
        self.ln(1)

    def rows(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """A table; its head is repeated on every page, no row is broken over a page, no word over a line.

        Columns are as wide as their texts ask for. A table that is too wide even in small letters continues
        below, its first column repeated. Columns of numbers stand to the right; columns in which nothing
        stands are left out.
        """
        if not rows:
            return
        # Before the table begins: another font may have to be added for them.
        kept = [column for column in range(len(rows[0])) if any(row[column] for row in rows)]
        shown = [[self._shown(row[column]) for column in kept] for row in rows]
        heads = [self._shown(head[column]) for column in kept] if head else []
        size, blocks, widths = self._fitted(heads, shown)
        for columns, wide in zip(blocks, widths, strict=True):
            block = [[cells[column] for column in columns] for cells in shown]
            self._table([heads[column] for column in columns] if heads else [], block, wide, size)
            self.ln(1)

    @property
    def room_in(self) -> float:
        """Height that is left on the page, inches."""
        return (self.page_break_trigger - self.get_y()) / 25.4

    def picture(self, figure: Figure) -> None:
        """A picture in its own size, at most as wide as the page."""
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=_DPI)
        width, height = map(float, figure.get_size_inches())
        wide = self.epw * min(1.0, width / PAGE_WIDTH_IN)
        if wide * height / width > self.room_in * 25.4:
            self.add_page()
        self.image(stream, w=wide)
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

    def _fitted(
        self, head: list[str], rows: list[list[str]]
    ) -> tuple[float, list[list[int]], list[list[float]]]:
        """Size of the letters, and columns and their widths of each table that it takes."""
        most = _LONGEST_WORD * self.epw
        columns = len(head) or len(rows[0])
        for size in _SIZES_PT:
            bold = partial(self._wide, size=size, style="B")
            natural, least = asked_widths(head, rows, bold, partial(self._wide, size=size), most)
            fitted = fitted_widths(natural, least, self.epw)
            if fitted is not None:
                return size, [list(range(columns))], [fitted]
        blocks = column_blocks(least, self.epw)
        widths = [
            fitted_widths([natural[c] for c in block], [least[c] for c in block], self.epw)
            for block in blocks
        ]
        return (
            _SIZES_PT[-1],
            blocks,
            [
                wide or [self.epw / len(block)] * len(block)
                for wide, block in zip(widths, blocks, strict=True)
            ],
        )

    def _table(self, head: list[str], rows: list[list[str]], widths: Sequence[float], size: float) -> None:
        numbers = [_numbers([row[column] for row in rows]) for column in range(len(widths))]
        self.set_font(_FAMILY, "", size)
        with self.table(
            width=sum(widths),
            col_widths=tuple(widths),
            align=Align.L,
            first_row_as_headings=bool(head),
            headings_style=FontFace(emphasis="BOLD"),
            cell_fill_color=_GREY,
            cell_fill_mode=TableCellFillMode.EVEN_ROWS,
            borders_layout="SINGLE_TOP_LINE" if head else "NONE",
            line_height=_LINE * _MM_PER_PT * size,
            text_align=tuple(Align.R if number and head else Align.L for number in numbers),
            v_align="TOP",
        ) as table:
            for cells in ([head] if head else []) + [part for row in rows for part in _parts(row)]:
                line = table.row()
                for cell, width in zip(cells, widths, strict=True):
                    line.cell(self._jointed(cell, width, size))

    def _wide(self, text: str, size: float, style: str = "") -> float:
        """Width of a cell with this text on one line, millimetres."""
        self.set_font(_FAMILY, style, size)
        # Rounding must not break what just fits.
        return float(self.get_string_width(text)) + 2 * self.c_margin + 0.3

    def _jointed(self, text: str, width: float, size: float) -> str:
        """The text with its words that are wider than their column broken at the joints of names.

        A line ends there and nothing is added: who copies the name copies the name.
        """
        return " ".join(
            word if self._wide(word, size) <= width else self._broken(word, width, size)
            for word in text.split(" ")
        )

    def _broken(self, word: str, width: float, size: float) -> str:
        lines = [""]
        for part in _JOINT.split(word):
            if lines[-1] and self._wide(lines[-1] + part, size) > width:
                lines.append("")
            lines[-1] += part
        return "\n".join(lines)

    def _one_line(self, text: str, width: float, size: float, style: str = "") -> None:
        """A text on one line, in smaller letters where it is long; its middle goes where it is too long."""
        while size > 5 and self._wide(text, size, style) > width:
            size -= 0.5
        while len(text) > 4 and self._wide(text, size, style) > width:
            half = (len(text) - 2) // 2
            text = f"{text[:half]}…{text[-half:]}"
        self.set_font(_FAMILY, style, size)
        self.cell(width, _LINE * _MM_PER_PT * size, text, align="L")

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


def _parts(cells: Sequence[str]) -> list[list[str]]:
    """Rows that a row becomes whose text would fill a page."""
    if max(map(len, cells)) <= _LONGEST_CELL:
        return [list(cells)]
    texts = [textwrap.wrap(cell, _LONGEST_CELL, break_on_hyphens=False) or [""] for cell in cells]
    count = max(map(len, texts))
    return [[text[part] if part < len(text) else "" for text in texts] for part in range(count)]


def _numbers(cells: Sequence[str]) -> bool:
    """Whether a column is one of numbers; some may be missing."""
    known = [cell for cell in cells if cell not in ("", "–")]
    return bool(known) and all(_NUMBER.fullmatch(cell) for cell in known)
