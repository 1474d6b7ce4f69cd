"""The square grid on which round marks lie, found from their own outlines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from alignment.arrays import Index
from alignment.imaging.mark_plane import PlaneView
from alignment.imaging.marks import Marks, upper_factor

FEWEST_MARKS = 6  # marks that make a grid
_STEP_TOLERANCE = 0.2  # of a step's length, between neighbours
_ANGLE_TOLERANCE = math.radians(25.0)
_SIZE_TOLERANCE = 1.6  # ratio of the areas of neighbours
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
    links = _links(marks, step)
    best: dict[int, tuple[int, int]] = {}
    left = set(links)
    while left and len(left) > len(best):
        # The mark with the most neighbours starts: it is inside.
        seed = max(left, key=lambda k: (len(links[k]), -k))
        places = _walk(seed, links)
        left -= places.keys()
        left.discard(seed)
        if len(places) > len(best):
            best = places
    rows = np.array(sorted(best), dtype=np.int64)
    places_ = np.array([best[int(k)] for k in rows], dtype=np.int64).reshape(-1, 2)
    if len(rows) < FEWEST_MARKS:
        return Grid(rows, places_)
    return _completed(marks, Grid(rows, places_))


def _links(marks: Marks, step: float) -> dict[int, list[tuple[int, float, float]]]:
    """For each mark its neighbours one step away: (mark, direction there, direction back), radians.

    Directions are those of each mark's own circle: with U of its outline, U p turns the image of a circle
    into a circle. y is turned upwards, so that angles count as on the plate.
    """
    links: dict[int, list[tuple[int, float, float]]] = {k: [] for k in range(len(marks))}
    if len(marks) < 2:
        return links
    factor = upper_factor(marks.shape)
    area = np.sqrt(np.linalg.det(marks.shape))
    major = marks.semi_axes[:, 1]
    tree = cKDTree(marks.points)
    for k in range(len(marks)):
        for j in tree.query_ball_point(marks.points[k], 1.4 * step * float(major[k])):
            if j <= k or not 1.0 / _SIZE_TOLERANCE < area[k] / area[j] < _SIZE_TOLERANCE:
                continue
            there = factor[k] @ (marks.points[j] - marks.points[k])
            back = factor[j] @ (marks.points[k] - marks.points[j])
            # Perspective makes one of them longer and the other shorter.
            if abs(0.5 * (math.hypot(*there) + math.hypot(*back)) / step - 1.0) > _STEP_TOLERANCE:
                continue
            direction, returned = math.atan2(-there[1], there[0]), math.atan2(-back[1], back[0])
            links[k].append((j, direction, returned))
            links[j].append((k, returned, direction))
    return links


def _walk(seed: int, links: dict[int, list[tuple[int, float, float]]]) -> dict[int, tuple[int, int]]:
    """Places of all marks that neighbours lead to from the seed, breadth first; the first way counts."""
    if not links[seed]:
        return {}
    places = {seed: (0, 0)}
    taken = {(0, 0)}
    # Direction of the grid's first axis at each mark.
    axis = {seed: links[seed][0][1]}
    queue = [seed]
    for k in queue:
        for j, direction, back in links[k]:
            quarter = (direction - axis[k]) / (0.5 * math.pi)
            turn = round(quarter)
            if abs(quarter - turn) * 0.5 * math.pi > _ANGLE_TOLERANCE or j in places:
                continue
            step = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn % 4]
            place = (places[k][0] + step[0], places[k][1] + step[1])
            if place in taken:
                continue
            places[j] = place
            taken.add(place)
            # From j the way back points against the step.
            axis[j] = back - (turn + 2) * 0.5 * math.pi
            queue.append(j)
    return places


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
