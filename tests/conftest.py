"""What every test needs: seeded property tests, no leaked threads, and the published data where it is."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from benchmarks.postgres_server import PostgresServer, binaries, postgres_server, temporary_folder
from tests import once

settings.register_profile("truewheel", deadline=None, derandomize=True)
settings.load_profile("truewheel")

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
SLOW_S = 5.0
"""A test that takes longer alone, with what it sets up, carries the mark `slow`."""


def pytest_configure(config: pytest.Config) -> None:
    """Give the run a folder for what is made once; its processes inherit the name.

    As many processes as cores run tests, so each computes with one thread.
    """
    if not hasattr(config, "workerinput"):
        os.environ[once.FOLDER] = tempfile.mkdtemp(prefix="truewheel-tests-")
        if getattr(config.option, "numprocesses", None):
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_unconfigure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        shutil.rmtree(os.environ.pop(once.FOLDER))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Tell the tests that took long without the mark `slow`."""
    taken: dict[str, float] = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport) and "slow" not in report.keywords:
                taken[report.nodeid] = taken.get(report.nodeid, 0.0) + report.duration
    unmarked = sorted((seconds, name) for name, seconds in taken.items() if seconds > SLOW_S)
    if unmarked:
        terminalreporter.section(f"tests over {SLOW_S:g} s without the mark 'slow'")
        for seconds, name in reversed(unmarked):
            terminalreporter.line(f"{seconds:5.1f} s {name}")


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
    # No test pulls the plug, so nothing needs to reach the disk: databases are made several times faster.
    with postgres_server(temporary_folder(), programs, ["-F"]) as server:
        yield server


@pytest.fixture(scope="session")
def published_data() -> Path:
    """Folder of measurements that others published; not part of the project."""
    if not SHARED.is_dir():
        pytest.skip(f"published data not present: {SHARED} does not exist")
    return SHARED
