"""Plates of every pattern but ring marks in one image, by the kind of their marks."""

from __future__ import annotations

from alignment.errors import DegenerateInputError
from alignment.imaging.circle_plates import number_circles
from alignment.imaging.mark_detection import require_image
from alignment.imaging.numbering import Numberings
from alignment.imaging.pattern import PatternKind
from alignment.imaging.plate import Plate
from alignment.imaging.plate_refusal import PlateRefusal
from alignment.imaging.square_plates import number_charuco, number_chessboard
from alignment.values import Image


def number_marks(image: Image, plate: Plate, method: str = "ellipse") -> Numberings | PlateRefusal:
    """Find and locate the marks of a plate without ring marks, and every way to number them.

    Parameters
    ----------
    image
        (height, width), one channel, 8 or 16 bit.
    plate
        The plate that is seen.
    method
        A name of `alignment.imaging.mark_location.METHODS`, for circles.

    Raises
    ------
    DegenerateInputError
        When the plate has ring marks (`alignment.imaging.plate_grid` numbers those), or the image is not of
        one channel and 8 or 16 bit.
    """
    require_image(image)
    match plate.pattern.kind:
        case PatternKind.CIRCLES | PatternKind.ASYMMETRIC_CIRCLES:
            return number_circles(image, plate, method)
        case PatternKind.CHESSBOARD:
            return number_chessboard(image, plate)
        case PatternKind.CHARUCO:
            return number_charuco(image, plate)
        case PatternKind.RING_MARKS:
            raise DegenerateInputError(
                field="plate.pattern", expected="a plate without ring marks", seen=plate.pattern.kind.value
            )
