"""Light lines of both directions in one image, with sub-pixel centres and their standard deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from alignment.imaging import chains, ridges
from alignment.imaging.crosses import Crosses, cross_lines
from alignment.values import Image

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PROBE_SIGMA = 1.5
_PROBE_STEP = 16
_STEEPEST = 1.05  # slope to the scan direction; steeper points belong to the other scan
_DISTURBED = 3.0  # line widths within which another line disturbs a centre
_SECOND_DIFFERENCE = math.sqrt(6.0)  # standard deviation of a − 2b + c for unit noise
_MEDIAN_OF_SQUARE = 0.4549  # median of the square of a unit normal variate
_QUANTISATION = math.sqrt(1.0 / 12.0)
_UNKNOWN_SIGMA = 0.1  # pixels, where there are too few points to tell
_LEAST_SIGMA = 0.005


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
        (L + 1,) first point of each line.
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


def contrast_of(image: Image) -> float:
    """Least height over both flanks, grey levels, that a ridge must have to be a candidate.

    Above the noise of the dark part (its second differences), and a few per cent of the light's swing.
    """
    sample = image[_PROBE_STEP // 2 :: _PROBE_STEP].astype(np.int32)
    second = np.bincount(np.abs(sample[:, :-2] - 2 * sample[:, 1:-1] + sample[:, 2:]).ravel())
    noise = max(_quantile(second, 0.5) / 0.6745 / _SECOND_DIFFERENCE, _QUANTISATION)
    levels = np.bincount(sample.ravel())
    swing = _quantile(levels, 0.995) - _quantile(levels, 0.5)
    return max(3.0, 5.0 * noise, 0.03 * swing)


def _quantile(counts: Index, share: float) -> float:
    """Value below which `share` of a histogram of integers lies."""
    return float(np.searchsorted(np.cumsum(counts), share * counts.sum()))


def line_width(image: Image, transposed: Image, contrast: float) -> float | None:
    """Standard deviation of the lines' cross profile, pixels, from some rows and columns; None without lines.

    A ridge that lies aslant shows too wide, so of each direction the narrow half counts.
    """
    weights = ridges.derivative_weights(_PROBE_SIGMA)
    widths = []
    for view in (image, transposed):
        table, _ = ridges.scan_rows(view, 3, weights, contrast, _PROBE_STEP)
        if len(table) >= 8:
            widths.append(float(np.percentile(table[:, ridges.WIDTH2], 40)))
    if not widths:
        return None
    # A Gaussian line of deviation s shows WIDTH2 = (s² + p²)^1.5 / s under a probe of deviation p.
    s = np.linspace(_PROBE_SIGMA / 2**0.5, 15.0, 400)
    shown = (s**2 + _PROBE_SIGMA**2) ** 1.5 / s
    return float(np.interp(min(widths), shown, s))


def extract_light_lines(image: Image) -> LightLines | None:
    """Find the light lines of both directions and their crosses.

    The centre of a line is the top of its cross profile. Rows are searched for the steep lines, columns for
    the flat ones; the profile along a row differs from the one across the line, which shifts the top where
    the light changes along a slanting line (gloss, rings): with intensity A, cross deviation σ and slope
    dx/dy that shift is σ² · d ln A/dy · dx/dy, and it is taken off.

    Parameters
    ----------
    image
        (height, width), 8 or 16 bit, one channel.

    Returns
    -------
    LightLines or None
        None when the image shows no lines.
    """
    transposed = cast(Image, cv2.transpose(image))
    contrast = contrast_of(image)
    width = line_width(image, transposed, contrast)
    if width is None:
        return None
    steep, flat = (_trace(view, width, contrast) for view in (image, transposed))
    crosses = cross_lines(steep.table, steep.starts, flat.table, flat.starts, width)
    parts = [
        _clean(steep, flat, width, image.shape),
        _transposed(_clean(flat, steep, width, transposed.shape)),
    ]
    counts = np.concatenate([np.diff(p.starts) for p in parts])
    return LightLines(
        points=np.concatenate([p.points for p in parts]),
        tangents=np.concatenate([p.tangents for p in parts]),
        sigma=np.concatenate([p.sigma for p in parts]),
        strength=np.concatenate([p.strength for p in parts]),
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        width=width,
        crosses=crosses.numbered_after(len(steep.starts) - 1),
    )


@dataclass(frozen=True, eq=False)
class _Trace:
    """Chains of one scan direction: ridge table in chain order, first row of each chain, slopes."""

    table: Array
    starts: Index
    slope: Array


@dataclass(frozen=True, eq=False)
class _Part:
    """The finished lines of one direction."""

    points: Array
    tangents: Array
    sigma: Array
    strength: Array
    starts: Index


def _trace(image: Image, width: float, contrast: float) -> _Trace:
    weights = ridges.derivative_weights(min(max(0.9 * width, 1.0), 6.0))
    table, row_starts = ridges.scan_rows(image, max(2, round(1.6 * width)), weights, contrast, 1)
    shortest = max(12, round(4 * width))
    order, starts = ridges.link_rows(table, row_starts, 1, 1.0, max(6, round(3 * width)), shortest)
    linked = table[order]
    return _Trace(linked, starts, chains.chain_slopes(linked, starts))


def _clean(trace: _Trace, other: _Trace, width: float, size: tuple[int, ...]) -> _Part:
    """Keep what no other line disturbs; all chains stay, if empty, so that their numbers do not change."""
    radius = _DISTURBED * width
    others = chains.shadow(
        other.table, other.starts, other.slope, _STEEPEST, radius, np.array([size[1], size[0]])
    )
    keep = chains.undisturbed(trace.table, trace.slope, _STEEPEST, others, 2.0 * radius)
    table = trace.table[keep]
    starts = np.concatenate([[0], np.cumsum(keep)])[trace.starts].astype(np.int64)
    slope = chains.chain_slopes(table, starts)
    chains.take_off_light_shift(table, starts, slope, width)
    along = np.hypot(1.0, slope)
    return _Part(
        points=np.ascontiguousarray(table[:, [ridges.X, ridges.Y]]),
        tangents=np.column_stack([slope, np.ones(len(slope))]) / along[:, None],
        sigma=_deviation(table, starts) / along,
        strength=table[:, ridges.STRENGTH],
        starts=starts,
    )


def _transposed(part: _Part) -> _Part:
    return replace(
        part,
        points=np.ascontiguousarray(part.points[:, ::-1]),
        tangents=np.ascontiguousarray(part.tangents[:, ::-1]),
    )


def _deviation(table: Array, starts: Index) -> Array:
    """Standard deviation of each centre along its row.

    Second differences along the lines show the noise itself. The variance of a centre is
    (a + b·level)/strength², with read noise in a and shot noise in b: both come from the medians of a few
    classes of brightness.
    """
    x, strength, level = table[:, ridges.X], table[:, ridges.STRENGTH], table[:, ridges.LEVEL]
    if len(x) < 64:
        return np.full(len(x), _UNKNOWN_SIGMA)
    same = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    joined = (same[2:] == same[:-2]) & (table[2:, ridges.Y] - table[:-2, ridges.Y] == 2.0)
    residual = (x[2:] - 2.0 * x[1:-1] + x[:-2])[joined] / _SECOND_DIFFERENCE
    scaled = (residual * strength[1:-1][joined]) ** 2
    grey = level[1:-1][joined]
    if len(scaled) < 64:
        return np.full(len(x), _UNKNOWN_SIGMA)
    ranks = np.array_split(np.argsort(grey), min(8, len(scaled) // 32))
    medians = np.array([np.median(scaled[r]) for r in ranks]) / _MEDIAN_OF_SQUARE
    greys = np.array([np.median(grey[r]) for r in ranks])
    spread = greys - greys.mean()
    b = float(spread @ medians / max(float(spread @ spread), 1e-9))
    b = min(max(b, 0.0), float((medians / greys).mean()))  # neither noise source is negative
    a = float(medians.mean() - b * greys.mean())
    sigma: Array = np.sqrt(np.maximum(a + b * level, 0.0)) / np.maximum(strength, 1e-9)
    return np.maximum(sigma, _LEAST_SIGMA)
