"""Copies of a result database: made while stations write, checked, restored into an empty place."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path
from urllib.parse import quote
from uuid import uuid4

from sqlalchemy import URL, inspect

from alignment.errors import FormatError, StoreDamagedError, StoreError, StoreUnavailableError
from alignment.file_limits import BACKUP, WANTED_CURE, unfit_kind, unfit_size
from db.connection import (
    current_revision,
    describe,
    make_engine,
    parse_url,
    require_file,
    sqlite_url,
    store_errors,
    unwritten,
)

_LONGEST_S = 24 * 3600.0
_SQLITE_HEADER = b"SQLite format 3\0"
_DUMP_HEADER = b"PGDMP"


def backup(url: str, path: Path) -> None:
    """Write a copy of the database as it is at this moment; `path` appears only when it is whole.

    SQLite becomes another SQLite file, PostgreSQL the archive of its own ``pg_dump``.

    Raises
    ------
    FormatError
        When `path` is there already.
    StoreError
        When the database cannot be read, or the copy is not sound.
    """
    parsed = parse_url(url)
    require_file(parsed)
    if current_revision(url) is None:
        raise StoreError(f"database {describe(parsed)} is empty. There is nothing to keep")
    if path.exists():
        raise FormatError(
            file=path, expected="a new file", seen="one that is there", cure="Name another; it is left alone"
        )
    part = path.with_name(f"{path.name}.part")
    try:
        if parsed.get_backend_name() == "sqlite":
            _copy_sqlite(Path(parsed.database or ""), part)
        else:
            _run("pg_dump", parsed, "--format=custom", f"--file={part}")
        with part.open("rb") as written:
            os.fsync(written.fileno())
        part.rename(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise StoreError(f"backup {path} cannot be written ({error.strerror or error})") from error
    finally:
        part.unlink(missing_ok=True)


def restore(path: Path, url: str) -> None:
    """Make a database out of a backup; there must be none at `url` yet, or an empty one.

    A restored SQLite database of a station ships everything again: the central database takes what it lacks.

    Raises
    ------
    FormatError
        When `path` is no backup of the kind of database that `url` names.
    StoreError
        When there is a database already, or the copy is not sound.
    """
    parsed = parse_url(url)
    local = parsed.get_backend_name() == "sqlite"
    try:
        found = path.stat()
        unfit = unfit_kind(found.st_mode) or unfit_size(found.st_size, BACKUP)
        if unfit is not None:
            raise FormatError(file=path, expected="a backup", seen=unfit, cure=WANTED_CURE)
        with path.open("rb") as file:
            header = file.read(16)
    except OSError as error:
        raise FormatError(file=path, expected="a backup", seen=str(error.strerror)) from error
    expected = _SQLITE_HEADER if local else _DUMP_HEADER
    if not header.startswith(expected):
        raise FormatError(
            file=path,
            expected="a backup of an SQLite database" if local else "an archive of pg_dump",
            seen="another file",
            cure="Restore it into the kind of database it was made of",
        )
    if local:
        _restore_sqlite(path, Path(parsed.database or ""))
    else:
        _require_empty(parsed)
        _run("pg_restore", parsed, "--no-owner", "--exit-on-error", "--single-transaction", str(path))


def _restore_sqlite(path: Path, target: Path) -> None:
    where = sqlite_url(str(target))
    if target.exists():
        raise StoreError(
            f"database {where} is there already and stays as it is. Name a new file, or move it away"
        )
    part = target.with_name(f"{target.name}.part")
    try:
        _copy_sqlite(path, part)
        with closing(sqlite3.connect(part)) as connection, connection:
            known = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'shipments'").fetchone()
            if known:
                # It is another database now: the original may have gone on.
                new = "UPDATE shipments SET origin = ?, shipped_sequence = 0"
                connection.execute(new, (uuid4().hex,))
        part.rename(target)
        _sync_folder(target.parent)
    except (OSError, sqlite3.Error) as error:
        raise StoreError(f"database {where} cannot be written ({error})") from error
    finally:
        for rest in target.parent.glob(f"{part.name}*"):
            rest.unlink(missing_ok=True)


def _copy_sqlite(source: Path, target: Path) -> None:
    target.unlink(missing_ok=True)
    mode = "mode=ro&immutable=1" if unwritten(source) else "mode=ro"
    try:
        with (
            closing(sqlite3.connect(f"file:{quote(str(source))}?{mode}", uri=True)) as old,
            closing(sqlite3.connect(target)) as new,
        ):
            # In one step: a copy in portions begins anew whenever a station writes.
            old.backup(new)
            # A file of WAL mode could only be opened where one may write; a station sets its own mode anew.
            new.execute("PRAGMA journal_mode=DELETE")
            found = new.execute("PRAGMA integrity_check(1)").fetchone()[0]
    except sqlite3.Error as error:
        raise StoreError(
            f"database {sqlite_url(str(source))} cannot be copied ({error}). Check that this user may read "
            f"it and write {target.parent}; a file with a -wal file beside it must be where one may write"
        ) from error
    if found != "ok":
        seen = " ".join(str(found).split())
        raise StoreDamagedError(
            f"database {sqlite_url(str(source))} is damaged: {seen}. Restore an older backup"
        )


def _require_empty(url: URL) -> None:
    engine = make_engine(url, timeout_s=5.0)
    try:
        with store_errors(describe(url)), engine.connect() as connection:
            names = inspect(connection).get_table_names()
    finally:
        engine.dispose()
    if names:
        raise StoreError(
            f"database {describe(url)} holds tables already and stays as it is. Name an empty database"
        )


def _run(program: str, url: URL, *arguments: str) -> None:
    found = shutil.which(program) or next(
        (str(path) for path in sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{program}"), reverse=True)),
        None,
    )
    if found is None:
        raise StoreUnavailableError(
            f"{program} is not installed, and copies of PostgreSQL are its work. Install postgresql-client"
        )
    # The password through the environment: a command line is open to everybody on the machine.
    given = {
        "PGHOST": url.host,
        "PGPORT": None if url.port is None else str(url.port),
        "PGUSER": url.username,
        "PGPASSWORD": url.password,
        "PGDATABASE": url.database,
    }
    environment = os.environ | {name: value for name, value in given.items() if value is not None}
    command = [found, "--no-password", *arguments]
    if program == "pg_restore":
        command.insert(1, f"--dbname={url.database}")
    try:
        subprocess.run(
            command, env=environment, check=True, capture_output=True, text=True, timeout=_LONGEST_S
        )
    except subprocess.CalledProcessError as error:
        detail = " ".join(error.stderr.split())[:500]
        raise StoreError(f"database {describe(url)}: {program} failed ({detail})") from error
    except subprocess.TimeoutExpired as error:
        raise StoreUnavailableError(f"database {describe(url)}: {program} did not end in a day") from error


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
