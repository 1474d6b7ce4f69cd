"""The grid on which round marks lie, found from their own outlines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from alignment.arrays import Array, Index
from alignment.imaging.mark_plane import PlaneView
from alignment.imaging.marks import Marks, upper_factor

FEWEST_MARKS = 6  # marks that make a grid
_STEP_TOLERANCE = 0.2  # of a step's length, between neighbours
_ANGLE_TOLERANCE = math.radians(25.0)
_SIZE_TOLERANCE = 1.6  # ratio of the areas of neighbours
_ABOUT_AS_MANY = 0.7  # of the marks that the better way leads to
_ALIKE = 0.03  # difference of two steps over their length, or of their angle, that marks do not show
_PLACE_TOLERANCE = 0.15  # of the pitch, from where the view puts a mark


@dataclass(frozen=True, eq=False)
class Grid:
    """Marks with places in a grid of unknown origin and orientation, never mirrored.

    Attributes
    ----------
    rows
        (K,) rows of the marks.
    places
        (K, 2) integer places; a positive turn takes the first axis to the second as seen from the marks'
        side.
    """

    rows: Index
    places: Index


def walk_grid(marks: Marks, step: float) -> Grid:
    """Give marks their places in the largest connected square grid.

    Parameters
    ----------
    marks
        Of one image.
    step
        Pitch of the grid over the radius of its marks.
    """
    return walk_lattice(marks, np.array([[step, 0.0], [0.0, step]]))


def walk_lattice(marks: Marks, steps: Array) -> Grid:
    """Give marks their places in the largest connected grid of two steps.

    Parameters
    ----------
    marks
        Of one image.
    steps
        (2, 2) the grid's two steps as rows, over the radius of its marks, the second to the left of the first
        as seen from the marks' side. Where neither their lengths nor their angle tell them apart, the first
        may be any of them.
    """
    lattice = _Lattice.of(steps)
    links = _links(marks, lattice)
    best: dict[int, tuple[int, int]] = {}
    left = set(links)
    while left and len(left) > len(best):
        # The mark with the most neighbours starts: it is inside.
        seed = max(left, key=lambda k: (len(links[k]), -k))
        places = _best_walk(seed, links, lattice)
        left -= places.keys()
        left.discard(seed)
        if len(places) > len(best):
            best = places
    rows = np.array(sorted(best), dtype=np.int64)
    places_ = np.array([best[int(k)] for k in rows], dtype=np.int64).reshape(-1, 2)
    if len(rows) < FEWEST_MARKS:
        return Grid(rows, places_)
    return _completed(marks, Grid(rows, places_))


def _best_walk(seed: int, links: dict[int, list[_Link]], lattice: _Lattice) -> dict[int, tuple[int, int]]:
    """Walk with the seed's first link as each of the steps that it may be; the one that fits best."""
    tried = [_walk(seed, links, lattice, first) for first in lattice.first_links]
    most = max(map(len, tried))
    # Steps of nearly one length lead to as many marks either way: their lengths say which is which.
    return min(
        (each for each in tried if len(each) >= _ABOUT_AS_MANY * most),
        key=lambda each: _misfit(each, links, lattice),
    )


def is_square(steps: Array) -> bool:
    """Whether two steps (2, 2) are so much alike that the marks between them do not tell them apart."""
    first, second = (float(np.hypot(*step)) for step in steps)
    across = abs(float(steps[0] @ steps[1])) / (first * second)
    return abs(first / second - 1.0) < _ALIKE and across < _ALIKE


@dataclass(frozen=True)
class _Lattice:
    """Steps to the neighbours of a mark: how far, in which direction from the first one, to which place."""

    steps: tuple[tuple[float, float, tuple[int, int]], ...]
    first_links: tuple[int, ...]
    """Numbers of the steps that a seed's first link may be."""

    @classmethod
    def of(cls, steps: Array) -> _Lattice:
        first, second = (float(np.hypot(*step)) for step in steps)
        base = math.atan2(steps[0][1], steps[0][0])
        angle = (math.atan2(steps[1][1], steps[1][0]) - base) % (2.0 * math.pi)
        return cls(
            (
                (first, 0.0, (1, 0)),
                (second, angle, (0, 1)),
                (first, math.pi, (-1, 0)),
                (second, angle + math.pi, (0, -1)),
            ),
            (0,) if is_square(steps) else (0, 1),
        )

    def step(self, direction: float, length: float) -> tuple[float, float, tuple[int, int]] | None:
        """Return the step of this direction, radians from the first, and length; None where there is none."""
        best, least = None, _ANGLE_TOLERANCE
        for step in self.steps:
            off = abs((direction - step[1] + math.pi) % (2.0 * math.pi) - math.pi)
            if off <= least and abs(length / step[0] - 1.0) <= _STEP_TOLERANCE:
                best, least = step, off
        return best


_Link = tuple[int, float, float, float]
"""Neighbour, direction there, direction back, length."""


def _links(marks: Marks, lattice: _Lattice) -> dict[int, list[_Link]]:
    """For each mark its neighbours one step away, directions in radians, lengths in radii.

    Directions are those of each mark's own circle: with U of its outline, U p turns the image of a circle
    into a circle. y is turned upwards, so that angles count as on the plate.
    """
    links: dict[int, list[_Link]] = {k: [] for k in range(len(marks))}
    if len(marks) < 2:
        return links
    factor = upper_factor(marks.shape)
    area = np.sqrt(np.linalg.det(marks.shape))
    major = marks.semi_axes[:, 1]
    tree = cKDTree(marks.points)
    lengths = [length for length, _, _ in lattice.steps[:2]]
    for k in range(len(marks)):
        for j in tree.query_ball_point(marks.points[k], 1.4 * max(lengths) * float(major[k])):
            if j <= k or not 1.0 / _SIZE_TOLERANCE < area[k] / area[j] < _SIZE_TOLERANCE:
                continue
            there = factor[k] @ (marks.points[j] - marks.points[k])
            back = factor[j] @ (marks.points[k] - marks.points[j])
            # Perspective makes one of them longer and the other shorter.
            length = 0.5 * (math.hypot(*there) + math.hypot(*back))
            if min(abs(length / known - 1.0) for known in lengths) > _STEP_TOLERANCE:
                continue
            direction, returned = math.atan2(-there[1], there[0]), math.atan2(-back[1], back[0])
            links[k].append((j, direction, returned, length))
            links[j].append((k, returned, direction, length))
    return links


def _walk(
    seed: int, links: dict[int, list[_Link]], lattice: _Lattice, first: int
) -> dict[int, tuple[int, int]]:
    """Places of all marks that neighbours lead to from the seed, breadth first; the first way counts.

    `first` says which step the seed's first link is.
    """
    if not links[seed]:
        return {}
    places = {seed: (0, 0)}
    taken = {(0, 0)}
    # Direction of the grid's first axis at each mark.
    axis = {seed: links[seed][0][1] - lattice.steps[first][1]}
    queue = [seed]
    for k in queue:
        for j, direction, back, length in links[k]:
            step = lattice.step(direction - axis[k], length)
            if step is None or j in places:
                continue
            place = (places[k][0] + step[2][0], places[k][1] + step[2][1])
            if place in taken:
                continue
            places[j] = place
            taken.add(place)
            # From j the way back points against the step.
            axis[j] = back - step[1] - math.pi
            queue.append(j)
    return places


def _misfit(places: dict[int, tuple[int, int]], links: dict[int, list[_Link]], lattice: _Lattice) -> float:
    """How far the lengths of the links between neighbours are from those of their steps, the median share."""
    expected = {step[2]: step[0] for step in lattice.steps}
    off = [
        abs(length / known - 1.0)
        for k, place in places.items()
        for j, _, _, length in links[k]
        if j in places
        and (known := expected.get((places[j][0] - place[0], places[j][1] - place[1]))) is not None
    ]
    return float(np.median(off)) if off else math.inf


def _completed(marks: Marks, grid: Grid) -> Grid:
    """Bring in marks beyond gaps, put out those that are not on the grid."""
    rows, places = grid.rows, grid.places
    if min(np.ptp(places, axis=0)) == 0:
        return grid  # one row is no view of a plane
    area = np.sqrt(np.linalg.det(marks.shape))
    for _ in range(4):
        view = PlaneView.fit(places.astype(np.float64), marks.points[rows], marks.size)
        inside, expected = view.with_areas(marks.points)
        nearest = np.rint(np.nan_to_num(inside, nan=0.5)).astype(np.int64)
        on_grid = np.hypot(*(inside - nearest).T) < _PLACE_TOLERANCE
        # The area that the view gives a mark of the common size, up to a constant.
        usual = float(np.median(area[rows] / expected[rows]))
        on_grid &= np.abs(np.log(area / expected / usual)) < math.log(_SIZE_TOLERANCE)
        found = np.flatnonzero(on_grid)
        # Of two marks on one place the nearer one stays.
        order = found[np.argsort(np.hypot(*(inside - nearest)[found].T), kind="stable")]
        _, first = np.unique(nearest[order], axis=0, return_index=True)
        new_rows = np.sort(order[first])
        if len(new_rows) < 4:
            break
        same = np.array_equal(new_rows, rows)
        rows, places = new_rows, nearest[new_rows]
        if same:
            break
    return Grid(rows, places)
