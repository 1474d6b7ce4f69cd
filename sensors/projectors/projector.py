"""What every projector looks like from outside: one protocol, whatever switches its light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class ProjectorState:
    """What a projector says of itself; None for what it cannot say.

    Attributes
    ----------
    identity
        Maker, model, serial number, version.
    lit
        Whether it lights at the cameras' strobe.
    brightness
        Share of its full light, 0 … 1.
    temperature_c
        Of the lamp, °C.
    hours
        That it has burnt.
    """

    identity: str | None = None
    lit: bool | None = None
    brightness: float | None = None
    temperature_c: float | None = None
    hours: float | None = None


class ProjectorDevice(Protocol):
    """The light of one rig: it flashes by the cameras' strobe line, and is told how bright, or not at all.

    Used by one thread at a time. Every call ends within bounds of the driver's own, seconds at most, and
    raises `ProjectorError`, or a subclass of it, with the rig's name. After an error `connect` begins anew.
    """

    @property
    def rig(self) -> str:
        """Name of the rig that it lights."""
        ...

    @property
    def can_be_dark(self) -> bool:
        """Whether an exposure without its light can be had."""
        ...

    def connect(self) -> None:
        """Reach it; nothing happens when it is connected already."""
        ...

    def light(self, brightness: float) -> None:
        """Flash with every exposure from now on, with so much of the full light, above 0 and at most 1."""
        ...

    def dark(self) -> None:
        """Flash no more until `light` is called again."""
        ...

    def state(self) -> ProjectorState:
        """Ask it how it is."""
        ...

    def close(self) -> None:
        """Let it go, dark where that can be; nothing happens when it is closed already."""
        ...
