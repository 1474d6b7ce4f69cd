"""Processes that compile, played by scripts that misbehave in every way."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from alignment.errors import WarmUpError
from station.warm_up.needs import Needed
from station.warm_up.workers import Compiled, compile_apart

TASKS = [Needed(f"alignment.some.kernel_{k}", "int64") for k in range(5)]
GOOD = '{"compiled": true, "error": null, "seconds": 0.5, "unsaved": null}'
ANSWERS = f"import sys\nfor line in sys.stdin: print('{GOOD}', flush=True)"


def run(code: str, stopping: threading.Event | None = None, **more: object) -> list[Compiled]:
    command = (sys.executable, "-c", code)
    return list(
        compile_apart(TASKS, 60.0, stopping or threading.Event(), command=command, **more)  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("count", [1, 2, 9])
def test_every_function_is_compiled_once_by_however_many_processes(count: int) -> None:
    done = run(ANSWERS, count=count)
    assert sorted(one.what.name for one in done) == [task.name for task in TASKS]
    assert all(one.compiled and one.seconds == 0.5 for one in done)


def test_a_function_that_does_not_compile_ends_it_with_the_compilers_sentence() -> None:
    bad = '{"compiled": false, "error": "kernel_0 was not compiled: no", "seconds": 0, "unsaved": null}'
    with pytest.raises(WarmUpError, match="kernel_0 was not compiled: no"):
        run(f"input(); print('{bad}', flush=True); input()")


def test_a_process_that_hangs_is_given_up_after_its_bound() -> None:
    times = iter(range(0, 10_000, 20))
    with pytest.raises(WarmUpError, match=r"kernel_\d did not end within 60 s"):
        run("import sys; sys.stdin.read()", clock=lambda: float(next(times)))


@pytest.mark.parametrize(
    ("code", "how"),
    [
        ("input(); raise SystemExit(7)", "with exit status 7"),
        ("input(); import os; os.kill(os.getpid(), 9)", "by signal 9"),
        ("input(); raise RuntimeError('no llvm here')", "no llvm here"),
        ("raise SystemExit(4)", "with exit status 4"),
    ],
)
def test_a_process_that_dies_is_told_with_its_last_words(code: str, how: str) -> None:
    with pytest.raises(WarmUpError, match=how) as told:
        run(code, count=1)
    assert "kernel_0" in str(told.value)
    assert "memory" in str(told.value)


def test_no_process_is_left_when_it_is_stopped(tmp_path: Path) -> None:
    stopping = threading.Event()
    code = (
        f"import os,sys; open(f'{tmp_path}/{{os.getpid()}}', 'w'); print(input() and '{GOOD}', flush=True)\n"
    )
    code += "sys.stdin.read()"
    found = compile_apart(TASKS, 60.0, stopping, command=(sys.executable, "-c", code), count=2)
    assert next(found).compiled
    stopping.set()
    assert list(found) in ([], [Compiled(TASKS[1], True, 0.5)], [Compiled(TASKS[0], True, 0.5)])
    assert_gone(tmp_path)


def test_no_process_is_left_when_the_asking_program_ends_early(tmp_path: Path) -> None:
    code = (
        f"import os,sys; open(f'{tmp_path}/{{os.getpid()}}', 'w'); print(input() and '{GOOD}', flush=True)\n"
    )
    code += "sys.stdin.read()"
    found = compile_apart(TASKS, 60.0, threading.Event(), command=(sys.executable, "-c", code), count=1)
    assert isinstance(found, Iterator)
    next(found)
    found.close()  # type: ignore[attr-defined]
    assert_gone(tmp_path)


def assert_gone(folder: Path) -> None:
    started = [int(file.name) for file in folder.iterdir()]
    assert started
    for process in started:
        assert not Path(f"/proc/{process}").exists()
