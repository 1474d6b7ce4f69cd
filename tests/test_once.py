"""What the tests make once for all their processes, and how slow ones without their mark are told."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests import conftest, once


@pytest.fixture(autouse=True)
def run_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(once.FOLDER, str(tmp_path))


def test_a_second_process_reads_every_bit_of_what_the_first_made() -> None:
    calls = []

    def make(seed: int) -> dict[str, np.ndarray]:
        calls.append(seed)
        rng = np.random.default_rng(seed)
        return {
            "deep": rng.integers(0, 4096, (5, 7), np.uint16),
            "real": np.array([rng.normal(), np.nan, -0.0]),
        }

    # Each wrapper stands for a process: it keeps what it has seen in its own memory.
    first, again = once.once(make)(3), once.once(make)(3)
    assert calls == [3]
    assert {name: (a.dtype, a.tobytes()) for name, a in first.items()} == {
        name: (a.dtype, a.tobytes()) for name, a in again.items()
    }
    once.once(make)(4)
    assert calls == [3, 4]


def test_while_one_process_makes_it_the_others_wait(tmp_path: Path) -> None:
    def make() -> bool:
        (lock,) = tmp_path.glob("make-*/lock")
        with lock.open() as other, pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True

    assert once.once(make)()


def test_a_folder_that_was_half_filled_is_filled_anew() -> None:
    attempts = []

    def fill(folder: Path, text: str) -> None:
        assert not list(folder.iterdir())
        (folder / "first").write_text(text)
        attempts.append(text)
        if len(attempts) == 1:
            raise OSError("the disk is full")
        (folder / "second").write_text(text)

    with pytest.raises(OSError, match="full"):
        once.folder_once(fill)("a")
    folder = once.folder_once(fill)("a")
    assert sorted(file.name for file in folder.iterdir()) == ["first", "second"]
    assert once.folder_once(fill)("a") == folder
    assert len(attempts) == 2


def report(name: str, when: str, seconds: float, *marks: str) -> pytest.TestReport:
    return pytest.TestReport(
        nodeid=name, location=("", None, ""), keywords=dict.fromkeys(marks, 1), outcome="passed",
        longrepr=None, when=when, duration=seconds,
    )  # fmt: skip


def test_a_test_over_the_bound_without_its_mark_is_told_with_the_time_of_what_it_set_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (0.0, 0.0, 0.0))
    said: list[str] = []
    reports = [
        report("marked", "call", 60.0, "slow"),
        report("quick", "call", 4.9),
        report("sets up", "call", 0.1),
    ]
    terminal = SimpleNamespace(
        stats={"passed": reports, "": [report("sets up", "setup", 5.0)], "deselected": [object()]},
        section=said.append,
        line=said.append,
    )
    conftest.pytest_terminal_summary(terminal)
    assert said[1:] == ["  5.1 s sets up"]
    said.clear()
    # A machine with twice the work takes twice the time.
    monkeypatch.setattr(os, "getloadavg", lambda: (0.0, 2.0 * (os.cpu_count() or 1), 0.0))
    conftest.pytest_terminal_summary(terminal)
    assert said == []
    monkeypatch.setattr(os, "getloadavg", lambda: (0.0, 0.0, 0.0))
    terminal.stats = {"passed": reports[:2]}
    conftest.pytest_terminal_summary(terminal)
    assert said == []
