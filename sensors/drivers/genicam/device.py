"""What is asked of a camera maker's library: features by name, a stream of buffers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sensors.drivers.driver import SeenCamera

FeatureValue = bool | int | float | str


@dataclass(frozen=True)
class Action:
    """An action command of GigE Vision, which exposes all cameras of its keys at once.

    Attributes
    ----------
    device_key, group_key, group_mask
        As set in the cameras.
    address
        Broadcast address of the cameras' network.
    ahead_s
        How long after the command the cameras expose, by their synchronised clocks; 0 at its arrival.
    """

    device_key: int
    group_key: int
    group_mask: int
    address: str
    ahead_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Buffer:
    """One buffer as it came, lent until `release`.

    Attributes
    ----------
    frame_id
        The camera's own number of the frame; None where it gives none.
    timestamp_s
        The camera's clock at the exposure, seconds; 0 where it has none.
    pixel_format
        By the naming convention.
    width, height
        Pixels.
    padding
        Bytes after each line.
    data
        (n,), the library's own memory, what was filled of it.
    problem
        Why it is not whole; None where it is.
    release
        Gives it back to the library; called once.
    """

    frame_id: int | None
    timestamp_s: float
    pixel_format: str
    width: int
    height: int
    padding: int
    data: NDArray[np.uint8]
    problem: str | None
    release: Callable[[], None]


NOTHING: NDArray[np.uint8] = np.empty(0, np.uint8)


class Device(Protocol):
    """One camera behind its maker's library; whatever it raises becomes an error of the camera.

    All calls end by themselves: those with a bound within it, the others in seconds. `close` may come from
    another thread, while `retrieve` or `wait_ready` waits; the waiting then ends.
    """

    @property
    def first_frame_id(self) -> int:
        """Number of the first frame of an acquisition."""
        ...

    def open(self) -> SeenCamera:
        """Reach the camera, alone, and return what it says of itself; after `close` again."""
        ...

    def lost(self) -> bool:
        """Whether the camera went away since it was opened."""
        ...

    def close(self) -> None:
        """Let it go, whatever state it is in; nothing happens when it is closed."""
        ...

    def get(self, name: str) -> FeatureValue | None:
        """Return a feature as the camera has it now, not as it was read before; None where it has none."""
        ...

    def set(self, name: str, value: FeatureValue) -> None:
        """Set a feature; `LookupError` where the camera has none of this name."""
        ...

    def limits(self, name: str) -> tuple[float, float] | None:
        """Return the bounds of a number; None of anything else."""
        ...

    def choices(self, name: str) -> tuple[str, ...]:
        """Return what an enumeration may be now; empty for anything else."""
        ...

    def execute(self, name: str) -> None:
        """Carry out a command."""
        ...

    def start(self, buffers: int) -> None:
        """Start an acquisition whose ring has so many buffers."""
        ...

    def wait_ready(self, timeout_s: float) -> bool:
        """Wait until the next trigger will not be ignored; whether that came."""
        ...

    def retrieve(self, timeout_s: float) -> Buffer | None:
        """Return the next buffer; None when none came within the bound, or the acquisition was stopped."""
        ...

    def stop(self) -> None:
        """End the acquisition; buffers that were not retrieved are gone."""
        ...

    def fire(self, action: Action) -> None:
        """Send an action command to all cameras of its network."""
        ...
