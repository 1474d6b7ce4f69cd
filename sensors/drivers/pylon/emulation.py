"""pylon's emulated cameras, each fed with the images that one camera of recorded shots took."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from alignment.errors import FormatError
from alignment.values import Side
from sensors.drivers.driver import SeenCamera
from sensors.drivers.genicam.device import Buffer
from sensors.drivers.pylon.device import PylonDevice
from sensors.drivers.pylon.library import EMULATION
from sensors.formats.images import read_image
from sensors.formats.shot import SHOT_FILE, read_shot_file


def images_of(folders: Sequence[Path], head: str, side: Side) -> tuple[Path, ...]:
    """Return the image files of one camera in recorded shots, in their order.

    Raises
    ------
    FormatError
        When a shot cannot be read or has no such head.
    """
    found = []
    for folder in folders:
        heads = {one.name: one for one in read_shot_file(folder).heads}
        if head not in heads:
            raise FormatError(
                file=folder / SHOT_FILE,
                field="heads",
                expected=f"head '{head}', whose cameras are emulated",
                seen=", ".join(heads),
            )
        entry = heads[head].left if side == "left" else heads[head].right
        found.append(folder / entry.image)
    return tuple(found)


class EmulatedDevice(PylonDevice):
    """An emulated camera that shows files, one for each trigger, and begins again after the last.

    Parameters
    ----------
    name, wanted
        As for `PylonDevice`; emulated cameras have the serial numbers ``0815-0000``, ``0815-0001`` and so on.
    images
        What it shows.
    """

    def __init__(self, name: str, wanted: str, images: Sequence[Path]) -> None:
        super().__init__(name, wanted, EMULATION)
        self._images = tuple(images)
        self._shown = 0
        self._size = (0, 0)
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def open(self) -> SeenCamera:
        """See `Device.open`."""
        height, width = read_image(self._images[0]).shape
        self._size = (width, height)
        seen = super().open()
        self._shown = 0
        return seen

    def limits(self, name: str) -> tuple[float, float] | None:
        """See `Device.limits`; the emulated sensor is as large as its first image."""
        if name in ("Width", "Height"):
            return 1.0, float(self._size[name == "Height"])
        return super().limits(name)

    def start(self, buffers: int) -> None:
        """Go on with the image after the last one that was shown; the library begins with its first file."""
        self._forget_files()
        self._folder = tempfile.TemporaryDirectory(prefix="truewheel-emulation-")
        folder = Path(self._folder.name)
        for place in range(len(self._images)):
            image = self._images[(self._shown + place) % len(self._images)]
            (folder / f"{place:06d}{image.suffix}").symlink_to(image.resolve())
        self.set("TestImageSelector", "Off")
        self.set("ImageFileMode", "On")
        self.set("ImageFilename", str(folder))
        super().start(buffers)

    def retrieve(self, timeout_s: float) -> Buffer | None:
        """See `Device.retrieve`."""
        buffer = super().retrieve(timeout_s)
        if buffer is not None:
            self._shown += 1
        return buffer

    def close(self) -> None:
        """See `Device.close`."""
        super().close()
        self._forget_files()

    def _forget_files(self) -> None:
        folder, self._folder = self._folder, None
        if folder is not None:
            folder.cleanup()
