"""A frame of several plates that puts the rigs into the vehicle frame, schema ``truewheel.gauge-frame/1``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from alignment.arrays import Array
from alignment.believable import NEAREST_MM, place_problem, side_in_name
from alignment.counting import listed
from alignment.errors import ConfigurationError, DegenerateInputError
from alignment.geometry import RigidTransform
from alignment.units import ARCMIN
from sensors.formats.calibration import Pose
from sensors.formats.plate import PlateDescription, read_plate
from sensors.formats.validation import FilePath, Name, StrictModel, load_toml, validate


class GaugePlateEntry(StrictModel):
    """One plate of the frame."""

    rig: Name = Field(description="Name of the rig that sees this plate")
    plate_file: FilePath = Field(
        description="TOML file that describes the plate, relative to this file's folder"
    )
    vehicle_from_plate: Pose = Field(
        description="Takes plate coordinates to vehicle coordinates, as the frame's certificate states"
    )


class WholeFrame(StrictModel):
    """What is not known of the frame as a whole: standard uncertainties that all rigs of a view share."""

    tilt_sigma_arcmin: float = Field(
        default=0.0,
        ge=0,
        le=5,
        description="About X and Y each, as it rests on the wheel supports, arcminutes",
    )
    yaw_sigma_arcmin: float = Field(
        default=0.0, ge=0, le=60, description="About Z, against the stand's centre plane, arcminutes"
    )
    position_sigma_mm: float = Field(
        default=0.0, ge=0, le=20, description="Of its place on the stand, each coordinate, millimetres"
    )
    length_sigma_ppm: float = Field(
        default=0.0,
        ge=0,
        le=1000,
        description="Of its length over the certified one, parts per million: the scale of what measured "
        "it, and its temperature when it was seen (steel: 12 per kelvin)",
    )

    def covariance(self) -> Array:
        """(7, 7) as `alignment.values.Placing.shared_covariance`."""
        tilt, yaw = self.tilt_sigma_arcmin * ARCMIN, self.yaw_sigma_arcmin * ARCMIN
        sigmas = [tilt, tilt, yaw, *[self.position_sigma_mm] * 3, 1e-6 * self.length_sigma_ppm]
        return np.diag(np.square(sigmas))


class GaugeFrameFile(StrictModel):
    """What describes a gauge frame."""

    schema_: Literal["truewheel.gauge-frame/1"] = Field(
        alias="schema", description="Kind and version of this file"
    )
    name: Name = Field(description="Name of the frame")
    position_sigma_mm: float = Field(
        ge=1e-4, le=1, description="Standard uncertainty of each coordinate of a plate's origin, millimetres"
    )
    angle_sigma_arcmin: float = Field(
        ge=1e-3, le=5, description="Standard uncertainty of a plate's rotation about each axis, arcminutes"
    )
    whole: WholeFrame = Field(
        default=WholeFrame(), description="What is not known of the frame as a whole; left out: nothing"
    )
    plates: tuple[GaugePlateEntry, ...] = Field(
        min_length=1, max_length=16, description="The plates, one for each rig"
    )

    @model_validator(mode="after")
    def _rigs_differ(self) -> GaugeFrameFile:
        rigs = [plate.rig for plate in self.plates]
        if len(set(rigs)) < len(rigs):
            raise DegenerateInputError(field="plates", expected="one plate for each rig", seen=listed(rigs))
        for k, plate in enumerate(self.plates):
            self._check_place(k, plate)
        return self

    def _check_place(self, number: int, plate: GaugePlateEntry) -> None:
        field = f"plates[{number}].vehicle_from_plate.translation_mm"
        here = plate.vehicle_from_plate.translation_mm
        problem = place_problem(here, side_in_name(plate.rig))
        if problem is not None:
            expected, seen, cure = problem
            raise DegenerateInputError(field=field, expected=expected, seen=seen, cure=cure)
        for other in self.plates[:number]:
            if math.dist(here, other.vehicle_from_plate.translation_mm) < NEAREST_MM:
                raise DegenerateInputError(
                    field=field,
                    expected=f"a place of its own, {NEAREST_MM:g} mm from every other plate",
                    seen=f"that of {other.rig}",
                    cure="Copy each plate's place from the frame's certificate",
                )


@dataclass(frozen=True, eq=False)
class GaugePlate:
    """One plate of a gauge frame, and its pose in the vehicle frame."""

    plate: PlateDescription
    vehicle_from_plate: RigidTransform


@dataclass(frozen=True, eq=False)
class GaugeFrame:
    """A gauge frame.

    Attributes
    ----------
    file
        What the file says.
    plates
        By name of the rig that sees the plate.
    """

    file: GaugeFrameFile
    plates: dict[str, GaugePlate]


def read_gauge_frame(path: str | PathLike[str]) -> GaugeFrame:
    """Read the description of a gauge frame and those of its plates.

    Raises
    ------
    ConfigurationError
        When a description is missing, is no TOML, or a field is missing, unknown or out of range.
    FormatError
        When a plate's certificate cannot be read.
    """
    path = Path(path)
    data = load_toml(path, "the description of a gauge frame")
    file = validate(GaugeFrameFile, data, file=path, error=ConfigurationError)
    return GaugeFrame(
        file,
        {
            entry.rig: GaugePlate(
                read_plate(path.parent / entry.plate_file), entry.vehicle_from_plate.transform()
            )
            for entry in file.plates
        },
    )
