"""Pairs of lines that are known, triangulated again: which right line belongs to a left one was found before.

Lines move little from image to image. Where a pixel lies in the rectified head is then told by a parabola
along its row, made once, in place of the inverse of the lens; and of all right lines one alone is looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from alignment.arrays import Array, Index
from alignment.imaging.lines import LEAST_SINE
from alignment.imaging.strips import SeenAgain, Strips
from alignment.kernels import njit
from alignment.stereo.correspondence import (
    BRIDGE_PX,
    Candidates,
    StereoGeometry,
    line_slopes,
    write_point,
)
from alignment.stereo.pool import STRETCH, PointPool
from alignment.stereo.rectification import rectify

_STEP = 4.0  # pixels to both sides of a place, through which the parabolas of its rectified view go
#: Columns of a view: place that it was made at; u, v and their first and second differences; |sin| of the
#: angle between the line and the epipolar lines.
_AT, _U, _V, _SINE = 0, 1, 4, 7
_COLUMNS = 8


@dataclass(frozen=True, eq=False)
class PairedLines:
    """The lines of one head.

    Attributes
    ----------
    left, right
        (N, 8) and (M, 8) rectified view of each point of the strips, as a function of its place.
    partner
        (N,) point of the right strips beside which the partner of each left point was found.
    way
        (N,) by how much gloss moves the point along its ray, to be put back, millimetres.
    """

    left: Array
    right: Array
    partner: Index
    way: Array


def view_of(strips: Strips, packed: Array, turn: Array) -> Array:
    """(N, 8) rectified view of the points of one image's strips; `packed`, `turn` as for `rectify`."""
    flat = np.arange(len(strips.rows)) >= strips.starts[strips.steep_lines]
    seen = np.empty((3, len(strips.rows), 2))
    for k, off in enumerate((-_STEP, 0.0, _STEP)):
        at = strips.places + off
        pixels = np.column_stack([np.where(flat, strips.rows, at), np.where(flat, at, strips.rows)])
        rectify(pixels, packed, turn, seen[k])
    out = np.empty((len(strips.rows), _COLUMNS))
    out[:, _AT] = strips.places
    for first, axis in ((_U, 0), (_V, 1)):
        before, here, after = seen[:, :, axis]
        out[:, first] = here
        out[:, first + 1] = (after - before) / (2.0 * _STEP)
        out[:, first + 2] = (after - 2.0 * here + before) / (2.0 * _STEP**2)
    sine = np.empty(len(strips.rows))
    line_slopes(np.ascontiguousarray(seen[1]), strips.starts, sine)
    out[:, _SINE] = sine
    return out


def match_again(
    seen: Sequence[tuple[SeenAgain, SeenAgain]],
    paired: Sequence[PairedLines],
    geometry: StereoGeometry,
    depth_range: tuple[float, float],
) -> tuple[list[Candidates], PointPool]:
    """Triangulate the lines of all heads.

    Parameters
    ----------
    seen
        Left and right image of each head.
    paired, geometry
        Of each head.
    depth_range
        As for `match_heads`.

    Returns
    -------
    candidates, pool
        As of a match, but for each point its one partner; without what gloss did to them.
    """
    room = sum(len(left.numbers) for left, _ in seen)
    points, rays, light = np.empty((room, 3)), np.empty((room, 3)), np.empty((room, 3))
    sigma, spread = np.empty((2, room))
    indices, cluster = np.empty((3, room), np.int64), np.empty(room, np.int64)
    bounds, offered = [0], []
    for k, ((left, right), lines) in enumerate(zip(seen, paired, strict=True)):
        of_left, of_right = left.lines, right.lines
        focal_left, focal_right = geometry.focal[2 * k], geometry.focal[2 * k + 1]
        n, each = _match_again(
            left.strips.places, left.numbers, of_left.starts, of_left.sigma, of_left.strength,
            of_left.tangents, lines.left, focal_left,
            right.strips.places, right.numbers, of_right.starts, of_right.sigma, of_right.strength,
            lines.right, focal_right,
            lines.partner, lines.way, of_left.width * of_right.width / (focal_left * focal_right),
            geometry.rotations[k], geometry.origins[k], geometry.baselines[k],
            depth_range[0], depth_range[1], LEAST_SINE, BRIDGE_PX / focal_left,
            points, rays, sigma, spread, light, indices, cluster, bounds[-1],
        )  # fmt: skip
        bounds.append(n)
        offered.append(each)
    n = bounds[-1]
    candidates = []
    shift_line = 0
    line, head = np.empty(n, np.int64), np.empty(n, np.int64)
    group = np.arange(n)
    for k, (first, last) in enumerate(pairwise(bounds)):
        part = slice(first, last)
        candidates.append(
            Candidates(
                points[part],
                sigma[part],
                rays[part],
                spread[part],
                indices[0, part],
                indices[1, part],
                indices[2, part],
                light[part],
                offered[k],
            )
        )
        line[part] = indices[1, part] + shift_line
        head[part] = k
        shift_line += len(seen[k][0].lines.starts)
    pool = PointPool(points[:n], sigma[:n], rays[:n], spread[:n], light[:n], group, cluster[:n], line, head)
    return candidates, pool


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _seen(view: Array, place: float, first: int) -> float:
    """Rectified u or v, by its first column, at a place."""
    off = place - view[0]
    return float(view[first] + off * (view[first + 1] + off * view[first + 2]))


@njit(cache=True, nogil=True, error_model="numpy")
def _rectified(places: Array, numbers: Index, view: Array) -> Array:
    """(N, 3) rectified u and v, and |sin|, of the points that were seen."""
    out = np.empty((numbers.size, 3))
    for i in range(numbers.size):
        p = numbers[i]
        out[i, 0], out[i, 1] = _seen(view[p], places[p], _U), _seen(view[p], places[p], _V)
        out[i, 2] = view[p, _SINE]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _match_again(
    left_places: Array,
    left_numbers: Index,
    left_starts: Index,
    left_sigma: Array,
    left_strength: Array,
    left_tangents: Array,
    left_view: Array,
    left_focal: float,
    right_places: Array,
    right_numbers: Index,
    right_starts: Index,
    right_sigma: Array,
    right_strength: Array,
    right_view: Array,
    right_focal: float,
    partner: Index,
    way: Array,
    variance: float,
    rotation: Array,
    origin: Array,
    baseline: float,
    zmin: float,
    zmax: float,
    flattest: float,
    bridge: float,
    points: Array,
    rays: Array,
    sigma: Array,
    spread: Array,
    light: Array,
    indices: Index,
    cluster: Index,
    first_row: int,
) -> tuple[int, int]:
    """Points of one head into the rows from `first_row` on; the row behind them, and how many were offered.

    `partner` and `way` are of `PairedLines`.
    """
    left = _rectified(left_places, left_numbers, left_view)
    right = _rectified(right_places, right_numbers, right_view)
    # Of each right point of the strips the first one at or behind it that was seen, and the line of that one.
    ahead, line_of = np.empty(right_places.size + 1, np.int64), np.empty(right_numbers.size + 1, np.int64)
    j = 0
    for p in range(right_places.size + 1):
        while j < right_numbers.size and right_numbers[j] < p:
            j += 1
        ahead[p] = j
    for b in range(right_starts.size - 1):
        for k in range(right_starts[b], right_starts[b + 1]):
            line_of[k] = b
    o = (origin[0], origin[1], origin[2])
    by_low, by_high = baseline / (zmin - origin[2]), baseline / (zmax - origin[2])
    n, offered = first_row, 0
    last_cluster = cluster[n - 1] if n > 0 else -1
    stretch = -1
    for a in range(left_starts.size - 1):
        stretch = -1
        for i in range(left_starts[a], left_starts[a + 1]):
            sine = left[i, 2]
            if sine < flattest:
                continue
            offered += 1
            j = min(ahead[partner[left_numbers[i]]], right_numbers.size - 1)
            if j < 0:
                continue
            b = line_of[j]
            first, last = right_starts[b], right_starts[b + 1] - 1
            if last <= first:
                continue
            u, v = left[i, 0], left[i, 1]
            j = min(j, last - 1)
            if right[last, 1] > right[first, 1]:
                while j < last - 1 and right[j + 1, 1] < v:
                    j += 1
                while j > first and right[j, 1] > v:
                    j -= 1
            else:
                while j < last - 1 and right[j + 1, 1] > v:
                    j += 1
                while j > first and right[j, 1] < v:
                    j -= 1
            v0, v1 = right[j, 1], right[j + 1, 1]
            if (v - v0) * (v - v1) > 0.0 or abs(v1 - v0) > bridge:
                continue
            if min(right[j, 2], right[j + 1, 2]) < flattest:
                continue
            t = (v - v0) / (v1 - v0) if v1 != v0 else 0.5
            disparity = u - (right[j, 0] + t * (right[j + 1, 0] - right[j, 0]))
            dx = rotation[0, 0] * u + rotation[0, 1] * v + rotation[0, 2]
            dy = rotation[1, 0] * u + rotation[1, 1] * v + rotation[1, 2]
            dz = rotation[2, 0] * u + rotation[2, 1] * v + rotation[2, 2]
            if not (0.0 < by_low * dz <= disparity <= by_high * dz):
                continue
            norm = np.sqrt(dx * dx + dy * dy + dz * dz)
            write_point(
                n, baseline / disparity, o, (dx, dy, dz), norm, baseline, variance,
                left_sigma[i] / (left_focal * sine), right_sigma[j] / (right_focal * right[j, 2]),
                left_strength[i], right_strength[j], left_tangents[i, 0], left_tangents[i, 1],
                points, rays, sigma, spread, light,
            )  # fmt: skip
            for k in range(3):
                points[n, k] += way[left_numbers[i]] * rays[n, k]
            indices[0, n], indices[1, n], indices[2, n] = i, a, j
            if i // STRETCH != stretch:
                stretch = i // STRETCH
                last_cluster += 1
            cluster[n] = last_cluster
            n += 1
    return n, offered
