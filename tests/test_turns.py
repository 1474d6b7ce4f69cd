"""Slow tests came in a row, in one process: the others had ended when the last of them began."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.turns import in_turns, seconds


@dataclass(frozen=True)
class Named:
    """A test of a file, with the arguments of its mark, if it has one."""

    path: Path
    number: int
    slow: tuple[float, ...] | None = None

    def get_closest_marker(self, name: str) -> Any:
        assert name == "slow"
        return None if self.slow is None else SimpleNamespace(args=self.slow)


def file_of(name: str, count: int, slow: tuple[float, ...] | None = None) -> list[Named]:
    return [Named(Path(name), number, slow if number == 0 else None) for number in range(count)]


TESTS = [
    *file_of("a", 40),
    *file_of("b", 5, (40.0,)),
    *file_of("c", 60),
    *file_of("d", 3, ()),
    *file_of("e", 4, (25.0,)),
    *file_of("f", 9, (12.0,)),
    *file_of("g", 31),
]


@pytest.mark.parametrize("processes", [1, 2, 3, 8, 200])
def test_no_test_is_lost_doubled_or_parted_from_the_slow_ones_of_its_file(processes: int) -> None:
    found = in_turns(TESTS, processes)
    assert sorted(found, key=TESTS.index) == TESTS
    for name in "bdef":
        places = [place for place, test in enumerate(found) if test.path == Path(name)]
        assert places == list(range(places[0], places[0] + len(places)))
        assert [found[place].number for place in places] == list(range(len(places)))


def test_each_process_begins_with_a_slow_file_and_has_as_much_of_them_as_the_others() -> None:
    found, pieces, begin = in_turns(TESTS, 3), [], 0
    for left in (3, 2, 1):
        end = begin + (len(found) - begin) // left
        pieces.append(found[begin:end])
        begin = end
    assert [piece[0].path.name for piece in pieces] == ["b", "e", "f"]
    assert [sum(map(seconds, piece)) for piece in pieces] == [40.0, 25.0, 17.0]


@pytest.mark.parametrize("processes", [1, 4])
def test_processes_that_read_the_files_in_another_order_get_the_same_list(processes: int) -> None:
    half = next(place for place, test in enumerate(TESTS) if test.path == Path("d"))
    assert in_turns(TESTS[half:] + TESTS[:half], processes) == in_turns(TESTS, processes)


def test_one_process_begins_with_what_takes_longest() -> None:
    slow = [test.path.name for test in in_turns(TESTS, 1) if test.slow is not None]
    assert slow == ["b", "e", "f", "d"]
