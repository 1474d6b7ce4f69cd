"""The vehicle identification number, put together from its three frames."""

from __future__ import annotations

import enum
from collections.abc import Mapping

from alignment.errors import InputError
from station.line.wire.dbc import VIN_LENGTH, Value

VIN_LIFETIME_S = 2.0
# ISO 3779: digits and capital letters except I, O and Q.
VIN_CHARACTERS = frozenset("0123456789ABCDEFGHJKLMNPRSTUVWXYZ")


class VinState(enum.Enum):
    """Why there is no VIN."""

    INCOMPLETE = "incomplete"
    INVALID = "invalid"


def is_vin(text: str) -> bool:
    """True for 17 characters of ISO 3779's alphabet; the check digit is not tested, not all makers use it."""
    return len(text) == VIN_LENGTH and VIN_CHARACTERS.issuperset(text)


class VinAssembly:
    """Collects the frames of one VIN. Parts of two vehicles are never joined.

    Frames of another sequence discard those before them; a frame with other content in a place that is taken
    does too; an accepted start uses the frames up (`clear`); and frames older than two seconds do not count.
    Each of these closes a way in which the end of an earlier VIN could complete the beginning of the next.
    """

    def __init__(self, messages: Mapping[str, tuple[str, ...]]) -> None:
        self._messages = messages
        self._sequence_low: int | None = None
        self._parts: dict[str, tuple[str, float]] = {}

    def clear(self) -> None:
        """Forget all frames."""
        self._parts = {}

    def add(self, message: str, values: Mapping[str, Value], now: float) -> None:
        """Take one frame: its message, decoded values, and the time of the monotonic clock."""
        text = "".join(chr(int(values[signal])) for signal in self._messages[message])
        sequence_low = int(values["SequenceLow"])
        known = self._parts.get(message)
        if sequence_low != self._sequence_low or (known is not None and known[0] != text):
            self.clear()
        self._sequence_low = sequence_low
        self._parts[message] = (text, now)

    def read(self, sequence: int, now: float) -> str | VinState:
        """VIN for a start of this sequence."""
        if self._sequence_low != sequence % 16:
            return VinState.INCOMPLETE
        fresh = {
            name: text for name, (text, received) in self._parts.items() if now - received <= VIN_LIFETIME_S
        }
        if set(fresh) != set(self._messages):
            return VinState.INCOMPLETE
        vin = "".join(fresh[name] for name in self._messages)
        return vin if is_vin(vin) else VinState.INVALID


def checked_vin(text: str) -> str:
    """Return the text when it can be sent as a VIN: 17 characters of ASCII; the station judges the rest.

    Raises
    ------
    InputError
        When it cannot.
    """
    if len(text) != VIN_LENGTH or not text.isascii():
        raise InputError(field="vin", expected=f"{VIN_LENGTH} characters of ASCII", seen=repr(text))
    return text
