"""In which order the processes of a run begin their tests: files with slow ones first, shared out evenly."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

SLOW_S = 5.0
"""A test that takes longer alone, with what it sets up, carries the mark `slow`."""


class Item(Protocol):
    """What is asked of a test."""

    path: Path

    def get_closest_marker(self, name: str) -> Any:
        """Its mark of this name, or None."""


T = TypeVar("T", bound=Item)


def seconds(item: Item) -> float:
    """How long a test takes by its mark: ``slow`` says five seconds, ``slow(40)`` forty, no mark nothing."""
    mark = item.get_closest_marker("slow")
    if mark is None:
        return 0.0
    return float(mark.args[0]) if mark.args else SLOW_S


def in_turns(items: Sequence[T], processes: int) -> list[T]:
    """Return the tests so that equal pieces of the list, one for each process, begin with equal work.

    Files stay together, the longest first; what is not slow fills the pieces up and is what others take over.
    In which order the files were read does not matter: every process gets the same list.
    """
    files: dict[Path, list[T]] = {}
    for item in sorted(items, key=lambda item: item.path):
        files.setdefault(item.path, []).append(item)
    work = {path: sum(map(seconds, tests)) for path, tests in files.items()}
    pieces: list[list[T]] = [[] for _ in range(processes)]
    given = [0.0] * processes
    for path in sorted(filter(work.__getitem__, files), key=lambda path: -work[path]):
        least = given.index(min(given))
        pieces[least] += files[path]
        given[least] += work[path]
    rest = [item for path, tests in files.items() if not work[path] for item in tests]
    for number, piece in enumerate(pieces):
        # As many as a process is given at first.
        wanted = (len(items) - sum(map(len, pieces[:number]))) // (processes - number)
        room = max(0, wanted - len(piece))
        piece.extend(rest[:room])
        del rest[:room]
    return [item for piece in pieces for item in piece] + rest
