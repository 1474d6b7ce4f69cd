"""Why a plate was not recognised in an image, in words that say what to do."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Index
from alignment.imaging.mark_grid import FEWEST_MARKS
from alignment.imaging.mark_plane import PlaneView
from alignment.imaging.marks import Exposure, Marks
from alignment.imaging.plate import Plate

_BLURRED = 0.4  # blur over radius
_FEWEST_OF_VISIBLE = 0.6


class PlateRefusalCode(enum.StrEnum):
    """Why the marks of an image are not those of the plate."""

    NO_MARKS = "no_marks"
    DARK = "dark"
    SATURATED = "saturated"
    BLURRED = "blurred"
    NO_GRID = "no_grid"
    ONE_ROW = "one_row"
    NO_RING_MARKS = "no_ring_marks"
    NOT_THIS_PLATE = "not_this_plate"
    AMBIGUOUS = "ambiguous"
    MIRRORED = "mirrored"
    COVERED = "covered"


@dataclass(frozen=True)
class PlateRefusal:
    """An image in which the plate was not recognised; never true, so `if observations:` reads well.

    Attributes
    ----------
    code
        For programs.
    reason
        For people: what was seen, and what to do.
    """

    code: PlateRefusalCode
    reason: str

    def __bool__(self) -> bool:
        return False


def bad_exposure(marks: Marks, plate: Plate) -> PlateRefusal | None:
    """Why an image shows no usable marks, from its exposure and the marks' own edges."""
    exposure = marks.exposure
    shades = f"grey levels {exposure.dark:.0f} … {exposure.bright:.0f}"
    if len(marks) >= FEWEST_MARKS:
        if float(np.mean(marks.saturated)) > 0.5:
            return PlateRefusal(
                PlateRefusalCode.SATURATED,
                f"the ground of {int(marks.saturated.sum())} of {len(marks)} marks is saturated ({shades}). "
                "Shorten the exposure or dim the light.",
            )
        radius = np.sqrt(np.sqrt(np.linalg.det(marks.shape)))
        if float(np.median(marks.blur / radius)) > _BLURRED:
            return PlateRefusal(
                PlateRefusalCode.BLURRED,
                f"the marks' edges are blurred over {float(np.median(marks.blur)):.1f} pixels at a radius of "
                f"{float(np.median(radius)):.1f}. Focus the camera or hold the plate still.",
            )
        return None
    return nothing_seen(
        exposure,
        f"only {len(marks)} round marks were found, at least {FEWEST_MARKS} are needed. "
        f"Put the plate with marks of radius {plate.mark_radius_mm:g} mm into the camera's field.",
    )


def nothing_seen(exposure: Exposure, otherwise: str) -> PlateRefusal:
    """Why an image shows no plate: its exposure, or the sentence for one that is well exposed."""
    span = exposure.bright - exposure.dark
    shades = f"grey levels {exposure.dark:.0f} … {exposure.bright:.0f}"
    if exposure.saturated > 0.3:
        return PlateRefusal(
            PlateRefusalCode.SATURATED,
            f"{exposure.saturated:.0%} of the image is saturated and no plate was found. "
            "Shorten the exposure or dim the light.",
        )
    grey = exposure.limit / 255.0
    if span < max(10.0 * exposure.noise, 12.0 * grey):
        return PlateRefusal(
            PlateRefusalCode.DARK,
            f"the image has hardly any contrast ({shades}). Switch on the light or lengthen the exposure.",
        )
    if exposure.edge < 0.12 * span + 4.0 * exposure.noise:
        return PlateRefusal(
            PlateRefusalCode.BLURRED,
            f"the image has light and dark parts ({shades}) but no sharp edge. Focus the camera.",
        )
    return PlateRefusal(PlateRefusalCode.NO_MARKS, otherwise)


def missing_marks(
    view: PlaneView, plate: Plate, seen: Index, size: tuple[int, int], margin: float
) -> PlateRefusal | None:
    """Refuse when many of the marks that ought to be in the image are not.

    Parameters
    ----------
    view
        Of the plate's plane, millimetres.
    plate, seen
        The plate, and the rows of the marks that were found.
    size, margin
        (width, height) of the image; how far from its border a mark is whole, pixels.
    """
    pixels, shown = view.to_pixels(plate.points[:, :2])
    w = view.depths(plate.points[:, :2])
    inside = shown & (np.sign(w) == np.sign(w[seen[0]])) & (pixels > margin).all(axis=1)
    inside &= (pixels < np.array(size) - 1.0 - margin).all(axis=1)
    expected = int(inside.sum())
    found = int(inside[seen].sum())
    if found >= _FEWEST_OF_VISIBLE * expected:
        return None
    return PlateRefusal(
        PlateRefusalCode.COVERED,
        f"{found} of the {expected} marks that should be in the image were found. "
        "Take away what covers the plate or shades it, and clean it.",
    )
