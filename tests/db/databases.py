"""New databases of SQLite, all tables and no row: a copy is made ten times faster than its tables."""

from __future__ import annotations

import shutil
from pathlib import Path

from db.connection import migrate
from tests.once import folder_once

SQLITE = "sqlite:///"


@folder_once
def _migrated(folder: Path, revision: str | None = None) -> None:
    migrate(f"{SQLITE}{folder / 'results.db'}", revision)


def new_database(path: Path) -> str:
    """Make one, and return its URL."""
    shutil.copyfile(_migrated() / "results.db", path)
    return f"{SQLITE}{path}"


def migrate_new(url: str, revision: str) -> None:
    """Bring a database that is not there yet, or has no table, to an earlier revision."""
    if url.startswith(SQLITE):
        shutil.copyfile(_migrated(revision) / "results.db", url.removeprefix(SQLITE))
    else:
        migrate(url, revision)
