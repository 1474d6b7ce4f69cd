"""BLF logs of Vector's tools: a header, then objects, most of them inside compressed containers.

Layout after the public descriptions of the format (Vector's binlog objects, as python-can and Wireshark read
them too). Every size is checked before it is believed: a damaged file ends in an error, never in a loop.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, BinaryIO

import can

from station.line.tools.logs.notes import DamageError, Notes

_FILE = struct.Struct("<4sL8BQQLL8H8H")
_OBJECT = struct.Struct("<4sHHLL")  # signature, header size, header version, object size, type
_TIMES = {1: struct.Struct("<LHHQ"), 2: struct.Struct("<LBxHQ")}  # flags …, time; by header version
_CONTAINER = struct.Struct("<H6xL4x")  # compression, size when unpacked
_CLASSIC = struct.Struct("<HBBL8s")  # channel, flags, length, identifier, data
_ERROR = struct.Struct("<HHLBBBxLLH2x8s")  # channel … length (5), identifier (7), data (9)
_FLEXIBLE = struct.Struct("<HBBLLBBB5x64s")  # channel, flags, dlc, identifier, …, flags (6), length (7), data
_FLEXIBLE_64 = struct.Struct("<BBBBLLLLLLLHBBL")  # channel, dlc, length, …, identifier (4), flags (6) …

_CONTAINERS = 10
_CLASSICS, _PLAIN_ERROR, _LONG_ERROR, _FD, _FD_64, _FD_ERROR = (1, 86), 2, 73, 100, 101, 104
_FRAMES = (*_CLASSICS, _PLAIN_ERROR, _LONG_ERROR, _FD, _FD_64, _FD_ERROR)
_LARGEST = 16 * 2**20  # bytes of an object; containers are of 128 kB
_PADDING = 8  # bytes at most between objects
_EXTENDED, _IDENTIFIER = 0x80000000, 0x1FFFFFFF
_REMOTE, _SENT = 0x80, 0x01
_TEN_MICROSECONDS = 1
_CUT = "the file is cut short"


@dataclass
class _Place:
    """Where in the file the reader stands."""

    offset: int = 0

    def __str__(self) -> str:
        return f"byte {self.offset}"


def blf_frames(binary: BinaryIO, notes: Notes) -> Generator[can.Message]:
    """Frames of a file; objects that are frames and cannot be read are counted in `notes`.

    Raises
    ------
    DamageError
        Where the file is cut short, or says what cannot be.
    """
    start, stated = _header(binary, notes)
    place = _Place(binary.tell())
    stream = b""
    while base := binary.read(_OBJECT.size):
        size, kind, head = _sized(base, place)
        data = base + binary.read(size - len(base))
        cut = len(data) < size
        if kind == _CONTAINERS:
            stream += _unpacked(data, head, place, cut)
            done = 0
            for at, length in _objects(stream, place):
                done = at + length
                frame = _frame(stream[at:done], start, notes, place)
                if frame is not None:
                    yield frame
            stream = stream[done:]  # an object may go on in the next container
        elif not cut:
            frame = _frame(data, start, notes, place)
            if frame is not None:
                yield frame
        if cut:
            raise DamageError(str(place), _CUT)
        place.offset += size
        place.offset += _skip_padding(binary)
    if len(stream) > _PADDING or (stated and place.offset < stated):
        raise DamageError(str(place), _CUT)


def _header(binary: BinaryIO, notes: Notes) -> tuple[float, int]:
    """Start of the measurement, seconds since 1970, and the size that the file says it has; 0 for none."""
    data = binary.read(_FILE.size)
    if len(data) < _FILE.size or data[:4] != b"LOGG":
        raise DamageError("byte 0", "no header of a BLF file")
    fields = _FILE.unpack(data)
    length, stated, words = fields[1], fields[10], fields[14:22]
    if not _FILE.size <= length <= 4096:
        raise DamageError("byte 4", f"a header of {length} bytes")
    binary.seek(length)
    if not stated or not fields[12]:
        notes.remark("the file was not closed: its end may be missing")
    year, month, _, day, hour, minute, second, milliseconds = words
    try:
        start = datetime(year, month, day, hour, minute, second, milliseconds * 1000, tzinfo=UTC).timestamp()
    except ValueError:
        start = 0.0
    return start, stated


def _sized(base: bytes, place: _Place) -> tuple[int, int, int]:
    """Size, type and header size of an object, all of them possible."""
    if len(base) < _OBJECT.size:
        raise DamageError(str(place), _CUT)
    signature, head, _, size, kind = _OBJECT.unpack(base)
    if signature != b"LOBJ":
        raise DamageError(str(place), "no object where one must begin")
    if not _OBJECT.size <= head <= size <= _LARGEST:
        raise DamageError(str(place), f"an object of {size} bytes, {head} of them its header")
    return size, kind, head


def _skip_padding(binary: BinaryIO) -> int:
    """Go to where the next object begins, or the file ends; return how far that was."""
    here = binary.tell()
    ahead = binary.read(_PADDING + 4)
    found = ahead.find(b"LOBJ")
    end = not ahead.strip(b"\0") and len(ahead) < _PADDING
    skipped = found if found >= 0 else len(ahead) if end else 0
    binary.seek(here + skipped)
    return skipped


def _unpacked(data: bytes, head: int, place: _Place, cut: bool) -> bytes:
    """Content of a container; of one that is cut short, what there is of it."""
    if len(data) < head + _CONTAINER.size:
        raise DamageError(str(place), "a container without its header")
    method, size = _CONTAINER.unpack_from(data, _OBJECT.size)
    packed = data[_OBJECT.size + _CONTAINER.size :]
    if size > _LARGEST:
        raise DamageError(str(place), f"a container of {size} bytes")
    if method == 0:
        return packed
    if method != 2:
        raise DamageError(str(place), f"a container compressed by method {method}, 0 and 2 are known")
    try:
        unpacked = zlib.decompressobj().decompress(packed, _LARGEST)
    except zlib.error as error:
        raise DamageError(str(place), f"a container that cannot be unpacked ({error})") from error
    if len(unpacked) < size and not cut:
        raise DamageError(str(place), f"a container of {len(unpacked)} bytes that says {size}")
    return unpacked


def _objects(data: bytes, place: _Place) -> Iterator[tuple[int, int]]:
    """Place and size of the objects that lie whole in unpacked bytes."""
    at = 0
    while (found := data.find(b"LOBJ", at, at + _PADDING + 4)) >= 0 and found + _OBJECT.size <= len(data):
        size, _, _ = _sized(data[found : found + _OBJECT.size], place)
        if found + size > len(data):
            return
        yield found, size
        at = found + size
    if len(data) - at >= _PADDING + 4 and found < 0:
        raise DamageError(str(place), "no object where one must begin, within a container")


def _frame(data: bytes, start: float, notes: Notes, place: _Place) -> can.Message | None:
    _, head, version, _, kind = _OBJECT.unpack_from(data)
    if kind not in _FRAMES:
        return None
    times = _TIMES.get(version)
    if times is None:
        notes.skip(str(place), f"a frame with an object header of version {version}")
        return None
    try:
        flags, *_, ticks = times.unpack_from(data, _OBJECT.size)
        per_second = 1e5 if flags == _TEN_MICROSECONDS else 1e9
        return _message(kind, data[head:], start + ticks / per_second)
    except (struct.error, ValueError):
        notes.skip(str(place), "a frame that is shorter than its kind")
        return None


def _identified(identifier: int) -> dict[str, Any]:
    return {"arbitration_id": identifier & _IDENTIFIER, "is_extended_id": bool(identifier & _EXTENDED)}


def _message(kind: int, body: bytes, timestamp: float) -> can.Message:
    if kind in _CLASSICS:
        channel, flags, length, identifier, data = _CLASSIC.unpack_from(body.ljust(_CLASSIC.size, b"\0"))
        remote = bool(flags & _REMOTE)
        return can.Message(
            timestamp=timestamp,
            channel=channel - 1,
            is_rx=not flags & _SENT,
            is_remote_frame=remote,
            dlc=min(length, 8),
            data=None if remote else data[: min(length, 8)],
            **_identified(identifier),
        )
    if kind == _LONG_ERROR:
        fields = _ERROR.unpack_from(body)
        return can.Message(
            timestamp=timestamp,
            channel=fields[0] - 1,
            is_error_frame=True,
            data=fields[9][: min(fields[5], 8)],
            **_identified(fields[7]),
        )
    if kind in (_PLAIN_ERROR, _FD_ERROR):
        channel = body[0] if kind == _FD_ERROR else int.from_bytes(body[:2], "little")
        return can.Message(
            timestamp=timestamp, channel=channel - 1, is_error_frame=True, is_extended_id=False
        )
    if kind == _FD:
        channel, flags, _, identifier, _, _, bits, length, data = _FLEXIBLE.unpack_from(
            body.ljust(_FLEXIBLE.size, b"\0")
        )
        return can.Message(
            timestamp=timestamp,
            channel=channel - 1,
            is_rx=not flags & _SENT,
            is_remote_frame=bool(flags & _REMOTE),
            is_fd=bool(bits & 1),
            bitrate_switch=bool(bits & 2),
            error_state_indicator=bool(bits & 4),
            data=data[:length],
            **_identified(identifier),
        )
    fields = _FLEXIBLE_64.unpack_from(body)
    bits, length = fields[6], fields[2]
    # Fewer bytes than stated are zeros, as Vector's own library has it.
    data = body[_FLEXIBLE_64.size : _FLEXIBLE_64.size + length].ljust(length, b"\0")
    return can.Message(
        timestamp=timestamp,
        channel=fields[0] - 1,
        is_rx=not fields[12],
        is_remote_frame=bool(bits & 0x0010),
        is_fd=bool(bits & 0x1000),
        bitrate_switch=bool(bits & 0x2000),
        error_state_indicator=bool(bits & 0x4000),
        data=data,
        **_identified(fields[4]),
    )
