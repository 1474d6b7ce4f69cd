"""Text that others typed: formulas, line breaks, scripts without a font. It stays text, and is seen."""

from __future__ import annotations

import csv
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from pypdf import PdfReader

from db.exports import fonts
from db.exports.aqdef import write_aqdef
from db.exports.pdf import Document
from db.exports.rows import AngleRow
from db.exports.tables import csv_cell, write_csv

FORMULAS = (
    "=1+1", '=HYPERLINK("http://example.org","x")', "+1+1", "-2+3+cmd|' /C calc'!A0", "@SUM(1)", "\t=1+1",
    "\r=1+1", "\n=1+1", "＝1+1", "＋1", "－1", "＠SUM(1)", "-5", "=",
)  # fmt: skip
HARMLESS = ("", "W1", "a=b", "a-b", " =1", "'=1", "1-2", "(=)")


@pytest.mark.parametrize("text", FORMULAS)
def test_text_that_a_spreadsheet_would_run_is_text_in_every_column(
    tmp_path: Path, rows: list[AngleRow], text: str
) -> None:
    names = (
        "station", "vin", "vehicle_type", "part", "reason_code", "reason_text", "method", "calibration_id",
        "zero_measurement_id", "software_version", "config_hash", "thrust_sign",
    )  # fmt: skip
    write_csv(tmp_path / "r.csv", [replace(rows[0], **dict.fromkeys(names, text))])
    with (tmp_path / "r.csv").open(newline="", encoding="utf-8") as stream:
        (line,) = csv.DictReader(stream)
    assert {line[name] for name in names} == {f"'{text}"}


@pytest.mark.parametrize("text", HARMLESS)
def test_other_text_stays_as_it_is(text: str) -> None:
    assert csv_cell(text) == text


def test_numbers_stay_numbers(tmp_path: Path, rows: list[AngleRow]) -> None:
    """Camber is negative nearly always."""
    negative = [row for row in rows if row.value_deg is not None and row.value_deg < 0]
    write_csv(tmp_path / "r.csv", negative)
    with (tmp_path / "r.csv").open(newline="", encoding="utf-8") as stream:
        lines = list(csv.DictReader(stream))
    assert [float(line["value_deg"]) for line in lines] == [row.value_deg for row in negative]
    assert negative
    for value in (-1, -0.5, 1e-300, -1e300, None, True):
        assert csv_cell(value) in (value, repr(value))


@pytest.mark.parametrize("nasty", ["a\r\nK0001/1 9", "x\x01y", "\u2029p", "v\x0bt", "\x1b[31m"])
@pytest.mark.parametrize(
    "field", ["vehicle_type", "software_version", "calibration_id", "reason_code", "station"]
)
def test_no_text_makes_a_line_of_its_own_in_a_q_das_file(
    tmp_path: Path, rows: list[AngleRow], nasty: str, field: str
) -> None:
    write_aqdef(tmp_path / "a.dfq", rows)
    write_aqdef(
        tmp_path / "b.dfq", [replace(row, **{field: f"{getattr(row, field) or ''}{nasty}"}) for row in rows]
    )
    one, other = (
        [line.partition(" ")[0] for line in (tmp_path / name).read_bytes().decode("utf-8-sig").split("\r\n")]
        for name in ("a.dfq", "b.dfq")
    )
    # The same keys in the same places; `splitlines` would see what other readers break at.
    assert one == other
    assert len((tmp_path / "b.dfq").read_bytes().decode("utf-8-sig").splitlines()) == len(one) - 1


MADE = datetime(2026, 11, 23, 8, 30, tzinfo=UTC)


def page_text(path: Path) -> str:
    return " ".join("\n".join(page.extract_text() for page in PdfReader(path).pages).split())


def write_document(path: Path, text: str) -> None:
    document = Document(f"Title {text}", f"footer {text}", MADE)
    document.heading(f"heading {text}")
    document.paragraph(f"paragraph {text}")
    document.rows(("head", f"head {text}"), [("cell", f"cell {text}")])
    document.save(path)


@pytest.fixture
def no_other_fonts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fonts, "other_fonts", lambda: ())


@pytest.mark.parametrize("text", ["Škoda Ω Привет", "Übergröße", "camber ≤ 0.5° ± 0.1′", "שלום"])
def test_scripts_that_the_font_has_are_shown(tmp_path: Path, no_other_fonts: None, text: str) -> None:
    write_document(tmp_path / "d.pdf", text)
    found = page_text(tmp_path / "d.pdf")
    for word in text.split():
        # Right-to-left scripts may come back in the order of the page.
        assert found.count(word) + found.count(word[::-1]) >= 5
    assert "U+" not in found


def test_character_that_no_font_has_is_named_wherever_it_stands(tmp_path: Path, no_other_fonts: None) -> None:
    """It was an empty box, or nothing at all."""
    write_document(tmp_path / "d.pdf", "紧凑")
    found = page_text(tmp_path / "d.pdf")
    for place in ("Title", "heading", "paragraph", "head", "cell", "footer"):
        assert f"{place} [U+7D27][U+51D1]" in found
    assert "U+7D27] CJK UNIFIED IDEOGRAPH-7D27" in found


def test_many_unknown_characters_do_not_fill_the_pages(tmp_path: Path, no_other_fonts: None) -> None:
    document = Document("x", "y", MADE)
    document.paragraph("".join(chr(0x4E00 + number) for number in range(300)))
    document.save(tmp_path / "d.pdf")
    assert "and 270 more" in page_text(tmp_path / "d.pdf")
    assert len(PdfReader(tmp_path / "d.pdf").pages) <= 2


def font_of(path: Path, characters: str) -> Path:
    """A font whose glyphs are squares."""
    names = {ord(character): f"u{ord(character):04X}" for character in characters}
    order = [".notdef", *names.values()]
    pen = TTGlyphPen(None)
    for number, point in enumerate([(50, 0), (50, 700), (700, 700), (700, 0)]):
        (pen.lineTo if number else pen.moveTo)(point)
    pen.closePath()
    glyph = pen.glyph()
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder(order)
    builder.setupCharacterMap(names)
    builder.setupGlyf(dict.fromkeys(order, glyph))
    builder.setupHorizontalMetrics(dict.fromkeys(order, (800, 50)))
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": "Squares", "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    builder.save(path)
    return path


def test_another_font_of_the_machine_shows_what_the_usual_one_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "broken.ttf"
    broken.write_bytes(b"\x00\x01\x00\x00 no font")
    squares, more = font_of(tmp_path / "squares.ttf", "紧"), font_of(tmp_path / "more.ttf", "凑")
    monkeypatch.setattr(fonts, "other_fonts", lambda: (broken, squares, more))
    write_document(tmp_path / "d.pdf", "紧凑型")
    found = page_text(tmp_path / "d.pdf")
    for place in ("Title", "heading", "paragraph", "head", "cell", "footer"):
        assert f"{place} 紧凑[U+578B]" in found


def test_fonts_of_boxes_and_blanks_are_not_asked() -> None:
    names = [path.name.lower() for path in fonts.other_fonts()]
    assert names[:2] == ["dejavusans.ttf", "stixgeneral.ttf"]
    assert not [name for name in names if "lastresort" in name]
    assert fonts.font_with("\U0010fffd") is None
