"""Connections to SQLite and PostgreSQL that commit durably and never wait without a bound."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from alignment.errors import ConfigurationError

_DRIVERS = {"sqlite": "sqlite+pysqlite", "postgresql": "postgresql+psycopg"}
_SECRET_KEYS = ("password", "sslpassword")


def parse_url(url: str) -> URL:
    """Read a database URL: ``sqlite:///results.db`` or ``postgresql://user@host/database``.

    Raises
    ------
    ConfigurationError
        For anything else; the message never repeats the URL, which may hold a password.
    """
    expected = "'sqlite:///FILE' or 'postgresql://USER@HOST/DATABASE'"
    try:
        parsed = make_url(url)
    except (ArgumentError, ValueError):
        # Not chained: the original message may quote the URL.
        raise ConfigurationError(
            field="database URL", expected=expected, seen="something that is no URL"
        ) from None
    drivername = _DRIVERS.get(parsed.drivername, parsed.drivername)
    if drivername not in _DRIVERS.values():
        raise ConfigurationError(
            field="database URL", expected=expected, seen=f"a URL that begins with '{parsed.drivername}:'"
        )
    if drivername == _DRIVERS["sqlite"] and parsed.database in (None, "", ":memory:"):
        raise ConfigurationError(
            field="database URL",
            expected="a file, so that results survive the program",
            seen="an SQLite database in memory",
        )
    return parsed.set(drivername=drivername)


def describe(url: URL) -> str:
    """The URL as messages show it, without passwords."""
    hidden = {key: "hidden" for key in _SECRET_KEYS if key in url.query}
    shown = url.set(drivername=url.get_backend_name()).update_query_dict(hidden)
    return shown.render_as_string(hide_password=True)


def make_engine(url: URL, *, timeout_s: float, create: bool = False, read_only: bool = False) -> Engine:
    """Engine of a parsed URL.

    Parameters
    ----------
    timeout_s
        Longest wait for a connection and for a lock; a statement on a server may take twice as long.
    create
        Whether a missing SQLite file may be made.
    read_only
        Whether the database itself refuses every write; a transaction then sees one state of the database.

    Notes
    -----
    A connection with the execution option ``writes=True`` takes SQLite's write lock when its transaction
    begins, so that a busy database is found before anything is read.
    """
    if url.get_backend_name() == "sqlite":
        mode = "ro" if read_only else "rwc" if create else "rw"
        creator = _sqlite_creator(Path(url.database or ""), timeout_s, mode)
        engine = create_engine(url, creator=creator, pool_timeout=timeout_s)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    milliseconds = math.ceil(timeout_s * 1000)
    settings = {
        "timezone": "UTC",
        # A server may be configured to acknowledge before the data is on disk.
        "synchronous_commit": "on",
        "lock_timeout": str(milliseconds),
        # Longer, or a lock that is waited for would look like a slow server.
        "statement_timeout": str(2 * milliseconds),
    }
    if read_only:
        settings |= {
            "default_transaction_read_only": "on",
            "default_transaction_isolation": r"repeatable\ read",
            # Compiling and helpers cost more than the short questions asked here.
            "jit": "off",
            "max_parallel_workers_per_gather": "0",
        }
    given = url.query.get("options", "")
    options = [given if isinstance(given, str) else " ".join(given)]
    options += [f"-c {name}={value}" for name, value in settings.items()]
    return create_engine(
        url,
        # A server that was restarted leaves dead connections in the pool.
        pool_pre_ping=True,
        pool_timeout=timeout_s,
        connect_args={
            # libpq takes whole seconds and treats 1 as 2.
            "connect_timeout": max(2, math.ceil(timeout_s)),
            "tcp_user_timeout": milliseconds,
            "application_name": "truewheel",
            "options": " ".join(options).strip(),
        },
    )


def _sqlite_creator(path: Path, timeout_s: float, mode: str) -> Callable[[], sqlite3.Connection]:
    # Without mode=rw SQLite would replace a file that was moved away by an empty one.
    uri = f"file:{quote(str(path))}?mode={mode}"

    def connect() -> sqlite3.Connection:
        connection = sqlite3.connect(
            uri, uri=True, timeout=timeout_s, isolation_level=None, check_same_thread=False
        )
        # SQLite has no variance of its own; see db.partial_sums.
        connection.create_aggregate("squared_deviations", 1, _SquaredDeviations)  # type: ignore[arg-type]
        try:
            if mode == "ro":
                connection.execute("PRAGMA query_only=ON")
                # What one question reads; the operating system keeps the rest.
                connection.execute("PRAGMA cache_size=-64000")
                connection.execute("PRAGMA mmap_size=1073741824")
                return connection
            connection.execute("PRAGMA journal_mode=WAL")
            connection.execute("PRAGMA synchronous=FULL")
            connection.execute("PRAGMA foreign_keys=ON")
        except sqlite3.Error:
            connection.close()
            raise
        return connection

    return connect


class _SquaredDeviations:
    """Sum of squared deviations from the mean, by Welford's recurrence: nothing cancels."""

    def __init__(self) -> None:
        self._n, self._mean, self._m2 = 0, 0.0, 0.0

    def step(self, value: float) -> None:
        """Take the next value."""
        self._n += 1
        shift = value - self._mean
        self._mean += shift / self._n
        self._m2 += shift * (value - self._mean)

    def finalize(self) -> float:
        """The sum."""
        return self._m2


def _begin_sqlite(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
