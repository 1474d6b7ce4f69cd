"""What a database driver reports, said as one sentence with its cure."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.exc import DBAPIError, SQLAlchemyError, StatementError

from alignment.errors import (
    Deed,
    Remedy,
    StoreDamagedError,
    StoreError,
    StoreUnavailableError,
    TruewheelError,
)

_Sentence = tuple[type[StoreError], str]

_SQLITE: dict[int, _Sentence] = {
    sqlite3.SQLITE_BUSY: (
        StoreUnavailableError,
        "is locked by another program. Close the program that keeps it open for writing, then try again",
    ),
    sqlite3.SQLITE_FULL: (
        StoreError,
        "cannot grow: the disk is full. Free some space; nothing stored is lost",
    ),
    sqlite3.SQLITE_READONLY: (
        StoreError,
        "is not writable. Give this user the right to write the file and its folder",
    ),
    sqlite3.SQLITE_CANTOPEN: (
        StoreUnavailableError,
        "cannot be opened. Check that the folder exists and that this user may write in it; where that "
        "cannot be, copy the file with the -wal file beside it to where it can",
    ),
    sqlite3.SQLITE_NOTADB: (
        StoreDamagedError,
        "is not an SQLite database. Name another file in the database URL",
    ),
    sqlite3.SQLITE_CORRUPT: (
        StoreDamagedError,
        "is damaged. Keep a copy of the file and its -wal file, then restore the last backup",
    ),
    sqlite3.SQLITE_IOERR: (
        StoreError,
        "cannot be read or written: the disk reports an error. Check space, quota and the disk itself",
    ),
}

# By SQLSTATE, or its class of two characters.
_POSTGRESQL: dict[str, _Sentence] = {
    "08": (StoreUnavailableError, "lost its connection. Check the network and the server"),
    "28": (StoreUnavailableError, "refuses the login. Check user and password in the database URL"),
    "3D": (StoreUnavailableError, "does not exist on its server. Create it, then migrate it"),
    "25006": (StoreError, "is read-only. Connect to the primary server"),
    "42501": (StoreError, "refuses this user the right to do so. Grant it, or use another user"),
    "53": (StoreError, "is out of resources. Check the server's disk space, memory and connections"),
    "55P03": (
        StoreUnavailableError,
        "is locked by another program. Close the program that keeps it locked, then try again",
    ),
    "57014": (StoreUnavailableError, "did not answer in time. Check the load of the server"),
    "57P": (StoreUnavailableError, "shut its connection down. Start the server again"),
    "58": (StoreError, "reports a disk error. Check the server's disk"),
    "XX": (StoreDamagedError, "reports damaged data. Check the server's log, then restore the last backup"),
}


@contextmanager
def store_errors(where: str) -> Iterator[None]:
    """Turn every error on the way to a database and back into a `StoreError` that names the database.

    Errors of the product pass as they are. What else comes from reading a row (text that is no time, a number
    that is text, bytes that are no letters) is damage: no program has stored it.

    Parameters
    ----------
    where
        The database, without password.
    """
    try:
        yield
    except DBAPIError as error:
        kind, sentence = _explain(error)
        raise kind(f"database {where} {sentence} ({_detail(error)})") from error
    except SQLAlchemyError as error:
        if _unreadable(error):
            raise damaged(where, error) from error
        # A pool that gave no connection in time, for one.
        raise StoreUnavailableError(f"database {where} cannot be used ({error})") from error
    except TruewheelError:
        raise
    except OSError as error:
        raise StoreUnavailableError(f"database {where} cannot be used ({error})") from error
    except Exception as error:
        raise damaged(where, error) from error


def damaged(where: str, error: Exception) -> StoreDamagedError:
    """The error for a row that cannot be read as what it must be."""
    detail = " ".join(str(error).split()).rstrip(".")
    return StoreDamagedError(
        f"database {where} holds what no program stored ({type(error).__name__}: {detail})",
        Remedy(Deed.CHECK_DATABASE, then="Keep a copy of the file, then restore the last backup"),
    )


def _unreadable(error: SQLAlchemyError) -> bool:
    # SQLAlchemy wraps what a type of its own could not convert.
    return isinstance(error, StatementError) and not isinstance(error.orig, SQLAlchemyError)


def _explain(error: DBAPIError) -> _Sentence:
    original = error.orig
    if isinstance(original, sqlite3.Error):
        code = getattr(original, "sqlite_errorcode", 0)
        if "Could not decode" in str(original):
            return _SQLITE[sqlite3.SQLITE_CORRUPT]
        if code == sqlite3.SQLITE_CONSTRAINT_FOREIGNKEY:
            return _FOREIGN_KEY
        if code & 0xFF == sqlite3.SQLITE_CONSTRAINT:
            return _CONSTRAINT
        return _SQLITE.get(code & 0xFF, _OTHER)
    state = getattr(original, "sqlstate", None)
    if state is None:
        return StoreUnavailableError, "cannot be reached. Check host, port and that the server runs"
    if state == "23503":
        return _FOREIGN_KEY
    if state.startswith("23"):
        return _CONSTRAINT
    for prefix in (state, state[:3], state[:2]):
        if prefix in _POSTGRESQL:
            return _POSTGRESQL[prefix]
    return _OTHER


def _detail(error: DBAPIError) -> str:
    # The driver's own text only: SQLAlchemy's adds the statement with all its values.
    return " ".join(str(error.orig).split()).rstrip(".")


_FOREIGN_KEY: _Sentence = (
    StoreError,
    "holds no calibration of that id. Record the calibration before the cycle that used it",
)
_CONSTRAINT: _Sentence = (
    StoreError,
    "refused a record that contradicts itself; nothing of it was stored. Report this as a defect",
)
_OTHER: _Sentence = (StoreError, "failed. See the database's own message")
