"""Images of blurred ellipses whose grey levels are exact, so that the error of a mark method is its own.

A blurred ellipse, integrated over the squares of the pixels, is a product of known functions in the frequency
domain: J₁ for the ellipse, a Gaussian for the blur, two sincs for the pixel. Sampling folds frequencies above
one half per pixel back; the folded ones are added until the blur has extinguished them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import j1

from alignment.arrays import Array


@dataclass(frozen=True, eq=False)
class RenderedMark:
    """One mark: how it is drawn.

    Attributes
    ----------
    centre
        (x, y) pixels.
    shape
        (2, 2) matrix S of the outline pᵀ S⁻¹ p = 1, pixels².
    blur
        Standard deviation of the optical blur, pixels; at least 0.4.
    contrast
        Grey levels between ground and mark; positive for dark marks.
    ground
        Grey level of the ground at the centre.
    slope
        (2,) change of the light per pixel, relative to the centre's.
    hole
        Radius of a ring mark's middle over the mark's; 0 for a full mark.
    """

    centre: tuple[float, float]
    shape: Array
    blur: float = 1.0
    contrast: float = 150.0
    ground: float = 190.0
    slope: tuple[float, float] = (0.0, 0.0)
    hole: float = 0.0


def tilted_shape(radius: float, tilt: float, direction: float) -> Array:
    """Shape (2, 2) of a circle of a radius in pixels, tilted about an axis of a direction; radians."""
    axis = np.array([math.cos(direction), math.sin(direction)])
    across = np.array([-axis[1], axis[0]])
    shape: Array = radius**2 * (np.outer(axis, axis) + math.cos(tilt) ** 2 * np.outer(across, across))
    return shape


def coverage(mark: RenderedMark, size: int) -> Array:
    """Share of the mark in each pixel of a window (size, size), its top-left pixel at (0, 0).

    The window must be even and hold the whole mark with its blur: what leaves it comes in again on the other
    side.
    """
    share = _disc(mark.centre, mark.shape, mark.blur, size)
    if mark.hole > 0.0:
        share = share - _disc(mark.centre, mark.hole**2 * mark.shape, mark.blur, size)
    return share


def render_mark(mark: RenderedMark, size: int) -> Array:
    """Grey levels (size, size), not rounded, without noise."""
    y, x = np.mgrid[:size, :size].astype(np.float64)
    light = 1.0 + mark.slope[0] * (x - mark.centre[0]) + mark.slope[1] * (y - mark.centre[1])
    result: Array = light * (mark.ground - mark.contrast * coverage(mark, size))
    return result


def imaged_circle(image_from_plane: Array, centre: Array, radius: float) -> tuple[tuple[float, float], Array]:
    """Centre and shape of the ellipse that a homography makes of a circle in the plane."""
    x, y = centre
    circle = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [-x, -y, x * x + y * y - radius**2]])
    back = np.linalg.inv(image_from_plane)
    conic = back.T @ circle @ back
    matrix, linear = conic[:2, :2], conic[:2, 2]
    middle = -np.linalg.solve(matrix, linear)
    level = float(middle @ matrix @ middle) - conic[2, 2]
    return (float(middle[0]), float(middle[1])), np.asarray(np.linalg.inv(matrix / level), dtype=np.float64)


def render_plate(
    image_from_plane: Array,
    centres: Array,
    radius: float,
    holes: Array,
    size: tuple[int, int],
    *,
    blur: float = 1.0,
    ground: float = 190.0,
    mark: float = 40.0,
    slope: tuple[float, float] = (0.0, 0.0),
) -> Array:
    """Grey levels (height, width) of a plate with round marks, seen through a homography; not rounded, no
    noise.

    Parameters
    ----------
    image_from_plane
        (3, 3) homography, millimetres to pixels.
    centres
        (N, 2) of the marks, millimetres; those that the image does not show are left out.
    radius
        Of the marks, millimetres.
    holes
        (N,) radius of each mark's light middle over its own; 0 for full marks.
    size
        (width, height), pixels.
    blur, ground, mark
        Standard deviation of the blur, pixels; grey levels in the image's middle.
    slope
        Change of the ground over the image's width and height, relative to its level in the middle.
    """
    width, height = size
    y, x = np.mgrid[:height, :width].astype(np.float64)
    light = 1.0 + slope[0] * (x / width - 0.5) + slope[1] * (y / height - 0.5)
    share = np.zeros((height, width))
    for centre, hole in zip(centres, holes, strict=True):
        w = float(image_from_plane[2] @ [*centre, 1.0])
        if w * image_from_plane[2, 2] <= 0.0:
            continue
        middle, shape = imaged_circle(image_from_plane, centre, radius)
        reach = math.sqrt(max(float(np.linalg.eigvalsh(shape)[1]), 1.0)) + 6.0 * blur + 2.0
        window = 2 * math.ceil(reach)
        x0, y0 = math.floor(middle[0]) - window // 2, math.floor(middle[1]) - window // 2
        rows = slice(max(y0, 0), min(y0 + window, height))
        columns = slice(max(x0, 0), min(x0 + window, width))
        if rows.start >= rows.stop or columns.start >= columns.stop:
            continue
        local = RenderedMark((middle[0] - x0, middle[1] - y0), shape, blur, hole=float(hole))
        patch = coverage(local, window)
        share[rows, columns] += patch[
            rows.start - y0 : rows.stop - y0, columns.start - x0 : columns.stop - x0
        ]
    grey: Array = light * (ground + (mark - ground) * share)
    return grey


def as_camera(grey: Array, noise: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Image of 8 bit with noise of a standard deviation in grey levels."""
    noisy = grey + noise * rng.standard_normal(grey.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _disc(centre: tuple[float, float], shape: Array, blur: float, size: int) -> Array:
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :]
    # Beyond this frequency the blur leaves less than a billionth.
    highest = 1.05 / blur
    folds = max(0, math.ceil(highest - 0.5))
    spectrum = np.zeros((size, size // 2 + 1), dtype=np.complex128)
    for ky in range(-folds, folds + 1):
        for kx in range(-folds, folds + 1):
            y, x = np.broadcast_arrays(fy + ky, fx + kx)
            seen = np.hypot(x, y) < highest
            x, y = x[seen], y[seen]
            rho = 2.0 * math.pi * np.sqrt(shape[0, 0] * x**2 + 2.0 * shape[0, 1] * x * y + shape[1, 1] * y**2)
            disc = np.where(rho > 1e-9, 2.0 * j1(rho) / np.maximum(rho, 1e-9), 1.0)
            optics = np.exp(-2.0 * (math.pi * blur) ** 2 * (x**2 + y**2))
            place = np.exp(-2j * math.pi * (x * centre[0] + y * centre[1]))
            spectrum[seen] += disc * optics * np.sinc(x) * np.sinc(y) * place
    area = math.pi * math.sqrt(float(np.linalg.det(shape)))
    share: Array = area * np.fft.irfft2(spectrum, s=(size, size))
    return share
