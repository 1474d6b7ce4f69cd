"""Whoever waits for the compiling sees that it goes on, also where standard error is no terminal."""

from __future__ import annotations

import pytest

from station.commands.warm_up import lines_of_progress
from station.warm_up.prepare import WarmUpProgress


def test_a_log_says_how_far_the_compiling_is(capsys: pytest.CaptureFixture[str]) -> None:
    """One line, and then nothing for a minute or ten on a slow computer: it looked hung."""
    now = 0.0
    tell = lines_of_progress(lambda: now, every_s=5.0)
    for done in range(101):
        tell(WarmUpProgress(done / 100, done, 100))
        now += 0.6
    said = capsys.readouterr()
    assert said.out == ""
    lines = said.err.splitlines()
    assert lines[0] == "compiling for this computer (once): 100 functions, about a minute"
    assert lines[1] == "  9 of 100 functions, 9 %, 5 s"
    assert lines[-1] == "  100 of 100 functions, 100 %, 60 s"
    assert 10 <= len(lines) <= 14


def test_little_to_compile_is_two_lines(capsys: pytest.CaptureFixture[str]) -> None:
    tell = lines_of_progress(lambda: 0.0)
    tell(WarmUpProgress(0.0, 0, 1))
    tell(WarmUpProgress(1.0, 1, 1))
    assert capsys.readouterr().err.splitlines() == [
        "compiling for this computer (once): 1 function, about a minute",
        "  1 of 1 functions, 100 %, 0 s",
    ]
