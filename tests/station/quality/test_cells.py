"""Values as people read them: decimals and units of their names, in terminal, page and paper alike."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from station.quality.cells import heading, is_number_column, on_paper, shown
from station.quality.text_tables import print_names, print_table


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("mean_deg", -0.123456, "-0.1235"),
        ("mean_deg", -0.00001, "-0.00001"),
        ("mean_deg", 0.0, "0.0000"),
        ("mean_deg", -0.0, "0.0000"),
        ("yield_percent", 5.405405, "5.4"),
        ("cpk", 1.328, "1.33"),
        ("least_cpk", 0.6195612, "0.62"),
        ("cpk_low", None, "–"),
        ("p", 3e-12, "<0.0001"),
        ("normality_p", 0.04567, "0.0457"),
        ("expected_outside_ppm", 123456.7, "123457"),
        ("expected_outside_ppm", 0.0012345, "0.00123"),
        ("change", 1.23456789e-7, "0.00000012346"),
        ("change", 123456.0, "123460"),
        ("camber_arcmin", 0.01234, "0.012"),
        ("ndc", 13, "13"),
        ("degraded", True, "yes"),
        ("reason", "", "–"),
        ("cp", float("nan"), "–"),
    ],
)
def test_a_value_has_the_decimals_of_its_name(name: str, value: object, text: str) -> None:
    """Angles had five digits or eight, counts an exponent, indices six decimals."""
    assert shown(name, value) == text


@given(
    st.floats(allow_nan=True, allow_infinity=True), st.sampled_from(["x", "mean_deg", "a_ppm", "p", "cpk"])
)
def test_no_number_has_an_exponent_or_a_zero_with_a_sign(value: float, name: str) -> None:
    text = shown(name, value)
    assert "e" not in text
    assert not text.startswith("-0.0000") or text.strip("-0.")
    assert on_paper(name, value).replace("−", "-") == text


def test_a_name_that_begins_with_a_hyphen_keeps_it() -> None:
    assert on_paper("vin", "-1") == "-1"
    assert on_paper("mean_deg", -1.0) == "−1.0000"


@pytest.mark.parametrize(
    ("name", "text"),
    [("mean_deg", "mean [°]"), ("yield_percent", "yield [%]"), ("percent", "percent"), ("n", "n"),
     ("residual_mm", "residual [mm]"), ("cpk_low", "cpk low")],
)  # fmt: skip
def test_a_heading_has_its_unit_in_brackets(name: str, text: str) -> None:
    assert heading(name) == text


def test_a_column_of_numbers_may_have_gaps_but_no_words() -> None:
    assert is_number_column([1, None, 2.5])
    assert not is_number_column([None, ""])
    assert not is_number_column([1, "none"])
    assert not is_number_column([True, False])


ROWS = [
    {
        "characteristic": "front_left.toe", "station": "Achsvermessung-Halle-Sued-Linie-2-Platz-1",
        "vin": f"WVWZZZ1JZXW00000{number}-PROTOTYP-0000000000000", "mean_deg": -0.51237, "n": 1000 + number,
        "cpk_low_of_the_worst": 1.5,
        "reason": "head 2 sees no light: clean its window, look at the lamp of the projector, measure again",
        "last": f"the[last]{number}",
    }
    for number in range(3)
]  # fmt: skip


@pytest.mark.parametrize("width", [60, 80, 120, 200])
def test_no_text_of_a_table_is_cut_or_broken_in_any_terminal(width: int) -> None:
    """At eighty columns values ended in an ellipsis."""
    console = Console(width=width, file=io.StringIO())
    print_table(console, ROWS)
    out = console.file.getvalue()  # type: ignore[attr-defined]
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= width
    for row in ROWS:
        for name, value in row.items():
            for word in (*shown(name, value).split(), *heading(name).split()):
                assert word in out.split()


def test_names_are_broken_between_each_other_alone() -> None:
    names = [f"{number}-Achsvermessung-Halle-Sued" for number in range(20)]
    console = Console(width=80, file=io.StringIO())
    print_names(console, "stations", names)
    out = console.file.getvalue()  # type: ignore[attr-defined]
    assert max(map(len, out.splitlines())) <= 80
    assert [word.strip(",") for word in out.split()[1:]] == names
