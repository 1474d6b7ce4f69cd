"""Looks for archived images below a folder: a whole archive, one of its days, or one folder of images."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from uuid import UUID

from alignment.errors import ConfigurationError
from sensors.formats import ARCHIVED_FILE, SHOT_FILE

_NAME = re.compile(r"([0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12})-([A-Za-z0-9][A-Za-z0-9_.-]{0,63})")
_DAY = re.compile(r"\d{4}-\d{2}-\d{2}")


@dataclass(frozen=True)
class FoundFolder:
    """A folder of archived images.

    Attributes
    ----------
    key
        Its path below what was searched; ``.`` for that itself.
    path
        Where it is.
    cycle, wheel
        As its name tells; None where it tells nothing.
    """

    key: str
    path: Path
    cycle: UUID | None = None
    wheel: str | None = None


def require_archive(folder: Path) -> None:
    """Refuse what is no folder.

    Raises
    ------
    ConfigurationError
        When it is none.
    """
    if not folder.is_dir():
        raise ConfigurationError(
            file=folder,
            choice="archive",
            expected="a folder of archived images",
            seen="a file" if folder.exists() else "no such folder",
            cure="Name the folder of [archive] in the station's file, or one below it",
        )


def archived_folders(archive: Path, first_day: str = "", last_day: str = "~") -> Iterator[FoundFolder]:
    """Yield the folders of archived images below a folder, sorted by day and name.

    Parameters
    ----------
    archive
        Two levels are searched. What is hidden, as half-written folders are, is passed over.
    first_day, last_day
        Only of days from the first to the last, as the archive names them (``2026-03-01``).
    """
    if _is_one(archive):
        yield _found(archive, archive)
        return
    for child in _folders(archive):
        if _is_one(child):
            yield _found(archive, child)
        elif not _DAY.fullmatch(child.name) or first_day <= child.name <= last_day:
            yield from (_found(archive, grandchild) for grandchild in _folders(child) if _is_one(grandchild))


def level_of(archive: Path) -> Path:
    """Return the root of the archive that a folder belongs to, as the database's paths begin there."""
    if _is_one(archive):
        return archive.resolve().parent.parent
    return archive.resolve().parent if _DAY.fullmatch(archive.resolve().name) else archive.resolve()


def _is_one(folder: Path) -> bool:
    if _named(folder):
        # Whatever it has lost.
        return True
    return (folder / ARCHIVED_FILE).exists() or (folder / SHOT_FILE).exists()


def _folders(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as scan:
            names = sorted(entry.name for entry in scan if entry.is_dir() and not entry.name.startswith("."))
    except OSError as error:
        raise ConfigurationError(
            file=folder, choice="archive", expected="a folder that can be read", seen=error.strerror
        ) from error
    return [folder / name for name in names]


def _named(folder: Path) -> re.Match[str] | None:
    """What its name tells; one of a year is asked a hundred thousand times, and most say it as they are."""
    return _NAME.fullmatch(folder.name) or _NAME.fullmatch(folder.resolve().name)


def _found(archive: Path, folder: Path) -> FoundFolder:
    match = _named(folder)
    key = folder.relative_to(archive).as_posix()
    return FoundFolder(key, folder, UUID(match[1]), match[2]) if match else FoundFolder(key, folder)
