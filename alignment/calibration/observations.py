"""What a calibration is made of: a plate, and where each camera saw its marks in each view."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from alignment.arrays import Array, Index, Mask
from alignment.errors import DegenerateInputError

CameraKey = tuple[str, Literal["left", "right"]]
"""Name of the head, and which of its cameras."""

# A tolerance of ±a, evenly distributed, has the standard uncertainty a/√3 (JCGM 100, 4.3.7).
MARK_SIGMA_MM = 0.01 / math.sqrt(3.0)
FLATNESS_SIGMA_MM = 0.005
STAGE_SIGMA_MM = 0.01 / math.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class Plate:
    """Round marks of a plate in the plate's own frame: x along the columns, y along the rows, z = 0.

    Attributes
    ----------
    indices
        (M, 2) column i and row j of each mark in the plate's grid.
    points
        (M, 3) nominal or certified positions, millimetres.
    sigma_mm
        (M, 3) their standard uncertainties, millimetres.
    mark_radius_mm
        Radius of every mark.
    hollow
        (M,) True for ring marks, whose arrangement tells which part of the plate is seen.
    hollow_radius_mm
        Radius of the light centre of a ring mark; 0 where there are none.
    """

    indices: Index
    points: Array
    sigma_mm: Array
    mark_radius_mm: float
    hollow: Mask
    hollow_radius_mm: float

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
        if (self.sigma_mm < 0).any() or self.mark_radius_mm <= 0 or self.hollow_radius_mm < 0:
            raise DegenerateInputError(
                field="plate.sigma_mm, plate.mark_radius_mm",
                expected="uncertainties of at least 0 and a positive radius",
                seen=f"least uncertainty {self.sigma_mm.min()}, radius {self.mark_radius_mm}",
            )


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
    """

    marks: Index
    pixels: Array
    covariance: Array
    corrected: bool = True

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


@dataclass(frozen=True, eq=False)
class PlateView:
    """One position of the plate and what the cameras saw of it.

    Attributes
    ----------
    name
        Name of the view, for messages.
    stage_mm
        (3,) nominal position of the plate's origin in the rig (or head) frame, its axes parallel to the
        frame's; None for a plate held by hand, whose pose is unknown.
    observations
        By head and camera; a camera that is missing saw nothing.
    """

    name: str
    stage_mm: Array | None
    observations: dict[CameraKey, MarkObservations]


@dataclass(frozen=True, eq=False)
class CalibrationInput:
    """All that one calibration is computed from.

    Attributes
    ----------
    plate
        The plate of all views.
    views
        At least one.
    sizes
        (width, height) of each camera's images, pixels; names every camera of the rig, heads in the order in
        which a shot gives their images, left before right.
    stage_sigma_mm
        Standard uncertainty of each coordinate of the stage's positions.
    """

    plate: Plate
    views: tuple[PlateView, ...]
    sizes: dict[CameraKey, tuple[int, int]]
    stage_sigma_mm: float = STAGE_SIGMA_MM

    def __post_init__(self) -> None:
        if not self.views or not self.sizes:
            raise DegenerateInputError(
                field="views, sizes",
                expected="at least one view and one camera",
                seen=f"{len(self.views)} views, {len(self.sizes)} cameras",
            )
        for view in self.views:
            for key, seen in view.observations.items():
                if key not in self.sizes:
                    raise DegenerateInputError(
                        field=f"views[{view.name}]",
                        expected="cameras that `sizes` names",
                        seen=f"{key[0]} {key[1]}",
                    )
                if len(seen.marks) and not 0 <= seen.marks.min() <= seen.marks.max() < len(self.plate.points):
                    raise DegenerateInputError(
                        field=f"views[{view.name}].{key[0]}.{key[1]}",
                        expected=f"rows 0 … {len(self.plate.points) - 1} of the plate",
                        seen=f"{seen.marks.min()} … {seen.marks.max()}",
                    )

    @property
    def cameras(self) -> tuple[CameraKey, ...]:
        """Every camera, in the order of `sizes`."""
        return tuple(self.sizes)

    @property
    def heads(self) -> tuple[str, ...]:
        """Names of the heads, in the order of `sizes`."""
        return tuple(dict.fromkeys(head for head, _ in self.sizes))
