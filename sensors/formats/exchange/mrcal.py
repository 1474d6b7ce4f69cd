"""mrcal's ``.cameramodel``: one file for each camera, a dictionary in Python's notation.

``intrinsics`` are fx, fy, cx, cy, then OpenCV's coefficients; ``extrinsics``, in newer versions
``rt_cam_ref``, are a rotation vector and a translation that take points of the reference frame, here the
rig's, to the camera. mrcal leaves the unit of length to its user and recommends metres, which Truewheel
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
from sensors.formats.validation import validate

SUFFIX = ".cameramodel"
_COUNTS = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
}


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


def _read_model(path: Path, unit_mm: float) -> NamedCamera:
    content = read_bytes(path, "a camera model of mrcal")
    try:
        data = ast.literal_eval(content.decode().strip())
        known = {"lensmodel", "lens_model", "intrinsics", "imagersize", "extrinsics", "rt_cam_ref"}
        # The rest, such as the inputs of the optimisation, may be of any kind.
        data = {key: value for key, value in data.items() if key in known}
    except (ValueError, SyntaxError, AttributeError, MemoryError, RecursionError) as error:
        raise FormatError(file=path, expected="a camera model of mrcal", seen=f"an error: {error}") from error
    for newer, older in (("lensmodel", "lens_model"), ("extrinsics", "rt_cam_ref")):
        if newer not in data and older in data:
            data[newer] = data[older]
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
