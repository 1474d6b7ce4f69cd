"""What every test needs: seeded property tests, no leaked threads, and the published data where it is."""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from benchmarks.postgres_server import PostgresServer, binaries, postgres_server, temporary_folder
from tests import once, statements
from tests.turns import SLOW_S, in_turns

settings.register_profile("truewheel", deadline=None, derandomize=True)
settings.load_profile("truewheel")

TESTS = Path(__file__).resolve().parent
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
MEMORY, MEMORY_NEEDED = Path("/dev/shm"), 4e9
TEMPORARY = "PYTEST_DEBUG_TEMPROOT"
"""Where pytest makes the folders of its tests."""


def pytest_configure(config: pytest.Config) -> None:
    """Settle what all processes of the run inherit.

    No test pulls the plug, so folders of tests are in memory where there is room: commits wait for no disk.
    Where as many processes as cores run tests, each computes with one thread.
    """
    if MEMORY.is_dir() and os.access(MEMORY, os.W_OK):
        found = os.statvfs(MEMORY)
        if found.f_bavail * found.f_frsize > MEMORY_NEEDED and not found.f_flag & os.ST_NOEXEC:
            os.environ.setdefault(TEMPORARY, str(MEMORY))
    if getattr(config.option, "numprocesses", None):
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # No test searches the network for cameras: where emulated ones are asked for, pylon looks for no others.
    os.environ.setdefault("PYLON_CAMEMU", "6")
    statements.share()
    # Nothing that is made while tests are collected is garbage.
    gc.disable()


def pytest_xdist_auto_num_workers() -> int:
    """Two processes more than there are cores: tests wait for clocks and servers half of their time."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return cores + 2


def worker_count() -> int:
    """How many processes run the tests."""
    return int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))


def worker_number() -> int:
    """Which of them this is, from 0."""
    return int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Let each process of a whole run begin to read the tests somewhere else.

    pytest compiles each file of tests for whoever reads it first, so that all compile a share of them.
    """
    if hasattr(session.config, "workerinput") and session.config.args == session.config.getini("testpaths"):
        files = sorted(str(path) for path in TESTS.rglob("test_*.py"))
        first = len(files) * worker_number() // worker_count()
        session.config.args[:] = files[first:] + files[:first]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let every process begin with its share of the files with slow tests, those that take longest first.

    Each begins with a piece of the list, all pieces equally long, and takes from others when it has ended.
    """
    items[:] = in_turns(items, worker_count())


def pytest_collection_finish() -> None:
    """Let the search for garbage pass over modules and tests: it took up to a third of the time of a run.

    What a test makes is searched as ever; what has stayed for long, libraries that tests load, more seldom.
    """
    gc.collect()
    gc.freeze()
    young, middle, _ = gc.get_threshold()
    gc.set_threshold(young, middle, 50)
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Tell the tests that took long without the mark `slow`."""
    taken: dict[str, float] = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport) and "slow" not in report.keywords:
                taken[report.nodeid] = taken.get(report.nodeid, 0.0) + report.duration
    # Beside other work everything takes longer.
    share = max(1.0, os.getloadavg()[1] / (os.cpu_count() or 1))
    unmarked = sorted((seconds, name) for name, seconds in taken.items() if seconds > SLOW_S * share)
    if unmarked:
        terminalreporter.section(f"tests over {SLOW_S:g} s without the mark 'slow'")
        for seconds, name in reversed(unmarked):
            terminalreporter.line(f"{seconds:5.1f} s {name}")


@pytest.fixture(scope="session", autouse=True)
def folder_of_the_run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Where `tests/once.py` keeps what one process of the run makes for all; gone with the run's folders."""
    folder = tmp_path_factory.getbasetemp()
    if hasattr(request.config, "workerinput"):
        folder = folder.parent
    os.environ[once.FOLDER] = str(folder / "once")
    (folder / "once").mkdir(exist_ok=True)


@pytest.fixture(autouse=True)
def no_leaked_threads() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    leaked = [t for t in threading.enumerate() if t not in before and t.is_alive() and not t.daemon]
    assert not leaked, f"threads left running: {[t.name for t in leaked]}"


@pytest.fixture(scope="session", name="postgres_server")
def running_postgres_server() -> Iterator[PostgresServer]:
    """A server for all tests of a process; each makes databases of its own in it."""
    programs = binaries()
    if programs is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    # No test pulls the plug, so nothing needs to reach the disk: databases are made ten times faster.
    with postgres_server(temporary_folder(os.environ.get(TEMPORARY)), programs, ["-F"]) as server:
        yield server


@pytest.fixture(scope="session")
def published_data() -> Path:
    """Folder of measurements that others published; not part of the project."""
    if not SHARED.is_dir():
        pytest.skip(f"published data not present: {SHARED} does not exist")
    return SHARED
