"""What a plate carries: which marks, and what tells which way round they are seen."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Index


class PatternKind(enum.StrEnum):
    """What a plate carries."""

    RING_MARKS = "ring_marks"
    CIRCLES = "circles"
    ASYMMETRIC_CIRCLES = "asymmetric_circles"
    CHESSBOARD = "chessboard"
    CHARUCO = "charuco"


class Orientation(enum.StrEnum):
    """What tells which way round a plate is seen, where its pattern looks the same after a turn."""

    MARKS = "marks"
    CORNER = "corner"
    STAGE = "stage"
    UPRIGHT = "upright"


class CornerLook(enum.StrEnum):
    """How the mark at a plate's marked corner differs from the others."""

    MISSING = "missing"
    RING = "ring"
    LARGE = "large"


class YAxis(enum.StrEnum):
    """Where the plate's y axis points in the image."""

    UP = "up"
    LEFT = "left"
    DOWN = "down"
    RIGHT = "right"


@dataclass(frozen=True)
class CornerMark:
    """The mark that tells one place of a grid from the others that a turn brings there.

    Attributes
    ----------
    index
        Column and row; where the mark is missing, or larger than the others, it is none of the plate's marks.
    look
        What is different about it.
    radius_mm
        Of a larger mark; 0 otherwise.
    """

    index: tuple[int, int]
    look: CornerLook
    radius_mm: float = 0.0


@dataclass(frozen=True)
class Pattern:
    """What a plate carries besides the places of its marks.

    Attributes
    ----------
    kind
        Round marks or corners of squares, and how they are arranged.
    bright
        True for white marks on a black ground.
    orientation, y_axis, corner
        What tells which way round the plate is seen; where its y axis points in the image, for ``upright``,
        within 30°; the corner mark, for ``corner``.
    first_dark
        Of squares: True when the one between the first two columns and the first two rows of corners is dark.
    dictionary, first_id, marker_share
        Of ChArUco: OpenCV's name of the markers' dictionary; number of the marker at the top left, from where
        they count to the right and then down; side of a marker over that of its square.
    """

    kind: PatternKind = PatternKind.RING_MARKS
    bright: bool = False
    orientation: Orientation = Orientation.MARKS
    y_axis: YAxis = YAxis.UP
    corner: CornerMark | None = None
    first_dark: bool = True
    dictionary: str = ""
    first_id: int = 0
    marker_share: float = 0.0

    @property
    def has_squares(self) -> bool:
        """Whether the marks are corners of squares, and no circles."""
        return self.kind in (PatternKind.CHESSBOARD, PatternKind.CHARUCO)


QUARTER_TURNS: tuple[Index, ...] = tuple(
    np.array(turn, dtype=np.int64)
    for turn in (((1, 0), (0, 1)), ((0, -1), (1, 0)), ((-1, 0), (0, -1)), ((0, 1), (-1, 0)))
)
"""Turns by 0°, 90°, 180° and 270° of columns and rows, counter-clockwise as seen from the marks' side."""


def place_table(indices: Index) -> tuple[Index, Index]:
    """Rows of marks by column and row, −1 where there is none, and the index (2,) of its first cell."""
    origin = indices.min(axis=0)
    table = np.full(indices.max(axis=0) - origin + 1, -1, dtype=np.int64)
    table[tuple((indices - origin).T)] = np.arange(len(indices))
    return table, origin


def rows_at(table: Index, origin: Index, indices: Index) -> Index:
    """Rows (N,) of the marks at indices (N, 2), −1 where there is none; `table` as `place_table` makes it."""
    local = indices - origin
    inside = ((local >= 0) & (local < table.shape)).all(axis=1)
    rows = np.full(len(indices), -1, dtype=np.int64)
    rows[inside] = table[tuple(local[inside].T)]
    return rows


RING_MARKED = Pattern()
"""Dark round marks, of which rings tell the place."""
