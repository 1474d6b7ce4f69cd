"""Connections to SQLite and PostgreSQL that commit durably and never wait without a bound."""

from __future__ import annotations

import math
import re
import sqlite3
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from alignment.errors import ConfigurationError
from alignment.file_limits import unfit_kind
from db.connection.files import WatchedConnection, companions, file_is_lost, identity_of, unwritten
from db.connection.server import bounded_connection

_DRIVERS = {"sqlite": "sqlite+pysqlite", "postgresql": "postgresql+psycopg"}
_SECRET_KEYS = ("password", "sslpassword")
_QUOTED = re.compile(r"[%?\x00-\x1f\x7f]")
"""What means something else in a URL, or would spoil a message."""


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
            field="database URL",
            expected=expected,
            seen="something that is no URL",
            cure=_cure_of_no_url(url),
        ) from None
    drivername = _DRIVERS.get(parsed.drivername, parsed.drivername)
    if drivername not in _DRIVERS.values():
        raise ConfigurationError(
            field="database URL", expected=expected, seen=f"a URL that begins with '{parsed.drivername}:'"
        )
    if drivername == _DRIVERS["sqlite"]:
        _require_plain_file(parsed, url.partition("://")[2])
    return parsed.set(drivername=drivername)


def _cure_of_no_url(url: str) -> str | None:
    """Say how a path, or a URL with too few slashes, is written; never what may hold a password."""
    path = url.removeprefix("sqlite:").strip()
    if not path or "@" in path or "://" in path or not path.isprintable():
        return None
    return f"Write {sqlite_url(path)}"


def sqlite_url(path: str) -> str:
    """Return the URL of a file, readable, and so that `parse_url` finds this file again."""
    return "sqlite:///" + _QUOTED.sub(lambda match: quote(match[0]), path)


def _require_plain_file(url: URL, typed: str) -> None:
    """Refuse what would not be a file on the disk, or one that SQLite opens without its own protection.

    `typed` is what stands behind the two slashes.
    """
    database, seen, cure = url.database or "", None, None
    literal = typed.removeprefix("/")
    if url.host:
        seen, cure = "a name of a computer", "Write three slashes"
        if not url.password:
            cure += f": sqlite:///{typed}"
    elif not database.strip() or database == ":memory:":
        seen, cure = "an SQLite database in memory", "Write sqlite:///results.db"
    elif database.startswith("file:") or "\0" in database:
        seen, cure = "a path that is no path of a file", "Write sqlite:///results.db, without 'file:'"
    elif "?" in typed and (not url.query or _is_there(unquote(literal))):
        seen = f"the file '{database}', for a question mark ends the name"
        cure = f"Write %3F for one that is a part of it: sqlite:///{literal.replace('?', '%3F')}"
    elif url.query:
        # mode=memory, immutable, nolock, cache, vfs: each takes durability or the locks away.
        names = ", ".join(sorted(url.query))
        seen, cure = f"the parameters {names}", "Leave out what stands from the question mark on"
    elif literal != database and not _is_there(database) and _is_there(literal):
        seen = f"the file '{database}', for a percent sign begins the code of a character"
        cure = f"Write %25 for one that is a part of the name: {sqlite_url(literal)}"
    if seen is not None:
        raise ConfigurationError(
            field="database URL",
            expected="'sqlite:///FILE', a file so that results survive the program",
            seen=seen,
            cure=cure,
        )
    _require_ordinary(Path(database))


def _is_there(path: str) -> bool:
    try:
        return Path(path).exists()
    except (OSError, ValueError):
        return False


def _require_ordinary(path: Path) -> None:
    """Refuse a pipe, a device or a folder before SQLite waits for it."""
    try:
        unfit = unfit_kind(path.stat().st_mode)
    except (OSError, ValueError):
        return  # Not there yet, or told by whoever opens it.
    if unfit is not None:
        raise ConfigurationError(
            field="database URL",
            expected="the file of an SQLite database",
            seen=f"'{path}', {unfit}",
            cure="Name another file in the database URL",
        )


def describe(url: URL) -> str:
    """The URL as messages show it, without passwords."""
    if url.get_backend_name() == "sqlite" and not url.host:
        return sqlite_url(url.database or "")
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
    No call waits without a bound: a server is given up by this side too, so one that is frozen, or a network
    that swallows everything, is an error like others. A connection to a file that may be written is refused
    as soon as the file at the path is another one.

    A connection with the execution option ``writes=True`` takes SQLite's write lock when its transaction
    begins, so that a busy database is found before anything is read.
    """
    if url.get_backend_name() == "sqlite":
        mode = "ro" if read_only else "rwc" if create else "rw"
        creator = _SqliteCreator(Path(url.database or ""), timeout_s, mode, describe(url))
        engine = create_engine(url, creator=creator, pool_timeout=timeout_s)
        event.listen(engine, "begin", partial(_begin_sqlite, where=describe(url)))
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
    engine = create_engine(
        url,
        # A server that was restarted leaves dead connections in the pool.
        pool_pre_ping=True,
        pool_timeout=timeout_s,
        connect_args={
            # libpq takes whole seconds and treats 1 as 2.
            "connect_timeout": max(2, math.ceil(timeout_s)),
            "tcp_user_timeout": milliseconds,
            "application_name": "truewheel",
            "client_encoding": "UTF8",
            "options": " ".join(options).strip(),
        },
    )
    # Longer than the server's own bound, whose message says more.
    bound_s = 2.0 * timeout_s + 2.0
    event.listen(engine, "do_connect", partial(_connect_server, where=describe(url), bound_s=bound_s))
    return engine


def _connect_server(
    dialect: object, record: object, arguments: Any, parameters: Any, *, where: str, bound_s: float
) -> Any:
    return bounded_connection(where, bound_s, *arguments, **parameters)


class _SqliteCreator:
    """Opens a file; never another one than the first time."""

    def __init__(self, path: Path, timeout_s: float, mode: str, where: str) -> None:
        self._path, self._timeout_s, self._mode, self._where = path, timeout_s, mode, where
        self._first: tuple[int, int] | None = None

    def __call__(self) -> sqlite3.Connection:
        # Without mode=rw SQLite would replace a file that was moved away by an empty one.
        mode = "rw" if self._mode == "rwc" and self._first is not None else self._mode
        still = unwritten(self._path) if mode == "ro" else ()
        connection = sqlite3.connect(
            f"file:{quote(str(self._path))}?mode={mode}{'&immutable=1' if still else ''}",
            uri=True, timeout=self._timeout_s, isolation_level=None, check_same_thread=False,
            factory=WatchedConnection,
        )  # fmt: skip
        try:
            connection.opened, connection.absent = {}, still
            # SQLite has no variance of its own; see db.sums.partial.
            connection.create_aggregate("squared_deviations", 1, _SquaredDeviations)  # type: ignore[arg-type]
            if mode == "ro":
                connection.execute("PRAGMA query_only=ON")
                # What one question reads; the operating system keeps the rest.
                connection.execute("PRAGMA cache_size=-64000")
                connection.execute("PRAGMA mmap_size=1073741824")
                return connection
            (journal,) = connection.execute("PRAGMA journal_mode=WAL").fetchone()
            connection.execute("PRAGMA synchronous=FULL")
            connection.execute("PRAGMA foreign_keys=ON")
            # A file system without shared memory keeps another journal, without companions.
            self._note_files(connection, companions(self._path) if journal == "wal" else ())
        except BaseException:
            connection.close()
            raise
        return connection

    def _note_files(self, connection: WatchedConnection, beside: Iterable[Path]) -> None:
        # Opens the companions, should they not be open yet.
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
        opened = {path: identity_of(path) for path in (self._path, *beside)}
        for path, found in opened.items():
            if found is None or (path == self._path and self._first not in (None, found)):
                raise file_is_lost(self._where, path, gone=found is None)
            connection.opened[path] = found
        self._first = opened[self._path]


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


def _begin_sqlite(connection: Connection, *, where: str) -> None:
    look_at_files(connection, where)
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def look_at_files(connection: Connection, where: str) -> None:
    """Refuse to go on when the file at the path is not the one that is open; a server has none.

    Raises
    ------
    StoreUnavailableError
        When it was deleted, moved or replaced, or one of its companions.
    """
    driver = connection.connection.driver_connection
    if isinstance(driver, WatchedConnection):
        driver.look(where)
