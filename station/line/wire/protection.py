"""End-to-end protection of the line's messages: AUTOSAR E2E profile 1, variant 1A.

Byte 0 of a protected frame is a CRC over the message's data id and all other bytes, the low half of byte 1 a
counter. The sender's half is `Protector`, the receiver's half `Guard`, one pair for each end of the bus. CRC
arithmetic is the library's (autosar-e2e); how counters are judged follows E2E_P01Check of the AUTOSAR E2E
protocol specification (PRS_E2EProtocol, profile 1): a frame counts when its counter is one to
`max_delta` ahead of the last one; the first frame of all, and the frame after a jump, only set the counter.
"""

from __future__ import annotations

import enum
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from e2e.p01 import E2E_P01_DATAID_BOTH, e2e_p01_check, e2e_p01_protect

COUNTERS = 15
"""The counter runs from 0 to 14; 15 is never sent."""
_CRC_BYTE, _COUNTER_BYTE = 0, 1


@dataclass(frozen=True)
class E2eParameters:
    """How one message is protected: its data id, and the largest step of the counter that is accepted."""

    data_id: int
    max_delta: int = 3


class Check(enum.StrEnum):
    """What the receiver makes of a frame; only OK and SOME_LOST count.

    OK: CRC right, counter one ahead. SOME_LOST: right, but up to `max_delta` - 1 frames before it did not
    arrive. REPEATED: the counter stands. WRONG_SEQUENCE: the counter jumped; the next frame is compared with
    this one. INITIAL: the first frame, which there is nothing to compare with. SYNC: the first good frame
    after a jump. WRONG_CRC: damaged, of another message, or not protected at all.
    """

    OK = "ok"
    SOME_LOST = "some_lost"
    REPEATED = "repeated"
    WRONG_SEQUENCE = "wrong_sequence"
    INITIAL = "initial"
    SYNC = "sync"
    WRONG_CRC = "wrong_crc"

    @property
    def counts(self) -> bool:
        """True when the frame's content may be used."""
        return self in (Check.OK, Check.SOME_LOST)

    @property
    def is_error(self) -> bool:
        """True when something is wrong on the bus or with the sender, and not only beginning."""
        return self in (Check.REPEATED, Check.WRONG_SEQUENCE, Check.WRONG_CRC)


def protect(data: bytearray, data_id: int, counter: int) -> None:
    """Write counter and CRC into a frame of two bytes or more, in place."""
    data[_COUNTER_BYTE] = (data[_COUNTER_BYTE] & 0xF0) | counter
    e2e_p01_protect(data, data_id, data_id_mode=E2E_P01_DATAID_BOTH, increment_counter=False)


class Protector:
    """Sender's half: counts the frames of each message and protects them.

    Parameters
    ----------
    messages
        By the name of the message.
    """

    def __init__(self, messages: Mapping[str, E2eParameters]) -> None:
        self._messages = messages
        self._counters = dict.fromkeys(messages, COUNTERS - 1)

    def protect(self, name: str, data: bytearray, jump: int = 1) -> None:
        """Protect the next frame of a message, in place; a jump other than 1 is a wrong counter."""
        self._counters[name] = (self._counters[name] + jump) % COUNTERS
        protect(data, self._messages[name].data_id, self._counters[name])


class Guard:
    """Receiver's half: says of every frame whether it counts.

    Parameters
    ----------
    messages
        By the name of the message.

    Attributes
    ----------
    counts
        How many frames were judged how, since the beginning.
    """

    def __init__(self, messages: Mapping[str, E2eParameters]) -> None:
        self._messages = messages
        self._last: dict[str, int] = {}
        self._unsure: set[str] = set()
        self.counts: Counter[Check] = Counter()

    def forget(self) -> None:
        """Begin anew, as after a lost communication: of each message the first frame will not count."""
        self._last.clear()
        self._unsure.clear()

    def check(self, name: str, data: bytes | bytearray) -> Check:
        """Judge one frame of a message."""
        found = self._check(name, bytearray(data))
        self.counts[found] += 1
        return found

    def _check(self, name: str, data: bytearray) -> Check:
        parameters = self._messages[name]
        counter = data[_COUNTER_BYTE] & 0x0F if len(data) > _COUNTER_BYTE else COUNTERS
        if counter >= COUNTERS or not e2e_p01_check(
            data, parameters.data_id, data_id_mode=E2E_P01_DATAID_BOTH
        ):
            return Check.WRONG_CRC
        last = self._last.get(name)
        if last is None:
            self._last[name] = counter
            return Check.INITIAL
        step = (counter - last) % COUNTERS
        if step == 0:
            return Check.REPEATED
        self._last[name] = counter
        if step > parameters.max_delta:
            self._unsure.add(name)
            return Check.WRONG_SEQUENCE
        if name in self._unsure:
            self._unsure.discard(name)
            return Check.SYNC
        return Check.OK if step == 1 else Check.SOME_LOST
