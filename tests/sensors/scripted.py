"""A camera whose driver does what a script says: hangs, raises, sends short, old, strange or no frames."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from alignment.errors import CameraConnectionError, CameraError, CameraTimeoutError
from sensors.camera import CameraSettings, Frame, SettingsInForce
from sensors.camera_health import CameraStatistics
from tests.sensors.samples import HEIGHT, WIDTH

NEVER = 10.0  # seconds; a call that a test let go on comes back well before


@dataclass
class Device:
    """What hangs on the cable, whichever driver object talks to it; a test changes it at any time.

    `hangs` names calls that hang until `go_on` is set; each one that does so sets `hanging`.
    """

    name: str = "front_left/head_2/right"
    serial: str = "40123456"
    exposure_ms: float | None = None
    pixel_format: str = "Mono8"
    plugged: bool = True
    hangs: set[str] = field(default_factory=set)
    raises: dict[str, BaseException] = field(default_factory=dict)
    once: dict[str, BaseException] = field(default_factory=dict)
    frames_left: int | None = None
    rows: int = HEIGHT
    counter_error: int = 0
    frozen: bool = False
    known: bool = True
    statistics: CameraStatistics | None = None
    temperature_c: float | None = None
    image: Callable[[int], Any] | None = None
    clock: Callable[[], float] = lambda: 0.0
    hanging: threading.Event = field(default_factory=threading.Event)
    go_on: threading.Event = field(default_factory=threading.Event)
    calls: list[str] = field(default_factory=list)
    inside: int = 0
    most_inside: int = 0
    opened: int = 0
    made: int = 0
    shots: int = 0

    def make(self) -> ScriptedCamera:
        """Another driver object for it."""
        self.made += 1
        return ScriptedCamera(self)


class ScriptedCamera:
    """A driver object."""

    def __init__(self, device: Device) -> None:
        self.device, self.name, self.leads = device, device.name, False
        self._connected = False
        self._settings: CameraSettings | None = None
        self._counter = 0
        self._waiting: list[int] = []
        self._inside = threading.Lock()

    def _do(self, what: str) -> None:
        device = self.device
        device.calls.append(what)
        assert self._inside.acquire(blocking=False), "two calls at once on one driver object"
        try:
            if what in device.hangs:
                device.hanging.set()
                assert device.go_on.wait(NEVER)
            error = device.once.pop(what, None) or device.raises.get(what)
            if error is not None:
                raise error
        finally:
            self._inside.release()
        if what not in ("connect", "close"):
            if not self._connected:
                raise CameraConnectionError(self.name, "is not connected", "Connect it first")
            if not device.plugged:
                raise CameraConnectionError(self.name, "does not answer any more", "Check its cable")

    def connect(self) -> None:
        self._do("connect")
        if self._connected:
            return
        if not self.device.plugged:
            raise CameraConnectionError(self.name, "no such camera on the network", "Check its cable")
        self._connected = True
        self.device.opened += 1

    def arm(self, settings: CameraSettings) -> None:
        self._do("arm")
        self._settings = settings
        self._counter = 0
        self._waiting.clear()

    def trigger(self) -> int:
        self._do("trigger")
        if self._settings is None:
            raise CameraError(self.name, "is not armed", "Arm it first")
        self._counter += 1
        self.device.shots += 1
        left = self.device.frames_left
        if left is None or left > 0:
            self.device.frames_left = None if left is None else left - 1
            self._waiting.append(self._counter)
        return self._counter

    def fetch(self, timeout_s: float) -> Frame:
        self._do("fetch")
        if not self._waiting:
            raise CameraTimeoutError(self.name, f"no frame within {max(0.0, timeout_s):g} s")
        device, settings = self.device, self._settings
        assert settings is not None
        counter = self._waiting.pop(0)
        number = 1 if device.frozen else device.shots
        image = device.image(number) if device.image else self._painted(number)
        exposure = settings.exposure_ms if device.exposure_ms is None else device.exposure_ms
        in_force = SettingsInForce(
            "Scripted", device.serial, exposure, settings.gain_db, device.pixel_format, 8, "Software"
        )
        return Frame(
            self.name,
            image[: device.rows],
            counter + device.counter_error,
            device.clock(),
            device.clock(),
            exposure,
            in_force if device.known else None,
            device.temperature_c,
        )

    def _painted(self, number: int) -> Any:
        """Of this camera and shot alone; not one grey value, which would be dark."""
        image = np.full((HEIGHT, WIDTH), number % 251, np.uint8)
        image[0, : len(self.name)] = [ord(letter) for letter in self.name]
        return image

    def statistics(self) -> CameraStatistics:
        self._do("statistics")
        return self.device.statistics or CameraStatistics()

    def close(self) -> None:
        self._do("close")
        self._connected = False
        self._settings = None


class Patience:
    """Waits for calls without letting time pass: one that hangs is given up once it is known to hang.

    `bounds_s` lists how long each call that hung might have taken.
    """

    def __init__(self, *devices: Device) -> None:
        self.devices = list(devices)
        self.bounds_s: list[float] = []

    def __call__(self, done: threading.Event, bound_s: float) -> bool:
        while not done.wait(0.0005):
            for device in self.devices:
                if device.hanging.is_set():
                    device.hanging.clear()
                    self.bounds_s.append(bound_s)
                    return False
        return True


DEVICES: dict[str, Device] = {}
"""By name, for a driver that is installed; a test puts its own here."""
