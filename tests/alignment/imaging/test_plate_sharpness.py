"""How sharp and how bright a camera shows the plate: good pictures pass, blurred and dark ones are told."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from alignment.calibration.gate import GateLimits
from alignment.imaging.mark_detection import find_marks
from alignment.imaging.mark_location import locate_marks
from alignment.imaging.plate import MarkObservations
from alignment.imaging.plate_grid import observe_plate
from alignment.values import Image
from tests.alignment.imaging.plates import photograph, plate, view

LIMITS = GateLimits()
PHOTOGRAPHS = (
    "path_traced/plate/view1_head_1_left.png",
    "path_traced/plate/view5_head_3_right.png",
    "foreign_plates/asymmetric_23x7.png",
    "real_dots/coplanar/1479224185706804480_left.png",
    "real_dots/noncoplanar/1479224227386188288_right.png",
)


def looked_at(image: Image) -> tuple[float, float]:
    """Blur and contrast over noise, medians over the marks."""
    marks = locate_marks(image, find_marks(image))
    return float(np.median(marks.blur)), float(np.median(marks.contrast)) / marks.exposure.noise


def blurred(image: Image, sigma: float) -> Image:
    out: Image = cv2.GaussianBlur(image, (0, 0), sigma)
    return out


def darkened(image: Image, by: float) -> Image:
    out: Image = np.rint(image / by).astype(image.dtype)
    return out


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_good_photographs_pass_and_the_same_blurred_or_dark_do_not(published_data: Path, name: str) -> None:
    image = cv2.imread(str(published_data / name), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    blur, contrast = looked_at(image)
    assert blur < LIMITS.blur_warned_px
    assert contrast > 1.5 * LIMITS.contrast_warned
    assert looked_at(blurred(image, 3.0))[0] > LIMITS.blur_warned_px
    assert LIMITS.contrast < looked_at(darkened(image, 20.0))[1] < LIMITS.contrast_warned


def test_observations_say_how_sharp_and_bright_their_marks_are() -> None:
    seen = plate()
    image = photograph(seen, view())
    found = observe_plate(image, seen)
    assert isinstance(found, MarkObservations)
    assert found.blur_px is not None
    assert found.contrast is not None
    assert (found.blur_px, found.contrast) == pytest.approx(looked_at(image), rel=0.05)
    soft = observe_plate(blurred(image, 1.5), seen)
    assert isinstance(soft, MarkObservations)
    assert soft.blur_px is not None
    assert np.hypot(found.blur_px, 1.5) == pytest.approx(soft.blur_px, rel=0.1)
