"""Reading a log of CAN frames to its end, or to where it is damaged."""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Iterator
from os import PathLike
from pathlib import Path
from typing import BinaryIO, Self

import can

from alignment.errors import FormatError
from alignment.file_limits import LOG
from sensors.formats import open_ordinary
from station.line.tools.logs.asc import asc_frames
from station.line.tools.logs.blf import blf_frames
from station.line.tools.logs.candump import candump_frames
from station.line.tools.logs.lines import numbered_lines
from station.line.tools.logs.notes import DamageError, Notes
from station.line.wire import LOG_ENDINGS

_KINDS = {".log": "candump", ".asc": "ASC", ".blf": "BLF"}


class LogReading:
    """Frames of a candump (``.log``), ASC or BLF file, in order; afterwards, what was read and what was not.

    Parameters
    ----------
    path
        The file; its ending says of which kind it is.

    Raises
    ------
    FormatError
        For another ending; while it is read, when the file is missing, holds no frame, or is damaged. Frames
        before the damage have been given then.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self._file = Path(path)
        if self._file.suffix.lower() not in LOG_ENDINGS:
            raise FormatError(
                file=self._file,
                expected=f"a log ending in {', '.join(LOG_ENDINGS)}",
                seen=self._file.suffix or "no ending",
            )
        self.frames = 0
        self.notes = Notes()
        self._source = self._read()

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> can.Message:
        return next(self._source)

    @property
    def summary(self) -> str:
        """How many frames were read, and what could not be."""
        told = str(self.notes)
        return f"{self._file}: {self.frames} frame{'' if self.frames == 1 else 's'}" + (
            f"; {told}" if told else ""
        )

    def _read(self) -> Iterator[can.Message]:
        kind = _KINDS[self._file.suffix.lower()]
        try:
            # Opened here and not by a reader, which would leave a damaged file open.
            with (
                open_ordinary(self._file, "a log of CAN frames", LOG) as binary,
                contextlib.closing(self._frames(kind, binary)) as frames,
            ):
                for frame in frames:
                    self.frames += 1
                    yield frame
        except OSError as error:
            raise FormatError(
                file=self._file, expected="a readable log", seen=str(error.strerror or error)
            ) from error
        except DamageError as error:
            raise FormatError(
                file=self._file,
                field=error.where,
                expected=f"a whole {kind} log",
                seen=f"{error.seen}, after {self.frames} frame{'' if self.frames == 1 else 's'}",
                cure=error.cure,
            ) from error
        if not self.frames:
            raise FormatError(
                file=self._file,
                expected=f"at least one frame: is it a log of the kind {kind}?",
                seen=str(self.notes) or "none",
            )

    def _frames(self, kind: str, binary: BinaryIO) -> Generator[can.Message]:
        match kind:
            case "BLF":
                return blf_frames(binary, self.notes)
            case "ASC":
                return asc_frames(numbered_lines(binary, self.notes), self.notes)
            case _:
                return candump_frames(numbered_lines(binary, self.notes), self.notes)


def read_log(path: str | PathLike[str]) -> LogReading:
    """As `LogReading`."""
    return LogReading(path)
