"""A connection to a PostgreSQL server that never waits longer than it was told.

Bounds on the server (``statement_timeout``) and in the kernel (``tcp_user_timeout``) are silent when the
server's processes are frozen: its kernel goes on acknowledging what nobody reads. So this side counts too.
"""

from __future__ import annotations

import time
from typing import Any, TypeVar

import psycopg
from psycopg.abc import PQGen

from alignment.errors import StoreSchemaError

_T = TypeVar("_T")
_LOOK_S = 0.1


class _BoundedConnection(psycopg.Connection[Any]):
    """Given up, and closed, when the server does not answer in time."""

    bound_s = 0.0

    def wait(self, gen: PQGen[_T], interval: float = _LOOK_S, timeout: float | None = None) -> _T:
        bound_s = self.bound_s if timeout is None else min(timeout, self.bound_s)
        started = time.monotonic()
        try:
            return super().wait(gen, interval, bound_s)
        except psycopg.OperationalError as error:
            if error.sqlstate is not None or time.monotonic() - started < bound_s:
                raise
            # What the server does with the statement is not known; nothing more can be read here.
            self.pgconn.finish()
            raise psycopg.OperationalError(f"no answer within {bound_s:g} s") from error


def bounded_connection(
    where: str, bound_s: float, *arguments: Any, **parameters: Any
) -> psycopg.Connection[Any]:
    """Connect; every later wait for the server ends after `bound_s` seconds.

    Raises
    ------
    StoreSchemaError
        When the database cannot keep every text: its encoding is another than UTF-8.
    """
    connection = _BoundedConnection.connect(*arguments, **parameters)
    connection.bound_s = bound_s
    encoding = connection.info.parameter_status("server_encoding")
    if encoding != "UTF8":
        connection.close()
        raise StoreSchemaError(
            f"database {where} keeps text as {encoding}, where letters are lost or mixed up; expected UTF8."
            " Create it with `CREATE DATABASE name ENCODING 'UTF8' TEMPLATE template0`, then migrate it"
        )
    return connection
