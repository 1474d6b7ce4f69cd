"""Files that are there whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path

from alignment.errors import FormatError

_CURE = "Choose another place, or make this one writable"


def read_bytes(path: Path, kind: str) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    path
        The file.
    kind
        What it should be, such as "an image", for the message.

    Raises
    ------
    FormatError
        When there is no such file, or it cannot be read.
    """
    if not path.is_file():
        seen = "a folder" if path.is_dir() else "no such file"
        raise FormatError(file=path, expected=kind, seen=seen, cure="Check the name and the path")
    try:
        return path.read_bytes()
    except OSError as error:
        raise FormatError(
            file=path, expected=f"{kind} that can be read", seen=error.strerror or str(error)
        ) from error


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file so that a loss of power leaves the old content or the new one, never a part.

    Folders that are missing on the way are made.

    Raises
    ------
    FormatError
        When it cannot be written; what was there before is unchanged.
    """
    temporary = _partial(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _write_durably(temporary, content)
        temporary.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise FormatError(
            file=path, expected="a file that can be written", seen=error.strerror or str(error), cure=_CURE
        ) from error


def require_new(folder: Path) -> None:
    """Refuse a folder that holds something, before any time is spent on what shall go into it.

    Raises
    ------
    FormatError
        When it does.
    """
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise FormatError(
            file=folder,
            expected="a new or empty folder",
            seen="a file" if folder.is_file() else "a folder with files in it",
            cure="Choose another name; what is recorded is never replaced",
        )


def write_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Make a folder so that it appears with all its files or not at all.

    Parameters
    ----------
    folder
        Must not exist, or be empty: nothing recorded is ever replaced.
    files
        Content of each file by its name.

    Raises
    ------
    FormatError
        When the folder holds something already or cannot be written; nothing is left behind.
    """
    folder = folder.absolute()
    temporary = _partial(folder)
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise FormatError(
                file=folder,
                expected="a new or empty folder",
                seen="a folder with files in it" if folder.is_dir() else "a file",
                cure="Choose another name; what is recorded is never replaced",
            )
        temporary.mkdir(parents=True)
        for name, content in files.items():
            _write_durably(temporary / name, content)
        _sync_folder(temporary)
        temporary.replace(folder)
        _sync_folder(folder.parent)
    except OSError as error:
        raise FormatError(
            file=folder,
            expected="a folder that can be written",
            seen=error.strerror or str(error),
            cure=_CURE,
        ) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _partial(path: Path) -> Path:
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")


def _write_durably(path: Path, content: bytes) -> None:
    with path.open("xb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def _sync_folder(folder: Path) -> None:
    """Make a rename durable: the folder's own entry must reach the disk too."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
