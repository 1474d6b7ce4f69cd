"""OpenCV's YAML, as `cv2.FileStorage` writes it.

Truewheel writes one file: a list ``cameras`` of maps with ``name``, ``image_width``, ``image_height``,
``camera_matrix``, ``distortion_coefficients``, ``R`` and ``T``, where p_camera = R p_rig + T, millimetres.

Read are, besides: files of one camera (``camera_matrix``, ``distortion_coefficients``, ``image_width``,
``image_height``, as OpenCV's calibration sample writes them), which state no pose; and of a pair (``M1``,
``D1``, ``M2``, ``D2``, ``R``, ``T``, in one file or, as its stereo sample writes them, in two), where R and T
take points of the first camera to the second, and the first camera's frame is the frame of reference.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.errors import Deed, FormatError, Remedy
from alignment.geometry.cameras import CameraModel
from alignment.geometry.transforms import RigidTransform
from alignment.values import RigCalibration
from sensors.formats.exchange.cameras import (
    NamedCamera,
    brown_camera,
    cameras_to_export,
    reference_from,
)
from sensors.formats.files import read_bytes, write_bytes

_COUNTS = (4, 5, 8, 12, 14)
_PARSING_ERROR = re.compile(r"\((\d+)\): (.*)'")
_MATRIX_KEYS = {"rows", "cols", "dt", "data"}
_MEMORY = cv2.FILE_STORAGE_MEMORY


def write_opencv(path: Path, calibration: RigCalibration) -> None:
    """Write all cameras into one file; errors as `exchange.export_calibration`."""
    storage = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | _MEMORY)
    storage.write("calibration_id", calibration.id)
    storage.write("rig", calibration.rig)
    storage.startWriteStruct("cameras", cv2.FILE_NODE_SEQ)
    for head, side, model, camera_from_rig in cameras_to_export(calibration, path, "OpenCV", _COUNTS[1:]):
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
        One file, or several whose entries belong together.
    unit_mm
        Millimetres in the unit of T.
    size
        (width, height), pixels, when the files do not state it.

    Raises
    ------
    FormatError
        When a file is missing or damaged, or lacks what makes a camera.
    """
    entries: dict[str, Any] = {}
    for path in paths:
        entries.update(_read_storage(path))
    top = _Entries(entries, paths[0])
    if "cameras" in entries:
        return tuple(entry.camera(size, unit_mm) for entry in top.list_of("cameras"))
    for left, right in (("M1", "M2"), ("K1", "K2"), ("cameraMatrix1", "cameraMatrix2")):
        if left in entries and right in entries:
            return _read_pair(top, left, right, size, unit_mm)
    return (top.camera(size, unit_mm, paths[0].stem),)


def _read_pair(
    top: _Entries, left: str, right: str, size: tuple[int, int] | None, unit_mm: float
) -> tuple[NamedCamera, ...]:
    first, second = (
        top.model(matrix, f"D{n}" if f"D{n}" in top.values else f"distCoeffs{n}", size)
        for n, matrix in ((1, left), (2, right))
    )
    return (
        NamedCamera("head_1.left", first, RigidTransform.identity()),
        NamedCamera("head_1.right", second, top.pose(unit_mm)),
    )


@dataclass(frozen=True)
class _Entries:
    """A map of a file storage as plain values, with its place for messages."""

    values: dict[str, Any]
    path: Path
    place: str = ""

    def wrong(self, key: str, expected: str, seen: str, remedy: Remedy | None = None) -> FormatError:
        field = f"{self.place}.{key}" if self.place else key
        return FormatError(file=self.path, field=field, expected=expected, seen=seen, remedy=remedy)

    def list_of(self, key: str) -> list[_Entries]:
        """Return the maps in a list."""
        found = self.values[key]
        if not isinstance(found, list) or not found or not all(isinstance(item, dict) for item in found):
            raise self.wrong(key, "a list of cameras", "none")
        return [_Entries(item, self.path, f"{key}[{n}]") for n, item in enumerate(found)]

    def matrix(self, key: str, *shapes: tuple[int, ...]) -> Array:
        """Return a matrix in the first of the shapes that fits; (n,) fits a row and a column."""
        expected = (
            f"a matrix of {' or '.join(' × '.join(map(str, shape)) for shape in shapes)} finite numbers"
        )
        found = self.values.get(key)
        if not isinstance(found, np.ndarray):
            raise self.wrong(key, expected, "none" if found is None else "another kind of entry")
        array = np.asarray(found, dtype=np.float64)
        for shape in shapes:
            if array.shape == shape or (len(shape) == 1 and array.size == shape[0] == max(array.shape)):
                if not np.isfinite(array).all():
                    raise self.wrong(key, expected, "others")
                return array.reshape(shape)
        raise self.wrong(key, expected, " × ".join(map(str, array.shape)))

    def model(self, matrix: str, coefficients: str, size: tuple[int, int] | None) -> CameraModel:
        """Return the camera that a matrix and its coefficients describe."""
        if self.values.get("fisheye_model", 0) != 0:
            raise self.wrong("fisheye_model", "0: Truewheel has no fisheye lenses", "1")
        stated = [self.values.get(key) for key in ("image_width", "image_height")]
        if isinstance(stated[0], int) and isinstance(stated[1], int):
            size = stated[0], stated[1]
        if size is None:
            raise self.wrong(
                "image_width",
                "the size of the images under image_width and image_height",
                "none",
                Remedy(Deed.SAY_IMAGE_SIZE),
            )
        k = self.matrix(matrix, (3, 3))
        if k[0, 1] != 0 or (k[1, 0], *k[2]) != (0, 0, 0, 1):
            raise self.wrong(matrix, "fx 0 cx, 0 fy cy, 0 0 1", str(k.tolist()))
        d = self.matrix(coefficients, *((count,) for count in _COUNTS))
        intrinsics = [float(value) for value in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])]
        return brown_camera(size, intrinsics, d.tolist(), self.path, self.place or matrix)

    def pose(self, unit_mm: float) -> RigidTransform:
        """Return reference from camera, of R (a matrix or a rotation vector) and T."""
        rotation, translation = self.matrix("R", (3, 3), (3,)), self.matrix("T", (3,))
        if rotation.shape == (3,):
            rotation = np.asarray(Rotation.from_rotvec(rotation).as_matrix())
        return reference_from(rotation, unit_mm * translation, self.path, f"{self.place or 'R'}")

    def camera(self, size: tuple[int, int] | None, unit_mm: float, name: str = "") -> NamedCamera:
        """Return the camera of this map; its pose where it states one."""
        model = self.model("camera_matrix", "distortion_coefficients", size)
        posed = "R" in self.values and "T" in self.values
        stated = self.values.get("name", name or self.place)
        return NamedCamera(str(stated), model, self.pose(unit_mm) if posed else None)


def _read_storage(path: Path) -> dict[str, Any]:
    kind = "calibration data of OpenCV"
    content = read_bytes(path, kind)
    storage = cv2.FileStorage()
    try:
        opened = storage.open(content.decode(), cv2.FILE_STORAGE_READ | _MEMORY)
        found = _plain(storage.root()) if opened else None
    except (cv2.error, SystemError, UnicodeDecodeError, RecursionError) as error:
        # OpenCV reports the line and what is wrong with it among the names of its own sources.
        report = _PARSING_ERROR.search(str(error))
        seen = f"an error in line {report[1]}: {report[2]}" if report else "damage, or another kind of file"
        raise FormatError(file=path, expected=kind, seen=seen) from error
    if not isinstance(found, dict):
        raise FormatError(file=path, expected=kind, seen="another kind of file")
    return found


def _plain(node: Any) -> Any:
    """Return a node as map, list, matrix, number or text: nodes themselves die with their storage."""
    if node.isMap():
        keys = node.keys()
        if set(keys) >= _MATRIX_KEYS:
            return node.mat()
        return {key: _plain(node.getNode(key)) for key in keys}
    if node.isSeq():
        return [_plain(node.at(n)) for n in range(node.size())]
    if node.isInt():
        return int(node.real())
    if node.isReal():
        return float(node.real())
    return node.string() if node.isString() else None
