"""A document as it lies on the table: whole words, whole rows, heads and numbers on every page."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pypdf import PdfReader

from db.exports.column_widths import column_blocks, fitted_widths
from db.exports.pdf import Document

MADE = datetime(2026, 11, 22, 12, tzinfo=UTC)
STATION = "Achsvermessung-Halle-Sued-Linie-2-Platz-1"
KIND = "Golf_Variant_GTI_Clubsport_2026_Facelift"
VIN = "WVWZZZ1JZXW000003-PROTOTYP-0000000000000"


def pages_of(path: Path) -> list[str]:
    return [page.extract_text() for page in PdfReader(path).pages]


def written(path: Path, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    document = Document("Everything measured", "sqlite:///r.db    2026-11-22", MADE)
    document.rows(head, rows)
    document.save(path)
    return pages_of(path)


def test_no_word_of_a_table_is_broken(tmp_path: Path) -> None:
    """Columns had shares of the page: ``front_left.cambe|r``, ``master_wh|eel``, ``0.0008501|5``."""
    head = ("time", "characteristic", "value [°]", "against", "verdict", "reason", "calibration", "type")
    rows = [
        ("2026-11-02 04:04:36 UTC", "front_right.camber", "−0.45483015", "master_wheel", "not measured",
         "head 2 sees no light: clean its window and measure again", "cal-station_1-front_left-2026-11-01",
         KIND),
    ] * 3  # fmt: skip
    text = " ".join(written(tmp_path / "d.pdf", head, rows)).split()
    for word in {word for row in (head, *rows) for cell in row for word in cell.split()}:
        assert word in text


def test_table_that_is_too_wide_continues_below_with_its_first_column(tmp_path: Path) -> None:
    rows = [(f"{number}-{STATION}", VIN, KIND, STATION, KIND, VIN) for number in range(3)]
    text = " ".join(written(tmp_path / "d.pdf", ("station", "vin", "type", "a", "b", "c"), rows)).split()
    for number in range(3):
        assert text.count(f"{number}-{STATION}") > 1
    assert text.count(VIN) == text.count(KIND) == 6


def test_a_word_without_end_is_broken_at_its_joints(tmp_path: Path) -> None:
    name = "_".join(["measured-by-station"] * 12)
    [page] = written(tmp_path / "d.pdf", ("name", "n"), [(name, "1")])
    lines = page[page.index("measured-by") : page.rindex("station") + len("station")].splitlines()
    assert len(lines) > 1
    assert all(line.endswith(("-", "_")) for line in lines[:-1])
    assert "".join(lines) == name


def test_every_page_has_its_number_and_head_and_tables_their_heads(tmp_path: Path) -> None:
    rows = [(f"vehicle {number}", "ok") for number in range(200)]
    pages = written(tmp_path / "d.pdf", ("which", "verdict"), rows)
    assert len(pages) > 2
    for number, page in enumerate(pages, start=1):
        assert f"{number} of {len(pages)}" in page
        assert "sqlite:///r.db" in page
        assert "which" in page
        assert page.count("Everything measured") == 1


def test_no_row_is_broken_over_a_page(tmp_path: Path) -> None:
    rows = [(f"begin{number} " + "word " * 60 + f"end{number}", "x " * 20) for number in range(60)]
    pages = written(tmp_path / "d.pdf", ("text", "more"), rows)
    assert len(pages) > 1
    for number in range(60):
        [page] = [page for page in pages if re.search(rf"begin{number}\b", page)]
        assert re.search(rf"end{number}\b", page)


def test_a_text_longer_than_a_page_ends_nothing(tmp_path: Path) -> None:
    """A row that was too high for a page ended the report with an error of the library."""
    long = " ".join(f"w{number}" for number in range(2500))
    pages = written(tmp_path / "d.pdf", ("reason", "as found"), [(long, long), ("last", "row")])
    text = " ".join(pages).split()
    assert all(text.count(f"w{number}") == 2 for number in range(2500))
    assert "last" in text


def test_a_database_with_a_long_path_leaves_the_page_number_alone(tmp_path: Path) -> None:
    document = Document("T", "sqlite:////" + "folder/" * 40 + "results.db", MADE)
    document.save(tmp_path / "d.pdf")
    [page] = pages_of(tmp_path / "d.pdf")
    assert "1 of 1" in page
    assert "results.db" in page


@pytest.mark.parametrize("values", [("–", "–"), ("0.9.0", "1.2.3"), ("cal-1", "cal-2")])
def test_what_only_looks_like_numbers_stands_to_the_left(tmp_path: Path, values: tuple[str, str]) -> None:
    document = Document("T", "f", MADE)
    document.rows(("a wide heading", "b"), [(value, "b") for value in values])
    document.save(tmp_path / "d.pdf")
    assert _left(tmp_path / "d.pdf", values[0]) == pytest.approx(_left(tmp_path / "d.pdf", "a"), abs=2.0)


def test_numbers_stand_to_the_right(tmp_path: Path) -> None:
    document = Document("T", "f", MADE)
    document.rows(("a wide heading", "b"), [("−0.51", "b"), ("–", "b"), ("12.75", "b")])
    document.save(tmp_path / "d.pdf")
    assert _left(tmp_path / "d.pdf", "12.75") > _left(tmp_path / "d.pdf", "a") + 20


def _left(path: Path, text: str) -> float:
    """Where a text begins, points from the left edge of the page."""
    found: list[float] = []

    def look(said: str, _cm: object, matrix: list[float], *_: object) -> None:
        if said.strip().startswith(text):
            found.append(matrix[4])

    PdfReader(path).pages[0].extract_text(visitor_text=look)
    return found[0]


widths = st.lists(st.tuples(st.floats(1, 50), st.floats(0, 200)), min_size=1, max_size=12)


@given(widths)
def test_columns_share_the_page_and_keep_their_words(columns: list[tuple[float, float]]) -> None:
    least = [small for small, _ in columns]
    natural = [small + more for small, more in columns]
    fitted = fitted_widths(natural, least, 190.0)
    if fitted is None:
        assert sum(least) > 190.0
        return
    assert sum(fitted) <= 190.0 + 1e-6
    for small, width, most in zip(least, fitted, natural, strict=True):
        assert small - 1e-6 <= width <= most + 1e-6


@given(st.lists(st.floats(5, 76), min_size=2, max_size=30))
def test_blocks_hold_every_column_once_and_fit(least: list[float]) -> None:
    blocks = column_blocks(least, 190.0)
    assert [column for block in blocks for column in block[1:]] == list(range(1, len(least)))
    for block in blocks:
        assert block[0] == 0
        assert sum(least[column] for column in block) <= 190.0 or len(block) == 2
