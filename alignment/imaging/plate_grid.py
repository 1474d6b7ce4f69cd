"""Which mark of a plate each found mark is: its place follows from the arrangement of the ring marks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Index, Mask
from alignment.errors import DegenerateInputError
from alignment.imaging.mark_bias import homography_offsets
from alignment.imaging.mark_detection import find_marks
from alignment.imaging.mark_grid import FEWEST_MARKS, Grid, walk_grid
from alignment.imaging.mark_location import locate_marks
from alignment.imaging.mark_plane import PlaneView, fit_grid_homography
from alignment.imaging.marks import Marks
from alignment.imaging.numbering import decided
from alignment.imaging.pattern import PatternKind, place_table, rows_at
from alignment.imaging.pattern_plates import number_marks
from alignment.imaging.plate import MarkObservations, Plate
from alignment.imaging.plate_refusal import PlateRefusal, PlateRefusalCode, bad_exposure, missing_marks
from alignment.values import Image

_QUARTER = np.array([[0, -1], [1, 0]])


def observe_plate(
    image: Image,
    plate: Plate,
    *,
    method: str = "ellipse",
    bright: bool = False,
    ring_group: Index | None = None,
    corrected: bool = True,
) -> MarkObservations | PlateRefusal:
    """Find, locate and identify the marks of a plate in an image.

    A plate without ring marks is numbered by its own pattern, its corner mark, or the way it is held, as its
    description says; where only its moves on a stage tell, one image is refused
    (`alignment.calibration.stage_turns`).

    Parameters
    ----------
    image
        (height, width), one channel, 8 or 16 bit.
    plate
        The plate that is seen.
    method
        A name of `alignment.imaging.mark_location.METHODS`.
    bright
        True when the marks are brighter than their ground; for other patterns their description says so.
    ring_group, corrected
        As for `identify_marks`.

    Returns
    -------
    MarkObservations or PlateRefusal
        Projections of the marks' centres with their covariance, or what is wrong with the image.
    """
    if plate.pattern.kind is not PatternKind.RING_MARKS:
        found = number_marks(image, plate, method)
        return found if isinstance(found, PlateRefusal) else decided(found, corrected=corrected)
    rough = find_marks(image, bright=bright)
    return identify_marks(
        locate_marks(image, rough, method), plate, ring_group=ring_group, corrected=corrected
    )


def identify_marks(
    marks: Marks, plate: Plate, *, ring_group: Index | None = None, corrected: bool = True
) -> MarkObservations | PlateRefusal:
    """Tell which mark of the plate each mark is.

    A mark's outline is the image of a circle and so shows the plane's local scale and tilt: in its own units
    the neighbours are pitch/radius away, at right angles. From neighbour to neighbour every mark gets a place
    in the grid; a homography brings in marks beyond gaps and puts out what does not lie on the grid. The ring
    marks then fix the place and the orientation on the plate: of all positions that put every mark on a mark,
    the one where ring marks meet ring marks and full meet full.

    Parameters
    ----------
    marks
        Of one image.
    plate
        Its columns and rows must have the same pitch.
    ring_group
        (n, 2) indices (i, j) of the ring marks that this camera is to see, for plates that carry the same
        arrangement several times; None: the arrangement is unique on the plate.
    corrected
        False leaves the centres of the outlines as they are; the joint adjustment then takes off perspective
        and distortion together, with the cameras it finds.

    Returns
    -------
    MarkObservations or PlateRefusal
        Corrected for perspective unless told otherwise, or what is wrong.

    Raises
    ------
    DegenerateInputError
        When the plate has no square grid, or no ring marks, or the group's are not ring marks.
    """
    plane = _PlatePlane.of(plate, ring_group)
    wrong = bad_exposure(marks, plate)
    if wrong is not None:
        return wrong
    grid = walk_grid(marks, plane.pitch / plate.mark_radius_mm)
    if len(grid.rows) < FEWEST_MARKS:
        return PlateRefusal(
            PlateRefusalCode.NO_GRID,
            f"{len(marks)} round marks were found, but at most {len(grid.rows)} lie on a grid with pitch "
            f"{plane.pitch:g} mm of marks with radius {plate.mark_radius_mm:g} mm. "
            "Use the plate that the plate file describes.",
        )
    if min(np.ptp(grid.places, axis=0)) == 0:
        return PlateRefusal(
            PlateRefusalCode.ONE_ROW,
            f"{len(grid.rows)} marks of the plate were found, all in one row, which tells neither "
            "how it leans nor which marks they are. Show more of the plate, and take away what covers it.",
        )
    place = _place_on_plate(grid, marks.hollow[grid.rows], plane)
    if isinstance(place, PlateRefusal):
        return place
    known = np.flatnonzero(place >= 0)
    rows, seen = grid.rows[known], place[known]
    homography = fit_grid_homography(plate.points[seen, :2], marks.points[rows])
    view = PlaneView.fit(plate.points[seen, :2], marks.points[rows], marks.size)
    missing = missing_marks(view, plate, seen, marks.size, 1.3 * float(np.median(marks.semi_axes[:, 1])))
    if missing is not None:
        return missing
    pixels = marks.points[rows]
    if corrected:
        pixels = pixels + homography_offsets(homography, plate.points[seen, :2], plate.mark_radius_mm)
    order = np.argsort(seen)
    return MarkObservations(
        marks=seen[order],
        pixels=pixels[order],
        covariance=marks.covariance[rows][order],
        corrected=corrected,
        blur_px=float(np.median(marks.blur[rows])),
        contrast=float(np.median(marks.contrast[rows])) / marks.exposure.noise,
    )


@dataclass(frozen=True, eq=False)
class _PlatePlane:
    """What identification needs of a plate: pitch, indices, ring marks, and a table of rows by index."""

    plate: Plate
    pitch: float
    rings: Index
    table: Index
    origin: Index

    @classmethod
    def of(cls, plate: Plate, ring_group: Index | None) -> _PlatePlane:
        design = np.column_stack([plate.indices, np.ones(len(plate.indices))]).astype(np.float64)
        affine = np.linalg.lstsq(design, plate.points[:, :2], rcond=None)[0]
        first, second = affine[0], affine[1]
        pitch = 0.5 * (math.hypot(*first) + math.hypot(*second))
        turned = np.array([-first[1], first[0]])
        if pitch <= 0.0 or math.hypot(*(second - turned)) > 0.05 * pitch:
            raise DegenerateInputError(
                field="plate.points",
                expected="columns and rows at right angles, with the same pitch, x to the right and y up",
                seen=f"steps {first.round(3).tolist()} and {second.round(3).tolist()} mm",
            )
        if pitch < 2.0 * plate.mark_radius_mm:
            raise DegenerateInputError(
                field="plate.mark_radius_mm",
                expected=f"marks that do not touch, radius under {pitch / 2.0:g} mm",
                seen=f"{plate.mark_radius_mm:g} mm",
            )
        table, origin = place_table(plate.indices)
        rings = np.flatnonzero(plate.hollow)
        plane = cls(plate, pitch, rings, table, origin)
        if ring_group is not None:
            rings = plane.rows_of(np.asarray(ring_group, dtype=np.int64).reshape(-1, 2))
            if (rings < 0).any() or not plate.hollow[rings].all():
                raise DegenerateInputError(
                    field="ring_group", expected="indices of ring marks of the plate", seen=str(ring_group)
                )
        if not len(rings):
            raise DegenerateInputError(
                field="plate.hollow",
                expected="ring marks, which tell the part of the plate that is seen",
                seen="none",
            )
        return cls(plate, pitch, rings, table, origin)

    def rows_of(self, indices: Index) -> Index:
        """Rows (N,) of the plate at indices (N, 2), −1 where it has no mark."""
        return rows_at(self.table, self.origin, indices)


@dataclass(frozen=True)
class _Fit:
    """How well a position on the plate explains the marks."""

    right: int
    wrong: int
    rows: Index


def _place_on_plate(grid: Grid, hollow: Mask, plane: _PlatePlane) -> Index | PlateRefusal:
    """Rows of the plate (K,) of the grid's marks, −1 for marks beyond the plate."""
    seen = int(hollow.sum())
    if not seen:
        return PlateRefusal(
            PlateRefusalCode.NO_RING_MARKS,
            f"{len(grid.rows)} marks lie on the grid, but none is a ring mark, so the place is unknown. "
            "Shift the plate until its ring marks are in the image, and check the focus.",
        )
    fits = _positions(grid.places, hollow, plane)
    if not fits or not _convincing(fits[0], seen):
        mirrored = _positions(grid.places * np.array([1, -1]), hollow, plane)
        if mirrored and _convincing(mirrored[0], seen):
            return PlateRefusal(
                PlateRefusalCode.MIRRORED,
                "the ring marks are arranged as on the plate seen in a mirror. "
                "Turn the plate's marked side to the camera, or switch off the camera's image mirroring.",
            )
        best = fits[0].right if fits else 0
        return PlateRefusal(
            PlateRefusalCode.NOT_THIS_PLATE,
            f"{seen} ring marks were found, of which at most {best} lie as the plate's do. "
            "Check that the plate file is that of this plate and that no ring mark is covered or dirty.",
        )
    rivals = [f for f in fits[1:] if f.right - f.wrong >= fits[0].right - fits[0].wrong]
    if rivals:
        return PlateRefusal(
            PlateRefusalCode.AMBIGUOUS,
            f"the {seen} ring marks in the image fit {len(rivals) + 1} places of the plate. "
            "Say which group of ring marks this camera sees, or show more of them.",
        )
    return fits[0].rows


def _convincing(fit: _Fit, seen: int) -> bool:
    """One ring mark that is covered or invented by dirt is borne when others agree."""
    return fit.wrong == 0 or (fit.right >= 2 and fit.wrong <= max(1, seen // 4))


def _positions(places: Index, hollow: Mask, plane: _PlatePlane) -> list[_Fit]:
    """All turns and shifts that put a seen ring mark on one of the plate, the best first."""
    fits = []
    turned = places
    for _ in range(4):
        tried = set()
        for ring in turned[hollow]:
            for target in plane.plate.indices[plane.rings]:
                shift = (int(target[0] - ring[0]), int(target[1] - ring[1]))
                if shift in tried:
                    continue
                tried.add(shift)
                rows = plane.rows_of(turned + shift)
                on = rows >= 0
                expected = on & plane.plate.hollow[rows]
                right = int((hollow & expected).sum())
                # A mark beyond the plate counts as wrong too: nothing is there that could be seen.
                wrong = int((hollow != expected).sum()) + int((~on & ~hollow).sum())
                fits.append(_Fit(right, wrong, rows))
        turned = turned @ _QUARTER.T
    return sorted(fits, key=lambda f: f.wrong - f.right)
