"""Do the frames of one shot belong together? Counters, the cameras' own clocks, and images that never change.

A camera that hangs, a driver that gives an old buffer again, a cable in the wrong socket: each delivers a
good picture of another moment, from which wrong angles with a small uncertainty follow.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from alignment.errors import CameraError, ConfigurationError
from alignment.values import Image
from sensors.camera import Frame

_DRIFT = 2e-4  # by which clocks of cameras may run differently; crystals keep a tenth of that
_SOME_ROWS = 16
HOST_SPREAD_S = 600.0
"""Frames of one shot arrive within the longest timeout that a station may have."""


@dataclass(frozen=True)
class FrameTolerance:
    """What frames of one shot may differ by.

    Attributes
    ----------
    device_time_s
        Of the cameras' own clocks, seconds; 0 leaves them uncompared.
    synchronised
        The clocks show the same time, as with PTP. Otherwise what passed between two shots is compared, for
        which their origins are free.
    repeats
        The same images come again on purpose, as from a recording of one shot.
    """

    device_time_s: float = 0.02
    synchronised: bool = False
    repeats: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.device_time_s <= 60:
            raise ConfigurationError(
                field="device_time_s", expected="from 0 to 60", seen=str(self.device_time_s)
            )


class FrameComparison:
    """Compares the frames of each shot with one another and with the shot before.

    Parameters
    ----------
    tolerance
        What they may differ by.
    """

    def __init__(self, tolerance: FrameTolerance | None = None) -> None:
        self.tolerance = tolerance or FrameTolerance()
        self._times: dict[str, float] = {}
        self._prints: dict[str, int] = {}

    def forget(self, *, images: bool = True) -> None:
        """Begin anew: the cameras were connected, and their clocks may have begun again.

        With `images` the last ones too, as of a recording that begins again; a real camera that sends the
        last one once more is frozen still.
        """
        self._times.clear()
        if images:
            self._prints.clear()

    def problems(self, frames: Sequence[Frame]) -> list[CameraError]:
        """Name every camera whose frame does not belong to this shot; none when all do."""
        found = {error.camera: error for error in [*_counters(frames), *self._clocks(frames)]}
        # An image that stands still says more than the clock that stands still with it.
        found |= {error.camera: error for error in self._still(frames)}
        if not found:
            self._times = {frame.camera: frame.device_time_s for frame in frames}
        return [found[frame.camera] for frame in frames if frame.camera in found]

    def _clocks(self, frames: Sequence[Frame]) -> list[CameraError]:
        allowed = self.tolerance.device_time_s
        if allowed == 0.0:
            return []
        found = []
        if self.tolerance.synchronised:
            times = {frame.camera: frame.device_time_s for frame in frames}
            found += _apart(times, allowed, "its clock shows", "the others show")
        passed = {
            frame.camera: frame.device_time_s - self._times[frame.camera]
            for frame in frames
            # A camera without a clock says 0 for ever.
            if frame.camera in self._times and (frame.device_time_s, self._times[frame.camera]) != (0.0, 0.0)
        }
        drift = _DRIFT * abs(median(passed.values())) if passed else 0.0
        found += _apart(passed, allowed + drift, "by its clock the shot before is", "by the others")
        return found

    def _still(self, frames: Sequence[Frame]) -> list[CameraError]:
        prints = {frame.camera: _print(frame.image) for frame in frames}
        before, self._prints = self._prints, prints
        found = []
        for number, frame in enumerate(frames):
            mine = prints[frame.camera]
            twin = next((f.camera for f in frames[:number] if prints[f.camera] == mine), None)
            frozen = before.get(frame.camera) == mine and not self.tolerance.repeats
            # A picture of one grey value is dark or blinded, which the measurement says better.
            if not (frozen or twin) or frame.image.min() == frame.image.max():
                continue
            if frozen:
                seen = f"the same bytes as at the one before, trigger {frame.trigger_counter}"
            else:
                seen = f"the same bytes as camera {twin}, trigger {frame.trigger_counter}"
            found.append(
                CameraError(
                    frame.camera,
                    f"frozen: expected a new image of its own at each trigger, it sent {seen}",
                    "Power it off and on, check its cable, and connect it again",
                )
            )
        return found


def _counters(frames: Sequence[Frame]) -> list[CameraError]:
    counters = [frame.trigger_counter for frame in frames]
    common = max(set(counters), key=lambda counter: (counters.count(counter), counter))
    return [
        CameraError(
            frame.camera,
            f"out of step: expected a frame of trigger {common}, as most cameras sent, it sent one of "
            f"trigger {frame.trigger_counter}",
            "Arm the rig again",
        )
        for frame in frames
        if frame.trigger_counter != common
    ]


def _apart(times: dict[str, float], allowed: float, its: str, others: str) -> list[CameraError]:
    """Name the cameras whose time is not that of most."""
    if len(times) < 2:
        return []
    common = median(times.values())
    return [
        CameraError(
            camera,
            f"a frame of another moment: {its} {time:.3f} s, {others} {common:.3f} s, allowed is a "
            f"difference of {1e3 * allowed:.3g} ms",
            "Arm the rig again; if it stays, connect the camera again, or allow more in [cameras]",
        )
        for camera, time in times.items()
        if abs(time - common) > allowed
    ]


def _print(image: Image) -> int:
    """Return a checksum of all bytes, by exclusive sums of columns, and of some rows for their order.

    A CRC of every byte would take longer than all else between the trigger and six images in memory.
    """
    rows = np.ascontiguousarray(image).view(np.uint8).reshape(len(image), -1)
    whole = rows.shape[1] // 8 * 8
    words = rows[:, :whole].view(np.uint64)
    found = zlib.crc32(np.ascontiguousarray(rows[:, whole:]).data, image.shape[1])
    found = zlib.crc32(np.bitwise_xor.reduce(words, axis=0).data, found)
    return zlib.crc32(np.bitwise_xor.reduce(words[::_SOME_ROWS], axis=1).data, found)
