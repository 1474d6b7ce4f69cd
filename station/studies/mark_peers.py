"""How OpenCV and scikit-image locate round marks: what one would use without this program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from skimage import filters as untyped_filters
from skimage import measure as _measure

from alignment.arrays import Array
from alignment.values import Image

# Without types of their own.
_filters: Any = untyped_filters
measure: Any = _measure
Peer = Callable[[Image, tuple[int, int]], Array]
"""Centres (N, 2) in an image of a grid of so many columns and rows of dark marks."""

_SMALLEST = 40.0  # pixels of a mark's area


def circle_grid(image: Image, grid: tuple[int, int]) -> Array:
    """`cv2.findCirclesGrid`; where it finds no grid, the blobs that it would have ordered."""
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.minArea, parameters.maxArea = _SMALLEST, 0.2 * image.size
    parameters.minDistBetweenBlobs = 4.0
    detector = cv2.SimpleBlobDetector.create(parameters)
    found, centres = cv2.findCirclesGrid(
        image, grid, flags=cv2.CALIB_CB_SYMMETRIC_GRID, blobDetector=detector
    )
    if found:
        return np.asarray(centres, dtype=np.float64).reshape(-1, 2)
    return np.array([blob.pt for blob in detector.detect(image)], dtype=np.float64).reshape(-1, 2)


def opencv_ellipse(image: Image, grid: tuple[int, int]) -> Array:
    """`cv2.fitEllipse` on the contours under Otsu's threshold."""
    _, mask = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    large = [c for c in contours if len(c) >= 6 and cv2.contourArea(c) >= _SMALLEST]
    return np.array([cv2.fitEllipse(c)[0] for c in large], dtype=np.float64).reshape(-1, 2)


def skimage_centroid(image: Image, grid: tuple[int, int]) -> Array:
    """`skimage.measure.regionprops`: middle of each region under Otsu's threshold."""
    regions = measure.regionprops(measure.label(image < _filters.threshold_otsu(image)))
    large = [r for r in regions if r.area >= _SMALLEST]
    return np.array([r.centroid[::-1] for r in large], dtype=np.float64).reshape(-1, 2)


def skimage_contour(image: Image, grid: tuple[int, int]) -> Array:
    """`skimage.measure.EllipseModel` through the sub-pixel contours at Otsu's level."""
    centres = []
    for contour in measure.find_contours(image.astype(np.float64), _filters.threshold_otsu(image)):
        if len(contour) < 24:
            continue
        model = measure.EllipseModel.from_estimate(contour[:, ::-1])
        if model:
            centres.append(model.center)
    return np.array(centres, dtype=np.float64).reshape(-1, 2)


PEERS: dict[str, Peer] = {
    "opencv_circle_grid": circle_grid,
    "opencv_ellipse": opencv_ellipse,
    "skimage_centroid": skimage_centroid,
    "skimage_contour": skimage_contour,
}
