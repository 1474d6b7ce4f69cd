"""A rig of GenICam cameras, of whatever maker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from alignment.values import Side
from sensors.drivers.driver import RigPlace
from sensors.drivers.genicam.camera import GenICamCamera
from sensors.drivers.genicam.device import Device
from sensors.drivers.genicam.options import GenICamOptions, check_options
from sensors.rig import Rig, StereoHead

DeviceOf = Callable[[str, Side, str], Device]
"""Head, side, and how the camera is named in the configuration; returns its device, not open."""


def genicam_rig(options: GenICamOptions, place: RigPlace, device: DeviceOf, repeats: bool = False) -> Rig:
    """Return the rig, not connected, with one camera for each that the options name.

    Parameters
    ----------
    options
        Of the rig; its heads are those of the calibration, or all that are named where there is none.
    place
        The rig.
    device
        Makes the devices, at each connection.
    repeats
        The same images come again on purpose.

    Raises
    ------
    ConfigurationError
        As `check_options`.
    """
    check_options(options, place)

    def camera(head: str, side: Side) -> GenICamCamera:
        wanted = options.cameras[head][0 if side == "left" else 1]
        return GenICamCamera(
            place.camera(head, side).name,
            wanted,
            options,
            lambda: device(head, side, wanted),
            options.leads(head, side),
        )

    heads = [StereoHead(h, camera(h, "left"), camera(h, "right")) for h in place.heads or options.cameras]
    tolerance = replace(place.tolerance, repeats=repeats)
    return Rig(place.rig, heads, place.settings, tolerance=tolerance)
