"""The recorded formats that have a JSON schema, by name."""

from __future__ import annotations

from pydantic import BaseModel

from sensors.formats.archived import ArchivedFile
from sensors.formats.calibration import CalibrationFile
from sensors.formats.calibration_input import CalibrationInputFile
from sensors.formats.gauge_frame import GaugeFrameFile
from sensors.formats.pattern_plate import PatternPlateFile
from sensors.formats.plate import PlateFile
from sensors.formats.plate_session import PlateSessionFile
from sensors.formats.plate_truth import PlateTruthFile
from sensors.formats.shot_file import ShotFile
from sensors.formats.truth import TruthFile
from sensors.formats.vehicle import SteeringTruthFile, VehicleFile, VehicleTruthFile

SCHEMAS: dict[str, type[BaseModel]] = {
    "shot": ShotFile,
    "archived": ArchivedFile,
    "calibration": CalibrationFile,
    "calibration-input": CalibrationInputFile,
    "truth": TruthFile,
    "plate": PlateFile,
    "pattern-plate": PatternPlateFile,
    "plate-session": PlateSessionFile,
    "gauge-frame": GaugeFrameFile,
    "plate-truth": PlateTruthFile,
    "vehicle": VehicleFile,
    "vehicle-truth": VehicleTruthFile,
    "steering-truth": SteeringTruthFile,
}
