"""What every camera driver looks like from outside: one protocol, one frame, one set of settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from alignment.errors import ConfigurationError
from alignment.values import Image


@dataclass(frozen=True)
class CameraSettings:
    """What a camera is told before it is triggered.

    Attributes
    ----------
    exposure_ms
        Exposure time, milliseconds, above 0.
    gain_db
        Analogue gain, decibels; 0 is the sensor's own.
    """

    exposure_ms: float = 5.0
    gain_db: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.exposure_ms <= 60_000:
            raise ConfigurationError(
                field="exposure_ms", expected="above 0, at most 60000", seen=str(self.exposure_ms)
            )
        if not 0 <= self.gain_db <= 60:
            raise ConfigurationError(field="gain_db", expected="from 0 to 60", seen=str(self.gain_db))


@dataclass(frozen=True)
class SettingsInForce:
    """What a camera is set to, as it said when it was armed; never taken from what it was told.

    Attributes
    ----------
    model, serial_number
        Of the camera, as it names itself.
    exposure_ms, gain_db
        As in `CameraSettings`.
    pixel_format
        Name of GenICam's Pixel Format Naming Convention, such as ``Mono8`` or ``Mono12p``.
    bits
        Significant bits of a pixel: 8, 10, 12 or 16.
    trigger_source
        Such as ``Software`` or ``Line1``.
    packet_size
        Bytes; None where the link has no such setting.
    others
        What else the driver's configuration sets, name and value as the camera gives them, by name.
    """

    model: str
    serial_number: str
    exposure_ms: float
    gain_db: float
    pixel_format: str
    bits: int
    trigger_source: str
    packet_size: int | None = None
    others: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Frame:
    """One image and when it was taken; stamped on receipt, before anything is done with it.

    Attributes
    ----------
    camera
        Name of the camera.
    image
        (height, width), one channel, 8 or 16 bit.
    trigger_counter
        Which trigger since `Camera.arm` it belongs to, from 1. Frames of several cameras are paired by it.
    device_time_s
        The camera's own clock at the exposure, seconds from an origin of its own.
    host_time_s
        This computer's monotonic clock when the frame was received, seconds; its age is measured from it.
    exposure_ms
        Exposure time, milliseconds.
    in_force
        What the camera is set to; None where its driver cannot read it.
    temperature_c
        Of the camera, °C; None where it has no sensor for it.
    """

    camera: str
    image: Image
    trigger_counter: int
    device_time_s: float
    host_time_s: float
    exposure_ms: float
    in_force: SettingsInForce | None = None
    temperature_c: float | None = None


class Camera(Protocol):
    """One camera. Used by one thread at a time.

    A camera whose trigger makes others of its rig expose, by a line that they wait for, has an attribute
    ``leads``, which is true: it is triggered after them.

    Every method raises `CameraError`, or a subclass of it, with the camera's name; a driver that reads files
    may also raise `FormatError`. The order is connect, arm, any number of trigger and fetch, close.
    """

    @property
    def name(self) -> str:
        """Name that no other camera of the station has, such as ``front_left/head_1/left``."""
        ...

    def connect(self) -> None:
        """Reach the camera; nothing happens when it is connected already.

        Raises
        ------
        CameraConnectionError
            When it cannot be reached.
        """
        ...

    def arm(self, settings: CameraSettings) -> None:
        """Take over the settings, forget all frames not yet fetched, count triggers from 1 again."""
        ...

    def trigger(self) -> int:
        """Expose one image, or count one that another camera's trigger exposes, ready for it.

        Returns the value that counts this trigger: 1 for the first after `arm`.
        """
        ...

    def fetch(self, timeout_s: float) -> Frame:
        """Return the next frame in the order of arrival, whichever trigger it belongs to.

        Parameters
        ----------
        timeout_s
            Upper bound of the waiting, seconds; 0 takes only a frame that is already there.

        Raises
        ------
        CameraTimeoutError
            When none came within the bound.
        CameraConnectionError
            When the camera is not connected, or was lost.
        """
        ...

    def close(self) -> None:
        """Let the camera go; nothing happens when it is closed already. It can be connected again."""
        ...
