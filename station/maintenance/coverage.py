"""How well a plate session covers each camera so far, and what is missing; told while the plate is moved.

The gate of the calibration has the last word. This tells early what it will ask for: the same limits, as
far as they can be seen without cameras being calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.calibration import CameraKey, GateLimits, image_share
from alignment.counting import count_of, listed
from alignment.imaging import MarkObservations, Plate
from sensors.formats import PlannedView

_LEAST_CHANGE = 0.01  # of the marks' spacing in the image, from which two views tell depth
_PARTS = 3  # of an image each way, for telling where marks are missing
_WHERE = (
    ("top left", "top", "top right"),
    ("left", "middle", "right"),
    ("bottom left", "bottom", "bottom right"),
)


@dataclass(frozen=True, eq=False)
class SeenView:
    """One view of the plate as the cameras saw it.

    Attributes
    ----------
    planned
        Where the plate was.
    marks
        What each camera saw; one that is missing saw nothing.
    """

    planned: PlannedView
    marks: Mapping[CameraKey, MarkObservations]


@dataclass(frozen=True)
class CameraCoverage:
    """What one camera has seen in all views so far.

    Attributes
    ----------
    camera
        Head and side.
    views, marks
        How many views, and marks in all of them.
    image_share
        Share of its image inside the hull of all marks.
    missing
        Where in the image no marks were, such as ``top left``.
    """

    camera: CameraKey
    views: int
    marks: int
    image_share: float
    missing: tuple[str, ...]

    @property
    def name(self) -> str:
        """Head and side, for messages."""
        return " ".join(self.camera)


def coverage_of(
    views: Sequence[SeenView], sizes: Mapping[CameraKey, tuple[int, int]]
) -> tuple[CameraCoverage, ...]:
    """Return what each camera has seen; `sizes` are (width, height) by camera."""
    out = []
    for key, size in sizes.items():
        seen = [view.marks[key].pixels for view in views if key in view.marks]
        pixels = np.concatenate(seen) if seen else np.empty((0, 2))
        out.append(
            CameraCoverage(key, len(seen), len(pixels), image_share(pixels, size), _missing(pixels, size))
        )
    return tuple(out)


def _missing(pixels: Array, size: tuple[int, int]) -> tuple[str, ...]:
    columns = np.clip((pixels[:, 0] / size[0] * _PARTS).astype(int), 0, _PARTS - 1)
    rows = np.clip((pixels[:, 1] / size[1] * _PARTS).astype(int), 0, _PARTS - 1)
    seen = set(zip(rows.tolist(), columns.tolist(), strict=True))
    return tuple(_WHERE[r][c] for r in range(_PARTS) for c in range(_PARTS) if (r, c) not in seen)


def what_is_missing(
    views: Sequence[SeenView],
    sizes: Mapping[CameraKey, tuple[int, int]],
    plate: Plate,
    limits: GateLimits | None = None,
) -> tuple[str, ...]:
    """Return sentences that say what the session lacks so far; none where it may be calibrated from.

    Parameters
    ----------
    views
        So far.
    sizes
        (width, height) of each camera's images.
    plate
        That is shown.
    limits
        Of the gate.
    """
    limits = limits or GateLimits()
    out = []
    if len(views) < limits.views:
        out.append(f"{count_of(len(views), 'view')} so far, at least {limits.views} are needed")
    for each in coverage_of(views, sizes):
        if each.marks < limits.marks and len(views) >= limits.views:
            out.append(f"{each.name} has seen {each.marks} marks, at least {limits.marks} are needed")
        elif each.image_share < limits.image_share:
            where = f"; none at {listed(each.missing)}" if each.missing else ""
            out.append(
                f"{each.name}: marks cover {each.image_share:.0%} of its image, at least "
                f"{limits.image_share:.0%} are needed{where}"
            )
    if len(views) >= 2 and not _tells_depth(views, plate):
        out.append(
            "all views are alike in distance and tilt: add other heights of the stage, or tilt the plate"
        )
    return tuple(out)


def what_would_help(views: Sequence[SeenView]) -> tuple[str, ...]:
    """Return sentences about views that are not needed, and make a calibration better."""
    if views and all(view.planned.on_stage for view in views):
        return (
            "no tilted view: one or two, by ten degrees, make the angles nearly three times better known",
        )
    return ()


def _tells_depth(views: Sequence[SeenView], plate: Plate) -> bool:
    """Whether some camera saw the plate at clearly different scales, or differently tilted."""
    for key in {key for view in views for key in view.marks}:
        steps = [_steps(view.marks[key], plate) for view in views if key in view.marks]
        first = steps[0]
        if any(np.abs(step / first - 1.0).max() > _LEAST_CHANGE for step in steps[1:]):
            return True
    return False


def _steps(seen: MarkObservations, plate: Plate) -> Array:
    """(2,) how many pixels the plate's x and y axes take per millimetre, in the mean of the image."""
    points = plate.points[seen.marks, :2]
    design = np.column_stack([points - points.mean(axis=0), np.ones(len(points))])
    affine = np.linalg.lstsq(design, seen.pixels, rcond=None)[0][:2]
    lengths: Array = np.hypot(affine[:, 0], affine[:, 1])
    return lengths


def movement_px(
    first: Mapping[CameraKey, MarkObservations], other: Mapping[CameraKey, MarkObservations]
) -> float:
    """Largest, over the cameras, of the mean distance by which marks that both shots show moved, pixels.

    Infinite where no camera saw a mark in both.
    """
    moved = [-math.inf]
    for key in first.keys() & other.keys():
        _, a, b = np.intersect1d(first[key].marks, other[key].marks, return_indices=True)
        if len(a):
            difference = first[key].pixels[a] - other[key].pixels[b]
            moved.append(float(np.hypot(*difference.mean(axis=0))))
    return max(moved) if len(moved) > 1 else math.inf
