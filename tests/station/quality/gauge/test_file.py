"""Tables of a gauge study: what is read, and that every bad one is refused with file, line and column."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.errors import FormatError
from station.quality.gauge.file import GaugeRow, read_gauge_file

GOOD = "part,appraiser,trial,value\n1,A,1,0.29\n1,A,2,0.41\n2,B,1,-0.56\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "study.csv"


def test_columns_come_in_any_order_and_case(file: Path) -> None:
    file.write_text("Value; TRIAL ;Part;comment;time\n1,25;2;P-1;was;2026-11-22T10:00:00+02:00\n")
    assert read_gauge_file(file) == [
        GaugeRow("P-1", "", 2, Decimal("1.25"), None, datetime(2026, 11, 22, 8, tzinfo=UTC))
    ]


def test_spreadsheet_signature_blank_lines_and_windows_ends_are_fine(file: Path) -> None:
    file.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode() + b"\r\n ,,,\r\n")
    rows = read_gauge_file(file)
    assert [(row.part, row.appraiser, row.trial) for row in rows] == [
        ("1", "A", 1), ("1", "A", 2), ("2", "B", 1),
    ]  # fmt: skip
    assert rows[2].value == Decimal("-0.56")


def test_values_alone_are_trials_of_one_part(file: Path) -> None:
    file.write_text("value\n1.0\n\N{MINUS SIGN}2.0\n")
    rows = read_gauge_file(file, ("value",))
    assert [(row.part, row.trial, row.value) for row in rows] == [("1", 1, 1), ("1", 2, -2)]


def test_a_certified_value_names_its_part(file: Path) -> None:
    file.write_text("reference,value\n2,2.1\n2,2.2\n4,4.1\n")
    rows = read_gauge_file(file, ("reference", "value"))
    assert [(row.part, row.trial, row.reference) for row in rows] == [("2", 1, 2), ("2", 2, 2), ("4", 1, 4)]


def test_no_digit_is_lost(file: Path) -> None:
    file.write_text("part,value\n1,1000000000000.4\n")
    assert read_gauge_file(file)[0].value - 10**12 == Decimal("0.4")


@pytest.mark.parametrize(
    ("text", "where", "seen"),
    [
        ("", "line 1", "nothing"),
        ("\n\n", "line 1", "nothing"),
        ("part,trial\n1,1\n", "line 1", "Missing: value"),
        ("part,value,value\n1,1,1\n", "line 1", "value twice"),
        (GOOD.replace("0.41", "0.4x"), "line 3, column value", "'0.4x'"),
        (GOOD.replace("0.41", ""), "line 3, column value", "nothing"),
        (GOOD.replace("0.41", "nan"), "line 3, column value", "'nan'"),
        (GOOD.replace("0.41", "1e999"), "line 3, column value", "'1e999'"),
        (GOOD.replace("0.41", "0,41"), "line 3", "found 5"),
        (GOOD.replace("A,2", "A,0"), "line 3, column trial", "'0'"),
        (GOOD.replace("A,2", "A,1.5"), "line 3, column trial", "'1.5'"),
        (GOOD.replace("A,2", "A,²"), "line 3, column trial", "xb2"),
        (GOOD.replace("A,2", "A," + "9" * 5000), "line 3, column trial", "'999"),
        (GOOD.replace("A,2", "A,1"), "line 3, column trial", "as in line 2"),
        (GOOD.replace("\n1,A,2", "\n,A,2"), "line 3, column part", "nothing"),
        (GOOD.replace("\n1,A,2", "\n\x07,A,2"), "line 3, column part", "x07"),
        (GOOD.replace("1,A,2,0.41", '1,A,2,"0.41'), "line", "unexpected end"),
        ("part,trial,value\n", "", "none"),
        ("part,value,time\n1,2,yesterday\n", "line 2, column time", "yesterday"),
        ("part,value,reference\n1,2,x\n", "line 2, column reference", "'x'"),
        ("part,value\n1,\x00\n", "line 2", "x00"),
        ("part,value\n1," + "9" * 200_000 + "\n", "line 2", "larger than field limit"),
    ],
)
def test_bad_table_is_one_error_with_its_place(file: Path, text: str, where: str, seen: str) -> None:
    file.write_text(text)
    with pytest.raises(FormatError) as caught:
        read_gauge_file(file)
    assert caught.value.file == str(file)
    assert where in (caught.value.field or "")
    assert seen in str(caught.value)
    assert len(str(caught.value)) < 500 + len(str(file))


def test_reference_is_needed_where_the_study_needs_it(file: Path) -> None:
    file.write_text("part,reference,value\n1,2.0,2.1\n2,,4.1\n")
    with pytest.raises(FormatError, match="line 3, column reference"):
        read_gauge_file(file, ("reference", "value"))


def test_binary_file_is_refused(file: Path) -> None:
    file.write_bytes(bytes(range(256)))
    with pytest.raises(FormatError, match="expected a header with the columns"):
        read_gauge_file(file)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_a_table_as_a_german_excel_saves_it(file: Path, encoding: str, ends: str) -> None:
    """A name with an umlaut in code page 1252 was refused as no UTF-8."""
    lines = ["sep=;", "Part;Appraiser;Value", "#1;Jürgen;0,25", "#2;Jürgen;0,5"]
    file.write_bytes(ends.join(lines).encode(encoding))
    rows = read_gauge_file(file)
    assert [(row.part, row.appraiser, float(row.value)) for row in rows] == [
        ("#1", "Jürgen", 0.25),
        ("#2", "Jürgen", 0.5),
    ]


CELLS = st.one_of(
    st.sampled_from(
        ["1", "2", "A", "0.5", "-1e9", "", " ", '"', "'", "nan", "1_0", "０", "=1", "1e400", "\x00"]
    ),
    st.text(max_size=6),
)
TABLES = st.lists(st.lists(CELLS, min_size=1, max_size=5), max_size=6)


@settings(max_examples=300)
@given(
    rows=TABLES, head=st.sampled_from(["part,appraiser,trial,value", "value;part", "part\tvalue", "x", ""])
)
def test_any_table_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]], head: str
) -> None:
    file = tmp_path_factory.getbasetemp() / "any.csv"
    separator = next((each for each in "\t;" if each in head), ",")
    text = "\n".join([head, *(separator.join(row) for row in rows)])
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    with suppress(FormatError):
        for row in read_gauge_file(file):
            assert row.value.is_finite()
            assert row.trial >= 1
            assert row.part


@settings(max_examples=200)
@given(data=st.binary(max_size=200))
def test_any_bytes_are_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    file = tmp_path_factory.getbasetemp() / "bytes.csv"
    file.write_bytes(b"part,value\n" + data)
    with suppress(FormatError):
        assert read_gauge_file(file)
