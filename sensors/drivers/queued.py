"""What cameras without hardware have in common: states, trigger counter, frames that wait to be fetched."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from alignment.errors import CameraConnectionError, CameraError, CameraTimeoutError
from alignment.values import Image
from sensors.camera import CameraSettings, Frame, SettingsInForce


@dataclass(frozen=True, eq=False)
class QueuedExposure:
    """An image on its way from the sensor to the computer.

    Attributes
    ----------
    trigger_counter
        The trigger it belongs to.
    image
        (height, width), 8 or 16 bit.
    device_time_s
        Clock of the device at the exposure, seconds.
    exposure_ms
        Exposure time, milliseconds.
    arrives_s
        When it can be fetched, seconds on the driver's clock.
    in_force, temperature_c
        What the camera said of itself; None where it said nothing.
    """

    trigger_counter: int
    image: Image
    device_time_s: float
    exposure_ms: float
    arrives_s: float
    in_force: SettingsInForce | None = None
    temperature_c: float | None = None


class QueuedCamera(ABC):
    """Base of drivers whose images come from this computer; see `sensors.camera.Camera` for the protocol.

    Parameters
    ----------
    name
        Name of the camera.
    clock
        Monotonic clock, seconds.
    sleep
        Waits the given seconds of that clock.
    """

    def __init__(
        self,
        name: str,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.name = name
        self._clock = clock
        self._sleep = sleep
        self._connected = False
        self._settings: CameraSettings | None = None
        self._counter = 0
        self._waiting: list[QueuedExposure] = []

    @abstractmethod
    def _open(self) -> None:
        """Make ready, or raise what `Camera.connect` may."""

    @abstractmethod
    def _expose(self, counter: int, settings: CameraSettings) -> QueuedExposure | None:
        """Take the image of this trigger; None when it is lost."""

    def connect(self) -> None:
        """Reach the source of images; see `Camera.connect`."""
        if not self._connected:
            self._open()
            self._connected = True

    def arm(self, settings: CameraSettings) -> None:
        """Take over settings, start counting again; see `Camera.arm`."""
        self._require_connection()
        self._settings = settings
        self._counter = 0
        self._waiting.clear()

    def trigger(self) -> int:
        """Expose one image; see `Camera.trigger`."""
        settings = self._require_armed()
        self._counter += 1
        exposure = self._expose(self._counter, settings)
        if exposure is not None:
            self._waiting.append(exposure)
            # Arrival decides the order, as on a real link: a late image comes after its successor.
            self._waiting.sort(key=lambda waiting: waiting.arrives_s)
        return self._counter

    def fetch(self, timeout_s: float) -> Frame:
        """Return the next frame that arrives; see `Camera.fetch`."""
        self._require_armed()
        wait_s = max(0.0, timeout_s)
        now = self._clock()
        if not self._waiting or self._waiting[0].arrives_s > now + wait_s:
            if wait_s:
                self._sleep(wait_s)
            raise CameraTimeoutError(
                self.name, f"expected a frame within {wait_s:g} s, {self._counter} triggers since armed"
            )
        exposure = self._waiting.pop(0)
        if exposure.arrives_s > now:
            self._sleep(exposure.arrives_s - now)
        return Frame(
            camera=self.name,
            image=exposure.image,
            trigger_counter=exposure.trigger_counter,
            device_time_s=exposure.device_time_s,
            host_time_s=self._clock(),
            exposure_ms=exposure.exposure_ms,
            in_force=exposure.in_force,
            temperature_c=exposure.temperature_c,
        )

    def close(self) -> None:
        """Let go of the source; see `Camera.close`."""
        self._connected = False
        self._settings = None
        self._waiting.clear()

    def _require_connection(self) -> None:
        if not self._connected:
            raise CameraConnectionError(self.name, "is not connected", "Connect it first")

    def _require_armed(self) -> CameraSettings:
        self._require_connection()
        if self._settings is None:
            raise CameraError(self.name, "is not armed", "Arm it first: its settings are not known")
        return self._settings
