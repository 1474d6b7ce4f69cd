"""A database of its own for each test: an SQLite file, and one in a real PostgreSQL server."""

from __future__ import annotations

import os
import secrets
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psycopg
import pytest

from db.store import ResultStore
from tests.db.example_records import CALIBRATION


@dataclass(frozen=True)
class PostgresServer:
    """A running server: port on the loopback address, password of its superuser ``truewheel``."""

    port: int
    password: str

    def url(self, database: str) -> str:
        return f"postgresql://truewheel:{self.password}@127.0.0.1:{self.port}/{database}"

    @contextmanager
    def database(self) -> Iterator[str]:
        """A new empty database, dropped in the end; yields its URL."""
        name = f"truewheel_{secrets.token_hex(4)}"
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
            yield self.url(name)
            connection.execute(f"DROP DATABASE {name} WITH (FORCE)")


def _binaries() -> Path | None:
    on_path = shutil.which("initdb")
    found = [Path(on_path)] if on_path else sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    return found[-1].parent if found else None


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[PostgresServer]:
    binaries = _binaries()
    if binaries is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    # The server refuses to run as root; its package comes with a user.
    user = "postgres" if os.geteuid() == 0 else None
    folder = Path(tempfile.mkdtemp(prefix="truewheel-pg-"))
    server = None
    try:
        if user:
            shutil.chown(folder, user)
        password = secrets.token_hex(8)
        secret = folder / "password"
        secret.write_text(password)
        secret.chmod(0o644)
        subprocess.run(
            [binaries / "initdb", "-D", folder / "data", "-U", "truewheel", "-E", "UTF8", "--locale=C.UTF-8",
             "-A", "scram-sha-256", f"--pwfile={secret}", "--no-sync"],
            user=user, cwd=folder, check=True, capture_output=True, timeout=60,
        )  # fmt: skip
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        control = [binaries / "pg_ctl", "-D", folder / "data", "-l", folder / "log", "-w"]
        # No test pulls the plug, so nothing needs to reach the disk: databases are made several times faster.
        options = f"-F -p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={folder}"
        # Output to a file: the server would hold a pipe open.
        start = [*control, "-o", options, "start"]
        subprocess.run(start, user=user, cwd=folder, check=True, timeout=60, stdout=subprocess.DEVNULL)
        server = control
        yield PostgresServer(port, password)
    finally:
        if server:
            stop = [*server, "-m", "immediate", "stop"]
            subprocess.run(stop, user=user, cwd=folder, check=True, timeout=60, stdout=subprocess.DEVNULL)
        shutil.rmtree(folder)


@pytest.fixture
def postgres_url(postgres_server: PostgresServer) -> Iterator[str]:
    with postgres_server.database() as url:
        yield url


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'results.db'}"


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest) -> str:
    """URL of an empty database, once for each kind."""
    fixture = {"sqlite": "sqlite_url", "postgresql": "postgres_url"}[request.param]
    url: str = request.getfixturevalue(fixture)
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
