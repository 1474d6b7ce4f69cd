"""The driver ``genicam``: cameras of any maker whose software brings a GenTL producer, through harvesters."""

from __future__ import annotations

import contextlib
import os
import threading
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from alignment.errors import CameraConnectionError, ConfigurationError, told
from alignment.values import Side
from sensors.drivers.driver import RigDriver, RigPlace, SeenCamera
from sensors.drivers.genicam.device import NOTHING, Action, Buffer, Device, FeatureValue
from sensors.drivers.genicam.options import GenICamOptions, check_options
from sensors.drivers.genicam.pixels import name_of_format
from sensors.drivers.genicam.rig import genicam_rig
from sensors.formats.validation import FilePath
from sensors.rig import Rig

PRODUCERS_PATH = "GENICAM_GENTL64_PATH"
"""Folders in which makers' software says that its producers are."""
_NANOSECONDS = 1e9
_LEAST_WAIT_S = 1e-4  # harvesters takes 0 for no bound at all
_READY_POLL_S = 0.002
_CLOSE_S = 1.0
_UNKNOWN_ID = 2**64 - 1


class ProducerOptions(GenICamOptions):
    """GenICam cameras of a rig, through a GenTL producer."""

    producer: FilePath = Field(description="The producer of the cameras' maker, a file that ends in .cti")


class Producers:
    """The producers that are open in this process: a library may be opened once, for all of its cameras."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._open: dict[Path, Any] = {}
        self._users: Counter[Path] = Counter()

    @contextlib.contextmanager
    def searching(self, path: Path) -> Iterator[Any]:
        """Lend the harvester of a producer to one at a time.

        Its list of cameras is from when the first of them was opened: a new one would close all.
        """
        with self._lock:
            self.enter(path)
            try:
                yield self._open[path]
            finally:
                self.leave(path)

    def enter(self, path: Path) -> None:
        """Open the producer, unless it is open."""
        with self._lock:
            if path not in self._open:
                self._open[path] = _harvester(path)
            self._users[path] += 1

    def leave(self, path: Path) -> None:
        """Close it after the last one."""
        with self._lock:
            self._users[path] -= 1
            if self._users[path] <= 0:
                self._users.pop(path)
                self._open.pop(path).reset()


PRODUCERS = Producers()


class ProducerDevice:
    """See `Device`.

    Parameters
    ----------
    name
        Of the camera in the station, for errors.
    wanted
        Serial number or user's name.
    producer
        File of the GenTL producer.
    producers
        Those that are open.
    """

    def __init__(self, name: str, wanted: str, producer: Path, producers: Producers = PRODUCERS) -> None:
        self._name = name
        self._wanted = wanted
        self._producer = producer
        self._producers = producers
        self._acquirer: Any = None
        self._nodes: Any = None
        self._transport = ""
        self._incomplete = threading.Event()
        self._waiting = threading.Lock()

    @property
    def first_frame_id(self) -> int:
        """0 with USB3 Vision, 1 with the others."""
        return 0 if self._transport == "U3V" else 1

    def open(self) -> SeenCamera:
        """See `Device.open`."""
        with self._producers.searching(self._producer) as harvester:
            infos = list(harvester.device_info_list)
            seen = [_seen(info) for info in infos]
            index = next((n for n, one in enumerate(seen) if one.serial_number == self._wanted), None)
            if index is None:
                index = next((n for n, one in enumerate(seen) if one.user_name == self._wanted), None)
            if index is None:
                raise CameraConnectionError(
                    self._name,
                    f"expected a camera '{self._wanted}', the producer {self._producer.name} sees "
                    f"{', '.join(one.serial_number for one in seen[:12]) or 'none'}",
                    "Check its power, its cable and its address, and the serial number in the configuration; "
                    "one that was not there when the first of this producer was opened is found once all of "
                    "them are closed",
                )
            self._acquirer = harvester.create(index)
            self._producers.enter(self._producer)
        self._transport = _said(infos[index], "tl_type")
        self._nodes = self._acquirer.remote_device.node_map
        events = type(self._acquirer).Events
        self._acquirer.add_callback(events.INCOMPLETE_BUFFER, _noting(self._incomplete))
        said = self.get("DeviceSerialNumber") or self.get("DeviceID") or seen[index].serial_number
        return SeenCamera(str(said), seen[index].model, seen[index].address, seen[index].user_name)

    def lost(self) -> bool:
        """See `Device.lost`."""
        return False  # (GenTL tells of it by errors alone)

    def close(self) -> None:
        """See `Device.close`."""
        acquirer, self._acquirer, self._nodes = self._acquirer, None, None
        if acquirer is not None:
            # Whoever waits in the library leaves it first; one that hangs there is not waited for.
            left = self._waiting.acquire(timeout=_CLOSE_S)
            try:
                acquirer.stop()
                acquirer.destroy()
            finally:
                if left:
                    self._waiting.release()
                self._producers.leave(self._producer)

    def get(self, name: str) -> FeatureValue | None:
        """See `Device.get`."""
        from genicam import genapi

        node = self._node(name)
        readable = (genapi.EAccessMode.RO, genapi.EAccessMode.RW)
        if node is None or node.get_access_mode() not in readable:
            return None
        value: FeatureValue | None = None
        if isinstance(node, genapi.IEnumeration):
            value = str(node.to_string(False, True))
        elif isinstance(node, genapi.IInteger | genapi.IFloat | genapi.IBoolean | genapi.IString):
            value = node.get_value(False, True)
        return value

    def set(self, name: str, value: FeatureValue) -> None:
        """See `Device.set`."""
        from genicam import genapi

        node = self._node(name)
        if node is None:
            raise LookupError(name)
        node.value = float(value) if isinstance(node, genapi.IFloat) else value

    def limits(self, name: str) -> tuple[float, float] | None:
        """See `Device.limits`."""
        from genicam import genapi

        node = self._node(name)
        if not isinstance(node, genapi.IInteger | genapi.IFloat):
            return None
        return float(node.min), float(node.max)

    def choices(self, name: str) -> tuple[str, ...]:
        """See `Device.choices`."""
        from genicam import genapi

        node = self._node(name)
        return tuple(node.symbolics) if isinstance(node, genapi.IEnumeration) else ()

    def execute(self, name: str) -> None:
        """See `Device.execute`."""
        node = self._node(name)
        if node is None:
            raise LookupError(name)
        node.execute()

    def start(self, buffers: int) -> None:
        """See `Device.start`."""
        self._acquirer.num_buffers = max(buffers, self._acquirer.min_num_buffers)
        self._incomplete.clear()
        self._acquirer.start()

    def wait_ready(self, timeout_s: float) -> bool:
        """See `Device.wait_ready`; a camera that does not tell is taken to be ready."""
        names = ("AcquisitionStatusSelector", "AcquisitionStatus")
        if any(self.get(name) is None for name in names):
            return True
        self.set(names[0], "FrameTriggerWait")
        ends_s = time.monotonic() + timeout_s
        while not self.get(names[1]):
            if time.monotonic() >= ends_s or self._acquirer is None:
                return False
            time.sleep(_READY_POLL_S)
        return True

    def retrieve(self, timeout_s: float) -> Buffer | None:
        """See `Device.retrieve`."""
        acquirer = self._acquirer
        if acquirer is None or not acquirer.is_acquiring():
            return None
        try:
            with self._waiting:
                module = acquirer.try_fetch(timeout=max(timeout_s, _LEAST_WAIT_S), is_raw=True)
        except Exception:
            if self._acquirer is None:
                return None  # closed meanwhile: whoever waited learns of it from the camera
            raise
        if module is not None:
            return _lent(module)
        if self._incomplete.is_set():
            self._incomplete.clear()
            problem = "packets of it are missing"
            return Buffer(None, 0.0, "", 0, 0, 0, NOTHING, problem, _nothing_to_release)
        return None

    def stop(self) -> None:
        """See `Device.stop`."""
        if self._acquirer is not None and self._acquirer.is_acquiring():
            self._acquirer.stop()

    def fire(self, action: Action) -> None:
        """GenTL has no action command; `check` refuses one."""
        raise NotImplementedError(f"an action command to {action.address}")

    def _node(self, name: str) -> Any:
        nodes = self._nodes
        return nodes.get_node(name) if nodes is not None and nodes.has_node(name) else None


def _check(options: ProducerOptions, place: RigPlace) -> None:
    """Find what is wrong without a camera.

    Raises
    ------
    ConfigurationError
        When options contradict each other, the library or the producer is missing.
    """
    check_options(options, place)
    if options.action is not None:
        raise ConfigurationError(
            field="trigger_source",
            expected="Software, a line or Off: GenTL, which reaches these cameras, has no action command",
            seen=f"'{options.trigger_source}'",
            cure="Wire a trigger line, or use the driver of the cameras' maker",
        )
    _library()
    path = place.folder / options.producer
    if path.suffix != ".cti" or not path.is_file():
        raise ConfigurationError(
            field="producer",
            expected="the GenTL producer of the cameras' maker, a file that ends in .cti",
            seen=f"'{options.producer}'" + ("" if path.is_file() else ", no such file"),
            cure=f"Install the maker's software; {PRODUCERS_PATH} names the folders of its producers",
        )


def _make(options: ProducerOptions, place: RigPlace) -> Rig:
    """Return the rig, not connected; see `RigDriver.make`."""
    _check(options, place)
    producer = (place.folder / options.producer).resolve()

    def device(head: str, side: Side, wanted: str) -> Device:
        return ProducerDevice(place.camera(head, side).name, wanted, producer)

    return genicam_rig(options, place, device)


def _discover() -> list[SeenCamera]:
    """Return the cameras of all producers that makers' software has announced."""
    _library()
    folders = [Path(name) for name in os.environ.get(PRODUCERS_PATH, "").split(os.pathsep) if name]
    found = []
    for path in sorted({file.resolve() for folder in folders for file in folder.glob("*.cti")}):
        with PRODUCERS.searching(path) as harvester:
            found += [_seen(info) for info in harvester.device_info_list]
    return found


def _library() -> Any:
    try:
        with warnings.catch_warnings():
            # Of its bindings, which no user can do anything about.
            warnings.simplefilter("ignore", DeprecationWarning)
            from harvesters import core
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            expected="the library 'harvesters' for GenICam cameras",
            seen=f"none (no module '{error.name}')",
            cure="Install it: pip install 'truewheel[genicam]'",
        ) from error
    except Exception as error:
        raise ConfigurationError(
            expected="the library 'harvesters' for GenICam cameras, whole",
            seen=told(error),
            cure="Install it anew: pip install 'truewheel[genicam]'",
        ) from error
    return core


def _harvester(path: Path) -> Any:
    harvester = _library().Harvester()
    try:
        harvester.add_file(str(path), check_existence=True)
        harvester.update()
    except Exception as error:
        with contextlib.suppress(Exception):
            harvester.reset()
        raise ConfigurationError(
            field="producer",
            expected="a GenTL producer that can be opened",
            seen=f"'{path}': {told(error)}",
            cure="Install the maker's software anew",
        ) from error
    return harvester


def _noting(event: threading.Event) -> Any:
    """Return a callback of harvesters, which drops incomplete buffers and tells of them only so."""

    class Noting(_library().Callback):  # type: ignore[misc]
        def emit(self, context: object | None = None) -> None:
            event.set()

    return Noting()


def _seen(info: Any) -> SeenCamera:
    return SeenCamera(
        _said(info, "serial_number"),
        _said(info, "model"),
        _said(info, "id_"),
        _said(info, "user_defined_name"),
    )


def _said(owner: Any, name: str) -> str:
    """What a producer says of something; empty where it does not know."""
    try:
        return str(getattr(owner, name) or "")
    except Exception:  # noqa: BLE001  (every producer has errors of its own for what it does not know)
        return ""


def _lent(module: Any) -> Buffer:
    def number(name: str, otherwise: int = 0) -> int:
        try:
            return int(getattr(module, name))
        except Exception:  # noqa: BLE001  (as above)
            return otherwise

    pixel_format = name_of_format(number("pixel_format"))
    width, height, padding = number("width"), number("height"), number("padding_x")
    start = number("image_offset")
    data = np.frombuffer(module.raw_buffer, np.uint8)[start : number("size_filled", 1 << 62)]
    identity = number("frame_id", _UNKNOWN_ID)
    return Buffer(
        frame_id=None if identity == _UNKNOWN_ID else identity,
        timestamp_s=number("timestamp_ns") / _NANOSECONDS,
        pixel_format=pixel_format,
        width=width,
        height=height,
        padding=padding,
        data=data,
        problem=None,
        release=lambda: module.parent.queue_buffer(module),
    )


def _nothing_to_release() -> None:
    """Harvesters has taken an incomplete buffer back already."""


DRIVER = RigDriver(ProducerOptions, _make, check=_check, discover=_discover)
"""The driver ``genicam``."""
