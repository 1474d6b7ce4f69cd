"""What every test needs: seeded property tests, no leaked threads, and the published data where it is."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("truewheel", deadline=None, derandomize=True)
settings.load_profile("truewheel")

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(autouse=True)
def no_leaked_threads() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    leaked = [t for t in threading.enumerate() if t not in before and t.is_alive() and not t.daemon]
    assert not leaked, f"threads left running: {[t.name for t in leaked]}"


@pytest.fixture(scope="session")
def published_data() -> Path:
    """Folder of measurements that others published; not part of the project."""
    if not SHARED.is_dir():
        pytest.skip(f"published data not present: {SHARED} does not exist")
    return SHARED
