"""The driver ``pylon``: a rig of Basler cameras, or of pylon's emulated ones."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import Field

from alignment.errors import ConfigurationError
from alignment.values import Side
from sensors.drivers.driver import RigDriver, RigPlace
from sensors.drivers.genicam.device import Device
from sensors.drivers.genicam.options import GenICamOptions, check_options
from sensors.drivers.genicam.rig import genicam_rig
from sensors.drivers.pylon.device import PylonDevice
from sensors.drivers.pylon.emulation import EmulatedDevice, images_of
from sensors.drivers.pylon.library import EMULATION, basler_cameras, emulate, load_pylon
from sensors.drivers.recorded import RecordedOptions, shot_folders
from sensors.formats import FilePath, StrictModel
from sensors.rig import Rig

_SERIAL = "0815-"
_MOST_EMULATED = 256
_CLASSES = {"GigE": "BaslerGigE", "USB": "BaslerUsb", "emulation": EMULATION, "any": None}


class EmulationOptions(StrictModel):
    """Emulated cameras, for a first try and for tests: the maker's code runs, images come from files."""

    shots: FilePath = Field(description="Folder of recorded shots, shown in the order of their names")


class PylonOptions(GenICamOptions):
    """Basler cameras of a rig."""

    transport: Literal["any", "GigE", "USB", "emulation"] = Field(
        default="any", description="Where the cameras are looked for"
    )
    emulation: EmulationOptions | None = Field(
        default=None, description="Emulated cameras in place of real ones; serial numbers 0815-0000 and on"
    )


def _check(options: PylonOptions, place: RigPlace) -> None:
    """Find what is wrong without a camera.

    Raises
    ------
    ConfigurationError
        When options contradict each other, the library is missing, or there are no shots for an emulation.
    FormatError
        When a recorded shot of an emulation cannot be read.
    """
    check_options(options, place)
    load_pylon()
    if options.emulation is None:
        return
    for head in options.cameras:
        for number, camera in enumerate(options.cameras[head]):
            if not _is_emulated(camera):
                raise ConfigurationError(
                    field=f"cameras.{head}[{number}]",
                    expected=f"the serial number of an emulated camera, {_SERIAL}0000 to "
                    f"{_SERIAL}{_MOST_EMULATED - 1:04d}",
                    seen=f"'{camera}'",
                )
    folders = _folders(options, place)
    for head in place.heads or options.cameras:
        images_of(folders, head, "left")


def _make(options: PylonOptions, place: RigPlace) -> Rig:
    """Return the rig, not connected; see `RigDriver.make`."""
    _check(options, place)
    if options.emulation is None:
        device_class = _CLASSES[options.transport]

        def device(head: str, side: Side, wanted: str) -> Device:
            return PylonDevice(place.camera(head, side).name, wanted, device_class)

        return genicam_rig(options, place, device)
    folders = _folders(options, place)
    numbers = [int(camera.removeprefix(_SERIAL)) for pair in options.cameras.values() for camera in pair]
    emulate(max(numbers) + 1)

    @cache
    def shown(head: str, side: Side) -> tuple[Path, ...]:
        return images_of(folders, head, side)

    def emulated(head: str, side: Side, wanted: str) -> Device:
        return EmulatedDevice(place.camera(head, side).name, wanted, shown(head, side))

    return genicam_rig(options, place, emulated, repeats=len(folders) == 1)


def _folders(options: PylonOptions, place: RigPlace) -> list[Path]:
    assert options.emulation is not None
    try:
        return shot_folders(RecordedOptions(shots=options.emulation.shots), place)
    except ConfigurationError as error:
        raise ConfigurationError(
            field="emulation.shots", expected=error.expected, seen=error.seen, cure=error.cure
        ) from error


def _is_emulated(camera: str) -> bool:
    number = camera.removeprefix(_SERIAL)
    return camera == f"{_SERIAL}{number:0>4}" and number.isdecimal() and int(number) < _MOST_EMULATED


DRIVER = RigDriver(PylonOptions, _make, check=_check, discover=basler_cameras)
"""The driver ``pylon``."""
