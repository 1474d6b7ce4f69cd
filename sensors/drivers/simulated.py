"""A camera that looks at a simulated scene, and can fail as real cameras do."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from alignment.errors import CameraConnectionError
from alignment.values import Image
from sensors.camera import CameraSettings
from sensors.drivers.queued import QueuedCamera, QueuedExposure


class ImageSource(Protocol):
    """What one simulated camera sees. The cameras of a rig may share a scene behind their sources."""

    def image(self, trigger_counter: int) -> Image:
        """Return the image, (height, width), 8 or 16 bit, of this trigger (from 1)."""
        ...


@dataclass(frozen=True)
class Faults:
    """What goes wrong with a simulated camera, by trigger counter.

    Attributes
    ----------
    unreachable
        `connect` fails.
    dropped
        Triggers whose frame is lost on the way.
    delays_s
        Seconds by which the frame of a trigger comes late.
    stale
        Triggers at which the frame of the trigger before is sent again instead of the new one.
    lost_at
        The trigger at which the connection breaks.
    """

    unreachable: bool = False
    dropped: frozenset[int] = frozenset()
    delays_s: Mapping[int, float] = field(default_factory=dict)
    stale: frozenset[int] = frozenset()
    lost_at: int | None = None


class SimulatedCamera(QueuedCamera):
    """Exposes whatever its source shows at the moment of the trigger.

    It does not simulate the settings: exposure time and gain are reported, not applied to the image. Nor
    does it simulate the time of the read-out: a frame is there as soon as its source has rendered it.

    Parameters
    ----------
    name
        Name of the camera.
    source
        What it sees; asked once for each trigger, during `trigger`.
    faults
        What goes wrong; may be exchanged at any time.
    clock, sleep
        As for `QueuedCamera`.
    device_clock
        The camera's own clock, seconds; by default `clock` too.
    """

    def __init__(
        self,
        name: str,
        source: ImageSource,
        faults: Faults | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
        device_clock: Callable[[], float] | None = None,
    ) -> None:
        super().__init__(name, clock, sleep)
        self.faults = faults or Faults()
        self._source = source
        self._device_clock = device_clock or clock
        self._previous: QueuedExposure | None = None

    def _open(self) -> None:
        if self.faults.unreachable:
            raise CameraConnectionError(
                self.name, "expected an answer, none came", "Check its power and its cable"
            )
        self._previous = None

    def arm(self, settings: CameraSettings) -> None:
        """Take over settings, start counting again; see `Camera.arm`."""
        super().arm(settings)
        self._previous = None

    def _expose(self, counter: int, settings: CameraSettings) -> QueuedExposure | None:
        if self.faults.lost_at == counter:
            self.close()
            raise CameraConnectionError(
                self.name,
                f"the connection broke at trigger {counter}",
                "Check its power and its cable, then connect it again",
            )
        now = self._device_clock()
        image = self._source.image(counter)
        arrives = self._clock() + self.faults.delays_s.get(counter, 0.0)
        exposure = QueuedExposure(counter, image, now, settings.exposure_ms, arrives)
        previous, self._previous = self._previous, exposure
        if counter in self.faults.dropped:
            return None
        return previous if counter in self.faults.stale else exposure
