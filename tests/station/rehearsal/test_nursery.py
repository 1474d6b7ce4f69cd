"""Copies of a process that has loaded everything: each is a process of its own."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import pytest

from alignment.errors import LineError
from station.rehearsal.nursery import Nursery

# Its `main` runs the text on its command line.
MODULE = "timeit"
MARKED = "import builtins, os; old = getattr(builtins, 'mark', 3); builtins.mark = 5; os._exit(old)"


@pytest.fixture(scope="module")
def nursery() -> Iterator[Nursery]:
    with Nursery(MODULE) as nursery:
        yield nursery


def test_each_copy_begins_with_nothing_of_the_one_before(nursery: Nursery) -> None:
    for _ in range(2):
        with nursery.start(MODULE, MARKED) as copy:
            assert copy.wait(60.0) == 3


def test_a_copy_is_told_by_its_standard_input_and_answers_on_its_standard_output(nursery: Nursery) -> None:
    text = "import os, sys; print(sys.stdin.read()[::-1], flush=True); os._exit(0)"
    with nursery.start(MODULE, text) as copy:
        copy.stdin.write(b"abc")
        assert copy.poll() is None
        copy.stdin.close()
        assert copy.stdout.read() == b"cba\n"
        assert copy.wait(60.0) == 0


def test_a_copy_that_is_killed_says_by_which_signal_and_leaves_the_others(nursery: Nursery) -> None:
    waits = "import os, sys; sys.stdin.read(); os._exit(4)"
    with nursery.start(MODULE, waits) as killed, nursery.start(MODULE, waits) as other:
        killed.kill()
        assert killed.wait(60.0) == -9
        killed.kill()
        with pytest.raises(subprocess.TimeoutExpired):
            other.wait(0.0)
        other.stdin.close()
        assert other.wait(60.0) == 4


def test_an_error_of_a_copy_is_its_exit_status(nursery: Nursery) -> None:
    with nursery.start("no_such_module", "") as copy:
        assert copy.wait(60.0) == 1


def test_a_nursery_that_cannot_load_its_module_is_an_error_and_no_endless_wait() -> None:
    with (
        Nursery("no_such_module") as nursery,
        nursery.start("no_such_module", "") as copy,
        pytest.raises(LineError, match="nursery"),
    ):
        copy.wait(60.0)
