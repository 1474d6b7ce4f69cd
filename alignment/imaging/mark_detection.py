"""Finds round marks roughly: dark on a bright ground or bright on a dark one, full or ring-shaped."""

from __future__ import annotations

import math
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.imaging.marks import Exposure, RoughMarks
from alignment.imaging.thresholds import THRESHOLDS
from alignment.robust import deviation_of
from alignment.values import Image

_POOL = 4  # pixels of the image per pixel of the map of light
_LEVEL = 0.45  # between ground and darkest; under a half, since marks may be lighter than their neighbours
_NOISE_FACTOR = 10.0  # depth of the faintest mark over the noise
_RANGE_FACTOR = 0.08  # and over the image's range
_LEAST_DEPTH = 4.0  # grey levels of an 8-bit image
_FLATTEST = 0.2  # least ratio of an outline's axes
_ROUGHNESS_PX = 0.45  # allowed deviation of an outline from its ellipse: of the pixel grid
_ROUGHNESS = 0.025  # and in proportion to the radius
_CHORD = 1.2  # pixels of a whole mark that may lie on the border's pixels
_LEAST_HOLE = 0.1  # radius of a ring's middle over the mark's
_LARGEST_HOLE = 0.9
_HOLE_OFFSET = 0.2  # largest distance of the middle from the centre, over the radius


def exposure_of(image: Image) -> Exposure:
    """Grey levels, saturation, noise and steepest edges of an image, from a sample of its pixels."""
    sample = image[::8, :].astype(np.float32)
    dark, bright = np.percentile(sample[:, ::2], [1.0, 99.0])
    top = float(image.max())
    limit = 255.0 if image.dtype == np.uint8 else top
    # Cameras of 10 to 14 bits in 16-bit images saturate below the type's limit: many pixels share the top.
    saturated = float(np.mean(sample >= limit)) if image.dtype == np.uint8 else float(np.mean(sample >= top))
    if image.dtype == np.uint16 and saturated < 1e-3:
        limit, saturated = 65535.0, 0.0
    steps = np.abs(np.diff(sample, axis=1))
    second = np.abs(np.diff(sample, n=2, axis=1))
    # Median of |a − 2b + c| is 0.6745 √6 σ; most pixels lie on even ground.
    noise = deviation_of(second) / math.sqrt(6.0)
    return Exposure(
        dark=float(dark),
        bright=float(bright),
        limit=limit,
        saturated=saturated,
        noise=max(noise, 1.0 / math.sqrt(12.0)),
        edge=float(np.percentile(steps, 99.9)),
    )


def require_image(image: Image) -> None:
    """Raise DegenerateInputError when an image is not of one channel and 8 or 16 bit."""
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16) or min(image.shape) < 16:
        raise DegenerateInputError(
            field="image",
            expected="one channel of 8 or 16 bit, at least 16 × 16 pixels",
            seen=f"shape {image.shape}, {image.dtype}",
        )


def find_marks(
    image: Image,
    *,
    bright: bool = False,
    least_radius: float = 5.0,
    largest_radius: float = 65.0,
    threshold: str = "closing",
) -> RoughMarks:
    """Find round marks whose whole outline is in the image.

    The ground's light is mapped by a morphological closing that fills every mark, and a pixel belongs to a
    mark when it is darker than about half-way between that ground and the darkest near it: uneven light does
    not matter, and where nothing is darker than noise there are no marks. Outlines that are no ellipses, or
    cut by the border, are left out.

    Parameters
    ----------
    image
        (height, width), one channel, 8 or 16 bit.
    bright
        True when the marks are brighter than their ground.
    least_radius, largest_radius
        Bounds of the half axes, pixels.
    threshold
        ``closing`` as above, or a name of `alignment.imaging.thresholds.THRESHOLDS`.

    Raises
    ------
    DegenerateInputError
        When the image is not of one channel and 8 or 16 bit, or the radii are not in order.
    """
    require_image(image)
    if not 2.0 <= least_radius < largest_radius:
        raise DegenerateInputError(
            field="least_radius, largest_radius",
            expected="two radii in order, at least 2 pixels",
            seen=f"{least_radius}, {largest_radius}",
        )
    exposure = exposure_of(image)
    seen = cast(Image, cv2.bitwise_not(image)) if bright else image
    smooth = cast(Image, cv2.GaussianBlur(seen, (3, 3), 0.8))
    if threshold == "closing":
        mask = _below_ground(smooth, exposure, largest_radius)
    else:
        mask = _below(smooth, threshold)
    rows = _round_outlines(mask, least_radius, largest_radius)
    points = np.array([r[0] for r in rows]).reshape(-1, 2)
    shape = np.array([r[1] for r in rows]).reshape(-1, 2, 2)
    hole = np.array([r[2] for r in rows], dtype=np.float64)
    return RoughMarks(points, shape, hole, bright, (image.shape[1], image.shape[0]), exposure)


def _below_ground(image: Image, exposure: Exposure, largest_radius: float) -> NDArray[np.uint8]:
    height, width = image.shape
    small = (math.ceil(width / _POOL), math.ceil(height / _POOL))
    # A square that no disc of the largest radius holds: its half side is over R/√2.
    side = 2 * math.ceil(0.8 * largest_radius / _POOL) + 1
    square = np.ones((side, side), np.uint8)
    mean = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
    ground = cv2.morphologyEx(mean, cv2.MORPH_CLOSE, square).astype(np.float32)
    darkest = cv2.resize(
        cv2.erode(image, np.ones((_POOL, _POOL), np.uint8)), small, interpolation=cv2.INTER_NEAREST
    )
    depth = cv2.dilate(ground - darkest.astype(np.float32), square)
    grey = 1.0 if image.dtype == np.uint8 else exposure.limit / 255.0
    faintest = max(
        _NOISE_FACTOR * exposure.noise,
        _RANGE_FACTOR * (exposure.bright - exposure.dark),
        _LEAST_DEPTH * grey,
    )
    level = np.where(depth >= faintest, ground - _LEVEL * depth, -1.0).astype(np.float32)
    full = cv2.resize(level, (width, height), interpolation=cv2.INTER_LINEAR)
    return cast(
        NDArray[np.uint8], cv2.compare(image, np.ceil(np.maximum(full, 0.0)).astype(image.dtype), cv2.CMP_LT)
    )


def _below(image: Image, threshold: str) -> NDArray[np.uint8]:
    if threshold not in THRESHOLDS:
        raise DegenerateInputError(
            field="threshold", expected=f"one of closing, {', '.join(THRESHOLDS)}", seen=f"'{threshold}'"
        )
    return (image < THRESHOLDS[threshold](image)).astype(np.uint8)


def _round_outlines(
    mask: NDArray[np.uint8], least_radius: float, largest_radius: float
) -> list[tuple[Array, Array, float]]:
    """Centre, shape and relative size of the hole of each dark part of the mask that is a whole ellipse."""
    contours, links = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if links is None:
        return []
    height, width = mask.shape
    tree = links[0]
    found = []
    for k in np.flatnonzero(tree[:, 3] < 0):
        contour = np.asarray(contours[int(k)], dtype=np.int32)
        _, _, w, h = cv2.boundingRect(contour)
        if max(w, h) < 2 * least_radius or max(w, h) > 2.2 * largest_radius:
            continue
        if min(w, h) < _FLATTEST * max(w, h) or _cut(contour, width, height, max(w, h)):
            continue
        ellipse = _ellipse_of(contour)
        if ellipse is None:
            continue
        centre, shape = ellipse
        minor, major = np.sqrt(np.linalg.eigvalsh(shape))
        if minor < max(0.6 * least_radius, _FLATTEST * major) or not least_radius <= major <= largest_radius:
            continue
        found.append((centre, shape, _hole(contours, tree, int(tree[k, 2]), centre, shape)))
    return found


def _cut(contour: NDArray[np.int32], width: int, height: int, diameter: int) -> bool:
    """Tell whether the border cuts a part off.

    A whole mark may still cover border pixels by more than half. A chord of length c lies c²/(8R) inside of a
    circle's outline: beyond a pixel, the mark goes on outside.
    """
    x, y = contour[:, 0, 0], contour[:, 0, 1]
    for along, on_border in ((y, x == 0), (y, x == width - 1), (x, y == 0), (x, y == height - 1)):
        touching = along[on_border]
        if len(touching) and (int(touching.max()) - int(touching.min()) + 1) ** 2 > _CHORD * 4.0 * diameter:
            return True
    return False


def _ellipse_of(contour: NDArray[np.int32]) -> tuple[Array, Array] | None:
    """Centre and shape of the ellipse with the contour's moments; None when the contour is no ellipse."""
    m = cv2.moments(contour)
    area = m["m00"]
    if area < 8.0:
        return None
    centre = np.array([m["m10"], m["m01"]]) / area
    shape = 4.0 / area * np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]])
    values, axes = np.linalg.eigh(shape)
    if values[0] <= 0.25:
        return None
    half_axes = np.sqrt(values)
    offset = contour[:, 0, :] - centre
    relative = np.sqrt(((offset @ axes / half_axes) ** 2).sum(axis=1))
    # The distance from the outline along the radius, not across it, is enough to tell a disc from a letter.
    deviation = (relative - 1.0) * np.hypot(*offset.T) / np.maximum(relative, 1e-9)
    roughness = float(np.sqrt(np.mean(deviation**2)))
    if roughness > _ROUGHNESS_PX + _ROUGHNESS * float(half_axes.mean()):
        return None
    # The contour runs through the middles of the outermost pixels; the outline is half a pixel further out.
    grown = (half_axes + 0.5) ** 2
    return centre, (axes * grown) @ axes.T


def _hole(contours: Any, tree: NDArray[np.int32], child: int, centre: Array, shape: Array) -> float:
    """Relative radius of the largest light part within a mark, 0 when it has no light middle."""
    best, best_area = -1, 0.0
    while child >= 0:
        area = cv2.contourArea(contours[child])
        if area > best_area:
            best, best_area = child, area
        child = int(tree[child, 0])
    if best < 0:
        return 0.0
    m = cv2.moments(contours[best])
    radius = math.sqrt(math.sqrt(float(np.linalg.det(shape))))
    offset = math.hypot(m["m10"] / best_area - centre[0], m["m01"] / best_area - centre[1])
    # A hole's contour runs through the dark pixels around it: half a pixel too far out.
    ratio = (math.sqrt(best_area / math.pi) - 0.5) / radius
    if offset > _HOLE_OFFSET * radius or not _LEAST_HOLE <= ratio <= _LARGEST_HOLE:
        return 0.0
    return ratio
