"""Thresholds that part dark marks from their bright ground, by name.

Each takes an image (height, width) of 8 or 16 bit and gives the grey level below which a pixel is dark: a
number, or for a regional method an array (height, width). A flat image has no threshold: the answer is then
its own grey level, so that nothing is below it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from skimage import filters as untyped_filters

from alignment.arrays import Array
from alignment.robust import deviation_of
from alignment.values import Image

_filters: Any = untyped_filters  # without types of its own
Threshold = Callable[[Image], "float | Array"]

_BINS = 256
_FULL_MARK = math.pi / 16.0  # dark fraction of a window four radii wide around a full mark
_REGION = 64  # side of a Chow–Kaneko window, pixels; windows overlap by half
_LEAST_CLASS = 0.02  # share of a class in a bimodal window
_SEPARATION = 3.0  # distance of its peaks over the sum of their deviations


def histogram(image: Image) -> tuple[Array, Array]:
    """Counts and middles (256,) of the grey levels of an image between its lowest and highest."""
    low, high = float(image.min()), float(image.max())
    counts, edges = np.histogram(image, bins=_BINS, range=(low - 0.5, max(high, low + 1.0) + 0.5))
    return counts.astype(np.float64), 0.5 * (edges[:-1] + edges[1:])


def p_tile(image: Image, fraction: float = _FULL_MARK) -> float:
    """Level that the given fraction of the pixels is below, between grey levels where it needs to be."""
    if image.min() == image.max():
        return float(image.min())
    values = np.bincount(image.ravel())
    total = np.cumsum(values)
    target = fraction * image.size
    level = int(np.searchsorted(total, target))
    below = float(total[level - 1]) if level else 0.0
    return level + (target - below) / max(float(values[level]), 1.0)


def valley(image: Image) -> float:
    """Lowest place between the two peaks of the histogram, smoothed until it has two (Prewitt–Mendelsohn)."""
    try:
        return float(_filters.threshold_minimum(hist=histogram(image)))
    except RuntimeError:  # scikit-image's word for a histogram that never shows two peaks
        return otsu(image)


def edge_pixels(image: Image) -> float:
    """Mean grey level at the edges, weighted by their steepness (Katz): half-way between both sides."""
    smooth = image.astype(np.float32)
    gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0)
    gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    # The square keeps the noise of large even parts from drowning the few edge pixels.
    weight = (gx * gx + gy * gy).astype(np.float64)
    total = float(weight.sum())
    return float((weight * image).sum()) / total if total > 0.0 else float(image.min())


def iterative(image: Image) -> float:
    """Middle of the means of both sides, repeated until it stays (Ridler–Calvard)."""
    if image.min() == image.max():
        return float(image.min())
    return float(_filters.threshold_isodata(hist=histogram(image)))


def otsu(image: Image) -> float:
    """Largest variance between the classes (Otsu)."""
    if image.min() == image.max():
        return float(image.min())
    level, _ = cv2.threshold(image, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return float(level) + 1.0  # OpenCV counts the level itself as dark


def entropy(image: Image) -> float:
    """Largest sum of the entropies of both sides' histograms (Kapur, Sahoo, Wong)."""
    counts, middles = histogram(image)
    p = counts / counts.sum()
    plogp = np.where(p > 0.0, p * np.log(np.maximum(p, 1e-300)), 0.0)
    below, entropy_below = np.cumsum(p)[:-1], -np.cumsum(plogp)[:-1]
    above, entropy_above = 1.0 - below, -plogp.sum() - entropy_below
    valid = (below > 1e-9) & (above > 1e-9)
    if not valid.any():
        return float(image.min())
    b, a = np.where(valid, below, 1.0), np.where(valid, above, 1.0)
    total = np.log(b) + entropy_below / b + np.log(a) + entropy_above / a
    k = int(np.argmax(np.where(valid, total, -np.inf)))
    return float(0.5 * (middles[k] + middles[k + 1]))


def minimum_error(image: Image) -> float:
    """Least error of two normal distributions fitted to both sides (Kittler–Illingworth)."""
    counts, middles = histogram(image)
    p = counts / counts.sum()
    below = np.cumsum(p)[:-1]
    above = 1.0 - below
    first, second = np.cumsum(p * middles)[:-1], np.cumsum(p * middles**2)[:-1]
    rest_first, rest_second = (p * middles).sum() - first, (p * middles**2).sum() - second
    valid = (below > 1e-4) & (above > 1e-4)
    if not valid.any():
        return float(image.min())
    b, a = np.where(valid, below, 0.5), np.where(valid, above, 0.5)
    step = float(middles[1] - middles[0])
    # One grey level has the variance step²/12: without it a class of a single level would win with −∞.
    var_b = np.maximum(second / b - (first / b) ** 2, 0.0) + step**2 / 12.0
    var_a = np.maximum(rest_second / a - (rest_first / a) ** 2, 0.0) + step**2 / 12.0
    cost = b * np.log(var_b) + a * np.log(var_a) - 2.0 * (b * np.log(b) + a * np.log(a))
    k = int(np.argmin(np.where(valid, cost, np.inf)))
    return float(0.5 * (middles[k] + middles[k + 1]))


def chow_kaneko(image: Image) -> Array:
    """Regional threshold (height, width): windows with two classes vote, the others follow (Chow–Kaneko).

    In half-overlapping windows two normal distributions are fitted to the histogram; where it is bimodal
    their crossing is the window's threshold. Windows without one take it from their neighbours, weighted by
    the distance, and every pixel from the windows around it, bilinearly.
    """
    height, width = image.shape
    rows = max(1, math.ceil(height / (_REGION // 2)) - 1)
    columns = max(1, math.ceil(width / (_REGION // 2)) - 1)
    y = np.linspace(_REGION // 2, max(height - _REGION // 2, _REGION // 2), rows)
    x = np.linspace(_REGION // 2, max(width - _REGION // 2, _REGION // 2), columns)
    levels = np.full((rows, columns), np.nan)
    for r, cy in enumerate(y.astype(int)):
        for c, cx in enumerate(x.astype(int)):
            window = image[
                max(cy - _REGION // 2, 0) : cy + _REGION // 2, max(cx - _REGION // 2, 0) : cx + _REGION // 2
            ]
            levels[r, c] = _bimodal_threshold(window)
    known = np.isfinite(levels)
    if not known.any():
        return np.full(image.shape, otsu(image))
    gy, gx = np.mgrid[:rows, :columns]
    ky, kx = np.nonzero(known)
    distance = np.hypot(gy[..., None] - ky, gx[..., None] - kx)
    weight = 1.0 / np.maximum(distance, 0.5) ** 2
    spread = (weight * levels[known]).sum(axis=2) / weight.sum(axis=2)
    filled = np.where(known, levels, spread).astype(np.float32)
    map_y = np.interp(np.arange(height), y, np.arange(rows)).astype(np.float32)
    map_x = np.interp(np.arange(width), x, np.arange(columns)).astype(np.float32)
    grid_x, grid_y = np.meshgrid(map_x, map_y)
    result = cv2.remap(filled, grid_x, grid_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(result, dtype=np.float64)


def _bimodal_threshold(window: Image) -> float:
    """Crossing of two normal distributions fitted to the window's histogram; NaN when it is not bimodal.

    Medians and absolute deviations fit the two peaks alone: the pixels on blurred edges between them would
    widen the smaller one.
    """
    dark = window < otsu(window)
    classes = [window[dark].astype(np.float64), window[~dark].astype(np.float64)]
    weights = np.array([len(values) for values in classes])
    if weights.min() < _LEAST_CLASS * window.size:
        return math.nan
    means = np.array([np.median(values) for values in classes])
    spreads = np.array([deviation_of(values - m) for values, m in zip(classes, means, strict=True)])
    spreads = np.maximum(spreads, 0.5)
    if means[1] - means[0] < _SEPARATION * spreads.sum():
        return math.nan
    grid = np.linspace(means[0], means[1], 65)
    density = np.log(weights / spreads) - 0.5 * ((grid[:, None] - means) / spreads) ** 2
    return float(grid[np.argmin(np.abs(density[:, 0] - density[:, 1]))])


THRESHOLDS: dict[str, Threshold] = {
    "p_tile": p_tile,
    "valley": valley,
    "edge_pixels": edge_pixels,
    "iterative": iterative,
    "otsu": otsu,
    "entropy": entropy,
    "minimum_error": minimum_error,
    "chow_kaneko": chow_kaneko,
}
