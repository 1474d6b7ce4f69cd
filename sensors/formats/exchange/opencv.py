"""OpenCV's YAML, XML or JSON, as `cv2.FileStorage` writes it, and what others write for it.

Truewheel writes one file: a list ``cameras`` of maps with ``name``, ``image_width``, ``image_height``,
``camera_matrix``, ``distortion_coefficients``, ``R`` and ``T``, where p_camera = R p_rig + T, millimetres.

Read are, besides:

- a file for each camera: ``camera_matrix``, ``distortion_coefficients``, ``image_width``, ``image_height``,
  as OpenCV's calibration sample writes them (its older one ``Camera_Matrix``, …) and ROS's ``camera_info``
  (``K``, ``D``, ``width``, ``height``), with or without a pose; beside two of them one with ``R`` and ``T``;
- a pair: ``M1``, ``D1``, ``M2``, ``D2``, ``R``, ``T`` (names: `names.pair_in`), in one file or, as OpenCV's
  stereo sample writes them, in two. R and T take points of the first camera to the second, and the first
  camera's frame is the frame of reference.

Matrices may be plain lists. A key that this reader needs may stand in one of the files only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from alignment.errors import FormatError
from alignment.geometry import RigidTransform
from alignment.values import RigCalibration
from sensors.formats.exchange.cameras import NamedCamera, cameras_to_export
from sensors.formats.exchange.entries import Entries
from sensors.formats.exchange.lenses import refuse_other_lenses
from sensors.formats.exchange.names import IMPORTANT, MATRIX, ROTATION, TRANSLATION, pair_in
from sensors.formats.exchange.trees import storage_values
from sensors.formats.files import write_bytes

COUNTS = (5, 8, 12, 14)
_KIND = "calibration data of OpenCV"


def write_opencv(path: Path, calibration: RigCalibration) -> None:
    """Write all cameras into one file; errors as `exchange.export_calibration`."""
    storage = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("calibration_id", calibration.id)
    storage.write("rig", calibration.rig)
    storage.startWriteStruct("cameras", cv2.FILE_NODE_SEQ)
    for head, side, model, camera_from_rig in cameras_to_export(calibration, path, "OpenCV", COUNTS):
        storage.startWriteStruct("", cv2.FILE_NODE_MAP)
        storage.write("name", f"{head}.{side}")
        storage.write("image_width", model.width)
        storage.write("image_height", model.height)
        storage.write("camera_matrix", model.matrix)
        storage.write("distortion_coefficients", np.array([model.coefficients]))
        storage.write("R", np.array(camera_from_rig.rotation))
        storage.write("T", np.array(camera_from_rig.translation)[:, None])
        storage.endWriteStruct()
    storage.endWriteStruct()
    write_bytes(path, storage.releaseAndGetString().encode())


def read_opencv(
    paths: Sequence[Path], *, unit_mm: float = 1.0, size: tuple[int, int] | None = None
) -> tuple[NamedCamera, ...]:
    """Read cameras.

    Parameters
    ----------
    paths
        One file, or several whose entries belong together, or one for each camera.
    unit_mm
        Millimetres in the unit of T.
    size
        (width, height), pixels, when the files do not state it.

    Raises
    ------
    FormatError
        When a file is missing or damaged, or lacks what makes a camera, or a key stands in two files.
    """
    files = [Entries.of_file(path, storage_values(path, _KIND)) for path in paths]
    for file in files:
        refuse_other_lenses(file.values, file.path)
    alone = [file for file in files if file.has(*MATRIX)]
    if len(alone) > 1:
        return _camera_files(alone, [file for file in files if file not in alone], size, unit_mm)
    top = _merged(files)
    if "cameras" in top.values:
        return tuple(entry.camera(size, unit_mm) for entry in top.list_of("cameras"))
    names = pair_in(top.values)
    if names is not None:
        models = [top.model((names.matrix[n],), (names.distortion[n],), size) for n in (0, 1)]
        return _pair(models, top.pose(unit_mm))
    return (top.camera(size, unit_mm, paths[0].stem),)


def _pair(models: Sequence[Any], right_from_left: RigidTransform) -> tuple[NamedCamera, ...]:
    """Return the head of a pair; the pose is the right camera's in the left one's frame."""
    return (
        NamedCamera("head_1.left", models[0], RigidTransform.identity()),
        NamedCamera("head_1.right", models[1], right_from_left),
    )


def _camera_files(
    files: Sequence[Entries], others: Sequence[Entries], size: tuple[int, int] | None, unit_mm: float
) -> tuple[NamedCamera, ...]:
    """Return the cameras of files that describe one each; `others` may hold the pose between two of them."""
    cameras = tuple(file.camera(size, unit_mm, Path(file.path).stem) for file in files)
    if not others:
        rectified = [file.rectified(unit_mm) for file in files]
        if (
            len(files) == 2
            and None not in rectified
            and all(c.reference_from_camera is None for c in cameras)
        ):
            return _rectified_pair(cameras, rectified)
        return cameras
    pose = _merged(others)
    if len(cameras) != 2 or any(camera.reference_from_camera is not None for camera in cameras):
        raise pose.wrong(
            "R, T", "with a pose in a file of its own, two cameras without a pose", f"{len(cameras)} cameras"
        )
    if not pose.has(*ROTATION) and not pose.has(*TRANSLATION):
        raise pose.wrong("R, T", "a camera, or the pose between two", "neither")
    # As everywhere in these files: the first named is the left one.
    return (
        replace(cameras[0], reference_from_camera=RigidTransform.identity()),
        replace(cameras[1], reference_from_camera=pose.pose(unit_mm)),
    )


def _rectified_pair(
    cameras: Sequence[NamedCamera], rectified: Sequence[tuple[Any, float] | None]
) -> tuple[NamedCamera, ...]:
    """Return a pair with the poses that ROS states through the rectification of each camera.

    A point p of camera n is at ``R_n p + (shift_n, 0, 0)`` in the frame both are rectified to; the first
    camera's frame is the frame of reference.
    """
    rotations, shifts = zip(*(item for item in rectified if item is not None), strict=True)
    left = RigidTransform(rotations[0], np.zeros(3))
    right_shift = np.array([shifts[1] - shifts[0], 0.0, 0.0])
    right = RigidTransform(rotations[1], np.zeros(3))
    step = RigidTransform(np.eye(3), -right_shift)
    return (
        replace(cameras[0], reference_from_camera=RigidTransform.identity()),
        replace(cameras[1], reference_from_camera=left.inverse() @ step @ right),
    )


def _merged(files: Sequence[Entries]) -> Entries:
    """Return the entries of several files as those of one; each remembers its file.

    Raises
    ------
    FormatError
        When a key that makes a camera stands in two of them.
    """
    values: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for file in files:
        for key, value in file.values.items():
            if key in values and key in IMPORTANT and not _same_size(key, value, values[key]):
                raise FormatError(
                    file=f"{sources[key]} and {file.path}",
                    field=key,
                    expected="each key in one of the files",
                    seen="it in both",
                    cure="Give files that belong together: one for each camera, or lenses and pose of a pair",
                )
            values.setdefault(key, value)
            sources.setdefault(key, str(file.path))
    return Entries(values, " and ".join(str(file.path) for file in files), sources=sources)


def _same_size(key: str, one: object, other: object) -> bool:
    """Whether two files state the same size of the images, which does no harm."""
    return isinstance(one, int | float) and one == other
