"""Entries of a file, or of files that belong together, as matrices, cameras and poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike, fspath
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.errors import Deed, FormatError, Remedy
from alignment.geometry import CameraModel, RigidTransform
from sensors.formats.exchange.cameras import NamedCamera, brown_camera, reference_from
from sensors.formats.exchange.names import (
    DISTORTION,
    HEIGHT,
    MATRIX,
    PROJECTION,
    RECTIFICATION,
    ROTATION,
    TRANSLATION,
    WIDTH,
)

_COUNTS = (4, 5, 8, 12, 14)


@dataclass(frozen=True, eq=False)
class Entries:
    """A map as plain values, with its place for messages.

    Attributes
    ----------
    values
        Numbers, text, matrices, lists and maps by their keys.
    path
        The file, or the files, as a message names them.
    place
        Where in the file the map is.
    sources
        The file of each key, where there are several.
    """

    values: dict[str, Any]
    path: str
    place: str = ""
    sources: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of_file(cls, path: str | PathLike[str], values: dict[str, Any]) -> Entries:
        """Return the entries of one file."""
        return cls(values, fspath(path))

    def has(self, *names: str) -> bool:
        """Whether a key of one of these names is there."""
        return any(name in self.values for name in names)

    def file_of(self, key: str) -> str:
        """Return the file that holds a key; all of them when none does."""
        return self.sources.get(key, self.path)

    def where(self, key: str) -> str:
        """Return the place of a key in its file."""
        return f"{self.place}.{key}" if self.place else key

    def wrong(self, key: str, expected: str, seen: str, remedy: Remedy | None = None) -> FormatError:
        """Return the error about an entry."""
        return FormatError(
            file=self.file_of(key), field=self.where(key), expected=expected, seen=seen, remedy=remedy
        )

    def list_of(self, key: str) -> list[Entries]:
        """Return the maps in a list."""
        found = self.values[key]
        if not isinstance(found, list) or not found or not all(isinstance(item, dict) for item in found):
            raise self.wrong(key, "a list of cameras", "none")
        return [Entries(item, self.file_of(key), f"{key}[{n}]") for n, item in enumerate(found)]

    def name_of(self, names: tuple[str, ...]) -> str:
        """Return the name under which an entry is there, the first when under none.

        Raises
        ------
        FormatError
            When it is there under two that say different things.
        """
        there = [name for name in names if name in self.values]
        for other in there[1:]:
            if not _equal(self.values[there[0]], self.values[other]):
                raise self.wrong(other, f"the same as under '{there[0]}'", "something else")
        return there[0] if there else names[0]

    def matrix(self, names: tuple[str, ...], *shapes: tuple[int, ...]) -> Array:
        """Return a matrix in the first of the shapes that fits; (n,) fits a row and a column, a list all."""
        key = self.name_of(names)
        expected = (
            f"a matrix of {' or '.join(' × '.join(map(str, shape)) for shape in shapes)} finite numbers"
        )
        found = self.values.get(key)
        try:
            array = np.asarray(found, dtype=np.float64) if isinstance(found, np.ndarray | list) else None
        except (TypeError, ValueError):
            array = None
        if array is None:
            raise self.wrong(key, expected, "none" if found is None else "another kind of entry")
        listed = isinstance(found, list) and array.ndim == 1
        for shape in shapes:
            one_row = len(shape) == 1 and array.size == shape[0] and shape[0] == max(array.shape, default=0)
            if array.shape == shape or one_row or (listed and array.size == int(np.prod(shape))):
                if not np.isfinite(array).all():
                    raise self.wrong(key, expected, "others")
                return array.reshape(shape)
        raise self.wrong(key, expected, " × ".join(map(str, array.shape)) or "a single number")

    def size(self, known: tuple[int, int] | None) -> tuple[int, int]:
        """Return width and height of the images: the stated ones, else the known ones."""
        stated = [self.values.get(self.name_of(names)) for names in (WIDTH, HEIGHT)]
        whole = [int(n) for n in stated if isinstance(n, int | float) and float(n).is_integer()]
        if len(whole) == 2:
            return whole[0], whole[1]
        if known is None:
            raise self.wrong(
                "image_width",
                "the size of the images under image_width and image_height",
                "none",
                Remedy(Deed.SAY_IMAGE_SIZE),
            )
        return known

    def model(
        self, matrix: tuple[str, ...], coefficients: tuple[str, ...], size: tuple[int, int] | None
    ) -> CameraModel:
        """Return the camera that a matrix and its coefficients describe."""
        wanted = self.size(size)
        key = self.name_of(matrix)
        k = self.matrix(matrix, (3, 3))
        if k[0, 1] != 0 or (k[1, 0], *k[2]) != (0, 0, 0, 1):
            raise self.wrong(key, "fx 0 cx, 0 fy cy, 0 0 1", str(k.tolist()))
        d = self.matrix(coefficients, *((count,) for count in _COUNTS))
        intrinsics = [float(value) for value in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])]
        return brown_camera(wanted, intrinsics, d.tolist(), self.file_of(key), self.place or key)

    def pose(self, unit_mm: float) -> RigidTransform:
        """Return reference from camera, of R (a matrix or a rotation vector) and T."""
        rotation, translation = self.matrix(ROTATION, (3, 3), (3,)), self.matrix(TRANSLATION, (3,))
        if rotation.shape == (3,):
            rotation = np.asarray(Rotation.from_rotvec(rotation).as_matrix())
        key = self.name_of(ROTATION)
        return reference_from(rotation, unit_mm * translation, self.file_of(key), self.place or key)

    def camera(self, size: tuple[int, int] | None, unit_mm: float, name: str = "") -> NamedCamera:
        """Return the camera of this map; its pose where it states one."""
        model = self.model(MATRIX, DISTORTION, size)
        posed = self.has(*ROTATION) and self.has(*TRANSLATION)
        stated = self.values.get("name", name or self.place)
        return NamedCamera(str(stated), model, self.pose(unit_mm) if posed else None)

    def rectified(self, unit_mm: float) -> tuple[Array, float] | None:
        """Return the rotation to the rectified frame and the shift along x in it, as ROS states them.

        The shift is that of the point, millimetres: ``P[0, 3] / P[0, 0]``. None without both matrices.
        """
        if self.has(*TRANSLATION) or not (self.has(*PROJECTION) and self.has(*RECTIFICATION)):
            return None
        rotation, projection = self.matrix(RECTIFICATION, (3, 3)), self.matrix(PROJECTION, (3, 4))
        key = self.name_of(RECTIFICATION)
        upright = reference_from(rotation, np.zeros(3), self.file_of(key), self.where(key)).inverse()
        if not projection[0, 0] > 0:
            raise self.wrong(self.name_of(PROJECTION), "a focal length above 0", f"{projection[0, 0]:g}")
        return upright.rotation, unit_mm * float(projection[0, 3] / projection[0, 0])


def _equal(one: Any, other: Any) -> bool:
    try:
        return bool(np.array_equal(np.asarray(one, dtype=float), np.asarray(other, dtype=float)))
    except (TypeError, ValueError):
        return bool(one == other)
