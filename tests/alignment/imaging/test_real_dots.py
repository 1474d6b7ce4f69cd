"""Photographs of dots by a stereo endoscope: uneven light, overexposure, every second line only."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from alignment.imaging.mark_detection import find_marks
from alignment.imaging.mark_location import locate_marks

IMAGES = {
    "coplanar/1479224185706804480_left": ("coplanar/1479224185706804480_left.txt", 70, 1.0),
    "coplanar/1479224185706804480_right": ("coplanar/1479224185706804480_right.txt", 70, 1.0),
    "noncoplanar/1479224227386188288_left": ("noncoplanar/image-noncoplanar-left.txt", 140, 0.5),
    "noncoplanar/1479224227386188288_right": ("noncoplanar/image-noncoplanar-right.txt", 140, 0.5),
}


@pytest.mark.parametrize("name", IMAGES)
def test_every_dot_of_a_photograph_is_found_where_it_was_published(published_data: Path, name: str) -> None:
    folder = published_data / "real_dots"
    file, count, lines = IMAGES[name]
    published = np.loadtxt(folder / file)[:, 1:] * [1.0, lines]  # the published y of some counts every line
    image = cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    marks = locate_marks(image, find_marks(image))
    distance = np.hypot(*(marks.points[:, None] - published).transpose(2, 0, 1))
    assert len(published) == count
    assert len(marks) == count
    nearest = distance.min(axis=0)
    # Three published places of the last image are off by up to nine pixels from the dots in it.
    assert (nearest < 2.0).sum() >= count - 3
    assert np.median(nearest) < 0.6
