"""The calibration of one rig as a JSON file, schema ``truewheel.calibration/1``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AwareDatetime, Field, model_validator

from alignment.believable import LARGEST_TURN, place_problem, pose_slip, side_in_name, turn_from_nominal
from alignment.counting import listed
from alignment.errors import DegenerateInputError
from alignment.geometry import CameraModel, PosedCamera, RigidTransform
from alignment.values import SHARED_SIZE, HeadCalibration, Placing, RigCalibration, Side
from sensors.formats.files import write_bytes
from sensors.formats.validation import Name, StrictModel, dump_json, load_json, validate

_Identity = Annotated[str, Field(min_length=1, max_length=128, pattern=r"^[^\x00-\x1f\x7f]+$")]
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Cosine = Annotated[float, Field(ge=-1.000001, le=1.000001)]
_Row = tuple[Cosine, Cosine, Cosine]
_ASYMMETRY, _NEGATIVITY = 1e-6, 1e-6


class Pose(StrictModel):
    """A rigid transform: p_target = rotation · p_source + translation."""

    rotation: tuple[_Row, _Row, _Row] = Field(description="3 × 3 orthonormal matrix, by rows, determinant +1")
    translation_mm: tuple[Coordinate, Coordinate, Coordinate] = Field(
        description="Origin of the source frame in the target frame, millimetres"
    )

    @model_validator(mode="after")
    def _is_rigid(self) -> Pose:
        self.transform()
        return self

    def transform(self) -> RigidTransform:
        """Return the value that the mathematics uses."""
        return RigidTransform(np.array(self.rotation), np.array(self.translation_mm))


class RigPose(Pose):
    """Pose of the rig in the vehicle frame (ISO 8855: X forward, Y left, Z up)."""

    measured: bool = Field(description="True when a gauge measured it, false when it is nominal")


class CameraEntry(StrictModel):
    """One camera: lens, chip, and where it stands."""

    width: int = Field(ge=1, le=32_768, description="Width of the image, pixels")
    height: int = Field(ge=1, le=32_768, description="Height of the image, pixels")
    model: Literal["division", "brown"] = Field(
        description="Distortion: 'division' (undistorted = distorted / (1 + d ρ²)) or 'brown' (Brown–Conrady)"
    )
    fx: float = Field(gt=0, le=1e7, description="Focal length along x, pixels")
    fy: float = Field(gt=0, le=1e7, description="Focal length along y, pixels")
    cx: Coordinate = Field(description="Principal point, x, pixels; 0 is the centre of the left-most pixel")
    cy: Coordinate = Field(description="Principal point, y, pixels; 0 is the centre of the top-most pixel")
    skew: float = Field(default=0.0, ge=-1e4, le=1e4, description="Skew of the pixel axes, pixels")
    coefficients: tuple[Coordinate, ...] = Field(
        min_length=1,
        max_length=14,
        description="division: d. brown: k1 k2 p1 p2 k3, or 8, 12 or 14 of OpenCV's distCoeffs, in its order",
    )
    rig_from_camera: Pose = Field(description="Takes camera coordinates to rig coordinates")

    @model_validator(mode="after")
    def _is_camera(self) -> CameraEntry:
        self.posed_camera()
        return self

    def posed_camera(self) -> PosedCamera:
        """Return the value that the mathematics uses."""
        fields = self.model_dump(exclude={"rig_from_camera"})
        return PosedCamera(CameraModel(**fields), self.rig_from_camera.transform())


class HeadEntry(StrictModel):
    """One stereo head."""

    name: Name = Field(description="Name of the head; a shot names its heads the same, in the same order")
    left: CameraEntry = Field(description="The camera whose images the shot calls left")
    right: CameraEntry = Field(description="The camera whose images the shot calls right")


class Covariance(StrictModel):
    """Joint covariance of all camera parameters, and of the rig's measured pose in the vehicle."""

    parameters: tuple[str, ...] = Field(
        min_length=1,
        max_length=1000,
        description="Names of the rows. For each head, left then right: rx ry rz (radians, about the "
        "camera's own axes), cx_mm cy_mm cz_mm (centre in the rig frame), fx fy cx cy, then the "
        "coefficients. At last, where it was measured, vehicle_from_rig: rx ry rz (about the rig's axes), "
        "x_mm y_mm z_mm",
    )
    matrix: tuple[tuple[Annotated[float, Field(ge=-1e12, le=1e12)], ...], ...] = Field(
        min_length=1, max_length=1000, description="Symmetric, one row and one column for each parameter"
    )

    @model_validator(mode="after")
    def _is_covariance(self) -> Covariance:
        size = len(self.parameters)
        if len(self.matrix) != size:
            raise DegenerateInputError(
                field="matrix",
                expected=f"{size} × {size} numbers, one row for each parameter",
                seen=f"{len(self.matrix)} rows of {listed(sorted({len(row) for row in self.matrix}))}",
            )
        check_covariance("matrix", self.matrix)
        return self


_Numbers = tuple[Annotated[float, Field(ge=-1e12, le=1e12)], ...]


class PlacingEntry(StrictModel):
    """How well a view of a gauge frame put the rig into the vehicle frame, and what all rigs of it share."""

    view: str = Field(
        min_length=1,
        max_length=200,
        description="Names the frame and when it was seen; rigs with the same one share the second matrix",
    )
    pose_covariance: tuple[_Numbers, ...] = Field(
        min_length=6,
        max_length=6,
        description="6 × 6 of vehicle_from_rig: rx ry rz (radians, about the rig's axes), x_mm y_mm z_mm; "
        "what the rigs share included",
    )
    shared_covariance: tuple[_Numbers, ...] = Field(
        min_length=SHARED_SIZE,
        max_length=SHARED_SIZE,
        description="7 × 7 of the frame as a whole: its turn about X, Y and Z of the vehicle frame "
        "(radians), its shift (mm), its length over the stated one, less one",
    )

    @model_validator(mode="after")
    def _are_covariances(self) -> PlacingEntry:
        for name in ("pose_covariance", "shared_covariance"):
            check_covariance(name, getattr(self, name))
        return self

    def placing(self) -> Placing:
        """Return the value that the mathematics uses."""
        return Placing(self.view, np.array(self.pose_covariance), np.array(self.shared_covariance))


def check_covariance(field: str, rows: Sequence[Sequence[float]]) -> None:
    """Refuse a matrix that is no covariance.

    Raises
    ------
    DegenerateInputError
        When it is not square, not symmetric, or has a negative variance.
    """
    lengths, size = {len(row) for row in rows}, len(rows)
    if lengths != {size}:
        raise DegenerateInputError(
            field=field,
            expected=f"{size} × {size} numbers, one row for each parameter",
            seen=f"{size} rows of {listed(sorted(lengths))}",
        )
    matrix = np.array(rows)
    deviations = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.outer(deviations, deviations)
    known = scale > 0
    scaled = np.where(known, matrix / np.where(known, scale, 1.0), np.where(matrix == 0, 0.0, np.inf))
    if (
        not np.isfinite(scaled).all()
        or np.abs(scaled - scaled.T).max() > _ASYMMETRY
        or np.linalg.eigvalsh(scaled).min() < -_NEGATIVITY * size
    ):
        raise DegenerateInputError(
            field=field, expected="a symmetric matrix without negative variance", seen="another"
        )


def check_side(rig: str, side: Side) -> None:
    """Refuse a side that contradicts the rig's name: it would turn the signs of all its angles.

    Raises
    ------
    DegenerateInputError
        When the name ends in the other side.
    """
    named = side_in_name(rig)
    if named not in (None, side):
        raise DegenerateInputError(
            field="side",
            expected=f"'{named}', as the rig's name '{rig}' says",
            seen=f"'{side}'",
            cure="Correct the side or the name: left and right are exchanged in one of them",
        )


class CalibrationFile(StrictModel):
    """What a calibration file holds."""

    schema_: Literal["truewheel.calibration/1"] = Field(
        alias="schema", description="Kind and version of this file"
    )
    id: _Identity = Field(description="Identity of this calibration; every record carries it")
    rig: Name = Field(description="Name of the rig; shots name the same")
    side: Literal["left", "right"] = Field(description="Side of the vehicle")
    created_utc: AwareDatetime = Field(description="When it was made, ISO 8601 with the zone")
    method: str = Field(min_length=1, max_length=200, description="How it was made")
    vehicle_from_rig: RigPose = Field(description="Takes rig coordinates to vehicle coordinates")
    heads: tuple[HeadEntry, ...] = Field(
        min_length=1, max_length=16, description="The stereo heads, in the order of the shots"
    )
    covariance: Covariance | None = Field(
        default=None, description="Joint covariance of all parameters, null where it is not known"
    )
    placing: PlacingEntry | None = Field(
        default=None,
        description="Of the view of the gauge frame that measured vehicle_from_rig, null where none did or "
        "where it is not known: the rig is then taken to share nothing with others",
    )

    @model_validator(mode="after")
    def _is_calibration(self) -> CalibrationFile:
        names = [head.name for head in self.heads]
        if len(set(names)) < len(names):
            raise DegenerateInputError(
                field="heads", expected="heads with different names", seen=listed(names)
            )
        check_side(self.rig, self.side)
        self._check_pose()
        calibration = self.calibration()
        stated = () if self.covariance is None else self.covariance.parameters
        for index, (seen, expected) in enumerate(zip(stated, calibration.parameter_names, strict=False)):
            if seen != expected:
                raise DegenerateInputError(
                    field=f"covariance.parameters[{index}]", expected=f"'{expected}'", seen=f"'{seen}'"
                )
        return self

    def _check_pose(self) -> None:
        pose = self.vehicle_from_rig.transform()
        turn = turn_from_nominal(pose, self.side)
        if turn > LARGEST_TURN:
            slip = pose_slip(pose, self.side)
            raise DegenerateInputError(
                field="vehicle_from_rig.rotation",
                expected=f"axes within {math.degrees(LARGEST_TURN):g}° of a nominal rig on the {self.side}: "
                "z outboard, y up",
                seen=f"axes turned by {math.degrees(turn):.1f}°",
                cure="Check 'side' and the rotation" if slip is None else f"It would fit with {slip}",
            )
        problem = place_problem(self.vehicle_from_rig.translation_mm, self.side)
        if problem is not None:
            expected, seen, cure = problem
            raise DegenerateInputError(
                field="vehicle_from_rig.translation_mm", expected=expected, seen=seen, cure=cure
            )

    def calibration(self) -> RigCalibration:
        """Return the value that the mathematics uses."""
        known = RigCalibration(
            id=self.id,
            rig=self.rig,
            side=self.side,
            heads=tuple(
                HeadCalibration(head.name, head.left.posed_camera(), head.right.posed_camera())
                for head in self.heads
            ),
            vehicle_from_rig=self.vehicle_from_rig.transform(),
            vehicle_from_rig_measured=self.vehicle_from_rig.measured,
            placing=None if self.placing is None else self.placing.placing(),
        )
        if self.covariance is None:
            return known
        covariance = np.array(self.covariance.matrix)
        if len(covariance) == len(known.camera_parameter_names):
            # A measured pose whose rows are left out is taken as exact.
            covariance = np.pad(covariance, (0, len(known.parameter_names) - len(covariance)))
        return replace(known, covariance=covariance)


def read_calibration_file(path: str | PathLike[str]) -> CalibrationFile:
    """Read a calibration with what only its file knows: when and how it was made.

    Raises
    ------
    FormatError
        When the file is missing, is no JSON, or any field is missing, unknown or out of range.
    """
    path = Path(path)
    return validate(CalibrationFile, load_json(path, "a calibration"), file=path)


def read_calibration(path: str | PathLike[str]) -> RigCalibration:
    """Read a calibration; errors as `read_calibration_file`."""
    return read_calibration_file(path).calibration()


def write_calibration(
    path: str | PathLike[str], calibration: RigCalibration, *, method: str, created_utc: datetime
) -> None:
    """Write a calibration, whole or not at all; it reads back to exactly the same numbers.

    Parameters
    ----------
    path
        The file; an older one is replaced.
    calibration
        What is known of the rig.
    method
        How it was made, such as ``simulated, true`` or ``newton from 12 plate positions``.
    created_utc
        When it was made; aware.

    Raises
    ------
    FormatError
        When a value is out of the format's range, or the file cannot be written; an older file is unchanged.
    """
    path = Path(path)
    file = describe_calibration(calibration, method=method, created_utc=created_utc, path=path)
    write_calibration_file(path, file)


def write_calibration_file(path: str | PathLike[str], file: CalibrationFile) -> None:
    """Write a calibration that is described already; otherwise as `write_calibration`."""
    write_bytes(Path(path), dump_json(file))


def describe_calibration(
    calibration: RigCalibration, *, method: str, created_utc: datetime, path: Path
) -> CalibrationFile:
    """Return what `write_calibration` writes.

    Raises
    ------
    FormatError
        When a value is out of the format's range; the message names `path`.
    """
    covariance = calibration.covariance
    data = {
        "schema": "truewheel.calibration/1",
        "id": calibration.id,
        "rig": calibration.rig,
        "side": calibration.side,
        "created_utc": created_utc.astimezone(UTC) if created_utc.tzinfo else created_utc,
        "method": method,
        "vehicle_from_rig": {
            **pose_fields(calibration.vehicle_from_rig),
            "measured": calibration.vehicle_from_rig_measured,
        },
        "heads": [
            {"name": head.name, "left": _camera_fields(head.left), "right": _camera_fields(head.right)}
            for head in calibration.heads
        ],
        "covariance": None
        if covariance is None
        else {"parameters": list(calibration.parameter_names), "matrix": covariance.tolist()},
        "placing": None
        if calibration.placing is None
        else {
            "view": calibration.placing.view,
            "pose_covariance": calibration.placing.pose_covariance.tolist(),
            "shared_covariance": calibration.placing.shared_covariance.tolist(),
        },
    }
    return validate(CalibrationFile, data, file=path)


def pose_fields(transform: RigidTransform) -> dict[str, object]:
    """Return a pose as the recorded formats write it."""
    return {"rotation": transform.rotation.tolist(), "translation_mm": transform.translation.tolist()}


def _camera_fields(camera: PosedCamera) -> dict[str, object]:
    model = camera.model
    return {
        "width": model.width,
        "height": model.height,
        "model": model.model,
        "fx": model.fx,
        "fy": model.fy,
        "cx": model.cx,
        "cy": model.cy,
        "skew": model.skew,
        "coefficients": list(model.coefficients),
        "rig_from_camera": pose_fields(camera.rig_from_camera),
    }
