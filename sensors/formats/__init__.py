"""The recorded formats, read and written in one place: shot, calibration, truth, single images."""

from __future__ import annotations

from pydantic import BaseModel

from sensors.formats.calibration import (
    CalibrationFile,
    read_calibration,
    read_calibration_file,
    write_calibration,
)
from sensors.formats.images import read_image, write_image
from sensors.formats.shot import ShotFile, check_shot_matches, read_shot, write_shot
from sensors.formats.truth import TruthFile, WheelTruth, read_truth, write_truth

SCHEMAS: dict[str, type[BaseModel]] = {
    "shot": ShotFile,
    "calibration": CalibrationFile,
    "truth": TruthFile,
}

__all__ = [
    "SCHEMAS",
    "CalibrationFile",
    "ShotFile",
    "TruthFile",
    "WheelTruth",
    "check_shot_matches",
    "read_calibration",
    "read_calibration_file",
    "read_image",
    "read_shot",
    "read_truth",
    "write_calibration",
    "write_image",
    "write_shot",
    "write_truth",
]
