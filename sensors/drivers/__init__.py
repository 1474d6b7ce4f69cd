"""Camera drivers; all pass the same contract tests. Here is what a driver is written with."""

from __future__ import annotations

from sensors.camera_health import CameraStatistics
from sensors.drivers.driver import (
    CameraDriver,
    CameraPlace,
    KnownCalibration,
    RigDriver,
    RigPlace,
    SeenCamera,
)
from sensors.drivers.queued import QueuedCamera, QueuedExposure
from sensors.formats.validation import StrictModel

__all__ = [
    "CameraDriver",
    "CameraPlace",
    "CameraStatistics",
    "KnownCalibration",
    "QueuedCamera",
    "QueuedExposure",
    "RigDriver",
    "RigPlace",
    "SeenCamera",
    "StrictModel",
]
