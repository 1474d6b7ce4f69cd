"""Only one running program per station and database."""

from __future__ import annotations

import fcntl
import hashlib
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import func, select

from alignment.errors import StoreUnavailableError
from db.connection.engine import describe, make_engine, parse_url
from db.connection.failures import store_errors


@contextmanager
def station_lock(url: str, station: str, timeout_s: float = 5.0) -> Iterator[None]:
    """Hold the right to be this station on this database; gone with the program, however it ends.

    Raises
    ------
    StoreUnavailableError
        When another program holds it, or the database cannot be reached.
    """
    parsed = parse_url(url)
    taken = (
        f"station '{station}' is running already on database {describe(parsed)}{{holder}}. Stop it, or give"
        " this one another station id"
    )
    if parsed.get_backend_name() == "sqlite":
        # The system releases it when the process is gone.
        path = Path(f"{parsed.database}.{hashlib.sha256(station.encode()).hexdigest()[:8]}.lock")
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise StoreUnavailableError(
                f"{path} cannot be written ({error.strerror}). Give this user the right to write in its"
                " folder"
            ) from error
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                holder = os.pread(handle, 200, 0).decode(errors="replace").strip()
                raise StoreUnavailableError(taken.format(holder=f", {holder}" if holder else "")) from error
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
            yield
        finally:
            os.close(handle)
        return
    key = int.from_bytes(hashlib.sha256(f"truewheel station {station}".encode()).digest()[:8], signed=True)
    engine = make_engine(parsed, timeout_s=timeout_s)
    try:
        with store_errors(describe(parsed)):
            connection = engine.connect().execution_options(isolation_level="AUTOCOMMIT")
            with connection:
                if not connection.execute(select(func.pg_try_advisory_lock(key))).scalar_one():
                    raise StoreUnavailableError(taken.format(holder=""))
                yield
    finally:
        engine.dispose()
