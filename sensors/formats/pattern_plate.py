"""A plate without ring marks, schema ``truewheel.pattern-plate/1``: circles, chessboard or ChArUco."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import cv2
import numpy as np
from pydantic import Field, model_validator

from alignment.arrays import Array, Index, Mask
from alignment.errors import DegenerateInputError
from alignment.imaging import CornerLook, CornerMark, Orientation, Pattern, PatternKind, Plate, YAxis
from sensors.formats.validation import FilePath, Name, StrictModel

GridIndex = Annotated[int, Field(ge=-200, le=200)]
GridPoint = tuple[GridIndex, GridIndex]
ToleranceMm = Annotated[float, Field(ge=1e-4, le=1)]
Millimetres = Annotated[float, Field(gt=0, le=1000)]

_LARGE = 1.35  # times the others' diameter that a larger corner mark has at least
_DICTIONARIES = tuple(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))
_CIRCLES = (PatternKind.CIRCLES.value, PatternKind.ASYMMETRIC_CIRCLES.value)
_FEWEST = {PatternKind.CIRCLES.value: 2, PatternKind.ASYMMETRIC_CIRCLES.value: 3}


class CornerEntry(StrictModel):
    """The mark that tells one corner of a grid of circles from the others."""

    index: GridPoint = Field(description="Column and row of it")
    look: Literal["missing", "ring", "large"] = Field(
        description="What is different: it is not there; it has a hole; it is larger. A missing or larger "
        "one is none of the plate's marks"
    )
    diameter_mm: Millimetres | None = Field(
        default=None,
        description="Diameter of a larger mark, or of a ring's hole, millimetres; null if missing",
    )


class DirectionEntry(StrictModel):
    """How the plate is held before some heads."""

    heads: tuple[Name, ...] = Field(min_length=1, max_length=16, description="Names of the heads")
    y_axis: Literal["up", "left", "down", "right"] = Field(
        description="Where the plate's y axis points in their images, within 30°"
    )


class PatternPlateFile(StrictModel):
    """What describes a plate without ring marks."""

    schema_: Literal["truewheel.pattern-plate/1"] = Field(
        alias="schema", description="Kind and version of this file"
    )
    name: Name = Field(description="Name of the plate")
    pattern: Literal["circles", "asymmetric_circles", "chessboard", "charuco"] = Field(
        description="What it carries: circles on every place of the grid, or on every other one as the "
        "squares of one colour on a chessboard; squares, whose inner corners are the marks; squares and "
        "markers"
    )
    columns: GridPoint = Field(description="Index i of the first and of the last column; x = i · pitch_x")
    rows: GridPoint = Field(description="Index j of the first and of the last row; y = j · pitch_y")
    pitch_x_mm: float = Field(ge=0.1, le=1000, description="Distance of neighbouring columns, millimetres")
    pitch_y_mm: float = Field(ge=0.1, le=1000, description="Distance of neighbouring rows, millimetres")
    mark_diameter_mm: Millimetres | None = Field(
        default=None, description="Diameter of every circle, millimetres; null for squares"
    )
    bright: bool = Field(default=False, description="True for white circles on black")
    first_square: Literal["dark", "light"] = Field(
        default="dark",
        description="Of a chessboard: the square between its first two columns and first two rows of corners",
    )
    dictionary: str | None = Field(
        default=None, max_length=40, description="Of ChArUco: OpenCV's name of the dictionary; else null"
    )
    first_id: int = Field(
        default=0, ge=0, le=100_000, description="Of ChArUco: number of the marker at the top left"
    )
    marker_mm: Millimetres | None = Field(
        default=None, description="Of ChArUco: side of the markers, millimetres; else null"
    )
    orientation: Literal["marks", "corner", "stage", "upright"] = Field(
        default="marks",
        description="What tells which way round the plate is: its marks alone, its corner mark, its moves on "
        "the stage, or that its y axis is upright in the images",
    )
    corner: CornerEntry | None = Field(default=None, description="The corner mark; null when there is none")
    directions: tuple[DirectionEntry, ...] = Field(
        default=(), max_length=16, description="Heads in whose images the y axis points elsewhere than up"
    )
    mark_tolerance_mm: ToleranceMm = Field(
        default=0.01, description="Marks lie within ± this of the grid, in x and in y, millimetres"
    )
    flatness_tolerance_mm: ToleranceMm = Field(
        default=0.01, description="Marks lie within ± this of the plane, millimetres"
    )
    certificate: FilePath | None = Field(
        default=None,
        description="CSV file with the measured position of every mark, relative to this file's folder",
    )

    @model_validator(mode="after")
    def _is_plate(self) -> PatternPlateFile:
        for name in ("columns", "rows"):
            first, last = getattr(self, name)
            fewest = _FEWEST.get(self.pattern, 3)
            if last - first + 1 < fewest:
                raise DegenerateInputError(
                    field=name,
                    expected=f"the first index, then the last one: at least {fewest} of them",
                    seen=f"{first}, {last}",
                )
        self._check_kind()
        if self.pattern in _CIRCLES:
            self._check_circles()
        if self.pattern == "charuco":
            self._check_charuco()
        self._check_corner()
        self._check_orientation()
        return self

    def _check_kind(self) -> None:
        """What belongs to another pattern is a mistake."""
        circles, charuco = self.pattern in _CIRCLES, self.pattern == "charuco"
        for name, belongs, needed in (
            ("mark_diameter_mm", circles, circles),
            ("bright", circles, False),
            ("first_square", self.pattern == "chessboard", False),
            ("dictionary", charuco, charuco),
            ("first_id", charuco, False),
            ("marker_mm", charuco, charuco),
            ("corner", circles, self.orientation == "corner"),
            ("directions", self.orientation == "upright", False),
        ):
            given = getattr(self, name) != type(self).model_fields[name].default
            if needed and not given:
                raise DegenerateInputError(field=name, expected=f"a value, for {self.pattern}", seen="none")
            if given and not belongs:
                whose = "orientation 'upright'" if name == "directions" else "another pattern"
                raise DegenerateInputError(
                    field=name,
                    expected=f"nothing here: it belongs to {whose}",
                    seen=str(getattr(self, name)),
                )

    def _check_circles(self) -> None:
        asymmetric = self.pattern == "asymmetric_circles"
        x, y = self.pitch_x_mm, self.pitch_y_mm
        nearest = min(math.hypot(x, y), 2.0 * x, 2.0 * y) if asymmetric else min(x, y)
        assert self.mark_diameter_mm is not None
        if not self.mark_diameter_mm < nearest:
            raise DegenerateInputError(
                field="mark_diameter_mm",
                expected=f"less than the distance of neighbouring marks, {nearest:.4g}",
                seen=f"{self.mark_diameter_mm:g}",
            )
        if max(x, y) > 2.5 * min(x, y):
            raise DegenerateInputError(
                field="pitch_x_mm, pitch_y_mm",
                expected="one at most 2.5 times the other",
                seen=f"{x:g} and {y:g}",
            )

    def _check_charuco(self) -> None:
        assert self.marker_mm is not None
        assert self.dictionary is not None
        if self.pitch_x_mm != self.pitch_y_mm:
            raise DegenerateInputError(
                field="pitch_y_mm",
                expected=f"squares: the pitch_x_mm {self.pitch_x_mm:g}",
                seen=f"{self.pitch_y_mm:g}",
            )
        if not self.marker_mm < self.pitch_x_mm:
            raise DegenerateInputError(
                field="marker_mm",
                expected=f"less than a square's side {self.pitch_x_mm:g}",
                seen=f"{self.marker_mm:g}",
            )
        if self.dictionary not in _DICTIONARIES:
            raise DegenerateInputError(
                field="dictionary",
                expected="a dictionary of OpenCV's, such as DICT_5X5_1000",
                seen=f"'{self.dictionary}'",
            )
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary)).bytesList.shape[0]
        squares = (self.columns[1] - self.columns[0] + 2) * (self.rows[1] - self.rows[0] + 2)
        if self.first_id + squares // 2 > known:
            raise DegenerateInputError(
                field="first_id",
                expected=f"{squares // 2} markers from there among the {known} of {self.dictionary}",
                seen=str(self.first_id),
            )

    def _check_corner(self) -> None:
        if self.corner is None:
            return
        i, j = self.corner.index
        if not self._is_place(i, j):
            raise DegenerateInputError(
                field="corner.index", expected="a place of the plate's grid", seen=f"[{i}, {j}]"
            )
        if self.corner.look == "missing":
            return
        seen, smaller = self.corner.diameter_mm, self.mark_diameter_mm or 0.0
        large = self.corner.look == "large"
        if seen is None or (seen < _LARGE * smaller if large else not 0.1 * smaller < seen < 0.9 * smaller):
            raise DegenerateInputError(
                field="corner.diameter_mm",
                expected=f"at least {_LARGE * smaller:.4g}: {_LARGE:g} times that of the other marks"
                if large
                else f"between {0.1 * smaller:.4g} and {0.9 * smaller:.4g}: 0.1 and 0.9 times the mark's",
                seen="none" if seen is None else f"{seen:g}",
            )

    def _check_orientation(self) -> None:
        """A pattern that a turn maps onto itself needs something else that tells."""
        same = self.same_turned()
        if self.orientation == "marks" and same:
            listed = " and ".join(f"{90 * turn}°" for turn in same)
            raise DegenerateInputError(
                field="orientation",
                expected="'corner', 'stage' or 'upright': the pattern looks the same turned by " + listed,
                seen="'marks'",
                cure="See docs/how-to/use-your-own-plate.md for what each of them means",
            )
        if self.orientation == "corner":
            left = self.same_turned(with_corner=True)
            if left:
                raise DegenerateInputError(
                    field="corner.index",
                    expected="a place that no turn of the plate maps onto itself",
                    seen=f"one that looks the same turned by {90 * left[0]}°",
                )

    def same_turned(self, *, with_corner: bool = False) -> tuple[int, ...]:
        """Numbers of the quarter turns that map the marks onto themselves, the corner mark counted or not."""
        if self.pattern == "charuco":
            return ()
        columns, rows = (last - first + 1 for first, last in (self.columns, self.rows))
        squares = self.pattern == "chessboard"
        alike = columns == rows and (squares or abs(self.pitch_x_mm / self.pitch_y_mm - 1.0) < 0.03)
        turns = [2] + ([1, 3] if alike else [])
        if with_corner and self.corner is not None:
            i, j = self.corner.index[0] - self.columns[0], self.corner.index[1] - self.rows[0]
            onto = {
                1: (columns - 1 - j, i),
                2: (columns - 1 - i, rows - 1 - j),
                3: (j, rows - 1 - i),
            }
            turns = [turn for turn in turns if onto[turn] == (i, j)]
        if squares:
            # The first square goes to the last, or to one beside another corner: its colour must be the same.
            turns = [turn for turn in turns if (columns + rows if turn == 2 else columns) % 2 == 0]
        if self.pattern == "asymmetric_circles":
            turns = [turn for turn in turns if (columns + rows if turn == 2 else columns - 1) % 2 == 0]
        return tuple(turns)

    def _is_place(self, i: int, j: int) -> bool:
        inside = self.columns[0] <= i <= self.columns[1] and self.rows[0] <= j <= self.rows[1]
        asymmetric = self.pattern == "asymmetric_circles"
        return inside and not (asymmetric and (i + j - self.columns[0] - self.rows[0]) % 2)

    @property
    def indices(self) -> Index:
        """(M, 2) column and row of every mark, row by row."""
        j, i = np.mgrid[self.rows[0] : self.rows[1] + 1, self.columns[0] : self.columns[1] + 1]
        places = np.column_stack([i.ravel(), j.ravel()]).astype(np.int64)
        kept = np.array([self._is_place(int(i), int(j)) for i, j in places])
        if self.corner is not None and self.corner.look != "ring":
            kept &= (places != self.corner.index).any(axis=1)
        found: Index = places[kept]
        return found

    def hollow(self, head: str | None = None) -> Mask:
        """(M,) which marks are rings: the corner mark, where it is one."""
        ring = self.corner is not None and self.corner.look == "ring"
        indices = self.indices
        at = (indices == self.corner.index).all(axis=1) if self.corner else np.zeros(len(indices), dtype=bool)
        found: Mask = at & ring
        return found

    def pattern_for(self, head: str | None = None) -> Pattern:
        """Return what the plate carries, as a head sees it."""
        y_axis = next((d.y_axis for d in self.directions if head is not None and head in d.heads), "up")
        corner = None
        if self.corner is not None:
            radius = (self.corner.diameter_mm or 0.0) / 2 if self.corner.look == "large" else 0.0
            corner = CornerMark(self.corner.index, CornerLook(self.corner.look), radius)
        return Pattern(
            kind=PatternKind(self.pattern),
            bright=self.bright,
            orientation=Orientation(self.orientation),
            y_axis=YAxis(y_axis),
            corner=corner,
            first_dark=self.first_square == "dark",
            dictionary=self.dictionary or "",
            first_id=self.first_id,
            marker_share=(self.marker_mm or 0.0) / self.pitch_x_mm,
        )

    def plate(self) -> Plate:
        """Return the plate with its marks where the grid says."""
        indices, ring = self.indices, self.corner is not None and self.corner.look == "ring"
        pitch = np.array([self.pitch_x_mm, self.pitch_y_mm])
        points: Array = np.column_stack([indices * pitch, np.zeros(len(indices))])
        # A tolerance of ±a, evenly distributed, has the standard uncertainty a/√3 (JCGM 100, 4.3.7).
        tolerances = [self.mark_tolerance_mm, self.mark_tolerance_mm, self.flatness_tolerance_mm]
        hole = self.corner.diameter_mm if ring and self.corner is not None else None
        return Plate(
            indices=indices,
            points=points,
            sigma_mm=np.tile(np.array(tolerances) / math.sqrt(3.0), (len(indices), 1)),
            mark_radius_mm=(self.mark_diameter_mm or 0.0) / 2,
            hollow=self.hollow(),
            hollow_radius_mm=(hole or 0.0) / 2,
            pattern=self.pattern_for(),
        )

    @property
    def grid_pitch_mm(self) -> tuple[float, float]:
        """Distances of neighbouring columns and rows, millimetres."""
        return self.pitch_x_mm, self.pitch_y_mm
