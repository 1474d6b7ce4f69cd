"""Plates with a grid of full round marks, dark or bright, in one image."""

from __future__ import annotations

import math

import cv2
import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from alignment.arrays import Array, Index
from alignment.imaging.mark_detection import find_marks
from alignment.imaging.mark_grid import FEWEST_MARKS, Grid, is_square, walk_lattice
from alignment.imaging.mark_location import locate_marks
from alignment.imaging.mark_plane import PlaneView
from alignment.imaging.marks import Marks
from alignment.imaging.numbering import Numberings, ways_to_number
from alignment.imaging.pattern import CornerLook, CornerMark, PatternKind
from alignment.imaging.plate import Plate
from alignment.imaging.plate_refusal import PlateRefusal, PlateRefusalCode, bad_exposure
from alignment.values import Image

_LEAST_RADIUS = 4.0  # pixels: marks of 5 are found wherever they lie on the pixels
_ALIKE = 0.5  # of the marks of the larger grid that make another one a second plate
_SIZE_TOLERANCE = 1.25  # ratio of the marks' radii to what the plate's description says
_GAP = 2.0  # places that a mark may lie from the others of its plate
_STRAY = 0.4  # of the marks that a row has usually, below which an outer one is none of the plate
_NEAR = 0.3  # of the mark's own radius in the image, from where the corner mark should be
_LARGE_TOLERANCE = 1.2


def number_circles(image: Image, plate: Plate, method: str = "ellipse") -> Numberings | PlateRefusal:
    """Find the marks of a plate of circles and every way to number them.

    Parameters
    ----------
    image
        (height, width), 8 or 16 bit.
    plate
        With a pattern of kind ``circles`` or ``asymmetric_circles``.
    method
        A name of `alignment.imaging.mark_location.METHODS`.
    """
    rough = find_marks(image, bright=plate.pattern.bright, least_radius=_LEAST_RADIUS)
    marks = locate_marks(image, rough, method)
    wrong = bad_exposure(marks, plate)
    if wrong is not None:
        return wrong
    steps, from_steps = _steps(plate)
    grid = _together(walk_lattice(marks, steps / plate.mark_radius_mm))
    refusal = _no_grid(grid, marks, plate)
    if refusal is not None:
        return refusal
    grid = _without_strays(grid, from_steps)
    refusal = _no_grid(grid, marks, plate)
    if refusal is not None:
        return refusal
    places = grid.places @ from_steps
    ways = ways_to_number(places, plate, (0, 1, 2, 3) if is_square(steps) else (0, 2))
    if isinstance(ways, PlateRefusalCode):
        return _unfit(ways, places, plate)
    found = Numberings(
        plate=plate,
        places=places,
        turns=ways[0],
        shifts=ways[1],
        pixels=marks.points[grid.rows],
        covariance=marks.covariance[grid.rows],
        size=marks.size,
        margin_px=1.3 * float(np.median(marks.semi_axes[:, 1])),
        blur_px=float(np.median(marks.blur[grid.rows])),
        contrast=float(np.median(marks.contrast[grid.rows])) / marks.exposure.noise,
    )
    return _checked(found, grid, marks, steps)


def _steps(plate: Plate) -> tuple[Array, Index]:
    """Steps (2, 2) to the nearest marks as rows, millimetres; (2, 2): indices are places in steps @ it."""
    pitch: Array = np.ptp(plate.points[:, :2], axis=0) / np.ptp(plate.indices, axis=0)
    if plate.pattern.kind is PatternKind.ASYMMETRIC_CIRCLES:
        # Every other place is taken, so the next marks lie along the diagonals.
        diagonal = np.array([[1, 1], [-1, 1]], dtype=np.int64)
        return diagonal * pitch, diagonal
    return np.diag(pitch), np.eye(2, dtype=np.int64)


def _together(grid: Grid) -> Grid:
    """Return the largest part of a grid that hangs together: what lies far from it is of something else."""
    if len(grid.rows) < FEWEST_MARKS:
        return grid
    near = cKDTree(grid.places).sparse_distance_matrix(cKDTree(grid.places), _GAP, p=np.inf)
    _, part = connected_components(near, directed=False)
    rows = part == np.argmax(np.bincount(part))
    return Grid(grid.rows[rows], grid.places[rows])


def _without_strays(grid: Grid, from_steps: Index) -> Grid:
    """Take away outer rows and columns of hardly any marks.

    A spot beside the plate that happens to lie on its grid would stand for a row that is hidden on the other
    side: the marks would fit the plate, one place off.
    """
    kept = np.ones(len(grid.rows), dtype=bool)
    places = grid.places @ from_steps
    while True:
        before = int(kept.sum())
        for axis in range(2):
            lines, count = np.unique(places[kept, axis], return_counts=True)
            if len(lines) < 3:
                continue
            usual = float(np.median(count))
            few = [line for line, n in ((lines[0], count[0]), (lines[-1], count[-1])) if n < _STRAY * usual]
            kept &= ~np.isin(places[:, axis], few)
        if int(kept.sum()) == before:
            return Grid(grid.rows[kept], grid.places[kept])


def _no_grid(grid: Grid, marks: Marks, plate: Plate) -> PlateRefusal | None:
    if len(grid.rows) < FEWEST_MARKS:
        return PlateRefusal(
            PlateRefusalCode.NO_GRID,
            f"{len(marks)} round marks were found, but at most {len(grid.rows)} lie on the grid of a plate "
            f"with marks of radius {plate.mark_radius_mm:g} mm. Use the plate that the plate file describes.",
        )
    if min(np.ptp(grid.places, axis=0)) == 0:
        return PlateRefusal(
            PlateRefusalCode.ONE_ROW,
            f"{len(grid.rows)} marks of the plate were found, all in one row, which tells neither "
            "how it leans nor which marks they are. Show more of the plate, and take away what covers it.",
        )
    return None


def _unfit(code: PlateRefusalCode, places: Index, plate: Plate) -> PlateRefusal:
    seen, there = np.ptp(places, axis=0) + 1, np.ptp(plate.indices, axis=0) + 1
    if code is PlateRefusalCode.MIRRORED:
        return PlateRefusal(
            code,
            "the marks are arranged as on the plate seen in a mirror. "
            "Turn the plate's marked side to the camera, or switch off the camera's image mirroring.",
        )
    return PlateRefusal(
        code,
        f"{len(places)} marks were found on a grid of {seen[0]} × {seen[1]} places, which do not fit the "
        f"plate's {there[0]} × {there[1]}. Use the plate that the plate file describes, and take away what "
        "looks like its marks.",
    )


def _checked(found: Numberings, grid: Grid, marks: Marks, steps: Array) -> Numberings | PlateRefusal:
    """Refuse what is seen twice, has other marks, is covered, or contradicts its corner mark."""
    plate = found.plate
    second = _second_plate(found, grid, marks, steps)
    if second is not None:
        return second
    rows = found.rows(0)
    view = PlaneView.fit(plate.points[rows, :2], found.pixels, found.size)
    _, area = view.with_areas(found.pixels)
    shape = marks.shape[grid.rows]
    radius = float(np.median(np.sqrt(np.sqrt(np.linalg.det(shape)) / area)))
    if not 1.0 / _SIZE_TOLERANCE < radius / plate.mark_radius_mm < _SIZE_TOLERANCE:
        return PlateRefusal(
            PlateRefusalCode.NOT_THIS_PLATE,
            f"the marks' radius is {radius:.3g} mm beside their distances, not {plate.mark_radius_mm:g} mm. "
            "Check mark_diameter_mm and the pitch in the plate file.",
        )
    if plate.pattern.corner is None or plate.pattern.corner.look is CornerLook.MISSING:
        # Where a mark is missing, no way puts one there.
        return found
    fits = [
        way for way in range(len(found)) if _corner_is_there(found, way, plate.pattern.corner, grid, marks)
    ]
    if not fits:
        return PlateRefusal(
            PlateRefusalCode.AMBIGUOUS,
            f"the {plate.pattern.corner.look.value} mark that tells which way round the plate is was not "
            "seen at any of its corners. Show it, clean it, and check the focus.",
        )
    return found.only(fits)


def _second_plate(found: Numberings, grid: Grid, marks: Marks, steps: Array) -> PlateRefusal | None:
    """Refuse when what is left of the marks holds the same grid again."""
    left = np.setdiff1d(np.arange(len(marks)), grid.rows)
    fewest = max(FEWEST_MARKS, _ALIKE * len(grid.rows))
    if len(left) < fewest:
        return None
    other = walk_lattice(marks.only(left), steps / found.plate.mark_radius_mm)
    if len(other.rows) < fewest:
        return None
    hull = cv2.convexHull(found.pixels.astype(np.float32))
    middle = marks.points[left[other.rows]].mean(axis=0)
    if cv2.pointPolygonTest(hull, (float(middle[0]), float(middle[1])), measureDist=False) > 0:
        return PlateRefusal(
            PlateRefusalCode.NOT_THIS_PLATE,
            f"{len(other.rows)} other marks lie between the {len(grid.rows)} marks of the grid. "
            "Check pattern, pitch and mark_diameter_mm in the plate file.",
        )
    return PlateRefusal(
        PlateRefusalCode.AMBIGUOUS,
        "two plates with the same marks are in the image. Leave one of them in it.",
    )


def _corner_is_there(found: Numberings, way: int, corner: CornerMark, grid: Grid, marks: Marks) -> bool:
    """Whether the corner mark is where one way to number the marks puts it."""
    rows = found.rows(way)
    if corner.look is CornerLook.RING:
        at = np.flatnonzero((found.plate.indices[rows] == corner.index).all(axis=1))
        return bool(len(at)) and bool(marks.hollow[grid.rows[at[0]]])
    indices = found.plate.indices[rows].astype(np.float64)
    view = PlaneView.fit(indices, found.pixels, found.size)
    pixels, shown = view.to_pixels(np.array([corner.index], dtype=np.float64))
    if not shown[0]:
        return False
    nearest = int(np.argmin(np.hypot(*(marks.points - pixels[0]).T)))
    area = math.sqrt(float(np.linalg.det(marks.shape[nearest])))
    if math.hypot(*(marks.points[nearest] - pixels[0])) > _NEAR * math.sqrt(area):
        return False
    usual = float(
        np.median(np.sqrt(np.linalg.det(marks.shape[grid.rows])) / view.with_areas(found.pixels)[1])
    )
    ratio = math.sqrt(area / (usual * float(view.with_areas(marks.points[[nearest]])[1][0])))
    expected = corner.radius_mm / found.plate.mark_radius_mm
    return 1.0 / _LARGE_TOLERANCE < ratio / expected < _LARGE_TOLERANCE
