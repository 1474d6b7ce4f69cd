"""Which files are worth opening: ordinary ones, not larger than their kind can be.

A pipe never ends, a device neither, and opening one may wait for ever or do something to a machine. Here is
only the judgement, from what the system says of a file; whoever reads one asks before opening it.
"""

from __future__ import annotations

import stat

MIB = 2**20

TEXT = 16 * MIB
"""Bytes of a file that a person writes: TOML, DBC, the certificate of a plate."""
DOCUMENT = 256 * MIB
"""Bytes of a file that a program writes: JSON, tables, calibrations of other programs."""
IMAGE = 256 * MIB
"""Bytes of one image: 120 million pixels of 16 bits."""
LOG = 64 * 1024 * MIB
"""Bytes of a log of CAN frames, which is read frame by frame."""
BACKUP = 16 * 1024 * 1024 * MIB
"""Bytes of a database's backup, which is copied by the database itself."""
ENTRIES = 100_000
"""Entries of a folder that is searched for shots, sessions or vehicle types."""

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe, which has no end"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
WANTED_CURE = "Name an ordinary file"
SMALLER_CURE = "Check the name; no file of this kind is that large"


def unfit_kind(mode: int) -> str | None:
    """Say what a file is that is no ordinary one; None for an ordinary file.

    Parameters
    ----------
    mode
        As in `os.stat_result.st_mode`, links followed.
    """
    if stat.S_ISREG(mode):
        return None
    return next((words for is_kind, words in _KINDS if is_kind(mode)), "no ordinary file")


def unfit_size(size: int, largest: int) -> str | None:
    """Say how large a file is that is larger than `largest` bytes; None for one that is not."""
    return None if size <= largest else size_in_words(size)


def size_in_words(size: int) -> str:
    """Return a number of bytes as a person reads it."""
    value, units = float(size), ("bytes", "KiB", "MiB", "GiB", "TiB")
    for unit in units[:-1]:
        if value < 1024.0:
            return f"{value:.4g} {unit}"
        value /= 1024.0
    return f"{value:.4g} {units[-1]}"
