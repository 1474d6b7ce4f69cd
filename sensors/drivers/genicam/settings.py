"""Settings of a GenICam camera: set by name, read back, watched. What a camera did not take is an error."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass

from alignment.counting import listed
from alignment.errors import CameraConnectionError, CameraError, told
from sensors.camera import CameraSettings, SettingsInForce
from sensors.drivers.driver import SeenCamera
from sensors.drivers.genicam.device import Device, FeatureValue
from sensors.drivers.genicam.options import GenICamOptions
from sensors.drivers.genicam.pixels import BITS

_EXPOSURE = ("ExposureTime", "ExposureTimeAbs")  # of SFNC 2, and of cameras from before
_PTP = ("PtpEnable", "GevIEEE1588")
_PTP_STATUS = ("PtpStatus", "GevIEEE1588Status")
_SYNCHRONISED = ("Master", "Slave")
_GAIN_TOLERANCE_DB = 0.1
_RELATIVE = 1e-6  # by which a number may differ that no camera has reason to round
_ANEW = "Connect the camera again; if it stays, see what else uses it"


@dataclass(frozen=True)
class Wanted:
    """A feature, what it must be, and by how much a number may be rounded."""

    feature: str
    value: FeatureValue
    tolerance: float = 0.0

    def is_met(self, seen: FeatureValue | None) -> bool:
        """Whether the camera has it so."""
        if isinstance(self.value, bool | str) or isinstance(seen, bool | str) or seen is None:
            return seen == self.value
        return math.isclose(seen, self.value, rel_tol=_RELATIVE, abs_tol=self.tolerance)


class CameraFeatures:
    """The features of one open camera, with errors that name it.

    Parameters
    ----------
    camera
        Name of the camera, for the errors.
    device
        Open.
    """

    def __init__(self, camera: str, device: Device) -> None:
        self._camera = camera
        self._device = device

    def first_of(self, names: tuple[str, ...]) -> str | None:
        """Return the first of several names that the camera has."""
        return next((name for name in names if self._device.get(name) is not None), None)

    def take(self, wanted: Wanted) -> None:
        """Set a feature, unless it is so already.

        Raises
        ------
        CameraError
            When the camera has no such feature, or refuses the value.
        """
        name, value = wanted.feature, wanted.value
        with asked_of(self._camera, self._device, f"set {name}"):
            if self._device.get(name) == value:
                return
            try:
                self._device.set(name, value)
            except LookupError as error:
                raise CameraError(
                    self._camera,
                    f"expected to set {name} to {value}, it has no such feature",
                    "Leave the setting out, or use a camera that has it",
                ) from error
            except Exception as error:
                if self._device.lost():
                    raise
                raise CameraError(
                    self._camera,
                    f"expected to set {name} to {value}, it refused: {told(error)}{self._possible(name)}",
                    "Set what it can take",
                ) from error

    def take_if_there(self, name: str, value: FeatureValue) -> None:
        """Set a feature that not every camera has; one that cannot be written is left alone."""
        with asked_of(self._camera, self._device, f"set {name}"):
            if self._device.get(name) not in (None, value):
                # Not writable in this mode: what matters is looked at in the images or read back later.
                with contextlib.suppress(Exception):
                    self._device.set(name, value)

    def require(self, wanted: Wanted, when: str, cure: str) -> None:
        """Raise unless a feature is what it must be."""
        with asked_of(self._camera, self._device, f"read {wanted.feature}"):
            seen = self._device.get(wanted.feature)
        if not wanted.is_met(seen):
            raise CameraError(
                self._camera,
                f"expected {wanted.feature} {wanted.value}{when}, it is "
                f"{'not readable' if seen is None else seen}{self._possible(wanted.feature)}",
                cure,
            )

    def _possible(self, name: str) -> str:
        limits, choices = self._device.limits(name), self._device.choices(name)
        if limits is not None:
            return f" (it takes {limits[0]:g} to {limits[1]:g})"
        return f" (it takes {listed(list(choices))})" if choices else ""


class AppliedSettings:
    """What a camera was told and took; `of` tells it.

    Attributes
    ----------
    in_force
        As read back; None of a camera that has neither exposure time nor trigger.
    exposure_ms
        In force, or where the camera has no such feature what it was asked for.
    """

    def __init__(
        self,
        features: CameraFeatures,
        wanted: tuple[Wanted, ...],
        in_force: SettingsInForce | None,
        exposure_ms: float,
    ) -> None:
        self._features = features
        self._each_time = tuple(one for one in wanted if one.feature in (*_EXPOSURE, "Gain"))
        self._in_turn = tuple(one for one in wanted if one not in self._each_time)
        self._turn = 0
        self.in_force = in_force
        self.exposure_ms = exposure_ms

    def require_unchanged(self) -> None:
        """Raise `CameraError` when a setting has changed since: exposure and gain are read each time, the
        others in turn, one at a time."""
        others = self._in_turn[self._turn : self._turn + 1]
        self._turn = (self._turn + 1) % max(1, len(self._in_turn))
        for one in (*self._each_time, *others):
            self._features.require(
                one, " as when it was armed", "Arm the rig again; if it changes again, see what else sets it"
            )


def apply_settings(
    camera: str,
    device: Device,
    seen: SeenCamera,
    options: GenICamOptions,
    settings: CameraSettings,
    leads: bool,
) -> AppliedSettings:
    """Set everything, then read everything back.

    Parameters
    ----------
    camera
        Name of the camera.
    device
        Open, without an acquisition.
    seen
        What it said of itself.
    options, settings
        What it is told.
    leads
        Whether it is triggered by command while the others wait for its line.

    Raises
    ------
    CameraError
        When it has no such setting, refuses one, or took another than it was told.
    """
    features = CameraFeatures(camera, device)
    # Whatever another program left switched on would do its work behind these settings.
    for name, value in (
        ("AcquisitionMode", "Continuous"),
        ("ExposureAuto", "Off"),
        ("GainAuto", "Off"),
        ("ExposureMode", "Timed"),
        ("AcquisitionFrameRateEnable", False),
    ):
        features.take_if_there(name, value)
    wanted = [*_trigger(options, leads), Wanted("PixelFormat", options.pixel_format)]
    wanted += _region(device, options)
    if options.packet_size is not None:
        wanted.append(Wanted("GevSCPSPacketSize", options.packet_size))
    free = options.trigger_source == "Off"
    exposure = features.first_of(_EXPOSURE)
    if exposure is not None or not free:
        microseconds = 1e3 * settings.exposure_ms
        tolerance = options.exposure_tolerance * microseconds
        wanted.append(Wanted(exposure or _EXPOSURE[0], microseconds, tolerance))
    if device.get("Gain") is not None or settings.gain_db:
        wanted.append(Wanted("Gain", settings.gain_db, _GAIN_TOLERANCE_DB))
    if options.ptp:
        wanted.append(Wanted(features.first_of(_PTP) or _PTP[0], True))
    selected = _outputs(options) + [Wanted(name, value) for name, value in options.features]
    for one in (*wanted, *selected):
        features.take(one)
    for one in (*wanted, *_last_of_each(selected)):
        features.require(one, " as it was set", "Set a value that it can take, or allow it to round more")
    if options.ptp:
        _require_synchronised(camera, features, device)
    in_force = None
    if exposure is not None:
        in_force = _read_back(device, seen, options, exposure)
    watched = tuple(one for one in wanted if one.feature not in ("OffsetX", "OffsetY", "TriggerSelector"))
    return AppliedSettings(
        features, watched, in_force, settings.exposure_ms if in_force is None else in_force.exposure_ms
    )


def _trigger(options: GenICamOptions, leads: bool) -> list[Wanted]:
    if options.trigger_source == "Off":
        return []
    by_line = options.trigger_source.startswith("Line")
    source = "Software" if by_line and leads else options.trigger_source
    found = [Wanted("TriggerSelector", "FrameStart"), Wanted("TriggerMode", "On")]
    found.append(Wanted("TriggerSource", source))
    if source.startswith("Line"):
        found.append(Wanted("TriggerActivation", options.trigger_activation))
    return found


def _outputs(options: GenICamOptions) -> list[Wanted]:
    """Return what is set through selectors, in the order in which it must be set."""
    found = []
    if options.exposure_output is not None:
        found += [
            Wanted("LineSelector", options.exposure_output),
            Wanted("LineMode", "Output"),
            Wanted("LineSource", "ExposureActive"),
        ]
    if options.action is not None:
        found += [
            Wanted("ActionSelector", int(options.trigger_source.removeprefix("Action"))),
            Wanted("ActionDeviceKey", options.action.device_key),
            Wanted("ActionGroupKey", options.action.group_key),
            Wanted("ActionGroupMask", options.action.group_mask),
        ]
    return found


def _last_of_each(selected: list[Wanted]) -> list[Wanted]:
    """A feature behind a selector is read back where it was set last; a device key can never be read."""
    last = {one.feature: one for one in selected if one.feature != "ActionDeviceKey"}
    return list(last.values())


def _region(device: Device, options: GenICamOptions) -> list[Wanted]:
    """The whole sensor, unless a region is asked for: one left in the camera would move the image."""
    region = options.region
    found = []
    for offset, size, first, most in (
        ("OffsetX", "Width", region and region.x, region and region.width),
        ("OffsetY", "Height", region and region.y, region and region.height),
    ):
        if device.get(offset) is not None:
            device.set(offset, 0)
            found.append(Wanted(offset, first or 0))
        limits = device.limits(size)
        if most is not None or limits is not None:
            # The size before the offset, which it bounds.
            found.insert(0, Wanted(size, int(limits[1]) if most is None and limits else most or 0))
    return found


def _require_synchronised(camera: str, features: CameraFeatures, device: Device) -> None:
    name = features.first_of(_PTP_STATUS)
    state = None if name is None else device.get(name)
    if state not in _SYNCHRONISED:
        raise CameraError(
            camera,
            f"expected its clock to be synchronised (PTP: {listed(list(_SYNCHRONISED))}), it says {state}",
            "Wait until the clocks agree, half a minute after power-up; see that the network carries PTP",
        )


def _read_back(device: Device, seen: SeenCamera, options: GenICamOptions, exposure: str) -> SettingsInForce:
    def number(name: str) -> float | None:
        value = device.get(name)
        return float(value) if isinstance(value, int | float) else None

    packet = number("GevSCPSPacketSize")
    names = dict.fromkeys(name for name, _ in options.features)
    if device.get("Gain") is None and device.get("GainRaw") is not None:
        # Steps of the camera's own: what they are in decibels only its manual says.
        names["GainRaw"] = None
    pixel_format = str(device.get("PixelFormat"))
    return SettingsInForce(
        model=seen.model,
        serial_number=seen.serial_number,
        exposure_ms=(number(exposure) or 0.0) / 1e3,
        gain_db=number("Gain") or 0.0,
        pixel_format=pixel_format,
        bits=BITS.get(pixel_format, 0),
        trigger_source="Off" if options.trigger_source == "Off" else str(device.get("TriggerSource")),
        packet_size=None if packet is None else int(packet),
        others=tuple(sorted((name, str(device.get(name))) for name in names)),
    )


def require_there(camera: str, device: Device) -> None:
    """Raise `CameraConnectionError` when the camera went away since it was opened."""
    if device.lost():
        raise CameraConnectionError(
            camera, "the connection was lost", "Check its power and its cable; it is connected again then"
        )


@contextlib.contextmanager
def asked_of(camera: str, device: Device, what: str) -> Iterator[None]:
    """Let whatever a maker's library raises be one clear error of this camera."""
    try:
        yield
    except CameraError:
        raise
    except Exception as error:
        try:
            require_there(camera, device)
        except CameraConnectionError as lost:
            raise lost from error
        raise CameraError(camera, f"its library failed ({what}): {told(error)}", _ANEW) from error
