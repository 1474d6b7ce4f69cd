"""Light lines of both directions in one image, with sub-pixel centres and their standard deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from alignment.imaging import ridges
from alignment.imaging.crosses import Crosses, cross_lines, near_crosses
from alignment.values import Image

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PROBE_SIGMA = 1.5
_PROBE_STEP = 16
_STEEPEST = 1.05  # slope to the scan direction; steeper points belong to the other scan
_SLOPE_SPAN = 5  # points on either side of the difference that gives a slope
_SECOND_DIFFERENCE = math.sqrt(6.0)  # standard deviation of a − 2b + c for unit noise
_MEDIAN_OF_SQUARE = 0.4549  # median of the square of a unit normal variate
_QUANTISATION = math.sqrt(1.0 / 12.0)


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
    steep = _trace(image, width, contrast)
    flat = _trace(transposed, width, contrast)
    crosses = cross_lines(steep.table, steep.starts, flat.table, flat.starts, width)
    parts = []
    for trace, swap in ((steep, False), (flat, True)):
        keep = trace.usable & ~near_crosses(trace.table, crosses, swap, 2.5 * width)
        parts.append(trace.select(keep, swap))
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
class _Part:
    points: Array
    tangents: Array
    sigma: Array
    strength: Array
    starts: Index


@dataclass(frozen=True, eq=False)
class _Trace:
    """Chains of one scan direction: (N, 5) ridge table in chain order, slopes, deviations along the row."""

    table: Array
    starts: Index
    slope: Array
    sigma: Array
    usable: NDArray[np.bool_]

    def select(self, keep: NDArray[np.bool_], swap: bool) -> _Part:
        """Keep some points; all chains stay, so that their numbers do not change."""
        before = np.concatenate([[0], np.cumsum(keep)])
        along = np.hypot(1.0, self.slope[keep])
        tangents = np.column_stack([self.slope[keep], np.ones(len(along))]) / along[:, None]
        points = self.table[keep][:, [ridges.X, ridges.Y]]
        if swap:
            points, tangents = points[:, ::-1], tangents[:, ::-1]
        return _Part(
            np.ascontiguousarray(points),
            np.ascontiguousarray(tangents),
            self.sigma[keep] / along,
            self.table[keep, ridges.STRENGTH],
            before[self.starts].astype(np.int64),
        )


def _trace(image: Image, width: float, contrast: float) -> _Trace:
    weights = ridges.derivative_weights(min(max(0.9 * width, 1.0), 6.0))
    box = max(2, round(1.6 * width))
    table, row_starts = ridges.scan_rows(image, box, weights, contrast, 1)
    shortest = max(12, round(4 * width))
    order, starts = ridges.link_rows(table, row_starts, 1, 1.0, max(6, round(3 * width)), shortest)
    chains = table[order]
    same = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    slope = _difference(chains[:, ridges.X], chains[:, ridges.Y], same)
    # The strength's own noise would enter the correction: smooth it along the line first.
    light = np.log(np.maximum(_smooth(chains[:, ridges.STRENGTH], same), 1e-6))
    gain = _difference(light, chains[:, ridges.Y], same)
    shift = np.clip(width**2 * gain * slope, -0.5 * width, 0.5 * width)
    chains[:, ridges.X] -= shift
    sigma = _deviation(chains, same)
    return _Trace(chains, starts, slope, sigma, np.abs(slope) <= _STEEPEST)


def _difference(values: Array, y: Array, same: Index) -> Array:
    """Derivative along each chain by a wide central difference, one-sided at the ends."""
    n = len(values)
    if n == 0:
        return np.zeros(0)
    span = _SLOPE_SPAN
    i = np.arange(n)
    lo, hi = np.maximum(i - span, 0), np.minimum(i + span, n - 1)
    for step in range(span):
        lo = np.where(same[lo] != same, np.minimum(i, i - span + step + 1), lo)
        hi = np.where(same[hi] != same, np.maximum(i, i + span - step - 1), hi)
    run = y[hi] - y[lo]
    slope: Array = (values[hi] - values[lo]) / np.where(run > 0, run, 1.0)
    return slope


def _smooth(values: Array, same: Index) -> Array:
    """Mean of seven neighbours along the chain."""
    total, count = values.copy(), np.ones(len(values))
    for k in (1, 2, 3):
        if len(values) <= k:
            break
        joined = same[k:] == same[:-k]
        total[k:] += np.where(joined, values[:-k], 0.0)
        total[:-k] += np.where(joined, values[k:], 0.0)
        count[k:] += joined
        count[:-k] += joined
    mean: Array = total / count
    return mean


def _deviation(chains: Array, same: Index) -> Array:
    """Standard deviation of each centre along its row.

    Second differences along the lines show the noise itself. The variance of a centre is
    (a + b·level)/strength², with read noise in a and shot noise in b: both come from the medians of a few
    classes of brightness.
    """
    x, strength, level = chains[:, ridges.X], chains[:, ridges.STRENGTH], chains[:, ridges.LEVEL]
    if len(x) < 3:
        return np.full(len(x), 0.1)
    joined = (same[2:] == same[:-2]) & (chains[2:, ridges.Y] - chains[:-2, ridges.Y] == 2.0)
    residual = (x[2:] - 2.0 * x[1:-1] + x[:-2])[joined] / _SECOND_DIFFERENCE
    scaled = (residual * strength[1:-1][joined]) ** 2
    grey = level[1:-1][joined]
    if len(scaled) < 64:
        return np.full(len(x), 0.1)
    ranks = np.array_split(np.argsort(grey), min(8, len(scaled) // 32))
    medians = np.array([np.median(scaled[r]) for r in ranks]) / _MEDIAN_OF_SQUARE
    greys = np.array([np.median(grey[r]) for r in ranks])
    b, a = np.polyfit(greys, medians, 1) if len(ranks) > 1 else (0.0, float(medians[0]))
    if b < 0.0 or a < 0.0:  # noise that does not grow with the light, or hardly any read noise
        a, b = (float(medians.mean()), 0.0) if b < 0.0 else (0.0, float((medians / greys).mean()))
    sigma: Array = np.sqrt(np.maximum(a + b * level, 1e-12)) / np.maximum(strength, 1e-9)
    return np.maximum(sigma, 0.005)
