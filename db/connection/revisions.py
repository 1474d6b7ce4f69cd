"""Schema revisions: which one a database has, and how it gets the one this program needs."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import URL, Connection, inspect, text

from alignment.errors import Deed, Remedy, StoreSchemaError, StoreUnavailableError
from db.connection.engine import describe, make_engine, parse_url
from db.connection.failures import store_errors
from db.schema.partitions import ensure_partitions

# An arbitrary number that all Truewheel programs share: only one at a time migrates a PostgreSQL database.
_MIGRATION_LOCK = 7_206_155_014
# A migration of a large database takes longer than any statement of a cycle may.
_MIGRATION_TIMEOUT_S = 3600.0


def head_revision() -> str:
    """The revision this program reads and writes."""
    return _revisions()[-1]


def current_revision(url: str) -> str | None:
    """Revision of the database at `url`; None when it is empty.

    Raises
    ------
    StoreError
        When it cannot be read, or holds tables but no revision.
    """
    parsed = parse_url(url)
    require_file(parsed)
    # A copy may be on a medium that is read-only.
    engine = make_engine(parsed, timeout_s=5.0, read_only=True)
    try:
        with store_errors(describe(parsed)), engine.connect() as connection:
            return revision_of(connection, describe(parsed))
    finally:
        engine.dispose()


def migrate(url: str, revision: str | None = None) -> str:
    """Bring the database at `url` to `revision` (the newest when None), in one transaction; return it.

    A missing SQLite file is made. Nothing happens to a database that is there already.

    Raises
    ------
    StoreSchemaError
        For a revision below the database's, and for a database newer than this program.
    StoreError
        When the database cannot be used; it then stays as it was.
    """
    parsed = parse_url(url)
    where = describe(parsed)
    engine = make_engine(parsed, timeout_s=_MIGRATION_TIMEOUT_S, create=True)
    try:
        with (
            store_errors(where),
            engine.connect().execution_options(writes=True) as connection,
            connection.begin(),
        ):
            return upgrade(connection, where, revision)
    finally:
        engine.dispose()


def upgrade(connection: Connection, where: str, revision: str | None = None) -> str:
    """Do `migrate` inside the transaction of `connection`; `where` names the database in messages."""
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _MIGRATION_LOCK})
    known = _revisions()
    target = known[-1] if revision is None else revision
    if target not in known:
        raise StoreSchemaError(
            f"database {where}: expected one of the revisions {', '.join(known)}, found '{target}'"
        )
    current = revision_of(connection, where)
    if current is not None:
        if current not in known:
            raise newer_schema(where, current)
        if known.index(target) < known.index(current):
            raise StoreSchemaError(
                f"database {where} has revision {current} and is not taken back to {target}: that would drop"
                " stored results. Restore the backup made before the migration into another database instead"
            )
    if current != target:
        config = _config()
        config.attributes["connection"] = connection
        command.upgrade(config, target)
    if target == known[-1]:
        ensure_partitions(connection)
    return target


def revision_of(connection: Connection, where: str) -> str | None:
    """Revision of an open database; None when it holds no table at all."""
    revision = MigrationContext.configure(connection).get_current_revision()
    if revision is None and (tables := inspect(connection).get_table_names()):
        raise StoreSchemaError(
            f"database {where}: expected a Truewheel database or an empty one, found the tables"
            f" {', '.join(sorted(tables)[:5])} without a schema revision. Name another database in the URL"
        )
    return revision


def check_revision(connection: Connection, where: str) -> None:
    """Refuse a database of any other revision than `head_revision`, with the cure."""
    head = head_revision()
    current = revision_of(connection, where)
    if current == head:
        return
    remedy = Remedy(Deed.MIGRATE, where)
    if current is None:
        raise StoreSchemaError(f"database {where} is empty", remedy)
    if current not in _revisions():
        raise newer_schema(where, current)
    raise StoreSchemaError(
        f"database {where} has revision {current}, older than revision {head} that this program needs", remedy
    )


def newer_schema(where: str, current: str) -> StoreSchemaError:
    """The refusal of a revision that this program does not know."""
    return StoreSchemaError(
        f"database {where}: database revision {current} is newer than this program, which knows up to"
        f" {head_revision()}; install the Truewheel version that migrated it, or a later one"
    )


def require_file(url: URL) -> None:
    """Refuse a missing SQLite file in plain words."""
    path = None if url.get_backend_name() != "sqlite" else Path(url.database or "")
    if path is not None and not path.exists():
        raise StoreUnavailableError(
            f"database {describe(url)} does not exist", Remedy(Deed.MAKE_DATABASE, describe(url))
        )


def _config() -> Config:
    config = Config()
    # Alembic reads % as the start of an interpolation.
    folder = str(Path(__file__).parents[1] / "migrations").replace("%", "%%")
    config.set_main_option("script_location", folder)
    config.set_main_option("path_separator", "os")
    return config


@cache
def _revisions() -> tuple[str, ...]:
    # Oldest first. All scripts are loaded for it, which each opening of a store would do again.
    scripts = ScriptDirectory.from_config(_config()).walk_revisions()
    return tuple(script.revision for script in scripts)[::-1]
