"""Images of light grids drawn from formulas, so that the true centres are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array


def slanted_grid(
    slope: float,
    *,
    sigma: float = 2.2,
    pitch: float = 90.0,
    amplitude: float = 120.0,
    background: float = 8.0,
    noise: float = 0.0,
    curvature: float = 0.0,
    seed: int = 0,
    size: tuple[int, int] = (480, 640),
    flat: bool = True,
) -> NDArray[np.uint8]:
    """Steep lines x = k·pitch + slope·y + curvature·y²/2 and flat ones y = k·pitch − slope·x.

    Cross profiles are Gaussian across the line.
    """
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    image = np.full(size, background)
    for k in range(-8, 16):
        centre = steep_centre(k, y, slope, pitch, curvature)
        local = slope + curvature * y
        across = (x - centre) / np.hypot(1.0, local)
        image += amplitude * np.exp(-0.5 * (across / sigma) ** 2)
        if flat:
            across = (y - (k * pitch - slope * x)) / np.hypot(1.0, slope)
            image = np.maximum(image, background + amplitude * np.exp(-0.5 * (across / sigma) ** 2))
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(image + noise * rng.standard_normal(size)), 0, 255).astype(np.uint8)


def steep_centre(k: int, y: Array, slope: float, pitch: float = 90.0, curvature: float = 0.0) -> Array:
    return k * pitch + slope * y + 0.5 * curvature * y**2


def steep_error(points: Array, slope: float, pitch: float = 90.0, curvature: float = 0.0) -> Array:
    """Distance of points from the nearest true steep line, across it, pixels."""
    x, y = points.T
    k = np.rint((x - slope * y - 0.5 * curvature * y**2) / pitch)
    return (x - (k * pitch + slope * y + 0.5 * curvature * y**2)) / np.hypot(1.0, slope + curvature * y)
