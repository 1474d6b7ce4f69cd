"""A connection that only reads, and sees one state of the database for as long as a question lasts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from types import TracebackType
from typing import Concatenate, ParamSpec, Self, TypeVar

from sqlalchemy import Connection, Engine

from alignment.errors import StoreError
from db.connection import check_revision, describe, make_engine, parse_url, require_file, store_errors

_P = ParamSpec("_P")
_T = TypeVar("_T")


class ResultReader:
    """A result database opened for questions; the database itself refuses every write through it.

    Use as a context manager. A PostgreSQL user with nothing but the right to SELECT is enough, and an SQLite
    file that may only be read.

    Parameters
    ----------
    url
        ``sqlite:///results.db`` or ``postgresql://user@host/database``.
    timeout_s
        Longest wait for a connection; an answer may take twice as long.

    Raises
    ------
    ConfigurationError, StoreError
        As `db.store.ResultStore`.
    """

    def __init__(self, url: str, *, timeout_s: float = 30.0) -> None:
        self._url = parse_url(url)
        self._where = describe(self._url)
        self._timeout_s = timeout_s
        self._engine: Engine | None = None

    @property
    def where(self) -> str:
        """The database, without password."""
        return self._where

    def open(self) -> None:
        """Connect and check the schema revision."""
        if self._engine is not None:
            raise StoreError(f"database {self._where} is open already. Close it first")
        require_file(self._url)
        self._engine = make_engine(self._url, timeout_s=self._timeout_s, read_only=True)
        try:
            with self.transaction() as connection:
                check_revision(connection, self._where)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all connections; closing twice is fine."""
        if self._engine is not None:
            self._engine.dispose()
            self._engine = None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextmanager
    def transaction(self) -> Iterator[Connection]:
        """One state of the database; errors of its driver become `StoreError`."""
        if self._engine is None:
            raise StoreError(f"database {self._where} is not open. Open the reader first")
        with store_errors(self._where), self._engine.connect() as connection, connection.begin():
            yield connection


def question(
    ask: Callable[Concatenate[ResultReader, _P], _T],
) -> Callable[Concatenate[ResultReader, _P], _T]:
    """Let a question end in a `StoreError` also where what was read cannot be made an answer: damage."""

    @wraps(ask)
    def asked(reader: ResultReader, /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        with store_errors(reader.where):
            return ask(reader, *args, **kwargs)

    return asked
