"""How a camera sees a plane: a homography, and a lens that bends its edges.

The lens is a division model of two terms about the image's middle (Fitzgibbon 2001), good to fractions of a
pitch for barrels and cushions of any lens that a plate is measured through; it serves to know which mark is
which, not to measure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from alignment.arrays import Array, Mask

_FEWEST_BENT = 12  # marks that tell a lens from a tilt
_STIFF = 0.01  # of the pitch, by which a lens of 1 must improve places where they hardly tell of it
_LEAST, _MOST = -0.45, 2.0  # of a term, at the image's corner; together they must not fold it
_HALF_PIXEL = 0.5


@dataclass(frozen=True, eq=False)
class PlaneView:
    """Map between a plane and an image.

    Attributes
    ----------
    plane_from_ideal
        (3, 3) homography from pixels of a lens without distortion to the plane.
    bend
        (2,) terms of the division model, in powers of the squared distance from the middle over that of the
        corner.
    middle, corner
        (2,) middle of the image, pixels; distance of its corner from there.
    """

    plane_from_ideal: Array
    bend: Array
    middle: Array
    corner: float

    @classmethod
    def fit(cls, plane: Array, pixels: Array, size: tuple[int, int]) -> PlaneView:
        """Fit to points of the plane (N, 2), N ≥ 4, and their pixels (N, 2); `size` is (width, height)."""
        middle = 0.5 * (np.array(size, dtype=np.float64) - 1.0)
        corner = math.hypot(*middle)

        def view(bend: Array) -> PlaneView:
            ideal = _unbent(pixels, bend, middle, corner)
            return cls(fit_grid_homography(ideal, plane), bend, middle, corner)

        def away(bend: Array) -> Array:
            places = map_points(view(bend).plane_from_ideal, _unbent(pixels, bend, middle, corner))
            return np.concatenate([np.nan_to_num(places - plane, nan=1e3).ravel(), _STIFF * bend])

        none = np.zeros(2)
        if len(plane) < _FEWEST_BENT:
            return view(none)
        found = least_squares(away, none, bounds=(_LEAST, _MOST), diff_step=np.full(2, 1e-4), max_nfev=30)
        return view(np.asarray(found.x, dtype=np.float64))

    def to_plane(self, pixels: Array) -> Array:
        """Points (N, 2) of the plane that pixels (N, 2) show."""
        return map_points(self.plane_from_ideal, _unbent(pixels, self.bend, self.middle, self.corner))

    def with_areas(self, pixels: Array) -> tuple[Array, Array]:
        """Points (N, 2) of the plane at pixels (N, 2), and pixels² of a unit of its area (N,)."""
        right, up = np.array([_HALF_PIXEL, 0.0]), np.array([0.0, _HALF_PIXEL])
        x = self.to_plane(pixels + right) - self.to_plane(pixels - right)
        y = self.to_plane(pixels + up) - self.to_plane(pixels - up)
        shrunk = np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0])
        areas: Array = 1.0 / np.maximum(np.nan_to_num(shrunk, nan=1e12), 1e-12)
        return self.to_plane(pixels), areas

    def to_pixels(self, plane: Array) -> tuple[Array, Mask]:
        """Pixels (N, 2) of points (N, 2) of the plane, and which of them the lens can show (N,)."""
        ideal_from_plane = np.asarray(np.linalg.inv(self.plane_from_ideal), dtype=np.float64)
        ideal = map_points(ideal_from_plane, plane) - self.middle
        far = np.hypot(*ideal.T) / self.corner
        # Bent radii grow with ideal ones up to the corner, or to where the lens would fold.
        steps = np.linspace(0.0, 1.5, 301)
        unbent = steps / self._scale(steps)
        rising = np.diff(unbent, prepend=-1.0) > 0.0
        last = len(steps) - 1 if rising.all() else int(np.argmin(rising)) - 1
        shown: Mask = np.isfinite(far) & (far < unbent[last])
        bent = np.interp(far, unbent[: last + 1], steps[: last + 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels: Array = self.middle + ideal * np.where(far > 0.0, bent / far, 1.0)[:, None]
        return pixels, shown

    def unbent(self, pixels: Array) -> Array:
        """Where a lens without distortion would show what pixels (N, 2) show."""
        return _unbent(pixels, self.bend, self.middle, self.corner)

    def depths(self, plane: Array) -> Array:
        """Depth (N,) of points (N, 2) of the plane, up to a factor; the sign tells before from behind."""
        ideal_from_plane = np.linalg.inv(self.plane_from_ideal)
        result: Array = plane @ ideal_from_plane[2, :2] + ideal_from_plane[2, 2]
        return result

    def _scale(self, radius: Array) -> Array:
        square = np.square(radius)
        result: Array = 1.0 + self.bend[0] * square + self.bend[1] * square**2
        return np.where(result > 0.0, result, np.nan)


def _unbent(pixels: Array, bend: Array, middle: Array, corner: float) -> Array:
    away = pixels - middle
    square = np.square(away / corner).sum(axis=1)
    scale = 1.0 + bend[0] * square + bend[1] * square**2
    result: Array = middle + away / np.where(scale > 0.0, scale, np.nan)[:, None]
    return result


def fit_grid_homography(plane: Array, pixels: Array) -> Array:
    """Homography (3, 3) from points of a plane (N, 2) to pixels (N, 2), N ≥ 4, all points with equal weight.

    Direct linear transformation in normalised coordinates (Hartley), once repeated with the weights that make
    its residuals pixels.
    """
    a, normal_a = _normalised(plane)
    b, normal_b = _normalised(pixels)
    weight = np.ones(len(a))
    for _ in range(2):
        x, y, u, v = *a.T, *b.T
        zero, one = np.zeros_like(x), np.ones_like(x)
        design = np.concatenate(
            [
                weight[:, None] * np.column_stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u]),
                weight[:, None] * np.column_stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v]),
            ]
        )
        h = np.linalg.svd(design, full_matrices=False)[2][-1].reshape(3, 3)
        weight = 1.0 / np.maximum(np.abs(a @ h[2, :2] + h[2, 2]), 1e-9)
        weight /= weight.max()
    result: Array = np.linalg.inv(normal_b) @ h @ normal_a
    return result / np.linalg.norm(result)


def _normalised(points: Array) -> tuple[Array, Array]:
    mean = points.mean(axis=0)
    scale = math.sqrt(2.0) / max(float(np.sqrt(((points - mean) ** 2).sum(axis=1).mean())), 1e-12)
    matrix = np.array([[scale, 0.0, -scale * mean[0]], [0.0, scale, -scale * mean[1]], [0.0, 0.0, 1.0]])
    return (points - mean) * scale, matrix


def map_points(homography: Array, points: Array) -> Array:
    """Images (N, 2) of points (N, 2)."""
    image = points @ homography[:, :2].T + homography[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        result: Array = image[:, :2] / image[:, 2:]
    return result
