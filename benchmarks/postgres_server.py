"""A PostgreSQL server of one's own on the loopback address, for tests and benchmarks; gone afterwards."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psycopg


@dataclass
class PostgresServer:
    """A running server: port on the loopback address, password of its superuser ``truewheel``."""

    port: int
    password: str
    _control: list[str | Path] = field(repr=False)
    _options: str = field(repr=False)
    _user: str | None = field(repr=False)
    folder: Path = field(repr=False)

    def url(self, database: str) -> str:
        """URL of one of its databases."""
        return f"postgresql://truewheel:{self.password}@127.0.0.1:{self.port}/{database}"

    @contextmanager
    def database(self, template: str | None = None) -> Iterator[str]:
        """A new empty database, or a copy of one that nobody uses, dropped in the end; yields its URL."""
        name = f"truewheel_{secrets.token_hex(4)}"
        copied = "" if template is None else f" TEMPLATE {template} STRATEGY file_copy"
        self.execute(f"CREATE DATABASE {name}{copied}")
        yield self.url(name)
        self.execute(f"DROP DATABASE {name} WITH (FORCE)")

    def execute(self, statement: str) -> None:
        """Run a statement outside of all databases, such as CREATE DATABASE."""
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(statement.encode())

    def holds(self, database: str) -> bool:
        """Whether there is a database of this name."""
        with psycopg.connect(self.url("postgres")) as connection:
            found = connection.execute("SELECT 1 FROM pg_database WHERE datname = %s", [database])
            return found.fetchone() is not None

    def start(self) -> None:
        """Start it, after `stop`."""
        # Output to nowhere: the server would hold a pipe open.
        self._run("-o", self._options, "start")

    def stop(self, mode: str = "immediate") -> None:
        """Stop it: ``immediate`` as by a crash, ``fast`` as by an administrator."""
        self._run("-m", mode, "stop")

    def _run(self, *arguments: str) -> None:
        subprocess.run(
            [*self._control, *arguments], user=self._user, cwd=self.folder, check=True, timeout=120,
            stdout=subprocess.DEVNULL,
        )  # fmt: skip


def binaries() -> Path | None:
    """Folder of the server's programs; None when it is not installed."""
    on_path = shutil.which("initdb")
    found = [Path(on_path)] if on_path else sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    return found[-1].parent if found else None


@contextmanager
def postgres_server(
    folder: Path, programs: Path, options: Sequence[str] = (), *, keep: bool = False
) -> Iterator[PostgresServer]:
    """Run a server with its data in a folder, which is removed in the end.

    Parameters
    ----------
    folder
        Empty, or with the data of a server that was kept.
    options
        Of the server, such as ``-F`` (nothing reaches the disk) or ``-c shared_buffers=1GB``.
    keep
        Whether the folder stays.
    """
    # The server refuses to run as root; its package comes with a user.
    user = "postgres" if os.geteuid() == 0 else None
    try:
        if user:
            shutil.chown(folder, user)
        secret = folder / "password"
        if not secret.exists():
            secret.write_text(secrets.token_hex(8))
            secret.chmod(0o644)
            subprocess.run(
                [programs / "initdb", "-D", folder / "data", "-U", "truewheel", "-E", "UTF8",
                 "--locale=C.UTF-8", "-A", "scram-sha-256", f"--pwfile={secret}", "--no-sync"],
                user=user, cwd=folder, check=True, capture_output=True, timeout=60,
            )  # fmt: skip
        password = secret.read_text()
        port = free_port()
        own = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={folder}"
        control: list[str | Path] = [programs / "pg_ctl", "-D", folder / "data", "-l", folder / "log", "-w"]
        server = PostgresServer(port, password, control, " ".join([*options, own]), user, folder)
        server.start()
        try:
            yield server
        finally:
            if (folder / "data" / "postmaster.pid").exists():
                server.stop("fast" if keep else "immediate")
    finally:
        if not keep:
            shutil.rmtree(folder)


def free_port() -> int:
    """A port that nobody uses, below those that the system gives to whoever connects.

    A server that is stopped and started again finds it free, whatever else runs meanwhile.

    Raises
    ------
    OSError
        When a hundred were taken.
    """
    for _ in range(100):
        port = 20_000 + secrets.randbelow(12_000)
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise OSError(errno.EADDRINUSE, "a hundred ports from 20000 to 31999 were taken")


def temporary_folder(within: str | None = None) -> Path:
    """An empty folder that the server's user reaches too, in a folder or where temporary files are."""
    return Path(tempfile.mkdtemp(prefix="truewheel-pg-", dir=within))
