"""What a station may set of its line, and what the line knows of its own state."""

from __future__ import annotations

from dataclasses import dataclass

from station.cycle import SERVED_MODES, Mode
from station.line.wire.bus import BusHealth
from station.line.wire.link import LinkHealth


@dataclass(frozen=True)
class LineOptions:
    """What a station may set of its line.

    Attributes
    ----------
    communication_timeout_s
        Without a good Command frame for so long the communication is lost; None takes the DBC's timeout.
    live_age_s
        Live angles older than this are shown as stale.
    modes
        Modes that this station serves; that of a sweep only where a vehicle type says how.
    software
        Version of the program.
    """

    communication_timeout_s: float | None = None
    live_age_s: float = 1.0
    modes: frozenset[Mode] = SERVED_MODES - {Mode.SWEEP}
    software: tuple[int, int, int] = (0, 0, 0)


DEFAULT_OPTIONS = LineOptions()


@dataclass(frozen=True)
class LineHealth:
    """Everything that the line knows of its own state, for screens and logs."""

    bus: BusHealth
    link: LinkHealth
    link_up: bool
    cyclic_alive: bool
    cyclic_failures: int
    faults: int

    def __str__(self) -> str:
        heard = "controller heard" if self.link_up else "controller not heard"
        return f"{heard}; {self.bus}; {self.link}"
