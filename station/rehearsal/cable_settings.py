"""Settings of a bus between two processes, from what a command line can carry."""

from __future__ import annotations

from station.line.tools import SLCAN_OPTIONS
from station.line.wire import BusSettings


def settings_of(interface: str, channel: str) -> BusSettings:
    """How to open one end of a cable or of another bus."""
    return BusSettings(interface, channel, options=SLCAN_OPTIONS if interface == "slcan" else {})
