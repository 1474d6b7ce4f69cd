"""Whether an SQLite file at its path is still the one that a connection reads and writes.

A file that is deleted, moved or replaced stays open: SQLite goes on in what nobody will find again. So a
connection notes at its beginning which files it opened (device and inode), and whoever relies on a commit
compares them with what is at the path. The companions count too: what was committed is in the ``-wal`` file
first, and without a common ``-shm`` file two programs do not see each other.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from alignment.errors import StoreUnavailableError

_Identity = tuple[int, int]


class WatchedConnection(sqlite3.Connection):
    """A connection that knows which files it has open."""

    opened: dict[Path, _Identity]
    absent: tuple[Path, ...] = ()
    """Files that were not there when it was opened as one that nobody changes."""

    def look(self, where: str) -> None:
        """Compare the files at their paths with those that are open.

        Raises
        ------
        StoreUnavailableError
            When one is gone or another.
        """
        for path, identity in self.opened.items():
            seen = identity_of(path)
            if seen != identity:
                raise file_is_lost(where, path, gone=seen is None)
        if any(path.exists() for path in self.absent):
            raise StoreUnavailableError(
                f"database {where} is written by another program since it was opened to read. Ask again"
            )


def unwritten(path: Path) -> tuple[Path, ...]:
    """Return the files that would show that a database is written, where nothing can be written by us.

    SQLite opens a database that was last used with a ``-wal`` file only where it may make one anew. On a
    medium or in a folder that is read-only it must be told that nobody changes the file, which is so while
    none of these are beside it. Empty where the folder can be written, or one of them is there.
    """
    real = path.resolve()
    if not real.is_file() or os.access(real.parent, os.W_OK):
        return ()
    beside = (*companions(path), real.with_name(real.name + "-journal"))
    written = (beside[0], beside[2])
    return () if any(each.exists() for each in written) else written


def identity_of(path: Path) -> _Identity | None:
    """Device and inode of what is at a path; None where nothing is or can be seen."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def companions(path: Path) -> Iterator[Path]:
    """The files that SQLite keeps beside a database; beside the file itself where the path is a link."""
    real = path.resolve()
    for suffix in ("-wal", "-shm"):
        yield real.with_name(real.name + suffix)


def file_is_lost(where: str, path: Path, *, gone: bool) -> StoreUnavailableError:
    """The refusal to go on without the files that were opened."""
    what = "was deleted or moved away" if gone else "was replaced by another file"
    return StoreUnavailableError(
        f"database {where}: {path} {what} while it was in use, so what is stored would be lost. Put the file"
        " back as it was, or stop all programs that use the database and start them again"
    )
