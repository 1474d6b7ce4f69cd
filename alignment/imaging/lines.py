"""Light lines of both directions in one image, with sub-pixel centres and their standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba.typed import List
from numpy.typing import DTypeLike

from alignment.arrays import Array, Index
from alignment.imaging import extraction
from alignment.imaging.crosses import Crosses
from alignment.values import Image

LEAST_SINE = 0.25
"""Of the angle between a line and the epipolar lines, below which a match says nothing of depth."""


@dataclass(frozen=True)
class LineSearch:
    """What a search for lines went by in one image, so that they can be looked for again.

    Attributes
    ----------
    steep_lines
        Of the lines those that were located along the rows; they come first.
    contrast
        Least height of a ridge over its flanks, grey levels.
    spreads
        Of steep lines along the rows and of flat ones along the columns, standard deviation, pixels.
    """

    steep_lines: int
    contrast: float
    spreads: tuple[float, float]


@dataclass(frozen=True, eq=False)
class LightLines:
    """Centres of the light lines of one image; neither their number nor their order is assumed.

    Attributes
    ----------
    points
        (N, 2) pixels, line after line.
    tangents
        (N, 2) unit directions of the line at each point.
    sigma
        (N,) standard deviation of each centre across its line, pixels, from the image itself.
    strength
        (N,) slope of the ridge response, proportional to the light above the background.
    starts
        (L + 1,) first point of each line; steep lines first.
    width
        Standard deviation of the lines' cross profile, pixels.
    crosses
        Where lines of the two directions meet.
    share
        Of the points that were found, which are thinned evenly where there are more than the program takes.
    crowded
        True where there were so many lines or points that they cannot be thinned; there are none then.
    search
        What they were found by; None where that is not known.
    """

    points: Array
    tangents: Array
    sigma: Array
    strength: Array
    starts: Index
    width: float
    crosses: Crosses
    share: float = 1.0
    crowded: bool = False
    search: LineSearch | None = None

    @property
    def count(self) -> int:
        """Number of lines."""
        return len(self.starts) - 1


def extract_light_lines(image: Image) -> LightLines | None:
    """Find the light lines of both directions and their crosses in one image; see `extract_many`."""
    return extract_many([image])[0]


def extract_many(
    images: Sequence[Image],
    along: Array | None = None,
    views: Index | None = None,
    *,
    with_crosses: bool = True,
) -> list[LightLines | None]:
    """Find the light lines of both directions and their crosses in each image.

    The centre of a line is the top of its profile along a row, for the flat lines along a column. Shading
    along a line that lies aslant to the rows shifts it, by σ² · d ln A/dx with intensity A and deviation σ.
    That is left alone: both cameras of a head see the same shading and take the same neighbouring place of
    the surface, whose depth is right; an estimate of the shift in each image would err differently in both.
    Points that a line of the other direction disturbs are left out. More than `extraction.MAX_POINTS` are
    thinned evenly, along all lines; a pattern of more than `extraction.MAX_LINES` lines, or of four times as
    many points, is crowded.

    Parameters
    ----------
    images
        (height, width), all 8 or all 16 bit, one channel.
    along
        (n, 2) direction in each image, x and y, of the epipolar lines where they are known. Lines nearly
        parallel to it have no points: they are looked at in some rows only, for the crosses.
    views
        (n, 4) part of each image to look at: first column and row, and those behind the last. None: all.
    with_crosses
        Whether crosses are wanted; without, there are none.

    Returns
    -------
    list of LightLines or None
        None for an image that shows no lines.
    """
    n = len(images)
    kind: DTypeLike = np.uint8 if all(image.dtype == np.uint8 for image in images) else np.uint16
    # One type for all: a kernel is compiled anew for arrays that cannot be written to, as of a mapped file.
    same = [np.require(image, kind, ["C", "W"]) for image in images]
    if views is None:
        views = np.array([[0, 0, image.shape[1], image.shape[0]] for image in images], dtype=np.int64)
    # One large block: the C library keeps as much memory as the largest block it has seen freed, and fresh
    # pages would cost more than the whole search. Pages that stay unused cost nothing.
    block = np.empty((3, n * extraction.MAX_POINTS, 2))
    points = block[0].reshape(n, extraction.MAX_POINTS, 2)
    tangents = block[1].reshape(n, extraction.MAX_POINTS, 2)
    noise = block[2].reshape(n, 2, extraction.MAX_POINTS)
    starts = np.empty((n, extraction.MAX_LINES), np.int64)
    crosses = np.empty((n, extraction.MAX_CROSSES, extraction.CROSS_COLUMNS))
    counts = np.empty((n, extraction.COUNT_ENTRIES), np.int64)
    extraction.extract_all(
        List(same),
        views,
        8 * same[0].itemsize,
        np.zeros((n, 2)) if along is None else np.ascontiguousarray(along, dtype=np.float64),
        LEAST_SINE,
        with_crosses,
        points,
        tangents,
        noise,
        starts,
        crosses,
        counts,
    )
    corners = views[:, :2].astype(np.float64)
    return [
        _lines(*tables, *numbers)
        for *tables, numbers in zip(points, tangents, noise, starts, crosses, corners, counts, strict=True)
    ]


def _lines(
    points: Array, tangents: Array, noise: Array, starts: Index, crosses: Array, corner: Array,
    number: int, lines: int, steep_lines: int, meetings: int, milliwidth: int, offered: int, crowded: int,
    contrast: int, steep_spread: int, flat_spread: int,
) -> LightLines | None:  # fmt: skip
    if milliwidth == 0 and not crowded:
        return None
    found = crosses[:meetings]
    meet = found[:, 2:4].astype(np.int64) + np.array([0, steep_lines])
    return LightLines(
        points=points[:number],
        tangents=tangents[:number],
        sigma=noise[0, :number],
        strength=noise[1, :number],
        starts=starts[: lines + 1],
        width=milliwidth / 1000.0,
        crosses=Crosses(found[:, :2] + corner, meet, found[:, 4:6].copy()),
        share=float(number / offered) if offered else 1.0,
        crowded=bool(crowded),
        search=LineSearch(int(steep_lines), 1e-6 * contrast, (1e-6 * steep_spread, 1e-6 * flat_spread)),
    )
