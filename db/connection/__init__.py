"""Reaching a database: URL, bounded connections, errors, the schema's revision, one program per station."""

from db.connection.engine import describe, look_at_files, make_engine, parse_url, sqlite_url
from db.connection.failures import store_errors
from db.connection.files import WatchedConnection, unwritten
from db.connection.lock import station_lock
from db.connection.revisions import (
    check_revision,
    current_revision,
    head_revision,
    migrate,
    require_file,
    revision_of,
    upgrade,
)

__all__ = [
    "WatchedConnection",
    "check_revision",
    "current_revision",
    "describe",
    "head_revision",
    "look_at_files",
    "make_engine",
    "migrate",
    "parse_url",
    "require_file",
    "revision_of",
    "sqlite_url",
    "station_lock",
    "store_errors",
    "unwritten",
    "upgrade",
]
