"""What a calibration is made of: views of a plate, and what each camera saw of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from alignment.arrays import Array
from alignment.counting import count_of
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.imaging.plate import MarkObservations, Plate
from alignment.values import SIDES, RigCalibration

CameraKey = tuple[str, Literal["left", "right"]]
"""Name of the head, and which of its cameras."""


def cameras_of_rig(calibration: RigCalibration) -> dict[CameraKey, PosedCamera]:
    """Every camera of a rig by head and side, left before right."""
    return {
        (head.name, side): camera
        for head in calibration.heads
        for side, camera in zip(SIDES, head.cameras, strict=True)
    }


# A tolerance of ±a, evenly distributed, has the standard uncertainty a/√3 (JCGM 100, 4.3.7).
MARK_SIGMA_MM = 0.01 / math.sqrt(3.0)
FLATNESS_SIGMA_MM = 0.005
STAGE_SIGMA_MM = 0.01 / math.sqrt(3.0)


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
                seen=f"{count_of(len(self.views), 'view')}, {count_of(len(self.sizes), 'camera')}",
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
