"""Logs as can-utils' candump writes them with ``-L`` or ``-l``: ``(seconds) interface identifier#data``."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterable
from typing import Any

import can

from station.line.tools.logs.notes import DamageError, Notes

ERROR_FLAG, EXTENDED_DIGITS = 0x20000000, 8
_IDENTIFIER = 0x1FFFFFFF
_LINE = re.compile(
    r"\((-?\d+(?:\.\d+)?)\)\s+(\S+)\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(\S*)(?:\s+([RT]))?(?:\s.*)?"
)
# candump without -L, for people: [timestamp] interface identifier [length] bytes
_DISPLAY = re.compile(r"(?:\([^)]*\)\s+)?\S+\s+(?:RX|TX)?\s*(?:[-A-Z]+\s+)*[0-9A-Fa-f]{3,8}\s+\[\s*\d+\]")
_REMOTE = re.compile(r"R([0-9A-Fa-f])?(?:_[0-9A-Fa-f])?")
_CLASSIC = re.compile(r"((?:[0-9A-Fa-f]{2}\.?){0,8})(?:_[9A-Fa-f])?")
_FD = re.compile(r"#([0-9A-Fa-f])((?:[0-9A-Fa-f]{2}\.?){0,64})")
_XL = re.compile(r"[0-9A-Fa-f]+:")
_COMMENTS = ("#", ";", "//")
_CURE = "Record with `candump -L`, or check the file"


def candump_frames(lines: Iterable[tuple[int, str]], notes: Notes) -> Generator[can.Message]:
    """Frames of numbered lines; blank ones and comments are passed over.

    Raises
    ------
    DamageError
        At the first line that is none of a log.
    """
    for number, line in lines:
        if not line or line.startswith(_COMMENTS):
            continue
        where = f"line {number}"
        match = _LINE.fullmatch(line)
        if match is None:
            if _DISPLAY.match(line):
                raise DamageError(where, "what candump shows to people, without times", _CURE)
            raise DamageError(
                where, f"'{line[:60]}', which is no '(seconds) interface identifier#data'", _CURE
            )
        if _XL.match(match[4]):
            notes.skip(where, "a CAN XL frame")
            continue
        frame = _frame(match)
        if frame is None:
            raise DamageError(where, f"'{match[4][:60]}', which is no frame's data: was the file cut?", _CURE)
        yield frame


def _frame(match: re.Match[str]) -> can.Message | None:
    seconds, interface, digits, content, direction = match.groups()
    identifier = int(digits, 16)
    error = bool(identifier & ERROR_FLAG) and len(digits) == EXTENDED_DIGITS
    common: dict[str, Any] = {
        "timestamp": float(seconds),
        "channel": interface,
        "arbitration_id": identifier & _IDENTIFIER,
        "is_extended_id": len(digits) == EXTENDED_DIGITS and not error,
        "is_rx": direction != "T",
    }
    if remote := _REMOTE.fullmatch(content):
        return can.Message(**common, is_remote_frame=True, dlc=int(remote[1] or "0", 16))
    if classic := _CLASSIC.fullmatch(content):
        data = bytes.fromhex(classic[1].replace(".", ""))
        return can.Message(**common, is_error_frame=error, data=data)
    if fd := _FD.fullmatch(content):
        flags = int(fd[1], 16)
        return can.Message(
            **common,
            is_fd=True,
            bitrate_switch=bool(flags & 1),
            error_state_indicator=bool(flags & 2),
            data=bytes.fromhex(fd[2].replace(".", "")),
        )
    return None
