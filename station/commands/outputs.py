"""Where a verb shall write, looked at before it works: what cannot be written costs nobody the work."""

from __future__ import annotations

import tempfile
from pathlib import Path

from alignment.errors import ConfigurationError

_CURE = "Choose another place, or make this one writable"


def ready_file(path: Path | None, choice: str = "out", *, new: bool = False) -> None:
    """Refuse a place where no file can be written; None is none that was asked for.

    Parameters
    ----------
    path
        The file; folders that are missing on the way count as ones that will be made.
    choice
        What the person chose, for the message.
    new
        Whether one that is there is left alone.

    Raises
    ------
    ConfigurationError
        When a folder is there, or a file that stays, or nothing can be written beside it.
    """
    if path is None:
        return
    if _is(path, choice, folder=True):
        raise ConfigurationError(
            file=path, choice=choice, expected="a file to write", seen="a folder", cure="Name a file in it"
        )
    if new and _is(path, choice, folder=False):
        raise ConfigurationError(
            file=path,
            choice=choice,
            expected="a new file",
            seen="one that is there",
            cure="Choose another name; what is there is not replaced",
        )
    _probe(path, path.parent, choice, "a file that can be written")


def ready_folder(path: Path | None, choice: str = "out") -> None:
    """Refuse a place where no folder can be made or written; None is none that was asked for.

    Raises
    ------
    ConfigurationError
        When a file is there, or nothing can be written.
    """
    if path is None:
        return
    if _is(path, choice, folder=False):
        raise ConfigurationError(
            file=path, choice=choice, expected="a folder", seen="a file", cure="Choose another name"
        )
    _probe(path, path, choice, "a folder that can be written")


def ready_new_folder(path: Path) -> None:
    """Refuse a folder that holds something, and a place where none can be made.

    Raises
    ------
    FormatError
        When it holds something: what is recorded is never replaced.
    ConfigurationError
        As `ready_folder`.
    """
    from sensors.formats import require_new

    if _is(path, "out", folder=True) or path.is_file():
        require_new(path)
    ready_folder(path)


def ready_database(url: str | None, *, create: bool = False) -> None:
    """Refuse a database that cannot be written: not there, of another schema, read-only; None is none.

    With `create` one that is not there is made.

    Raises
    ------
    ConfigurationError, StoreError
        As `ResultStore.open` does.
    """
    if url is None:
        return
    from db.store import ResultStore

    with ResultStore(url, create=create):
        pass


def _is(path: Path, choice: str, *, folder: bool) -> bool:
    try:
        return path.is_dir() if folder else path.exists() and not path.is_dir()
    except (OSError, ValueError) as error:
        raise _unwritable(path, choice, "a name that a file can have", error) from error


def _probe(path: Path, folder: Path, choice: str, expected: str) -> None:
    """Write a nameless file into the folder, or where it will be made: rights alone do not tell."""
    try:
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:
        raise _unwritable(path, choice, expected, error) from error


def _unwritable(path: Path, choice: str, expected: str, error: OSError | ValueError) -> ConfigurationError:
    seen = getattr(error, "strerror", None) or str(error)
    return ConfigurationError(file=path, choice=choice, expected=expected, seen=seen, cure=_CURE)
