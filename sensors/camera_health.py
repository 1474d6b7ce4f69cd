"""How a camera is: what its driver counts, what went wrong with it, and where it stands in plain words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from alignment.errors import CameraConnectionError, CameraError, CameraTimeoutError


@dataclass(frozen=True)
class CameraStatistics:
    """What a camera and its link say of themselves; None where they do not.

    Attributes
    ----------
    link_mbit
        Speed of the link, megabits per second.
    dropped, incomplete
        Frames that were lost on the way, or came without all of their packets, since it was connected.
    resent
        Packets that were asked for again since it was connected.
    """

    link_mbit: float | None = None
    dropped: int | None = None
    incomplete: int | None = None
    resent: int | None = None


@runtime_checkable
class CameraWithStatistics(Protocol):
    """A camera whose driver tells more than frames; a driver need not be one.

    Asked after arming, every few seconds at most, in the thread of all its other calls.
    """

    def statistics(self) -> CameraStatistics:
        """Return the present state; errors as of every method of `sensors.camera.Camera`."""
        ...


@dataclass
class CameraCounts:
    """What happened with one camera since the start of the program.

    Attributes
    ----------
    frames
        That came whole.
    missing
        Frames that were triggered and did not come within their time.
    bad
        Frames that were no picture of this shot: short, out of step, frozen, of another setting.
    lost
        How often the connection was lost, or could not be made.
    hung
        Calls of the driver that did not come back within their bound.
    reconnected
        How often it was let go and reached anew after a failure.
    """

    frames: int = 0
    missing: int = 0
    bad: int = 0
    lost: int = 0
    hung: int = 0
    reconnected: int = 0

    @property
    def failures(self) -> int:
        """All that went wrong."""
        return self.missing + self.bad + self.lost

    def count(self, error: CameraError) -> None:
        """Count a failure by what it is."""
        if isinstance(error, CameraConnectionError):
            self.lost += 1
        elif isinstance(error, CameraTimeoutError):
            self.missing += 1
        else:
            self.bad += 1


def place_in_words(camera: str, serial: str | None = None) -> str:
    """Say where a camera stands: ``wheel front left, head 2, right camera, serial 40123456``.

    Parameters
    ----------
    camera
        Its name, ``front_left/head_2/right``; another one is told as it is.
    serial
        Serial number, where it is known.
    """
    parts = camera.split("/")
    where = f"camera {camera}"
    if len(parts) == 3 and all(parts):
        rig, head, side = (part.replace("_", " ") for part in parts)
        head = head if head.startswith("head") else f"head {head}"
        where = f"wheel {rig}, {head}, {side} camera"
    return where if serial is None else f"{where}, serial {serial}"
