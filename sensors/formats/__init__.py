"""The recorded formats, read and written in one place: shots, plates, sessions, calibrations, images."""

from __future__ import annotations

from pydantic import BaseModel

from sensors.formats.calibration import (
    CalibrationFile,
    read_calibration,
    read_calibration_file,
    write_calibration,
)
from sensors.formats.calibration_input import (
    CalibrationInputFile,
    read_calibration_input,
    write_calibration_input,
)
from sensors.formats.gauge_frame import GaugeFrame, GaugeFrameFile, read_gauge_frame
from sensors.formats.images import read_image, write_image
from sensors.formats.plate import PlateDescription, PlateFile, read_plate
from sensors.formats.plate_session import (
    PlateSession,
    PlateSessionFile,
    SessionView,
    read_plate_session,
    write_plate_session,
)
from sensors.formats.plate_truth import PlateTruth, PlateTruthFile, read_plate_truth, write_plate_truth
from sensors.formats.shot import ShotFile, check_shot_matches, read_shot, write_shot
from sensors.formats.truth import TruthFile, WheelTruth, read_truth, write_truth

SCHEMAS: dict[str, type[BaseModel]] = {
    "shot": ShotFile,
    "calibration": CalibrationFile,
    "calibration-input": CalibrationInputFile,
    "truth": TruthFile,
    "plate": PlateFile,
    "plate-session": PlateSessionFile,
    "gauge-frame": GaugeFrameFile,
    "plate-truth": PlateTruthFile,
}

__all__ = [
    "SCHEMAS",
    "CalibrationFile",
    "CalibrationInputFile",
    "GaugeFrame",
    "GaugeFrameFile",
    "PlateDescription",
    "PlateFile",
    "PlateSession",
    "PlateSessionFile",
    "PlateTruth",
    "PlateTruthFile",
    "SessionView",
    "ShotFile",
    "TruthFile",
    "WheelTruth",
    "check_shot_matches",
    "read_calibration",
    "read_calibration_file",
    "read_calibration_input",
    "read_gauge_frame",
    "read_image",
    "read_plate",
    "read_plate_session",
    "read_plate_truth",
    "read_shot",
    "read_truth",
    "write_calibration",
    "write_calibration_input",
    "write_image",
    "write_plate_session",
    "write_plate_truth",
    "write_shot",
    "write_truth",
]
