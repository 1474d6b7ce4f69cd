"""Known lines looked for again: only strips around the places where they were seen last.

Of a wheel that moves a little between two images the same rows of the same lines are looked at, with the same
filter as by the search that found them: what a whole search would find there, for a fraction of the work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from alignment.arrays import Array, Index, Mask, Singles
from alignment.errors import DegenerateInputError
from alignment.imaging.crosses import Crosses
from alignment.imaging.extraction import POINT_STRENGTH, SIGMA, probe_of, write_lines
from alignment.imaging.lines import LightLines
from alignment.imaging.ridges import (
    LEVEL,
    STRENGTH,
    WIDTH2,
    X,
    Y,
    derivative_weights,
    zero_of_cubic,
)
from alignment.imaging.tracing import LANES, response_at, whole_kernel
from alignment.kernels import njit
from alignment.values import Image

REACH = 5
"""Pixels that a line may stand off the place where it is expected."""

_BLOCK = 64  # points
_FEWEST = 0.5  # of the looked-at points of a line must show a ridge, else it is none


@dataclass(frozen=True, eq=False)
class Strips:
    """Lines of one image that are looked for again.

    Attributes
    ----------
    rows
        (N,) row of each point of a steep line, column of each point of a flat one; line after line.
    places
        (N,) where it was seen last along that row or column, pixels.
    starts
        (L + 1,) first point of each line; steep lines first.
    steep_lines
        How many of them are steep.
    contrast, spreads, width
        As of `LineSearch` and `LightLines`.
    moved
        (L,) by how much each line moved between the last two images, pixels.
    """

    rows: Index
    places: Array
    starts: Index
    steep_lines: int
    contrast: float
    spreads: tuple[float, float]
    width: float
    moved: Array

    @classmethod
    def of(cls, lines: LightLines, wanted: Mask) -> Self:
        """Take those points (N,) of found lines that are wanted.

        Raises
        ------
        DegenerateInputError
            When it is not known by what they were found.
        """
        if lines.search is None:
            raise DegenerateInputError(field="lines", expected="lines of a search", seen="lines of no search")
        count = np.concatenate([[0], np.cumsum(wanted)])[lines.starts]
        filled = np.diff(count) > 0
        steep = np.arange(lines.count) < lines.search.steep_lines
        flat = np.repeat(~steep, np.diff(lines.starts))
        rows = np.where(flat, lines.points[:, 0], lines.points[:, 1])
        places = np.where(flat, lines.points[:, 1], lines.points[:, 0])
        return cls(
            rows=np.rint(rows[wanted]).astype(np.int64),
            places=places[wanted],
            starts=np.concatenate([[0], count[1:][filled]]).astype(np.int64),
            steep_lines=int(np.count_nonzero(steep & filled)),
            contrast=lines.search.contrast,
            spreads=lines.search.spreads,
            width=lines.width,
            moved=np.zeros(int(filled.sum())),
        )


@dataclass(frozen=True, eq=False)
class SeenAgain:
    """The lines of one image that were found again.

    Attributes
    ----------
    lines
        Without crosses; a line that is hardly seen any more has no points.
    numbers
        (M,) which of the points of the strips each of theirs is.
    strips
        Where the lines are now, to be looked for in the next image.
    """

    lines: LightLines
    numbers: Index
    strips: Strips


def look_again(images: Sequence[Image], strips: Sequence[Strips]) -> list[SeenAgain]:
    """Find the lines of strips in new images.

    Parameters
    ----------
    images
        (height, width), 8 or 16 bit, as for `extract_many`.
    strips
        Of each image.
    """
    out = []
    for image, strip in zip(images, strips, strict=True):
        same = np.require(image, image.dtype, ["C", "W"])
        n, lines = len(strip.rows), len(strip.starts) - 1
        places, moved = strip.places.copy(), strip.moved.copy()
        points, tangents, noise = np.empty((n, 2)), np.empty((n, 2)), np.empty((2, n))
        starts, numbers = np.zeros(lines + 1, np.int64), np.empty(n, np.int64)
        found = _look(
            same, strip.rows, places, strip.starts, strip.steep_lines, strip.contrast, strip.spreads, moved,
            points, tangents, noise, starts, numbers,
        )  # fmt: skip
        seen = LightLines(
            points=points[:found],
            tangents=tangents[:found],
            sigma=noise[SIGMA, :found],
            strength=noise[POINT_STRENGTH, :found],
            starts=starts,
            width=strip.width,
            crosses=Crosses(np.empty((0, 2)), np.empty((0, 2), np.int64), np.empty((0, 2))),
        )
        out.append(SeenAgain(seen, numbers[:found], replace(strip, places=places, moved=moved)))
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _load(image: Any, flat: bool, row: int, corner: int, count: int, grey: Singles) -> None:
    """Pixels of a row, or of a column, from a corner on, into the first ones of `grey`."""
    if flat:
        for k in range(count):
            grey[k] = np.float32(image[corner + k, row])
    else:
        source = image[row][corner:]
        for k in range(count):
            grey[k] = np.float32(source[k])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fall(grey: Singles, m: int, half: int, kernel: Singles) -> tuple[int, float, float]:
    """Pixel before the fall of the response through zero near pixel `m`, and both responses; −1: none."""
    b, c = response_at(grey, m - half, kernel), response_at(grey, m + 1 - half, kernel)
    steps = 0
    while steps < REACH and c > 0.0:
        m += 1
        b, c = c, response_at(grey, m + 1 - half, kernel)
        steps += 1
    while steps < REACH and b <= 0.0:
        m -= 1
        b, c = response_at(grey, m - half, kernel), b
        steps += 1
    return (m if b > 0.0 and c <= 0.0 else -1), b, c


@njit(cache=True, nogil=True, error_model="numpy")
def _look_along(
    image: Any,
    flat: bool,
    spread: float,
    contrast: float,
    rows: Index,
    places: Array,
    starts: Index,
    moved: Array,
    number: Index,
) -> tuple[Array, Index]:
    """Ridge points of lines of one direction and the first of each line; places and moves are renewed.

    Which of the places each point has goes into `number`.
    """
    probe, box = probe_of(spread)
    weights = derivative_weights(probe)
    kernel = whole_kernel(weights)
    half, flank = weights.size, 2 * box
    # On either side of the pixel at which a line is expected; what lies behind meets the kernel's zeros.
    margin = REACH + 2 + max(half, flank + 1)
    count = (2 * margin + LANES) // LANES * LANES
    across = image.shape[0] if flat else image.shape[1]
    windows = np.zeros((_BLOCK, count + kernel.size), np.float32)
    pixels, corners = np.empty(_BLOCK, np.int64), np.empty(_BLOCK, np.int64)
    table, out_starts = np.empty((rows.size, WIDTH2)), np.zeros_like(starts)
    four = np.empty((4, rows.size))
    n = touched = 0
    for c in range(starts.size - 1) if across >= count else range(0):
        begin = n
        # By blocks, whose pixels are touched before any is looked at: memory answers all of them at once, and
        # the processor does not wait for one row after the other.
        for first in range(starts[c], starts[c + 1], _BLOCK):
            points = min(_BLOCK, starts[c + 1] - first)
            for k in range(points):
                pixels[k] = np.int64(np.floor(places[first + k] + moved[c]))
                corners[k] = max(min(pixels[k] - margin, across - count), 0)
                if flat:
                    touched += image[corners[k], rows[first + k]]
                else:
                    touched += image[rows[first + k], corners[k]]
                    touched += image[rows[first + k], corners[k] + count - 1]
            for k in range(points):
                _load(image, flat, rows[first + k], corners[k], count, windows[k])
            for k in range(points):
                m = pixels[k]
                if m < margin or m + margin >= across:
                    continue
                grey = windows[k]
                m, b, d = _fall(grey, m - corners[k], half, kernel)
                if m < 0:
                    continue
                level = 0.25 * float(grey[m - 1] + grey[m] + grey[m + 1] + grey[m + 2])
                left = float(grey[m - flank - 1] + grey[m - flank] + grey[m - flank + 1])
                right = float(grey[m + flank] + grey[m + flank + 1] + grey[m + flank + 2])
                if 3.0 * (level - contrast) < max(left, right):
                    continue
                four[0, n], four[1, n] = response_at(grey, m - 1 - half, kernel), b
                four[2, n], four[3, n] = d, response_at(grey, m + 2 - half, kernel)
                point = table[n]
                point[X], point[Y] = corners[k] + m, rows[first + k]
                point[STRENGTH], point[LEVEL] = b - d, level
                number[n] = first + k
                n += 1
        if n - begin < _FEWEST * (starts[c + 1] - starts[c]):
            n = begin
        out_starts[c + 1] = n
    out_starts[0] = min(touched, 0)  # 0: what is asked for nothing would not be touched
    # All at once: a loop that compilers turn into vector instructions.
    zero = np.empty(n)
    for i in range(n):
        zero[i] = zero_of_cubic(four[0, i], four[1, i], four[2, i], four[3, i])
    for i in range(n):
        table[i, X] += zero[i]
    for c in range(starts.size - 1):
        first, last = out_starts[c], out_starts[c + 1]
        total = 0.0
        for i in range(first, last):
            total += table[i, X] - places[number[i]]
        # A line that was not seen is expected where it would have gone on to.
        move = total / (last - first) if last > first else moved[c]
        for i in range(starts[c], starts[c + 1]):
            places[i] += move
        for i in range(first, last):
            places[number[i]] = table[i, X]
        moved[c] = move
    return table[:n], out_starts


@njit(cache=True, nogil=True, error_model="numpy")
def _look(
    image: Any,
    rows: Index,
    places: Array,
    starts: Index,
    steep_lines: int,
    contrast: float,
    spreads: tuple[float, float],
    moved: Array,
    points: Array,
    tangents: Array,
    noise: Array,
    line_starts: Index,
    numbers: Index,
) -> int:
    """Lines of one image into the last five; how many points. Places and moves are renewed."""
    middle = starts[steep_lines]
    none: Any = np.int64(0)
    behind: Any = np.int64(steep_lines)
    no: Any = np.bool_(False)
    yes: Any = np.bool_(True)
    room = rows.size
    table, found = _look_along(
        image, no, spreads[0], contrast, rows[:middle], places[:middle], starts[: steep_lines + 1],
        moved[:steep_lines], numbers,
    )  # fmt: skip
    corner = (0.0, 0.0)
    n = write_lines(table, found, no, points, tangents, noise, none, line_starts, none, corner, room)
    table, found = _look_along(
        image, yes, spreads[1], contrast, rows[middle:], places[middle:], starts[steep_lines:] - middle,
        moved[steep_lines:], numbers[n:],
    )  # fmt: skip
    numbers[n : n + table.shape[0]] += middle
    return write_lines(table, found, yes, points, tangents, noise, n, line_starts, behind, corner, room)
