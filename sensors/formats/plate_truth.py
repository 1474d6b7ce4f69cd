"""Where a simulated plate really was, schema ``truewheel.plate-truth/1``. Calibrating code never opens it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from alignment.arrays import Array, Index
from alignment.geometry import RigidTransform
from sensors.formats.calibration import Coordinate, Pose, pose_fields
from sensors.formats.files import write_bytes
from sensors.formats.pattern_plate import GridIndex
from sensors.formats.validation import Name, StrictModel, dump_json, load_json, validate


@dataclass(frozen=True, eq=False)
class PlateTruth:
    """What a simulated session was made of, besides the true cameras.

    Attributes
    ----------
    seed
        Of the random generator that made rig, plate and noise.
    indices, points
        (M, 2) column and row of each mark, (M, 3) where it really is in the plate's frame, millimetres.
    rig_from_plate
        True pose of the plate in each view, by name.
    vehicle_from_rig
        True pose of the rig in the vehicle; None where none was drawn.
    """

    seed: int
    indices: Index
    points: Array
    rig_from_plate: Mapping[str, RigidTransform]
    vehicle_from_rig: RigidTransform | None = None


class TrueView(StrictModel):
    """One position of the plate."""

    name: Name = Field(description="Name of the view")
    rig_from_plate: Pose = Field(description="Takes plate coordinates to rig coordinates")


class PlateTruthFile(StrictModel):
    """What the truth of a plate session holds."""

    schema_: Literal["truewheel.plate-truth/1"] = Field(
        alias="schema", description="Kind and version of this file"
    )
    seed: int = Field(ge=0, lt=2**64, description="Seed of rig, plate and noise")
    views: tuple[TrueView, ...] = Field(min_length=1, max_length=500, description="Poses of the plate")
    marks: tuple[tuple[GridIndex, GridIndex, Coordinate, Coordinate, Coordinate], ...] = Field(
        min_length=1,
        max_length=200_000,
        description="Of each mark: column, row, and where it really is in the plate's frame, millimetres",
    )
    vehicle_from_rig: Pose | None = Field(
        default=None,
        description="Takes rig coordinates to vehicle coordinates; null where the images do not show it",
    )


def read_plate_truth(path: str | PathLike[str]) -> PlateTruth:
    """Read the truth of a simulated plate session.

    Raises
    ------
    FormatError
        When the file is missing, is no JSON, or any field is missing, unknown or out of range.
    """
    path = Path(path)
    found = validate(PlateTruthFile, load_json(path, "the truth of a plate session"), file=path)
    return PlateTruth(
        seed=found.seed,
        indices=np.array([mark[:2] for mark in found.marks], dtype=np.int64),
        points=np.array([mark[2:] for mark in found.marks]),
        rig_from_plate={view.name: view.rig_from_plate.transform() for view in found.views},
        vehicle_from_rig=None if found.vehicle_from_rig is None else found.vehicle_from_rig.transform(),
    )


def write_plate_truth(path: str | PathLike[str], truth: PlateTruth) -> None:
    """Write the truth of a simulated plate session, whole or not at all.

    Raises
    ------
    FormatError
        When a value is out of the format's range, or the file cannot be written.
    """
    path = Path(path)
    data = {
        "schema": "truewheel.plate-truth/1",
        "seed": truth.seed,
        "views": [
            {"name": name, "rig_from_plate": pose_fields(pose)} for name, pose in truth.rig_from_plate.items()
        ],
        "marks": [
            [*mark, *point] for mark, point in zip(truth.indices.tolist(), truth.points.tolist(), strict=True)
        ],
        "vehicle_from_rig": None if truth.vehicle_from_rig is None else pose_fields(truth.vehicle_from_rig),
    }
    write_bytes(path, dump_json(validate(PlateTruthFile, data, file=path)))
