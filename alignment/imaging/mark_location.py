"""Locates marks below the pixel: one interface, methods by name.

=================  ===================================================================================
``ellipse``        blurred ellipse fitted to the grey levels: the most exact, and the usual choice
``edge_ellipse``   ellipse through the sub-pixel points of an edge operator
``arctan_edges``   mean of edge points on rays, each from an arctangent's fit (thesis, 5.2, level 4)
``weight_point``   middle of the dark pixels under a threshold of known dark fraction (level 3)
``centroid``       middle of the pixels under a threshold of the histogram: a plain recogniser
=================  ===================================================================================
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from alignment.arrays import Array, Mask
from alignment.errors import DegenerateInputError
from alignment.imaging import mark_ellipse as fit
from alignment.imaging import mark_levels as levels
from alignment.imaging.edges import OPERATORS
from alignment.imaging.marks import Marks, RoughMarks, upper_factor
from alignment.imaging.thresholds import THRESHOLDS
from alignment.values import Image

_LEAST_SIGMA = 0.001  # pixels: what the model itself may be wrong by
_WORST_FIT = 0.2  # RMS residual over contrast of a mark that is believed
_SATURATED = 0.995  # of the largest grey level

METHODS = ("ellipse", "edge_ellipse", "arctan_edges", "weight_point", "centroid")


def locate_marks(
    image: Image,
    rough: RoughMarks,
    method: str = "ellipse",
    *,
    threshold: str = "otsu",
    operator: str = "canny",
) -> Marks:
    """Locate rough marks below the pixel.

    Parameters
    ----------
    image
        (height, width), one channel, 8 or 16 bit: the one in which the rough marks were found.
    rough
        From `find_marks`.
    method
        One of `METHODS`.
    threshold
        For ``centroid``: one of `alignment.imaging.thresholds.THRESHOLDS`.
    operator
        For ``edge_ellipse``: one of `alignment.imaging.edges.OPERATORS`.

    Raises
    ------
    DegenerateInputError
        When there is no such method, threshold or operator, or the image is not the one of the rough marks.
    """
    for field, value, known in (
        ("method", method, METHODS),
        ("threshold", threshold, tuple(THRESHOLDS)),
        ("operator", operator, OPERATORS),
    ):
        if value not in known:
            raise DegenerateInputError(field=field, expected=f"one of {', '.join(known)}", seen=f"'{value}'")
    if (image.shape[1], image.shape[0]) != rough.size:
        raise DegenerateInputError(
            field="image", expected=f"the {rough.size} image of the rough marks", seen=f"shape {image.shape}"
        )
    if method == "ellipse":
        return _by_ellipse(image, rough)
    dark = np.invert(image) if rough.bright else image
    noise = rough.exposure.noise

    def locate(k: int) -> levels.Located | None:
        centre, shape = rough.points[k], rough.shape[k]
        if method == "edge_ellipse":
            return levels.edge_ellipse(dark, centre, shape, operator)
        if method == "arctan_edges":
            return levels.arctan_rays(dark, centre, shape)
        if method == "weight_point":
            return levels.weight_point(dark, centre, shape, float(rough.hole[k]), noise)
        return levels.plain_centroid(dark, centre, shape, THRESHOLDS[threshold], noise)

    return _by_window(image, rough, method, locate)


def _by_ellipse(image: Image, rough: RoughMarks) -> Marks:
    """Fit a blurred ellipse to the grey levels: the most exact method (`alignment.imaging.mark_ellipse`)."""
    factor = upper_factor(rough.shape)
    start = fit.start_values(image, rough.points, factor, rough.hole)
    table = fit.fit_ellipses(image, start, rough.hollow, rough.exposure.noise)
    contrast = np.abs(table[:, fit.GROUND] - table[:, fit.MARK])
    good = (table[:, fit.STEPS] > 0) & (table[:, fit.RMS] < _WORST_FIT * contrast)
    good &= _whole(table[:, [fit.CX, fit.CY]], _shapes(table), rough.size)
    # What was taken for a dark mark must be dark: shading may fool the rough search, not the fit.
    good &= (table[:, fit.MARK] > table[:, fit.GROUND]) == rough.bright
    rows = np.flatnonzero(good)
    table = table[rows]
    covariance = table[:, [fit.VXX, fit.VXY, fit.VXY, fit.VYY]].reshape(-1, 2, 2)
    return Marks(
        points=table[:, [fit.CX, fit.CY]],
        covariance=covariance + _LEAST_SIGMA**2 * np.eye(2),
        shape=_shapes(table),
        hollow=rough.hollow[rows],
        blur=table[:, fit.BLUR],
        contrast=contrast[rows],
        rough=rows,
        saturated=_saturated(table, rough),
        size=rough.size,
        exposure=rough.exposure,
        method="ellipse",
    )


def _by_window(
    image: Image, rough: RoughMarks, method: str, locate: Callable[[int], levels.Located | None]
) -> Marks:
    """Collect the marks that a method of one window could locate."""
    located = [(k, one) for k in range(len(rough)) if (one := locate(k)) is not None]
    rows = np.array([k for k, _ in located], dtype=np.int64)
    points = np.array([one[0] for _, one in located]).reshape(-1, 2)
    shape = np.array([one[2] for _, one in located]).reshape(-1, 2, 2)
    # Levels as the fit of ellipses reads them to begin with.
    start = fit.start_values(image, rough.points[rows], upper_factor(rough.shape[rows]), rough.hole[rows])
    inside = _whole(points, shape, rough.size)
    return Marks(
        points=points[inside],
        covariance=np.array([one[1] for _, one in located]).reshape(-1, 2, 2)[inside],
        shape=shape[inside],
        hollow=rough.hollow[rows][inside],
        blur=start[inside, fit.BLUR],
        contrast=np.abs(start[:, fit.GROUND] - start[:, fit.MARK])[inside],
        rough=rows[inside],
        saturated=_saturated(start, rough)[inside],
        size=rough.size,
        exposure=rough.exposure,
        method=method,
    )


def _whole(points: Array, shape: Array, size: tuple[int, int]) -> Mask:
    """Tell which outlines lie in the image as a whole: where a part is missing, a method extrapolates."""
    reach = np.sqrt(np.diagonal(shape, axis1=1, axis2=2))
    inside: Mask = ((points - reach).min(axis=1) >= -0.5) & ((points + reach - size).max(axis=1) <= -0.5)
    return inside


def _saturated(table: Array, rough: RoughMarks) -> Mask:
    brightest = np.maximum(table[:, fit.GROUND], table[:, fit.MARK])
    result: Mask = brightest >= _SATURATED * rough.exposure.limit
    return result


def _shapes(table: Array) -> Array:
    u = np.zeros((len(table), 2, 2))
    u[:, 0, 0], u[:, 0, 1], u[:, 1, 1] = table[:, fit.A], table[:, fit.B], table[:, fit.C]
    return np.asarray(np.linalg.inv(np.swapaxes(u, 1, 2) @ u), dtype=np.float64)
