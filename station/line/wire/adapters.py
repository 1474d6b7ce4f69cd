"""CAN adapters by the name of their python-can interface: what each needs to be installed, and what it says.

The part of python-can for an adapter, and the driver below it, may raise anything: a name that was never
defined because a library is missing, the end of the program, errors of its own that descend from nothing
common. Whatever it is becomes one sentence with what to install.
"""

from __future__ import annotations

import re

from alignment.errors import ConfigurationError, told

_NEEDS = {
    "canalystii": "the Python package 'canalystii'",
    "cantact": "the Python package 'cantact'",
    "etas": "ETAS's BOA driver (Windows only)",
    "gs_usb": "the Python package 'gs_usb', with libusb",
    "iscan": "Thorsis's isCAN driver (iscandrv)",
    "ixxat": "HMS's IXXAT VCI driver (Windows only; on Linux its SocketCAN driver, interface 'socketcan')",
    "kvaser": "Kvaser's canlib driver (linuxcan)",
    "neousys": "Neousys's WDT_DIO driver",
    "neovi": "the Python packages 'python-ics' and 'filelock', with Intrepid's driver",
    "nican": "National Instruments' NI-CAN driver (32-bit Windows only)",
    "nixnet": "National Instruments' NI-XNET driver and the Python package 'nixnet' (Windows only)",
    "pcan": "PEAK's PCAN-Basic library (libpcanbasic), or use interface 'socketcan' with the kernel's driver",
    "seeedstudio": "the Python package 'pyserial'",
    "serial": "the Python package 'pyserial'",
    "slcan": "the Python package 'pyserial'",
    "robotell": "the Python package 'pyserial'",
    "socketcan": "the kernel's driver of the adapter, and set the channel up: `ip link set can0 up type can "
    "bitrate 500000`",
    "systec": "SYS TEC's USB-CANmodul driver (Windows only; on Linux its SocketCAN driver, and interface "
    "'socketcan')",
    "usb2can": "8devices' USB2CAN driver and the Python package 'pywin32' (Windows only)",
    "vector": "Vector's XL driver library (Windows only)",
}
"""What the interfaces of python-can need beside it; one that is not here needs nothing that is known."""
_OPTION = re.compile(r"argument|parameter|option|keyword", re.IGNORECASE)
FOREIGN = (Exception, SystemExit)
"""Whatever the code of an adapter raises, other than a person's wish to end the program."""


def said(error: BaseException) -> str:
    """Return what an adapter says: its own text, with its kind where that alone is clear."""
    text = " ".join(str(error).split())
    if not text or not isinstance(error, OSError | ValueError):
        return told(error)
    return text


def unopened(interface: str, channel: str, error: BaseException) -> ConfigurationError:
    """Return the one error for a channel that does not open, with its cure."""
    needs = _NEEDS.get(interface)
    missing = isinstance(error, ImportError | NameError | AttributeError | NotImplementedError)
    cure = "Check that the adapter is plugged in, its driver installed and no other program has the channel"
    if isinstance(error, TypeError) and _OPTION.search(str(error)):
        cure = "Check the options of the line: this interface has others"
    elif missing:
        cure = "Its driver is not installed, or is not for this computer"
    if needs is not None:
        cure += f". This interface needs {needs}"
        if missing:
            cure += ": install it"
    return ConfigurationError(
        field="line.channel",
        expected=f"a channel of the interface '{interface}' that opens",
        seen=f"'{channel}': {said(error)}",
        cure=cure,
    )
