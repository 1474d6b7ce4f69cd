"""Error frames as SocketCAN tells them: the classes of the identifier, and what the controller adds.

Source: linux/can/error.h. Adapters and logs of other kinds tell of an error frame only that it was one.
"""

from __future__ import annotations

import can

_CLASSES = {
    0x001: "transmission timed out",
    0x002: "lost arbitration",
    0x004: "controller",
    0x008: "protocol violation",
    0x010: "transceiver",
    0x020: "no acknowledgement",
    0x040: "bus-off",
    0x080: "bus error",
    0x100: "controller restarted",
    0x200: "error counters",
}
_CONTROLLER, _COUNTERS = 0x004, 0x200
_STATES = {
    0x01: "receive buffer overflow",
    0x02: "send buffer overflow",
    0x04: "receive warning",
    0x08: "send warning",
    0x10: "receive error-passive",
    0x20: "send error-passive",
    0x40: "error-active again",
}


def error_in_words(frame: can.Message) -> str:
    """What an error frame says; "error frame" alone where nothing more is known."""
    classes = frame.arbitration_id
    told = []
    for flag, words in _CLASSES.items():
        if not classes & flag:
            continue
        more = ""
        if flag == _CONTROLLER and len(frame.data) > 1:
            more = ", ".join(text for bit, text in _STATES.items() if frame.data[1] & bit)
        if flag == _COUNTERS and len(frame.data) > 7:
            more = f"sent {frame.data[6]}, received {frame.data[7]}"
        told.append(f"{words} ({more})" if more else words)
    return f"error frame: {', '.join(told)}" if told else "error frame"
