"""One end of the protected line: frames out with CRC and counter, frames in only when they count."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import can

from alignment.counting import count_of
from alignment.errors import InputError
from station.line.wire.bus import LineBus
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.protection import Check, Guard, Protector

Spoil = Literal["crc", "counter"]
_JUMP = 7


@dataclass(frozen=True)
class LinkHealth:
    """Frames of the line that arrived.

    Attributes
    ----------
    good
        Counted.
    wrong_crc, wrong_counter
        Did not count, because of their CRC, or because their counter stood or jumped.
    unsettled
        Did not count, because they were the first ones, or the first after a jump.
    malformed
        Could not be decoded: of a wrong length, remote, or with a value that no signal has.
    """

    good: int = 0
    wrong_crc: int = 0
    wrong_counter: int = 0
    unsettled: int = 0
    malformed: int = 0

    def __str__(self) -> str:
        counts = {
            "with a wrong CRC": self.wrong_crc,
            "with a wrong counter": self.wrong_counter,
            "before the counter was known": self.unsettled,
            "malformed": self.malformed,
        }
        bad = [f"{count} {name}" for name, count in counts.items() if count]
        return ", ".join([f"{count_of(self.good, 'good frame')} of the controller", *bad])


class ProtectedLink:
    """Sends and reads the messages of the DBC; one object for each end of the bus.

    Parameters
    ----------
    bus
        Open bus.
    database
        The checked DBC.
    clock
        Monotonic seconds.
    """

    def __init__(self, bus: LineBus, database: LineDatabase, clock: Callable[[], float]) -> None:
        self.bus = bus
        self.database = database
        self._clock = clock
        self._protector = Protector(database.protected)
        self._guard = Guard(database.protected)
        self._sending = threading.Lock()
        self._heard: dict[str, float] = {}
        self._malformed = 0

    def send(self, frame: can.Message, spoil: Spoil | None = None) -> None:
        """Protect and send a frame that `LineDatabase.encode` made; the frame itself stays as it is.

        `spoil` sends it with a wrong CRC, or with a counter that jumps.

        Raises
        ------
        LineConnectionError
            When the bus does not take it.
        """
        name = self.database.name_of(frame)
        data = bytearray(frame.data)
        # A frame that fails has used its counter up, which the receiver takes for one lost frame.
        with self._sending:
            if name in self.database.protected:
                wrong = max(_JUMP, self.database.protected[name].max_delta + 1)
                self._protector.protect(name, data, jump=wrong if spoil == "counter" else 1)
                data[0] ^= int(spoil == "crc")
            self.bus.send(
                can.Message(
                    arbitration_id=frame.arbitration_id, is_extended_id=frame.is_extended_id, data=data
                )
            )

    def read(self, frame: can.Message) -> tuple[str, dict[str, Value]] | None:
        """Name and values of a frame that counts; None for every other one. Never raises."""
        name = self.database.name_of(frame)
        if name is None or name not in self.database.protected or frame.is_error_frame:
            return None
        try:
            values = self.database.decode(frame)
        except InputError:
            self._malformed += 1
            return None
        if not self._guard.check(name, frame.data).counts:
            return None
        self._heard[name] = self._clock()
        return name, values

    def heard_s(self, name: str) -> float | None:
        """When the last frame of a message that counted arrived; None before the first."""
        return self._heard.get(name)

    def forget(self) -> None:
        """Begin anew after a lost communication: the first frame of each message will not count."""
        self._guard.forget()
        self._heard.clear()

    @property
    def health(self) -> LinkHealth:
        """Counters up to now."""
        counts = self._guard.counts
        return LinkHealth(
            good=counts[Check.OK] + counts[Check.SOME_LOST],
            wrong_crc=counts[Check.WRONG_CRC],
            wrong_counter=counts[Check.REPEATED] + counts[Check.WRONG_SEQUENCE],
            unsettled=counts[Check.INITIAL] + counts[Check.SYNC],
            malformed=self._malformed,
        )
