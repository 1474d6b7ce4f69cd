"""pylon's library: loaded when a camera is asked for, and what it sees."""

from __future__ import annotations

import os
import warnings
from typing import Any

from alignment.errors import ConfigurationError, told
from sensors.drivers.driver import SeenCamera

EMULATION = "BaslerCamEmu"
"""Device class of the emulated cameras."""
EMULATED_CAMERAS = "PYLON_CAMEMU"
"""How many cameras the library emulates; read by it at each search."""


def load_pylon() -> Any:
    """Return the module ``pypylon.pylon``.

    Raises
    ------
    ConfigurationError
        When it is not installed, or does not load.
    """
    try:
        with warnings.catch_warnings():
            # Of its bindings, which no user can do anything about.
            warnings.simplefilter("ignore", DeprecationWarning)
            from pypylon import pylon
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            expected="Basler's library for its cameras",
            seen="none (no module 'pypylon')",
            cure="Install it: pip install 'truewheel[pylon]'",
        ) from error
    except Exception as error:
        raise ConfigurationError(
            expected="Basler's library for its cameras, whole",
            seen=told(error),
            cure="Install it anew: pip install 'truewheel[pylon]'",
        ) from error
    return pylon


def emulate(cameras: int) -> None:
    """Let the library emulate at least so many cameras in this process."""
    already = os.environ.get(EMULATED_CAMERAS, "")
    if not (already.isdigit() and int(already) >= cameras):
        os.environ[EMULATED_CAMERAS] = str(cameras)


def device_infos(device_class: str | None = None) -> list[Any]:
    """Return what the library finds: of one class, or of all; with emulation asked for those alone.

    The search for network cameras is a broadcast, which a trial without hardware does not need.
    """
    pylon = load_pylon()
    factory = pylon.TlFactory.GetInstance()
    if device_class is None and os.environ.get(EMULATED_CAMERAS, "0") not in ("", "0"):
        device_class = EMULATION
    if device_class is None:
        return list(factory.EnumerateDevices())
    layer = factory.CreateTl(device_class)
    try:
        return list(layer.EnumerateDevices())
    finally:
        factory.ReleaseTl(layer)


def seen_of(info: Any) -> SeenCamera:
    """Return what a camera says of itself in a search."""

    def text(name: str) -> str:
        found, value = info.GetPropertyValue(name)
        return str(value) if found else ""

    return SeenCamera(
        serial_number=text("SerialNumber"),
        model=text("ModelName"),
        address=text("IpAddress") or text("FullName"),
        user_name=text("UserDefinedName"),
    )


def basler_cameras() -> list[SeenCamera]:
    """Return all cameras that pylon sees."""
    return [seen_of(info) for info in device_infos()]
