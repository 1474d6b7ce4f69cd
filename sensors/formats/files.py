"""Files: read when they are ordinary and of a believable size, written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterable, Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import BinaryIO

from alignment.errors import FormatError
from alignment.file_limits import (
    DOCUMENT,
    ENTRIES,
    SMALLER_CURE,
    WANTED_CURE,
    size_in_words,
    unfit_kind,
    unfit_size,
)

_CURE = "Choose another place, or make this one writable"


def read_bytes(path: Path, kind: str, largest: int = DOCUMENT) -> bytes:
    """Return the content of an ordinary file.

    Parameters
    ----------
    path
        The file.
    kind
        What it should be, such as "an image", for the message.
    largest
        Bytes that a file of this kind may have; see `alignment.file_limits`.

    Raises
    ------
    FormatError
        When there is no such file, it is a pipe, a device or a folder, larger than that, or cannot be read.
    """
    with open_ordinary(path, kind, largest) as stream:
        try:
            content = stream.read(largest + 1)
        except OSError as error:
            raise _unreadable(path, kind, error) from error
    # Some files say nothing of their size, or grow meanwhile.
    _require_size(path, kind, len(content), largest)
    return content


def open_ordinary(path: Path, kind: str, largest: int) -> BinaryIO:
    """Open an ordinary file to read; refuses as `read_bytes` does, and never waits for a writer."""
    require_ordinary(path, kind, largest)
    try:
        # Should it have become a pipe since, opening it does not wait.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise _unreadable(path, kind, error) from error
    try:
        _require_fit(path, kind, os.fstat(handle), largest)
    except FormatError:
        os.close(handle)
        raise
    return os.fdopen(handle, "rb")


def require_ordinary(path: Path, kind: str, largest: int) -> None:
    """Refuse what is no ordinary file of at most `largest` bytes, without opening it.

    Raises
    ------
    FormatError
        As `read_bytes`.
    """
    try:
        found = path.stat()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise FormatError(
            file=path, expected=kind, seen="no such file", cure="Check the name and the path"
        ) from error
    except (OSError, ValueError) as error:
        raise _unreadable(path, kind, error) from error
    _require_fit(path, kind, found, largest)


def entries(folder: Path, name: str, what: str, most: int = ENTRIES) -> list[Path]:
    """Return the sorted paths ``folder/*/name``, or ``folder/*.ending`` for a name that starts with ``*``.

    Parameters
    ----------
    folder
        Searched one level deep; one that is not there has no entries.
    name
        File that each of its folders may hold, such as ``shot.json``, or a pattern such as ``*.toml``.
    what
        What the entries are, for the message.
    most
        Entries of the folder, of any kind.

    Raises
    ------
    FormatError
        When it has more, or cannot be read.
    """
    found: list[Path] = []
    try:
        with os.scandir(folder) as scan:
            for number, entry in enumerate(scan):
                if number >= most:
                    raise FormatError(
                        file=folder,
                        expected=f"a folder of {what}, at most {most} entries",
                        seen="more",
                        cure="Name the right folder, or move what is not needed out of it",
                    )
                if name.startswith("*"):
                    if fnmatch(entry.name, name):
                        found.append(folder / entry.name)
                elif (folder / entry.name / name).exists():
                    found.append(folder / entry.name / name)
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise _unreadable(folder, f"a folder of {what}", error) from error
    return sorted(found)


def _require_fit(path: Path, kind: str, found: os.stat_result, largest: int) -> None:
    unfit = unfit_kind(found.st_mode)
    if unfit is not None:
        raise FormatError(file=path, expected=kind, seen=unfit, cure=WANTED_CURE)
    _require_size(path, kind, found.st_size, largest)


def _require_size(path: Path, kind: str, size: int, largest: int) -> None:
    seen = unfit_size(size, largest)
    if seen is not None:
        expected = f"{kind} of at most {size_in_words(largest)}"
        raise FormatError(file=path, expected=expected, seen=seen, cure=SMALLER_CURE)


def _unreadable(path: Path, kind: str, error: OSError | ValueError) -> FormatError:
    return FormatError(
        file=path,
        expected=f"{kind} that can be read",
        seen=getattr(error, "strerror", None) or str(error),
    )


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


def write_folder(folder: Path, files: Mapping[str, bytes] | Iterable[tuple[str, bytes]]) -> None:
    """Make a folder so that it appears with all its files or not at all.

    Parameters
    ----------
    folder
        Must not exist, or be empty: nothing recorded is ever replaced.
    files
        Content of each file by its name, or name and content one after the other: then no more than one is
        in memory. A name may lead into a folder of its own.

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
        inner: set[Path] = set()
        for name, content in files.items() if isinstance(files, Mapping) else files:
            path = temporary / name
            if path.parent != temporary and path.parent not in inner:
                path.parent.mkdir(parents=True)
                inner.add(path.parent)
            _write_durably(path, content)
        for each in (*inner, temporary):
            _sync_folder(each)
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
