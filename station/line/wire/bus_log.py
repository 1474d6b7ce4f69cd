"""The log of the bus's traffic: kept over restarts, in a bounded number of files of a bounded size.

The current file is the configured one; `traffic.1.log` the one before, and so on.
A candump log is gone on with at the next start. ASC and BLF files have a beginning and an end, so that each
start begins a new one.
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import can
from can.io.generic import MessageWriter, SizedMessageWriter
from can.typechecking import StringPathLike

from alignment.errors import ConfigurationError

LOG_ENDINGS = (".log", ".asc", ".blf")
# Only a candump log is a row of lines, to which more can be added.
_APPENDED, _ASC = ".log", ".asc"


class _AscLog(can.ASCWriter):
    """An ASC file that begins at a whole second: its header has milliseconds, and no time loses digits."""

    def on_message_received(self, msg: can.Message) -> None:
        """Write one frame."""
        if not self.header_written:
            self.log_event("begin of the log", math.floor(msg.timestamp))
        super().on_message_received(msg)


class RotatingLog(can.SizedRotatingLogger):
    """Frames into files: the current one, and older ones that are counted upwards.

    Parameters
    ----------
    file
        The current one, ``.log`` (candump), ``.asc`` or ``.blf``.
    most_bytes
        A file that has reached this size is put aside before the next frame.
    files
        Files that are kept, the current one included; the oldest is given up for a new one.

    Raises
    ------
    OSError
        When a file cannot be written or renamed.
    """

    def __init__(self, file: Path, most_bytes: int, files: int) -> None:
        self._file = file
        self._files = files
        self.namer = lambda _: str(self._older(1))
        self.rotator = lambda _source, _destination: self._put_aside()
        for number, path in self._numbered():
            if number >= files:
                path.unlink()
        appended = file.suffix.lower() == _APPENDED
        if appended:
            _end_last_line(file)
        elif file.exists() and file.stat().st_size > 0:
            self._put_aside()
        super().__init__(file, max_bytes=most_bytes, **({"append": True} if appended else {}))

    def _get_new_writer(self, filename: StringPathLike) -> SizedMessageWriter:
        if Path(filename).suffix.lower() == _ASC:
            return _AscLog(filename)
        return super()._get_new_writer(filename)

    def _older(self, number: int) -> Path:
        return self._file.with_name(f"{self._file.stem}.{number}{self._file.suffix}")

    def _numbered(self) -> list[tuple[int, Path]]:
        """Files that were put aside, the newest first."""
        name = re.compile(rf"{re.escape(self._file.stem)}\.([1-9]\d{{0,8}}){re.escape(self._file.suffix)}")
        found = [(name.fullmatch(path.name), path) for path in self._file.parent.iterdir()]
        return sorted((int(match[1]), path) for match, path in found if match)

    def _put_aside(self) -> None:
        if self._files == 1:
            self._file.unlink()
            return
        for number in range(self._files - 1, 1, -1):
            if self._older(number - 1).exists():
                self._older(number - 1).replace(self._older(number))
        self._file.replace(self._older(1))


def _end_last_line(file: Path) -> None:
    """Cut off a line that a power loss left half written; the frame after it would be lost in it."""
    if not file.exists():
        return
    with file.open("rb+") as binary:
        size = binary.seek(0, os.SEEK_END)
        start = max(0, size - 4096)
        binary.seek(start)
        tail = binary.read()
        if tail and not tail.endswith(b"\n"):
            binary.truncate(start + tail.rfind(b"\n") + 1)


def open_log(path: Path, most_bytes: int | None = None, files: int = 1) -> MessageWriter:
    """Open a file that takes frames: candump (``.log``), ASC or BLF.

    Parameters
    ----------
    path
        The file.
    most_bytes, files
        Size and number of the files of a `RotatingLog`; without a size one file is begun anew.

    Raises
    ------
    ConfigurationError
        When it has another ending, is no ordinary file, or cannot be written.
    """
    if path.suffix.lower() not in LOG_ENDINGS:
        raise ConfigurationError(
            file=path,
            field="log",
            expected=f"a file ending in {', '.join(LOG_ENDINGS)}",
            seen=path.suffix or "none",
        )
    try:
        # To open a pipe would wait for its reader for ever.
        if path.exists() and not path.is_file():
            raise ConfigurationError(
                file=path, field="log", expected="an ordinary file", seen="a folder, a pipe or a device"
            )
        if most_bytes is not None:
            return RotatingLog(path, most_bytes, files)
        return _AscLog(path) if path.suffix.lower() == _ASC else can.Logger(path)
    except OSError as error:
        raise ConfigurationError(
            file=path,
            field="log",
            expected="a file that can be written",
            seen=str(error.strerror or error),
            cure="Make its folder, or give the station's user the right to write there",
        ) from error
