"""ASC logs of Vector's tools and of those that write them too: a header, then one line for each event.

Times count from the start of the measurement (``absolute``) or from the line before (``relative``); BusMaster
gives the time of day. Words and dates come in the language of the recording computer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import can

from station.line.tools.logs.notes import Notes

_EXTENDED = "x"
_DATE = re.compile(
    r"\S+\s+(\S+)\s+(\d{1,2})\s+(\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d{1,6}))?\s*(am|pm)?\s+(\d{4})",
    re.IGNORECASE,
)
_BASE = re.compile(r"base\s+(hex|dec)(.*)", re.IGNORECASE)
_MONTHS = {
    1: ("jan", "ene", "gen"), 2: ("feb", "fév", "fev"), 3: ("mar", "mär", "mrz"), 4: ("apr", "avr", "abr"),
    5: ("may", "mai", "mag"), 6: ("jun", "juin", "giu"), 7: ("jul", "juil", "lug"), 8: ("aug", "aoû", "ago"),
    9: ("sep", "set"), 10: ("oct", "okt", "ott", "out"), 11: ("nov",), 12: ("dec", "dez", "déc", "dic"),
}  # fmt: skip
_DIRECTIONS = {"rx": True, "tx": False}
_LONGEST_CLASSIC = 8
_FD_FLAG, _BRS_FLAG, _ESI_FLAG = 0x1000, 0x2000, 0x4000


def asc_frames(lines: Iterable[tuple[int, str]], notes: Notes) -> Generator[can.Message]:
    """Frames of numbered lines. A line that looks like a frame and is none is counted in `notes`."""
    reader = _Reader(notes)
    for number, line in lines:
        frame = reader.read(f"line {number}", line)
        if frame is not None:
            yield frame
    if reader.begun and not reader.ended:
        notes.remark("the log was not closed: its end may be missing")


def start_of(words: str) -> float | None:
    """Seconds since 1970 of a header's date, in this computer's time zone; None for one not understood."""
    match = _DATE.search(words)
    if match is None:
        return None
    name = match[1].lower().rstrip(".")
    month = next((number for number, starts in _MONTHS.items() if name.startswith(starts)), None)
    hour, half = int(match[3]), (match[7] or "").lower()
    if half:
        hour = hour % 12 + (12 if half == "pm" else 0)
    if month is None:
        return None
    # Vector writes three digits; python-can writes the bare number of milliseconds.
    fraction = match[6] or "0"
    seconds = int(fraction) / 1e3 if len(fraction) <= 3 else int(fraction) / 10.0 ** len(fraction)
    try:
        day = datetime(int(match[8]), month, int(match[2]), hour, int(match[4]), int(match[5]))
    except ValueError:
        return None
    return day.timestamp() + seconds


@dataclass
class _Reader:
    """What the header said, and the time of the line before."""

    notes: Notes
    base: int = 16
    relative: bool = False
    of_day: bool = False
    start: float = 0.0
    midnight: float = 0.0
    before: float = 0.0
    begun: bool = False
    ended: bool = False

    def read(self, where: str, line: str) -> can.Message | None:
        """Frame of one line; None for every other line."""
        lower = line.lower()
        if not line or lower.startswith(("//", "internal events", "no internal events", "previous log")):
            return None
        if lower.split()[0] == "date":
            self._dated(line)
        elif base := _BASE.match(line):
            self.base = 16 if base[1].lower() == "hex" else 10
            self.relative = "relative" in base[2].lower()
            self.of_day = "internal events" in base[2].lower()  # BusMaster's one line for two
        elif lower.startswith("begin triggerblock"):
            self.begun, self.ended = True, False
            if lower != "begin triggerblock":
                self._dated(line)
        elif lower.startswith("end triggerblock"):
            self.ended = True
        else:
            return self._event(where, line.split())
        return None

    def _dated(self, line: str) -> None:
        found = start_of(line)
        if found is None:
            self.notes.remark(f"'{line[:60]}' is no date that is understood: times count from zero")
            return
        self.start = found
        self.midnight = datetime.fromtimestamp(found).replace(
            hour=0, minute=0, second=0, microsecond=0
        ).timestamp()  # fmt: skip

    def _event(self, where: str, words: list[str]) -> can.Message | None:
        looks = any(word.lower() in _DIRECTIONS for word in words)
        try:
            stated = float(words[0])
            if not math.isfinite(stated):
                raise ValueError(words[0])
        except ValueError:
            if looks:
                self.notes.skip(where, "a line without a time")
            return None
        self.before = self.before + stated if self.relative else stated
        timestamp = (self.midnight if self.of_day else self.start) + self.before
        try:
            if words[1:2] == ["CANFD"]:
                return _flexible(words[2:], timestamp, self.base)
            if words[1:2] and words[1].isdecimal():
                return _classic(words[1:], timestamp, self.base)
        except (ValueError, IndexError):
            self.notes.skip(where, "a frame that is cut short or written otherwise")
            return None
        if looks:
            self.notes.skip(where, "a line that looks like a frame and is written otherwise")
        return None


def _identified(word: str, base: int) -> dict[str, Any]:
    extended = word[-1:].lower() == _EXTENDED
    return {"arbitration_id": int(word[:-1] if extended else word, base), "is_extended_id": extended}


def _classic(words: list[str], timestamp: float, base: int) -> can.Message | None:
    """``channel identifier Rx d length bytes``; None for an event of a channel that is no frame."""
    channel, name = int(words[0]) - 1, words[1]
    if name.lower() == "errorframe":
        return can.Message(timestamp=timestamp, channel=channel, is_error_frame=True, is_extended_id=False)
    if len(words) < 3 or words[2].lower() not in _DIRECTIONS:
        return None  # statistics, requests to send, transport protocols
    common: dict[str, Any] = {
        "timestamp": timestamp,
        "channel": channel,
        "is_rx": _DIRECTIONS[words[2].lower()],
        **_identified(name, base),
    }
    if words[3].lower() == "r":
        return can.Message(**common, is_remote_frame=True, dlc=int(words[4], 16) if words[4:] else 0)
    if words[3].lower() != "d":
        raise ValueError(words[3])
    length = min(int(words[4], 16), _LONGEST_CLASSIC)
    return can.Message(**common, data=_bytes(words[5 : 5 + length], length, base))


def _flexible(words: list[str], timestamp: float, base: int) -> can.Message | None:
    """``channel Rx identifier [name] brs esi dlc length bytes duration bits flags …``."""
    common: dict[str, Any] = {
        "timestamp": timestamp,
        "channel": int(words[0]) - 1,
        "is_rx": _DIRECTIONS[words[1].lower()],
    }
    if words[2].lower() == "errorframe":
        return can.Message(**common, is_error_frame=True, is_extended_id=False)
    rest = words[3:] if words[3] in ("0", "1") else words[4:]
    length = int(rest[3])
    data = _bytes(rest[4 : 4 + length], length, base)
    after = rest[4 + length :]
    # Lines of this kind tell of classic frames too, by their flags.
    flags = int(after[2], 16) if len(after) > 2 else _FD_FLAG
    return can.Message(
        **common,
        **_identified(words[2], base),
        is_fd=bool(flags & _FD_FLAG),
        bitrate_switch=rest[0] == "1" and bool(flags & _FD_FLAG),
        error_state_indicator=rest[1] == "1" and bool(flags & _FD_FLAG),
        data=data,
    )


def _bytes(words: list[str], length: int, base: int) -> bytes:
    if len(words) < length:
        raise ValueError("fewer bytes than stated")
    return bytes(int(word, base) for word in words)
