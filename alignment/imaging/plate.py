"""A calibration plate, and where an image shows its marks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index, Mask
from alignment.errors import DegenerateInputError
from alignment.imaging.pattern import RING_MARKED, Pattern


@dataclass(frozen=True, eq=False)
class Plate:
    """Marks of a plate in the plate's own frame: x along the columns, y along the rows, z = 0.

    Marks are round, or the corners of squares.

    Attributes
    ----------
    indices
        (M, 2) column i and row j of each mark in the plate's grid.
    points
        (M, 3) nominal or certified positions, millimetres.
    sigma_mm
        (M, 3) their standard uncertainties, millimetres.
    mark_radius_mm
        Radius of every mark; 0 for corners of squares.
    hollow
        (M,) True for ring marks, whose arrangement tells which part of the plate is seen.
    hollow_radius_mm
        Radius of the light centre of a ring mark; 0 where there are none.
    pattern
        What the marks are, and what tells which is which.
    """

    indices: Index
    points: Array
    sigma_mm: Array
    mark_radius_mm: float
    hollow: Mask
    hollow_radius_mm: float
    pattern: Pattern = RING_MARKED

    def __post_init__(self) -> None:
        count = len(self.points)
        for name, shape in (
            ("indices", (count, 2)),
            ("points", (count, 3)),
            ("sigma_mm", (count, 3)),
            ("hollow", (count,)),
        ):
            values = getattr(self, name)
            if values.shape != shape or not np.isfinite(values).all():
                raise DegenerateInputError(
                    field=f"plate.{name}", expected=f"finite numbers of shape {shape}", seen=str(values.shape)
                )
        if count < 4 or len(np.unique(self.indices, axis=0)) != count:
            raise DegenerateInputError(
                field="plate.indices",
                expected="at least four marks, each with its own (column, row)",
                seen=f"{count} marks, {len(np.unique(self.indices, axis=0))} different",
            )
        if (self.sigma_mm < 0).any() or not self._size_is_right() or self.hollow_radius_mm < 0:
            raise DegenerateInputError(
                field="plate.sigma_mm, plate.mark_radius_mm",
                expected="uncertainties of at least 0 and a positive radius, 0 for corners of squares",
                seen=f"least uncertainty {self.sigma_mm.min()}, radius {self.mark_radius_mm}",
            )

    def _size_is_right(self) -> bool:
        return self.mark_radius_mm == 0 if self.pattern.has_squares else self.mark_radius_mm > 0


@dataclass(frozen=True, eq=False)
class MarkObservations:
    """The marks that one camera saw in one view.

    Attributes
    ----------
    marks
        (K,) rows of the `Plate`.
    pixels
        (K, 2) where they lie in the image.
    covariance
        (K, 2, 2) of `pixels`, pixels².
    corrected
        True when `pixels` are the projections of the marks' centres; False when they are the centres of the
        imaged contours, which perspective and distortion shift from there.
    blur_px
        Standard deviation of the blur of the marks' edges, pixels, the median over the marks; None where it
        is not known.
    contrast
        Grey levels between mark and ground over the noise of a pixel, the median over the marks; None where
        it is not known.
    """

    marks: Index
    pixels: Array
    covariance: Array
    corrected: bool = True
    blur_px: float | None = None
    contrast: float | None = None

    def __post_init__(self) -> None:
        count = len(self.marks)
        if self.pixels.shape != (count, 2) or self.covariance.shape != (count, 2, 2):
            raise DegenerateInputError(
                field="pixels, covariance",
                expected=f"shapes ({count}, 2) and ({count}, 2, 2) for {count} marks",
                seen=f"{self.pixels.shape} and {self.covariance.shape}",
            )
        if len(np.unique(self.marks)) != count:
            raise DegenerateInputError(field="marks", expected="each mark once", seen="one mark twice")
