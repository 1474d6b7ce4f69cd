"""What is needed is there before a work begins, whatever the disk does."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment import kernels
from alignment.errors import WarmUpError
from station.warm_up import needs, prepare
from station.warm_up.needs import Needed, Work, load, needed
from station.warm_up.notation import read_all, spell_all
from station.warm_up.prepare import StoppedError, WarmUpProgress, warm_up
from station.warm_up.table import SIGNATURES
from station.warm_up.workers import Compiled
from tests.once import folder_once

ROOT = Path(__file__).parents[3]
NAME = "alignment.stereo.pool.take_numbers"
# Two small functions, compiled by processes of their own into a folder of the test's.
SMALL = """
import json, logging, sys
from station.warm_up import needs
from station.warm_up.prepare import warm_up
names = ("alignment.stereo.pool.take_numbers", "alignment.stereo.surface.nearest_candidates")
table = {name: needs.SIGNATURES["measure_8"][name] for name in names}
needs.SIGNATURES = {"spin": table}
told = []
done = warm_up([needs.Work.SPIN], told.append)
print(json.dumps([sorted({one.what.name for one in done.compiled}), done.unsaved, [p.share for p in told]]))
"""


def small(cache: Path, code: str = SMALL) -> Any:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@folder_once
def new_computer(folder: Path) -> None:
    """What a new computer compiled, in `cache`, and what it told of it."""
    (folder / "told.json").write_text(json.dumps(small(folder / "cache")), encoding="utf-8")


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    """A copy of what it compiled."""
    return Path(shutil.copytree(new_computer() / "cache", tmp_path / "cache"))


@pytest.fixture
def kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A compiled function of its own, kept in a folder of the test's."""
    monkeypatch.setattr(kernels.config, "CACHE_DIR", str(tmp_path / "cache"))

    def twice(x: float) -> float:
        return 2.0 * x

    # Without the angle brackets of a function in a function, which a file's name cannot have.
    twice.__qualname__ = "twice"
    name = f"{twice.__module__}.{twice.__qualname__}"
    yield lambda: kernels.njit(cache=True, nogil=True)(twice)
    kernels.KERNELS.pop(name, None)
    kernels.UNSAVED.pop(name, None)


def test_the_table_names_functions_that_there_are_with_types_that_can_be_read() -> None:
    assert set(SIGNATURES) == set(Work)
    for one in needed(Work):
        assert spell_all(read_all(one.signature)) == one.signature
        assert one.name in kernels.KERNELS


def test_the_largest_functions_are_compiled_first() -> None:
    order = [one.name.rsplit(".", 1)[1] for one in needed([Work.MEASURE_8])]
    assert order[0] == "extract_all"


def test_a_new_computer_compiles_once_and_a_second_start_finds_everything(cache: Path) -> None:
    names, unsaved, shares = json.loads((new_computer() / "told.json").read_text(encoding="utf-8"))
    assert [name.rsplit(".", 1)[1] for name in names] == ["take_numbers", "nearest_candidates"]
    assert unsaved is None
    assert shares[0] == 0.0
    assert shares[-1] == pytest.approx(1.0)
    assert shares == sorted(shares)
    assert small(cache) == [[], None, []]


@pytest.mark.slow
def test_a_damaged_cache_is_compiled_again(cache: Path) -> None:
    codes, indices = list(cache.rglob("*.nbc")), list(cache.rglob("*nearest*.nbi"))
    assert codes
    assert indices
    for file in codes:
        file.write_bytes(b"\x80\x04damaged")
    for file in indices:
        file.write_bytes(b"damaged")
    names, unsaved, _ = small(cache)
    assert (len(names), unsaved) == (2, None)
    assert small(cache)[0] == []


def test_a_full_disk_compiles_here_and_says_that_nothing_is_kept(tmp_path: Path) -> None:
    """A measurement used to end in the disk's error, after the compiler had done its work."""
    full = f"""
import errno, os
from alignment import kernels
from numba.core import caching
def full(self, name, data): raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
caching.IndexDataCacheFile._save_data = full
{SMALL}
"""
    here = full.replace(
        "warm_up([needs.Work.SPIN], told.append)",
        "warm_up([needs.Work.SPIN], told.append, apart=lambda *a: iter(()))",
    )
    names, unsaved, _ = small(tmp_path, here)
    assert (len(names), unsaved) == (2, os.strerror(errno.ENOSPC))


def test_a_full_disk_does_not_end_a_measurement(kernel: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*args: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    function = kernel()
    monkeypatch.setattr(function._cache._cache_file, "_save_data", full)
    assert function(1.5) == 3.0
    assert os.strerror(errno.ENOSPC) in kernels.UNSAVED.values()


def test_a_folder_that_cannot_be_written_serves_what_it_holds(
    kernel: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An installer compiles, and the station's user may only read: it compiled everything again."""
    kernel()(1.5)

    def read_only(self: object) -> None:
        raise PermissionError(errno.EACCES, "read-only")

    monkeypatch.setattr(kernels.GivenFolder, "ensure_cache_path", read_only)
    again = kernel()
    assert again(1.5) == 3.0
    assert (sum(again.stats.cache_hits.values()), sum(again.stats.cache_misses.values())) == (1, 0)


def test_where_nothing_can_be_written_a_function_still_compiles(
    kernel: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Importing the program used to end in numba's 'no locator available'."""

    def read_only(self: object) -> None:
        raise PermissionError(errno.EACCES, "read-only")

    for kind in (kernels.GivenFolder, kernels.InTree, kernels.UserWide):
        monkeypatch.setattr(kind, "ensure_cache_path", read_only)
    assert kernel()(1.5) == 3.0
    assert len(kernels.UNSAVED) == 1


def test_a_compiler_that_fails_is_one_clear_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(types: object) -> None:
        raise RuntimeError("LLVM says no\nand much more")

    one = next(one for one in needed([Work.MEASURE_8]) if one.name == NAME)
    monkeypatch.setattr(kernels.KERNELS[NAME], "compile", broken)
    with pytest.raises(WarmUpError, match=f"{NAME} was not compiled: LLVM says no; install") as told:
        load(one)
    assert "\n" not in str(told.value)


class Apart:
    """Stands for the processes that compile."""

    def __init__(self, *, unsaved: str | None = None, failure: Exception | None = None) -> None:
        self.unsaved = unsaved
        self.failure = failure
        self.asked: list[Needed] = []

    def __call__(
        self, tasks: Sequence[Needed], timeout_s: float, stopping: threading.Event
    ) -> Iterable[Compiled]:
        if self.failure is not None:
            raise self.failure
        for task in tasks:
            self.asked.append(task)
            yield Compiled(task, True, 0.1, self.unsaved)
            if stopping.is_set():
                return


@pytest.fixture
def cold(monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk seems to hold nothing."""
    monkeypatch.setattr(needs, "is_kept", lambda one: False)


@pytest.mark.usefixtures("cold")
def test_every_step_is_reported_up_to_the_whole() -> None:
    told: list[WarmUpProgress] = []
    apart = Apart()
    done = warm_up([Work.MEASURE_8], told.append, loaded=False, apart=apart)
    assert [one.what for one in done.compiled] == apart.asked == list(needed([Work.MEASURE_8]))
    assert [progress.done for progress in told] == list(range(len(apart.asked) + 1))
    assert told[-1].share == pytest.approx(1.0)


@pytest.mark.usefixtures("cold")
def test_when_the_first_is_not_kept_the_others_are_compiled_here(monkeypatch: pytest.MonkeyPatch) -> None:
    here: list[Needed] = []
    monkeypatch.setattr(prepare, "load", lambda one: here.append(one) or True)
    apart = Apart(unsaved="No space left on device")
    done = warm_up([Work.MEASURE_8], loaded=False, apart=apart)
    assert len(apart.asked) == 1
    assert here == list(needed([Work.MEASURE_8]))
    assert done.unsaved == "No space left on device"


@pytest.mark.usefixtures("cold")
def test_told_to_end_it_ends() -> None:
    stopping = threading.Event()

    def report(progress: WarmUpProgress) -> None:
        if progress.done == 2:
            stopping.set()

    apart = Apart()
    with pytest.raises(StoppedError):
        warm_up([Work.MEASURE_8], report, stopping, apart=apart)
    assert len(apart.asked) == 2


@pytest.mark.usefixtures("cold")
def test_a_failure_of_the_processes_reaches_the_caller() -> None:
    with pytest.raises(WarmUpError, match="hangs"):
        warm_up([Work.MEASURE_8], apart=Apart(failure=WarmUpError("hangs")))


def test_types_are_spelled_so_that_they_can_be_read() -> None:
    from numba import typeof, types

    frozen = np.zeros((2, 2))
    frozen.flags.writeable = False
    some = (
        np.zeros((2, 3)),
        np.zeros((2, 3)).T,
        np.zeros((4, 4))[::2, ::2],
        frozen,
        True,
        1,
        1.5,
        (1, 2),
        (1, 2.0),
    )
    kinds = (*map(typeof, some), types.ListType(typeof(np.zeros((1, 1), np.uint8))))
    assert read_all(spell_all(kinds)) == kinds
