"""Light lines of both directions in one image, with sub-pixel centres and their standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba.typed import List
from numpy.typing import DTypeLike, NDArray

from alignment.imaging import extraction
from alignment.imaging.crosses import Crosses
from alignment.values import Image

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEAST_SINE = 0.25
"""Of the angle between a line and the epipolar lines, below which a match says nothing of depth."""


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
    """

    points: Array
    tangents: Array
    sigma: Array
    strength: Array
    starts: Index
    width: float
    crosses: Crosses

    @property
    def count(self) -> int:
        """Number of lines."""
        return len(self.starts) - 1


def extract_light_lines(image: Image) -> LightLines | None:
    """Find the light lines of both directions and their crosses in one image; see `extract_many`."""
    return extract_many([image])[0]


def extract_many(images: Sequence[Image], along: Array | None = None) -> list[LightLines | None]:
    """Find the light lines of both directions and their crosses in each image.

    The centre of a line is the top of its cross profile. Rows are searched for the steep lines, columns for
    the flat ones; the profile along a row differs from the one across the line, which shifts the top where
    the light changes along a slanting line (gloss, rings): with intensity A, cross deviation σ and slope
    dx/dy that shift is σ² · d ln A/dy · dx/dy, and it is taken off. Points that a line of the other
    direction disturbs are left out.

    Parameters
    ----------
    images
        (height, width), all 8 or all 16 bit, one channel.
    along
        (n, 2) direction in each image, x and y, of the epipolar lines where they are known. Lines nearly
        parallel to it have no points: they are looked at in some rows only, for the crosses.

    Returns
    -------
    list of LightLines or None
        None for an image that shows no lines.
    """
    n = len(images)
    kind: DTypeLike = np.uint8 if all(image.dtype == np.uint8 for image in images) else np.uint16
    same = [np.ascontiguousarray(image, dtype=kind) for image in images]
    # One large block: the C library keeps as much memory as the largest block it has seen freed, and fresh
    # pages would cost more than the whole search. Pages that stay unused cost nothing.
    block = np.empty((3, n * extraction.MAX_POINTS, 2))
    points = block[0].reshape(n, extraction.MAX_POINTS, 2)
    tangents = block[1].reshape(n, extraction.MAX_POINTS, 2)
    noise = block[2].reshape(n, 2, extraction.MAX_POINTS)
    starts = np.empty((n, extraction.MAX_LINES), np.int64)
    crosses = np.empty((n, extraction.MAX_CROSSES, extraction.CROSS_COLUMNS))
    counts = np.empty((n, 5), np.int64)
    extraction.extract_all(
        List(same),
        List([np.asarray(cv2.transpose(image)) for image in same]),
        8 * same[0].itemsize,
        np.zeros((n, 2)) if along is None else np.ascontiguousarray(along, dtype=np.float64),
        LEAST_SINE,
        points,
        tangents,
        noise,
        starts,
        crosses,
        counts,
    )
    return [
        _lines(*tables, *numbers)
        for *tables, numbers in zip(points, tangents, noise, starts, crosses, counts, strict=True)
    ]


def _lines(
    points: Array, tangents: Array, noise: Array, starts: Index, crosses: Array,
    number: int, lines: int, steep_lines: int, meetings: int, milliwidth: int,
) -> LightLines | None:  # fmt: skip
    if milliwidth == 0:
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
        crosses=Crosses(found[:, :2].copy(), meet, found[:, 4:6].copy()),
    )
