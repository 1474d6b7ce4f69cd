"""Messages said "1 views"."""

from __future__ import annotations

import pytest

from alignment.counting import count_of


@pytest.mark.parametrize(
    ("number", "words", "told"),
    [
        (1, ("view",), "1 view"),
        (0, ("view",), "0 views"),
        (3, ("image pair",), "3 image pairs"),
        (1, ("study", "studies"), "1 study"),
        (2, ("study", "studies"), "2 studies"),
    ],
)
def test_numbers_of_things_are_told_as_a_person_does(number: int, words: tuple[str, ...], told: str) -> None:
    assert count_of(number, *words) == told
