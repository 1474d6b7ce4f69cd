"""Which mark of a plate without ring marks each found mark is: every way that fits, and what decides."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from alignment.arrays import Array, Index, Mask
from alignment.imaging.mark_bias import homography_offsets
from alignment.imaging.mark_plane import PlaneView, fit_grid_homography
from alignment.imaging.pattern import QUARTER_TURNS, Orientation, YAxis, place_table, rows_at
from alignment.imaging.plate import MarkObservations, Plate
from alignment.imaging.plate_refusal import PlateRefusal, PlateRefusalCode, missing_marks

_CLEARLY = math.radians(15.0)  # nearer to the wanted direction than the next turn
_DIRECTIONS = {
    YAxis.UP: (0.0, -1.0),
    YAxis.LEFT: (-1.0, 0.0),
    YAxis.DOWN: (0.0, 1.0),
    YAxis.RIGHT: (1.0, 0.0),
}


@dataclass(frozen=True, eq=False)
class Numberings:
    """Marks of one plate in one image, numbered in each way that fits; never without any.

    Attributes
    ----------
    plate
        The plate.
    places
        (K, 2) columns and rows of the marks, up to a turn and a shift.
    turns, shifts
        (C,) number of the quarter turn and (C, 2) the shift that make columns and rows of the plate of
        `places`, one for each way.
    pixels, covariance
        (K, 2), (K, 2, 2): centres of the marks' outlines, or corners of squares.
    size
        (width, height) of the image, pixels.
    margin_px
        How far from the image's border a mark must be to be seen.
    blur_px, contrast
        As in `MarkObservations`.
    """

    plate: Plate
    places: Index
    turns: Index
    shifts: Index
    pixels: Array
    covariance: Array
    size: tuple[int, int]
    margin_px: float
    blur_px: float
    contrast: float

    def __len__(self) -> int:
        return len(self.turns)

    def rows(self, way: int) -> Index:
        """Rows (K,) of the plate that the marks are."""
        table, origin = place_table(self.plate.indices)
        turned = self.places @ QUARTER_TURNS[int(self.turns[way])].T
        return rows_at(table, origin, turned + self.shifts[way])

    def y_axis(self, way: int) -> Array:
        """Direction (2,) of the plate's y axis in the image, of length 1."""
        plane = self.plate.points[self.rows(way), :2]
        design = np.column_stack([plane, np.ones(len(plane))])
        along = np.linalg.lstsq(design, self.pixels, rcond=None)[0][1]
        direction: Array = along / max(float(np.hypot(*along)), 1e-12)
        return direction

    def only(self, ways: Mask | list[int]) -> Numberings:
        """Return some of the ways."""
        return replace(self, turns=self.turns[ways], shifts=self.shifts[ways])

    def observations(self, way: int, *, corrected: bool) -> MarkObservations | PlateRefusal:
        """Return the marks numbered in one way, `corrected` as in `identify_marks`; refused if many hide."""
        rows, pixels = self.rows(way), self.pixels
        view = PlaneView.fit(self.plate.points[rows, :2], pixels, self.size)
        missing = missing_marks(view, self.plate, rows, self.size, self.margin_px)
        if missing is not None:
            return missing
        radius = self.plate.mark_radius_mm
        if corrected and radius > 0.0:
            plane = self.plate.points[rows, :2]
            pixels = pixels + homography_offsets(fit_grid_homography(plane, pixels), plane, radius)
        order = np.argsort(rows)
        return MarkObservations(
            marks=rows[order],
            pixels=pixels[order],
            covariance=self.covariance[order],
            corrected=corrected or radius == 0.0,
            blur_px=self.blur_px,
            contrast=self.contrast,
        )


def ways_to_number(
    places: Index, plate: Plate, turns: tuple[int, ...] = (0, 1, 2, 3)
) -> tuple[Index, Index] | Literal[PlateRefusalCode.MIRRORED, PlateRefusalCode.NOT_THIS_PLATE]:
    """All turns (C,) and shifts (C, 2) that put every place (K, 2) on a mark, or why there are none.

    Parameters
    ----------
    places
        Columns and rows up to a turn and a shift, never mirrored.
    plate
        The plate.
    turns
        Numbers of `QUARTER_TURNS` that the pattern leaves open.
    """
    found = _ways(places, plate, turns)
    if len(found[0]):
        return found
    if len(_ways(places * np.array([-1, 1]), plate, (0, 1, 2, 3))[0]):
        return PlateRefusalCode.MIRRORED
    return PlateRefusalCode.NOT_THIS_PLATE


def _ways(places: Index, plate: Plate, turns: tuple[int, ...]) -> tuple[Index, Index]:
    table, origin = place_table(plate.indices)
    last = origin + np.array(table.shape) - 1
    kept_turns, kept_shifts = [], []
    for turn in turns:
        turned = places @ QUARTER_TURNS[turn].T
        low, high = origin - turned.min(axis=0), last - turned.max(axis=0)
        for i in range(int(low[0]), int(high[0]) + 1):
            for j in range(int(low[1]), int(high[1]) + 1):
                if (rows_at(table, origin, turned + np.array([i, j])) >= 0).all():
                    kept_turns.append(turn)
                    kept_shifts.append((i, j))
    return np.array(kept_turns, dtype=np.int64), np.array(kept_shifts, dtype=np.int64).reshape(-1, 2)


def decided(found: Numberings, *, corrected: bool) -> MarkObservations | PlateRefusal:
    """Return the one numbering that image and plate file allow, or why there is not one."""
    if len(found) == 1:
        return found.observations(0, corrected=corrected)
    pattern = found.plate.pattern
    if pattern.orientation is Orientation.UPRIGHT:
        return turned_to(found, np.array(_DIRECTIONS[pattern.y_axis]), corrected=corrected)
    return undecided(found)


def turned_to(found: Numberings, direction: Array, *, corrected: bool) -> MarkObservations | PlateRefusal:
    """Return the numbering whose y axis points most nearly in a direction (2,) of the image, or a refusal."""
    ways = nearest_turn(found, direction)
    if ways is None:
        return PlateRefusal(
            PlateRefusalCode.AMBIGUOUS,
            "the plate is turned half-way between two ways round that look the same. "
            "Turn it so that its y axis is as the plate file says.",
        )
    left = found.only(ways)
    return left.observations(0, corrected=corrected) if len(left) == 1 else undecided(left)


def nearest_turn(found: Numberings, direction: Array) -> list[int] | None:
    """Return the ways of the turn whose y axis is nearest to a direction (2,); None where two are alike."""
    first = {int(turn): way for way, turn in reversed(list(enumerate(found.turns)))}
    angles = {}
    for turn, way in first.items():
        cosine = float(found.y_axis(way) @ direction) / max(float(np.hypot(*direction)), 1e-12)
        angles[turn] = math.acos(min(max(cosine, -1.0), 1.0))
    best, *others = sorted(angles, key=lambda turn: angles[turn])
    if others and angles[others[0]] - angles[best] < _CLEARLY:
        return None
    return [int(way) for way in np.flatnonzero(found.turns == best)]


def undecided(found: Numberings) -> PlateRefusal:
    """Return the refusal of an image that fits the plate in several ways."""
    if len(np.unique(found.turns)) < len(found):
        spans = sorted((np.ptp(found.places, axis=0) + 1).tolist())
        whole = sorted((np.ptp(found.plate.indices, axis=0) + 1).tolist())
        return PlateRefusal(
            PlateRefusalCode.AMBIGUOUS,
            f"a part of {spans[0]} × {spans[1]} places of the plate's {whole[0]} × {whole[1]} is seen, which "
            f"fits {len(found)} places of it, and nothing tells which part it is. Show the whole plate, or "
            "use one whose marks tell, such as ChArUco or one with ring marks.",
        )
    turns = " or ".join(f"{90 * int((turn - found.turns[0]) % 4)}°" for turn in found.turns[1:])
    return PlateRefusal(
        PlateRefusalCode.AMBIGUOUS,
        f"the plate looks the same turned by {turns}, and nothing tells which way round it is. {_CURE}",
    )


_CURE = (
    "Move it on a stage along x or y and say orientation = 'stage' in the plate file, or mark a corner and "
    "say 'corner', or keep its y axis upright in the images and say 'upright'."
)
