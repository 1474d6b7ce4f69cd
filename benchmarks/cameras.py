"""From the trigger to six frames in memory: what the program takes over what the cameras' library takes.

Six cameras of pylon's emulation, whose code runs as with real ones; images come from files. In one run, by
turns, the bare library triggers and retrieves six results, and `Rig.shoot` does the same, with settings
looked at, frames counted and compared, and images in arrays of their own. Each call of the library within a
shot is timed; the rest is ours. It is taken by the clock of the thread, since the library's own threads,
which read and decode the files meanwhile, would count as ours; the wall's is beside it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.values import Side
from sensors.camera import CameraSettings, Frame
from sensors.drivers import RigPlace
from sensors.drivers.genicam.pixels import PixelFormat
from sensors.drivers.pylon.driver import DRIVER, EmulationOptions, PylonOptions
from sensors.formats import write_shot
from sensors.frames import FrameTolerance
from sensors.rig import Rig
from sensors.shot import HeadFrames, WheelShot

MOST_MS = 5.0
"""Goal for the 95th percentile of a shot's overhead, of images of the first size, milliseconds."""
SHOTS = 200
_WARM = 5
SIZES = {"1280x1024": (1024, 1280), "2448x2048": (2048, 2448)}
HEADS = ("head_1", "head_2", "head_3")
TIMED = ("get", "execute", "wait_ready", "retrieve")
"""What a shot asks of the library."""


class Timed:
    """Adds up the time of a library's calls, by the thread's clock and by the wall's."""

    def __init__(self, device: Any) -> None:
        self.taken_s = np.zeros(2)
        self._inside = False
        for name in TIMED:
            setattr(device, name, self._timed(getattr(device, name)))

    def _timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            if self._inside:
                return call(*arguments)
            self._inside = True
            began_s = _now()
            try:
                return call(*arguments)
            finally:
                self.taken_s += _now() - began_s
                self._inside = False

        return timed


def _now() -> NDArray[np.float64]:
    return np.array([time.thread_time(), time.perf_counter()])


def compare(size: tuple[int, int], pixel_format: PixelFormat, shots: int) -> dict[str, float]:
    """Return the figures of one size of images, milliseconds.

    Parameters
    ----------
    size
        (height, width), pixels.
    pixel_format
        Of the cameras.
    shots
        How many are taken with each.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number in (1, 2):
            write_shot(folder / "shots" / f"shot_{number}", _drawn(size, number))
        rig = _rig(folder, pixel_format)
        rig.connect()
        try:
            rig.arm()
            return _compared(rig, shots)
        finally:
            rig.close()


def _compared(rig: Rig, shots: int) -> dict[str, float]:
    devices: list[Any] = [camera._device for camera in rig.cameras]  # type: ignore[attr-defined]
    timed = [Timed(device) for device in devices]
    bare, whole, ours = [], [], []
    for number in range(-_WARM, shots):
        for one in timed:
            one.taken_s[:] = 0.0
        began_s = _now()
        rig.shoot(5.0)
        taken_s = _now() - began_s
        if number >= 0:
            whole.append(1e3 * taken_s[1])
            ours.append(1e3 * (taken_s - sum(one.taken_s for one in timed)))
            bare.append(1e3 * _bare([device._camera for device in devices]))
            rig.arm()
    thread, wall = np.array(ours).T
    return {
        "library_median_ms": float(np.median(bare)),
        "shoot_median_ms": float(np.median(whole)),
        "overhead_median_ms": float(np.median(thread)),
        "overhead_p95_ms": float(np.percentile(thread, 95)),
        "overhead_wall_median_ms": float(np.median(wall)),
    }


def _bare(cameras: list[Any]) -> float:
    """Trigger and retrieve with the library alone; seconds."""
    from pypylon import pylon

    began_s = time.perf_counter()
    for camera in cameras:
        assert camera.WaitForFrameTriggerReady(5000, pylon.TimeoutHandling_Return)
        camera.TriggerSoftware.Execute()
    for camera in cameras:
        result = camera.RetrieveResult(5000, pylon.TimeoutHandling_Return)
        assert result.GrabSucceeded()
        result.Release()
    return time.perf_counter() - began_s


def _rig(folder: Path, pixel_format: PixelFormat) -> Rig:
    cameras = {h: (f"0815-{2 * n:04d}", f"0815-{2 * n + 1:04d}") for n, h in enumerate(HEADS)}
    options = PylonOptions(
        cameras=cameras, pixel_format=pixel_format, emulation=EmulationOptions(shots="shots")
    )
    settings = CameraSettings(exposure_ms=0.5)
    return DRIVER.make(
        options, RigPlace("front_left", "left", HEADS, folder, settings, FrameTolerance(repeats=True))
    )


def _drawn(size: tuple[int, int], number: int) -> WheelShot:
    rng = np.random.default_rng(number)

    def frame(head: str, side: Side) -> Frame:
        return Frame(f"front_left/{head}/{side}", rng.integers(0, 255, size, np.uint8), 1, 1.0, 1.0, 0.5)

    heads = tuple(HeadFrames(h, frame(h, "left"), frame(h, "right")) for h in HEADS)
    return WheelShot("front_left", datetime.now(UTC), heads)


def main() -> int:
    """Print the figures; 1 when the goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shots", type=int, default=SHOTS)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    options = parser.parse_args()
    figures = {name: compare(size, "Mono8", options.shots) for name, size in SIZES.items()}
    met = figures[next(iter(SIZES))]["overhead_p95_ms"] <= MOST_MS
    if options.json:
        print(json.dumps({"figures": figures, "goals_met": met}))
    else:
        for name, found in figures.items():
            for figure, value in found.items():
                print(f"{name:10s} {figure:24s} {value:8.3f}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
