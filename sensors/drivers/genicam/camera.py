"""A GenICam camera behind the `Camera` protocol: triggered by command, by a line, or by an action command.

The images go one way: the library's ring of buffers, from which each is copied (or unpacked) once into an
array of its own. So the ring is free again at once, whoever keeps the image for however long.
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

from alignment.errors import CameraConnectionError, CameraError, CameraTimeoutError
from sensors.camera import CameraSettings, Frame
from sensors.drivers.driver import SeenCamera
from sensors.drivers.genicam.counting import FrameIds
from sensors.drivers.genicam.device import Buffer, Device
from sensors.drivers.genicam.options import GenICamOptions
from sensors.drivers.genicam.pixels import ImagePool, bytes_of_image, image_of
from sensors.drivers.genicam.settings import AppliedSettings, apply_settings, asked_of, require_there

READY_S = 2.0
"""Longest wait until a camera takes the next trigger, beside its exposure time."""
_SLICE_S = 0.25  # of a wait for a frame: how soon a camera that is closed meanwhile is noticed
_TEMPERATURE_EVERY_S = 20.0
_CLOSED = "was closed amid a call"
_BROKEN = (
    "Check its cable, its packet size and what else uses its network; lower the rate where they share one"
)


class GenICamCamera:
    """One camera; see `sensors.camera.Camera` for the protocol. `close` may come from another thread.

    Parameters
    ----------
    name
        Name of the camera.
    wanted
        Serial number or user's name by which the device is found.
    options
        Of its rig.
    device
        Returns the device, not open; called when there is none, or the one before failed.
    leads
        Whether its trigger makes the others of its rig expose; the rig triggers it last.
    clock
        Monotonic clock, seconds.
    """

    def __init__(
        self,
        name: str,
        wanted: str,
        options: GenICamOptions,
        device: Callable[[], Device],
        leads: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = name
        self.leads = leads
        self._wanted = wanted
        self._options = options
        self._make = device
        self._clock = clock
        self._device: Device | None = None
        self._closed: Device | None = None
        self._seen: SeenCamera | None = None
        self._expected_serial: str | None = None
        self._applied: AppliedSettings | None = None
        self._ids = FrameIds(0)
        self._triggers = self._looked_at = 0
        self._taken: deque[Frame] = deque()
        self._pool = ImagePool(2 * options.buffers)
        self._temperature: float | None = None
        self._temperature_s: float | None = None

    def connect(self) -> None:
        """Open the camera, and see that it is the one; see `Camera.connect`."""
        device = self._device
        if device is not None and not device.lost():
            return
        self.close()
        # One that was used before is tried once: where it fails, or hangs, the next attempt has a new one.
        device, self._closed = self._closed or self._make(), None
        try:
            with asked_of(self.name, device, "open"):
                seen = device.open()
            self._require_itself(seen)
            with asked_of(self.name, device, "load its default settings"):
                if device.get("UserSetSelector") is not None:
                    # What somebody tried out last stays in a camera; only the configuration shall count.
                    device.set("UserSetSelector", "Default")
                    device.execute("UserSetLoad")
        except CameraConnectionError:
            _let_go(device)
            raise
        except CameraError as error:
            _let_go(device)
            raise CameraConnectionError(self.name, error.problem, error.cure) from error
        self._seen, self._device = seen, device
        self._temperature = self._temperature_s = None

    def arm(self, settings: CameraSettings) -> None:
        """Set everything and read it back, begin a new acquisition; see `Camera.arm`."""
        device = self._require_connection()
        assert self._seen is not None
        self._applied = None
        with self._asked(device, "arm"):
            device.stop()
            applied = apply_settings(self.name, device, self._seen, self._options, settings, self.leads)
            self._ids = FrameIds(device.first_frame_id)
            self._triggers = self._looked_at = 0
            self._taken.clear()
            device.start(self._options.buffers)
            if self._device is not device:
                raise CameraConnectionError(self.name, _CLOSED)
            self._applied = applied
            self._await_ready(device)
            self._read_temperature(device)

    def trigger(self) -> int:
        """Expose by command, or count what another signal exposes; see `Camera.trigger`."""
        device, applied = self._require_armed()
        with self._asked(device, "trigger"):
            # A trigger amid an exposure, or just after its image came, would be ignored, also that of a line.
            self._await_ready(device)
            if self._options.trigger_source == "Off":
                self._take_next(device, applied)
            elif not self._options.waits or (self.leads and self._options.action is None):
                device.execute("TriggerSoftware")
            elif self.leads and self._options.action is not None:
                device.fire(self._options.action.action())
        self._triggers += 1
        return self._triggers

    def fetch(self, timeout_s: float) -> Frame:
        """Return the next frame; see `Camera.fetch`.

        Raises
        ------
        CameraError
            When the frame is not whole, is no image as the camera was set to send, or has no number; when a
            setting has changed.
        """
        device, applied = self._require_armed()
        if self._options.trigger_source == "Off":
            if not self._taken:
                raise self._none_within(timeout_s)
            return self._taken.popleft()
        ends_s = self._clock() + max(0.0, timeout_s)
        if self._looked_at < self._triggers:
            # While the exposure lasts the reading costs nothing.
            self._looked_at = self._triggers
            applied.require_unchanged()
        while True:
            left_s = max(0.0, ends_s - self._clock())
            with self._asked(device, "fetch"):
                buffer = device.retrieve(min(left_s, _SLICE_S))
                received_s = self._clock()
                if buffer is not None:
                    return self._frame(buffer, applied, received_s)
            if self._device is not device:
                raise CameraConnectionError(self.name, _CLOSED)
            if left_s <= _SLICE_S:
                with self._asked(device, "fetch"):
                    require_there(self.name, device)
                raise self._none_within(timeout_s)

    def close(self) -> None:
        """Let the camera go; see `Camera.close`."""
        device, self._device, self._applied = self._device, None, None
        self._pool = ImagePool(2 * self._options.buffers)
        if device is not None:
            with asked_of(self.name, device, "close"):
                device.close()
            self._closed = device

    @contextlib.contextmanager
    def _asked(self, device: Device, what: str) -> Iterator[None]:
        """As `asked_of`; what a closed device raises means that it was closed."""
        try:
            with asked_of(self.name, device, what):
                yield
        except CameraConnectionError:
            raise
        except CameraError as error:
            if self._device is not device:
                raise CameraConnectionError(self.name, _CLOSED) from error
            raise

    def _none_within(self, timeout_s: float) -> CameraTimeoutError:
        return CameraTimeoutError(
            self.name,
            f"expected a frame within {max(0.0, timeout_s):g} s, {self._triggers} triggers since armed",
        )

    def _frame(self, buffer: Buffer, applied: AppliedSettings, received_s: float) -> Frame:
        try:
            if buffer.frame_id is None:
                raise CameraError(
                    self.name,
                    "expected frames that the camera numbers, this one has no number",
                    "Use a camera, or a transport, whose frames have one: they are paired by it",
                )
            counter = self._ids.counter(buffer.frame_id)
            self._require_whole(buffer, counter)
            image = image_of(
                buffer.data,
                buffer.pixel_format,
                buffer.width,
                buffer.height,
                buffer.padding,
                self._pool.empty,
            )
        finally:
            buffer.release()
        return Frame(
            camera=self.name,
            image=image,
            trigger_counter=counter,
            device_time_s=buffer.timestamp_s,
            host_time_s=received_s,
            exposure_ms=applied.exposure_ms,
            in_force=applied.in_force,
            temperature_c=self._temperature,
        )

    def _require_whole(self, buffer: Buffer, counter: int) -> None:
        options = self._options
        if buffer.problem is not None:
            raise CameraError(
                self.name, f"the frame of trigger {counter} is incomplete: {buffer.problem}", _BROKEN
            )
        if buffer.pixel_format != options.pixel_format:
            raise CameraError(
                self.name,
                f"expected pixels of {options.pixel_format}, as it was set, trigger {counter} came with "
                f"{buffer.pixel_format}",
                "Arm the rig again",
            )
        needed = bytes_of_image(buffer.pixel_format, buffer.width, buffer.height, buffer.padding)
        if len(buffer.data) < needed or not needed:
            raise CameraError(
                self.name,
                f"the frame of trigger {counter} is incomplete: expected {needed} bytes of "
                f"{buffer.width} × {buffer.height} pixels, its buffer has {len(buffer.data)}",
                _BROKEN,
            )

    def _take_next(self, device: Device, applied: AppliedSettings) -> None:
        """Take the next frame that was begun after now; of a camera that runs freely."""
        passed = 0
        while passed <= self._options.buffers and (buffer := device.retrieve(0.0)) is not None:
            buffer.release()
            passed += 1
        buffer = device.retrieve(READY_S)
        if buffer is not None:
            buffer.release()
            buffer = device.retrieve(READY_S)
        if buffer is not None and len(self._taken) < self._options.buffers:
            frame = self._frame(buffer, applied, self._clock())
            self._taken.append(replace(frame, trigger_counter=self._triggers + 1))
        elif buffer is not None:
            buffer.release()

    def _await_ready(self, device: Device) -> None:
        applied = self._applied
        if self._options.trigger_source == "Off" or applied is None:
            return
        bound_s = READY_S + applied.exposure_ms / 1e3
        if not device.wait_ready(bound_s):
            raise CameraError(
                self.name,
                f"expected to be ready for the next trigger within {bound_s:g} s, it is not",
                "Connect it again; if it stays, lower the rate of the exposures",
            )

    def _read_temperature(self, device: Device) -> None:
        now_s = self._clock()
        if self._temperature_s is None or now_s - self._temperature_s >= _TEMPERATURE_EVERY_S:
            value = device.get("DeviceTemperature")
            if value is None:
                value = device.get("TemperatureAbs")
            self._temperature = float(value) if isinstance(value, int | float) else None
            self._temperature_s = now_s

    def _require_itself(self, seen: SeenCamera) -> None:
        expected = self._expected_serial or self._wanted
        if expected not in (seen.serial_number, *([] if self._expected_serial else [seen.user_name])):
            raise CameraConnectionError(
                self.name,
                f"expected the camera '{expected}', it answers with serial number {seen.serial_number} "
                f"({seen.model})",
                "Connect the camera that was calibrated here, or name the new one in the configuration and "
                "calibrate",
            )
        self._expected_serial = seen.serial_number

    def _require_connection(self) -> Device:
        # Whether it is lost is asked where something failed: the question waits for the transfer under way.
        device = self._device
        if device is None:
            raise CameraConnectionError(self.name, "is not connected", "Connect it first")
        return device

    def _require_armed(self) -> tuple[Device, AppliedSettings]:
        device, applied = self._require_connection(), self._applied
        if applied is None and self._device is not device:
            self._require_connection()  # closed by another thread amid this one
        if applied is None:
            raise CameraError(self.name, "is not armed", "Arm it first: its settings are not known")
        return device, applied


def _let_go(device: Device) -> None:
    try:
        device.close()
    except Exception:  # noqa: BLE001  (that it did not open is the news)
        return
