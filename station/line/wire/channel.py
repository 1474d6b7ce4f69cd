"""Opens the channel of a bus: any python-can interface, a serial device for one program at a time only."""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can

from alignment.errors import ConfigurationError
from station.line.wire.adapters import FOREIGN, unopened

ONE_PROCESS = "virtual"
"""The interface whose channels end with the process: no other program can be on one."""


@dataclass(frozen=True)
class BusSettings:
    """How to reach the bus.

    Attributes
    ----------
    interface
        Name of a python-can interface: `ONE_PROCESS` (``virtual``), ``socketcan``, ``pcan``, ``vector``, …
    channel
        Its channel; for ``virtual`` any name that both ends share.
    bitrate
        Bits per second, for interfaces that set it.
    log
        File that takes all traffic: ``.log`` (candump), ``.asc`` or ``.blf``; None writes none.
    options
        Further arguments of the interface.
    log_bytes, log_files
        Size at which a new file of the log is begun, and how many are kept, the current one included.
    """

    interface: str = ONE_PROCESS
    channel: str = "truewheel"
    bitrate: int = 500_000
    log: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    log_bytes: int = 100_000_000
    log_files: int = 10


class Channel:
    """Opens the bus of some settings, as often as it is called; `release` gives a serial device free.

    Raises
    ------
    ConfigurationError
        When called: the interface is unknown or not installed, the channel is in use or cannot be opened.
    """

    def __init__(self, settings: BusSettings) -> None:
        self._settings = settings
        self._claim: int | None = None

    def __call__(self) -> can.BusABC:
        """Open the bus."""
        settings = self._settings
        require_interface(settings.interface)
        try:
            self._claim_device()
            return can.Bus(
                interface=settings.interface,
                channel=settings.channel,
                bitrate=settings.bitrate,
                ignore_config=True,
                **dict(settings.options),
            )
        except FOREIGN as error:
            self.release()
            raise unopened(settings.interface, settings.channel, error) from error
        except BaseException:
            self.release()
            raise

    def __str__(self) -> str:
        return f"{self._settings.interface} {self._settings.channel}"

    def release(self) -> None:
        """Let other programs have the device; harmless when there is none."""
        claim, self._claim = self._claim, None
        if claim is not None:
            os.close(claim)

    def _claim_device(self) -> None:
        """Lock a serial device: two programs on one would each take half of the other's bytes."""
        self.release()
        device = self._settings.channel.partition("@")[0]
        path = Path(device)
        if not path.exists() or not stat.S_ISCHR(path.stat().st_mode):
            return
        claim = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(claim)
            raise OSError("another program has it open") from error
        self._claim = claim


def require_interface(name: str) -> None:
    """Raise unless python-can knows an interface of this name.

    Raises
    ------
    ConfigurationError
        Names those that it knows.
    """
    if name not in can.VALID_INTERFACES:
        raise ConfigurationError(
            field="line.interface",
            expected=f"one of {', '.join(sorted(can.VALID_INTERFACES))}",
            seen=f"'{name}'",
        )
