"""mrcal's ``.cameramodel``: one file for each camera, a dictionary in Python's notation.

``lensmodel`` was called ``lens_model``, and before that ``distortion_model`` with names that begin with
``DISTORTION_``. ``intrinsics`` are fx, fy, cx, cy, then OpenCV's coefficients; ``extrinsics``, in newer
versions ``rt_cam_ref``, are a rotation vector and a translation that take points of the reference frame, here
the rig's, to the camera. mrcal leaves the unit of length to its user and recommends metres, which Truewheel
writes and, unless told otherwise, reads.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from alignment.errors import FormatError
from alignment.values import RigCalibration
from sensors.formats.exchange.cameras import (
    ForeignModel,
    NamedCamera,
    brown_camera,
    cameras_to_export,
    reference_from,
)
from sensors.formats.files import entries, read_bytes, write_folder
from sensors.formats.text import text_of
from sensors.formats.validation import validate

SUFFIX = ".cameramodel"
_COUNTS = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
}


_NAMES = {
    "lensmodel": ("lensmodel", "lens_model", "distortion_model"),
    "extrinsics": ("extrinsics", "rt_cam_ref"),
}
"""Newer and older names of one key."""
_KNOWN = {"intrinsics", "imagersize"}.union(*_NAMES.values())


class _CameraModelFile(ForeignModel):
    lensmodel: str
    intrinsics: tuple[float, ...] = Field(min_length=4, max_length=100_000)
    imagersize: tuple[int, int]
    extrinsics: tuple[float, float, float, float, float, float]


def write_mrcal(folder: Path, calibration: RigCalibration) -> None:
    """Write ``<head>_<side>.cameramodel`` for each camera into a new folder; metres, reference = rig frame.

    Raises
    ------
    FormatError
        When mrcal has no model for a camera, or the folder holds something or cannot be written.
    """
    files = {}
    for head, side, model, camera_from_rig in cameras_to_export(calibration, folder, "mrcal", (5, 8, 12)):
        pose = [*camera_from_rig.rotvec(), *camera_from_rig.translation / 1000.0]
        lines = [
            f"# {head} {side} of rig {calibration.rig}, Truewheel calibration {calibration.id}",
            "{",
            f"    'lensmodel':  'LENSMODEL_OPENCV{len(model.coefficients)}',",
            "",
            "    # fx, fy, cx, cy, then the distortion",
            f"    'intrinsics': {_numbers(model.parameters)},",
            "",
            "    # camera from rig: rotation vector, translation in metres",
            f"    'extrinsics': {_numbers(pose)},",
            "",
            f"    'imagersize': [ {model.width}, {model.height}, ],",
            "}",
            "",
        ]
        files[f"{head}_{side}{SUFFIX}"] = "\n".join(lines).encode()
    write_folder(folder, files)


def _numbers(values: Any) -> str:
    return f"[ {' '.join(f'{float(value)!r},' for value in values)} ]"


def read_mrcal(paths: Sequence[Path], *, unit_mm: float = 1000.0) -> tuple[NamedCamera, ...]:
    """Read camera models, named after their files; a folder stands for all of its models.

    Raises
    ------
    FormatError
        When a file is missing, is no camera model, or has another lens model than pinhole or OpenCV's with 4,
        5, 8 or 12 coefficients.
    """
    files: list[Path] = []
    for path in paths:
        inside = entries(path, f"*{SUFFIX}", "camera models") if path.is_dir() else [path]
        if not inside:
            raise FormatError(file=path, expected=f"{SUFFIX} files", seen="none")
        files += inside
    return tuple(_read_model(path, unit_mm) for path in files)


def _of_old(name: Any) -> Any:
    """Return the name of a lens model as it is today: DISTORTION_NONE was the pinhole."""
    if not isinstance(name, str) or not name.startswith("DISTORTION_"):
        return name
    return "LENSMODEL_" + name.removeprefix("DISTORTION_").replace("NONE", "PINHOLE")


def _read_model(path: Path, unit_mm: float) -> NamedCamera:
    content = read_bytes(path, "a camera model of mrcal")
    try:
        data = ast.literal_eval(text_of(content).strip())
        # The rest, such as the inputs of the optimisation, may be of any kind.
        data = {key: value for key, value in data.items() if key in _KNOWN}
    except (ValueError, SyntaxError, AttributeError, MemoryError, RecursionError) as error:
        raise FormatError(file=path, expected="a camera model of mrcal", seen=f"an error: {error}") from error
    for key, names in _NAMES.items():
        stated = [name for name in names if name in data]
        values = [data.pop(name) for name in stated]
        if key == "lensmodel":
            values = [_of_old(value) for value in values]
        if any(value != values[0] for value in values):
            raise FormatError(
                file=path, field=stated[1], expected=f"the same as under '{stated[0]}'", seen="something else"
            )
        if values:
            data[key] = values[0]
    found = validate(_CameraModelFile, data, file=path)
    count = _COUNTS.get(found.lensmodel)
    if count is None:
        raise FormatError(
            file=path,
            field="lensmodel",
            expected=f"one of {', '.join(_COUNTS)}",
            seen=f"'{found.lensmodel}'",
            cure="Fit one of these to it with mrcal-convert-lensmodel",
        )
    if len(found.intrinsics) != 4 + count:
        raise FormatError(
            file=path,
            field="intrinsics",
            expected=f"{4 + count} numbers for {found.lensmodel}",
            seen=str(len(found.intrinsics)),
        )
    model = brown_camera(found.imagersize, found.intrinsics[:4], found.intrinsics[4:], path, "intrinsics")
    rotation = Rotation.from_rotvec(found.extrinsics[:3]).as_matrix()
    translation = unit_mm * np.array(found.extrinsics[3:])
    return NamedCamera(path.stem, model, reference_from(rotation, translation, path, "extrinsics"))
