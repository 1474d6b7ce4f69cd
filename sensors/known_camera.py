"""Is it still the camera that it was? Serial number, settings and size of its images may not change."""

from __future__ import annotations

from alignment.errors import CameraConnectionError, CameraError
from sensors.camera import CameraSettings, Frame, SettingsInForce

_EXPOSURE_SHARE, _EXPOSURE_MS = 0.02, 0.05
_GAIN_DB = 0.15
"""Cameras keep exposure and gain in steps of their own, and say the step that they took."""


class KnownCamera:
    """What was seen of one camera since the program started; every frame is compared with it.

    A camera is calibrated by its place: another one there, or one that is set otherwise, gives good pictures
    and wrong angles. What is seen first is believed, unless a serial number is expected: whoever changes a
    camera on purpose calibrates the rig and starts the station anew.

    Parameters
    ----------
    name
        Of the camera.
    size
        (height, width) of its images as calibrated; None leaves their size unchecked.
    """

    def __init__(self, name: str, size: tuple[int, int] | None = None) -> None:
        self._name = name
        self._told: CameraSettings | None = None
        self._told_when_seen: CameraSettings | None = None
        self._seen: SettingsInForce | None = None
        self._size = size
        self._expected: str | None = None
        self._was_whole = False

    @property
    def serial(self) -> str | None:
        """Serial number that is expected; None before the first frame, and where it cannot be read."""
        if self._expected is not None:
            return self._expected
        return None if self._seen is None else self._seen.serial_number

    def expect(self, serial: str) -> None:
        """Believe in this serial number before anything is seen: it was calibrated here."""
        self._expected = serial

    @property
    def in_force(self) -> SettingsInForce | None:
        """What it was set to when it was seen first."""
        return self._seen

    def told(self, settings: CameraSettings) -> None:
        """Take note of what it was told."""
        self._told = settings

    def check(self, frame: Frame) -> None:
        """Compare a frame with what is known.

        Raises
        ------
        CameraConnectionError
            When another camera answers.
        CameraError
            When it is set otherwise than it was told, or than it was; when its image is short.
        """
        if frame.in_force is not None:
            self._check_settings(frame.in_force)
        self._check_size(frame.image.shape)
        if frame.in_force is not None and (self._seen is None or self._told != self._told_when_seen):
            self._seen, self._told_when_seen = frame.in_force, self._told

    def _check_size(self, shape: tuple[int, ...]) -> None:
        """Tell rows that are missing; a camera that never had the size of the calibration is another one."""
        if self._size is None or len(shape) != 2:
            return
        (height, width), whole = shape, self._size
        short = width == whole[1] and height < whole[0]
        if shape != whole and (short or self._was_whole):
            raise CameraError(
                self._name,
                f"an incomplete image: expected {whole[1]} × {whole[0]} pixels, it sent {width} × {height}",
                "Check the load of its link and its packet size; if it stays, its cable",
            )
        self._was_whole = shape == whole

    def _check_settings(self, now: SettingsInForce) -> None:
        seen, serial = self._seen, self.serial
        if serial is not None and now.serial_number != serial:
            raise CameraConnectionError(
                self._name,
                f"another camera answers: expected serial number {serial}, found {now.serial_number}",
                "Connect the camera that was calibrated here, or calibrate and start the station anew",
            )
        changes = [] if self._told is None else _not_as_told(self._told, now)
        if seen is not None:
            changes += _changes(seen, now)
            # What it was told otherwise meanwhile did not change by itself.
            if self._told == self._told_when_seen and abs(now.gain_db - seen.gain_db) > _GAIN_DB:
                changes.append(f"gain_db expected {seen.gain_db:g}, found {now.gain_db:g}")
        if changes:
            raise CameraError(
                self._name,
                f"its settings changed: {'; '.join(changes)}",
                "Close other programs that use it; it is set again when it is armed",
            )


def _not_as_told(told: CameraSettings, now: SettingsInForce) -> list[str]:
    if abs(now.exposure_ms - told.exposure_ms) <= _EXPOSURE_MS + _EXPOSURE_SHARE * told.exposure_ms:
        return []
    return [f"exposure_ms expected {told.exposure_ms:g}, found {now.exposure_ms:g}"]


def _changes(seen: SettingsInForce, now: SettingsInForce) -> list[str]:
    names = ("model", "pixel_format", "bits", "trigger_source", "packet_size")
    before, after = dict(seen.others), dict(now.others)
    pairs = [(name, getattr(seen, name), getattr(now, name)) for name in names]
    pairs += [(name, before.get(name), after.get(name)) for name in sorted(before.keys() | after.keys())]
    return [f"{name} expected {old}, found {new}" for name, old, new in pairs if old != new]
