"""A database of its own for each test: an SQLite file, and one in a real PostgreSQL server."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.postgres_server import PostgresServer
from db.connection import migrate
from db.store import ResultStore
from tests.db.databases import new_database
from tests.db.example_records import CALIBRATION


@pytest.fixture(scope="session")
def postgres_template(postgres_server: PostgresServer) -> Iterator[str]:
    """Name of a database with all tables; a copy is made faster than its tables."""
    with postgres_server.database() as url:
        migrate(url)
        yield url.rpartition("/")[2]


@pytest.fixture
def postgres_url(postgres_server: PostgresServer, postgres_template: str) -> Iterator[str]:
    with postgres_server.database(postgres_template) as url:
        yield url


@pytest.fixture
def empty_postgres_url(postgres_server: PostgresServer) -> Iterator[str]:
    with postgres_server.database() as url:
        yield url


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    """URL of a file that is not there yet."""
    return f"sqlite:///{tmp_path / 'results.db'}"


@pytest.fixture
def migrated_sqlite_url(tmp_path: Path) -> str:
    """URL of a file with all tables."""
    return new_database(tmp_path / "results.db")


@pytest.fixture(params=["migrated_sqlite_url", "postgres_url"], ids=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest) -> str:
    """URL of a database without a row, once for each kind."""
    url: str = request.getfixturevalue(request.param)
    return url


@pytest.fixture(params=["sqlite_url", "empty_postgres_url"], ids=["sqlite", "postgresql"])
def empty_database_url(request: pytest.FixtureRequest) -> str:
    """URL of a database without a table, once for each kind."""
    url: str = request.getfixturevalue(request.param)
    return url


@pytest.fixture
def open_store() -> Iterator[Callable[..., ResultStore]]:
    """Open stores that are closed when the test ends."""
    opened: list[ResultStore] = []

    def open_(url: str, **options: object) -> ResultStore:
        store = ResultStore(url, **({"create": True} | options))  # type: ignore[arg-type]
        store.open()
        opened.append(store)
        return store

    yield open_
    for store in opened:
        store.close()


@pytest.fixture
def store(database_url: str, open_store: Callable[..., ResultStore]) -> ResultStore:
    """An open store with one calibration in it, on each kind of database."""
    opened = open_store(database_url)
    opened.record_calibration(CALIBRATION)
    return opened
