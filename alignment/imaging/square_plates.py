"""Chessboards and ChArUco boards in one image: found by OpenCV, located by a fit to the grey levels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array, Index, Mask
from alignment.imaging.corner_fit import Corners, joined_corners, locate_corners
from alignment.imaging.mark_detection import exposure_of
from alignment.imaging.mark_grid import FEWEST_MARKS
from alignment.imaging.mark_plane import PlaneView
from alignment.imaging.marks import Exposure
from alignment.imaging.numbering import Numberings, ways_to_number
from alignment.imaging.pattern import QUARTER_TURNS, Pattern
from alignment.imaging.plate import Plate
from alignment.imaging.plate_refusal import PlateRefusal, PlateRefusalCode, nothing_seen
from alignment.values import Image

_PLACE_TOLERANCE = 0.15  # of a square, from where the view puts a corner
_LEAST_STEP = 6.0  # pixels between neighbouring corners
_LARGEST_BLUR = 0.2  # of the shorter step
_ROUNDS = 6
_NEIGHBOURS = 2  # known corners about one that is tried
_BORDER = 4.0  # pixels
_FAINT = 0.3  # of the contrast of the other corners
_COVER = 1.15  # by which the hull of a found board grows to cover its outer squares


def number_chessboard(image: Image, plate: Plate) -> Numberings | PlateRefusal:
    """Find the inner corners of a chessboard and every way to number them.

    Parameters
    ----------
    image
        (height, width), 8 or 16 bit; the whole board must be in it.
    plate
        With a pattern of kind ``chessboard``.
    """
    exposure = exposure_of(image)
    seen = _eight_bit(image, exposure)
    columns, rows = (int(n) for n in np.ptp(plate.indices, axis=0) + 1)
    points = _board(seen, columns, rows)
    if points is None:
        return nothing_seen(
            exposure,
            f"no chessboard with {columns} × {rows} inner corners was found. "
            "Show the whole board with a light rim about it, sharp, and check the plate file.",
        )
    if _board(_without(seen, points, columns), columns, rows, thorough=False) is not None:
        return PlateRefusal(
            PlateRefusalCode.AMBIGUOUS,
            "two boards with the same squares are in the image. Leave one of them.",
        )
    j, i = np.divmod(np.arange(columns * rows), columns)
    # OpenCV counts rows downwards or upwards; on the plate they count to the left of the columns.
    first, second = points[1] - points[0], points[columns] - points[0]
    if first[0] * second[1] - first[1] * second[0] > 0.0:
        j = rows - 1 - j
    places = np.column_stack([i, j]).astype(np.int64)
    located = _located(image, points, places, plate.pattern, exposure)
    if isinstance(located, PlateRefusal):
        return located
    if _goes_on(image, points, places, exposure):
        return PlateRefusal(
            PlateRefusalCode.NOT_THIS_PLATE,
            f"the chessboard goes on beyond the {columns} × {rows} inner corners of the plate file. "
            "Count its inner corners, and take away what looks like its squares.",
        )
    ways = ways_to_number(places, plate)
    if isinstance(ways, PlateRefusalCode):
        return PlateRefusal(
            ways, "the board's corners do not fit the plate file. Check its columns and rows."
        )
    right = [
        way
        for way, (turn, shift) in enumerate(zip(*ways, strict=True))
        if _first_is_dark(image, points, places, plate, int(turn), shift) == plate.pattern.first_dark
    ]
    if not right:
        return PlateRefusal(
            PlateRefusalCode.NOT_THIS_PLATE,
            "light and dark squares of the board are the other way round than in the plate file. "
            "Check first_square there, or that the camera does not mirror its images.",
        )
    return _numberings(plate, places, (ways[0][right], ways[1][right]), located, image, exposure)


def number_charuco(image: Image, plate: Plate) -> Numberings | PlateRefusal:
    """Find the corners of a ChArUco board, which its markers number; a part of the board is enough.

    Parameters
    ----------
    image
        (height, width), 8 or 16 bit.
    plate
        With a pattern of kind ``charuco``.
    """
    exposure = exposure_of(image)
    columns, rows = (int(n) for n in np.ptp(plate.indices, axis=0) + 1)
    parameters = cv2.aruco.CharucoParameters()
    parameters.minMarkers = 1
    detector = cv2.aruco.CharucoDetector(charuco_board(plate.pattern, columns, rows), parameters)
    corners, ids, _, _ = detector.detectBoard(_eight_bit(image, exposure))
    numbers = np.asarray([] if cast("Any", ids) is None else ids, dtype=np.int64).ravel()
    count = len(numbers)
    if count < FEWEST_MARKS:
        return nothing_seen(
            exposure,
            f"{count} corners of the ChArUco board were found, at least {FEWEST_MARKS} are needed. "
            f"Show more of it, sharp, and check dictionary {plate.pattern.dictionary} and first_id.",
        )
    points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    j, i = np.divmod(numbers, columns)
    places = np.column_stack([i, rows - 1 - j]) + plate.indices.min(axis=0)
    if min(np.ptp(places, axis=0)) == 0:
        return PlateRefusal(
            PlateRefusalCode.ONE_ROW,
            f"{count} corners of the board were found, all in one row. Show more of the board.",
        )
    on = _on_grid(points, places, (image.shape[1], image.shape[0]))
    if on.sum() < max(FEWEST_MARKS, 0.7 * count):
        return PlateRefusal(
            PlateRefusalCode.NOT_THIS_PLATE,
            f"only {int(on.sum())} of {count} corners lie on a grid by the numbers of their markers. "
            "Check dictionary, first_id, columns and rows in the plate file.",
        )
    points, places = points[on], places[on]
    located = _located(image, points, places, plate.pattern, exposure)
    if isinstance(located, PlateRefusal):
        return located
    places, located = _grown(image, places, located, plate, exposure)
    ways = np.zeros(1, dtype=np.int64), np.zeros((1, 2), dtype=np.int64)
    return _numberings(plate, places, ways, located, image, exposure)


def charuco_board(pattern: Pattern, columns: int, rows: int) -> Any:
    """OpenCV's board with so many columns and rows of inner corners; squares of length 1."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, pattern.dictionary))
    count = (columns + 1) * (rows + 1) // 2
    ids = np.arange(pattern.first_id, pattern.first_id + count, dtype=np.int32)
    return cv2.aruco.CharucoBoard((columns + 1, rows + 1), 1.0, pattern.marker_share, dictionary, ids)


_Located = tuple[Corners, float, float]
"""Corners, their blur and contrast over noise."""


def _located(
    image: Image, points: Array, places: Index, pattern: Pattern, exposure: Exposure
) -> _Located | PlateRefusal:
    """Locate corners below the pixel."""
    steps = _local_steps(points, places, (image.shape[1], image.shape[0]))
    shorter = float(np.median(np.hypot(steps[..., 0], steps[..., 1]).min(axis=1)))
    if shorter < _LEAST_STEP:
        return PlateRefusal(
            PlateRefusalCode.NOT_THIS_PLATE,
            f"the board's squares are {shorter:.1f} pixels wide, at least {_LEAST_STEP:g} are needed. "
            "Come nearer, or use larger squares.",
        )
    share = pattern.marker_share
    margin = (1.0 - share) / 2.0 if share else None
    found = locate_corners(image, points, steps, exposure.noise, margin)
    # The squares about the corners take turns: a corner that has them the other way round is none.
    found = replace(found, good=found.good & _takes_turns(found, places))
    if found.good.sum() < max(FEWEST_MARKS, 0.5 * len(points)):
        return PlateRefusal(
            PlateRefusalCode.BLURRED,
            f"only {int(found.good.sum())} of {len(points)} corners of the board are sharp enough to be "
            "located. Focus the camera, hold the board still, and even out the light.",
        )
    blur = float(np.median(found.blur[found.good]))
    if blur > _LARGEST_BLUR * shorter:
        return PlateRefusal(
            PlateRefusalCode.BLURRED,
            f"the board's edges are blurred over {blur:.1f} pixels with squares of {shorter:.1f}. "
            "Focus the camera or hold the board still.",
        )
    contrast = float(np.median(np.abs(found.contrast[found.good]))) / exposure.noise
    return found, blur, contrast


def _takes_turns(found: Corners, places: Index) -> Mask:
    signs = np.sign(found.contrast) * np.where(places.sum(axis=1) % 2, -1.0, 1.0)
    result: Mask = signs == np.sign(np.sum(signs[found.good]))
    return result


def _grown(
    image: Image, places: Index, located: _Located, plate: Plate, exposure: Exposure
) -> tuple[Index, _Located]:
    """Bring in corners beside those that are known, whose own markers were not read."""
    found, blur, contrast = located
    size = (image.shape[1], image.shape[0])
    for _ in range(_ROUNDS):
        known = {(int(i), int(j)) for i, j in places[found.good]}
        tried = np.array(
            [
                (i, j)
                for i, j in plate.indices.tolist()
                if (i, j) not in known
                and sum((i + a, j + b) in known for a in (-1, 0, 1) for b in (-1, 0, 1)) >= _NEIGHBOURS
            ],
            dtype=np.int64,
        ).reshape(-1, 2)
        if not len(tried):
            break
        view = PlaneView.fit(places[found.good].astype(np.float64), found.points[found.good], size)
        pixels, shown = view.to_pixels(tried.astype(np.float64))
        shown &= ((pixels >= _BORDER) & (pixels <= np.array(size) - 1.0 - _BORDER)).all(axis=1)
        if not shown.any():
            break
        steps = _steps_of(view, tried[shown])
        margin = (1.0 - plate.pattern.marker_share) / 2.0
        more = locate_corners(image, pixels[shown], steps, exposure.noise, margin)
        near = np.hypot(*(view.to_plane(more.points) - tried[shown]).T) < _PLACE_TOLERANCE
        strong = np.abs(more.contrast) > _FAINT * contrast * exposure.noise
        every = joined_corners(found, replace(more, good=more.good & near & strong))
        all_places = np.concatenate([places, tried[shown]])
        every = replace(every, good=every.good & _takes_turns(every, all_places))
        if every.good.sum() == found.good.sum():
            break
        places, found = all_places[every.good], every.only(every.good)
    return places, (found, blur, contrast)


def _numberings(
    plate: Plate,
    places: Index,
    ways: tuple[Index, Index],
    located: _Located,
    image: Image,
    exposure: Exposure,
) -> Numberings | PlateRefusal:
    corners, blur, contrast = located
    good, points = corners.good, corners.points
    size = (image.shape[1], image.shape[0])
    if min(np.ptp(places[good], axis=0)) == 0:
        return PlateRefusal(
            PlateRefusalCode.ONE_ROW, "corners of one row alone were located. Show more of the board."
        )
    # A marker tells its corners when all of it is in the image.
    steps = _local_steps(points[good], places[good], size)
    return Numberings(
        plate=plate,
        places=places[good],
        turns=ways[0],
        shifts=ways[1],
        pixels=points[good],
        covariance=corners.covariance[good],
        size=size,
        margin_px=float(np.median(np.hypot(*steps[:, 0].T))),
        blur_px=blur,
        contrast=contrast,
    )


def _eight_bit(image: Image, exposure: Exposure) -> NDArray[np.uint8]:
    """Return the image as OpenCV's detectors take it."""
    if image.dtype == np.uint8:
        return cast("NDArray[np.uint8]", image)
    low, high = float(image.min()), max(exposure.bright * 1.1, float(image.min()) + 1.0)
    scaled: NDArray[np.uint8] = np.clip((image - low) * (255.0 / (high - low)), 0.0, 255.0).astype(np.uint8)
    return scaled


def _board(image: NDArray[np.uint8], columns: int, rows: int, *, thorough: bool = True) -> Array | None:
    """Inner corners (columns · rows, 2) of a whole chessboard, or None."""
    size, normal = (columns, rows), cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCornersSB(image, size, flags=normal)
    if not found and thorough:
        found, corners = cv2.findChessboardCornersSB(image, size, flags=normal | cv2.CALIB_CB_EXHAUSTIVE)
    if not found:
        # The older detector sees boards that fill little of the image.
        flags = normal | cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK
        found, corners = cv2.findChessboardCorners(image, size, flags=flags)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2) if found else None


def _goes_on(image: Image, points: Array, places: Index, exposure: Exposure) -> bool:
    """Whether there are corners beyond the outer ones of a found board."""
    size = (image.shape[1], image.shape[0])
    view = PlaneView.fit(places.astype(np.float64), points, size)
    low, high = places.min(axis=0), places.max(axis=0)
    for axis in range(2):
        along = np.arange(low[1 - axis], high[1 - axis] + 1)
        for line in (low[axis] - 1, high[axis] + 1):
            there = np.empty((len(along), 2), dtype=np.int64)
            there[:, axis], there[:, 1 - axis] = line, along
            pixels, shown = view.to_pixels(there.astype(np.float64))
            shown &= ((pixels >= _BORDER) & (pixels <= np.array(size) - 1.0 - _BORDER)).all(axis=1)
            if shown.sum() < 0.5 * len(along):
                continue
            found = locate_corners(image, pixels[shown], _steps_of(view, there[shown]), exposure.noise)
            near = np.hypot(*(view.to_plane(found.points) - there[shown]).T) < _PLACE_TOLERANCE
            if (found.good & near).sum() >= 0.5 * shown.sum():
                return True
    return False


def _without(image: NDArray[np.uint8], points: Array, columns: int) -> NDArray[np.uint8]:
    """Return the image with a found board painted over."""
    hull = cv2.convexHull(points.astype(np.float32)).reshape(-1, 2)
    middle = hull.mean(axis=0)
    grid = points.reshape(-1, columns, 2)
    step = max(float(np.linalg.norm(np.diff(grid, axis=k), axis=-1).max()) for k in range(2))
    away = hull - middle
    length = np.maximum(np.hypot(*away.T), 1e-6)[:, None]
    grown = middle + away * (1.0 + _COVER * step / length)
    out = image.copy()
    cv2.fillConvexPoly(out, np.rint(grown).astype(np.int32), float(np.median(image)))
    return out


def _local_steps(points: Array, places: Index, size: tuple[int, int]) -> Array:
    """Pixels (N, 2, 2) to the next corner along columns and along rows, as rows."""
    return _steps_of(PlaneView.fit(places.astype(np.float64), points, size), places)


def _steps_of(view: PlaneView, places: Index) -> Array:
    half = np.eye(2) * 0.25
    steps = [
        (view.to_pixels(places + half[axis])[0] - view.to_pixels(places - half[axis])[0]) / 0.5
        for axis in range(2)
    ]
    return np.stack(steps, axis=1)


def _on_grid(points: Array, places: Index, size: tuple[int, int]) -> Mask:
    """Tell which corners lie where the others say that their markers' numbers put them."""
    on = np.ones(len(points), dtype=bool)
    for _ in range(4):
        view = PlaneView.fit(places[on].astype(np.float64), points[on], size)
        off = np.hypot(*(view.to_plane(points) - places).T)
        limit = max(_PLACE_TOLERANCE, 3.0 * float(np.median(off)))
        now = np.nan_to_num(off, nan=np.inf) < limit
        if now.sum() < FEWEST_MARKS or np.array_equal(now, on):
            break
        on = now
    result: Mask = on & (np.nan_to_num(off, nan=np.inf) < _PLACE_TOLERANCE)
    return result


def _first_is_dark(image: Image, points: Array, places: Index, plate: Plate, turn: int, shift: Index) -> bool:
    """Whether the square right above the plate's first corner is dark, if the corners are numbered so."""
    index = places @ QUARTER_TURNS[turn].T + shift - plate.indices.min(axis=0)
    at = {(int(i), int(j)): k for k, (i, j) in enumerate(index)}
    odd: list[float] = []
    even: list[float] = []
    for (i, j), k in at.items():
        others = [at.get((i + 1, j)), at.get((i, j + 1)), at.get((i + 1, j + 1))]
        if None in others:
            continue
        middle = points[[k, *(n for n in others if n is not None)]].mean(axis=0)
        x, y = (int(v) for v in np.rint(middle))
        (odd if (i + j) % 2 else even).append(
            float(image[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].mean())
        )
    return float(np.mean(even)) < float(np.mean(odd))
