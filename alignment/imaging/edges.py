"""Edge operators by name: edge points between the pixels, with their direction and strength.

The operators of the first order (gradient, Sobel, Kirsch, Canny) mark the crests of a slope and those of the
second order (Marr–Hildreth, Shen–Castan) the zeros of a curvature; both are interpolated between pixels, so
that an operator's own bias and noise show and not the pixel grid's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy import ndimage
from skimage import filters as untyped_filters

from alignment.arrays import Array, Singles
from alignment.errors import DegenerateInputError
from alignment.values import Image

_filters: Any = untyped_filters  # without types of its own

_SMOOTHING = 1.4  # standard deviation of Canny's and Marr–Hildreth's Gaussian, pixels
_DECAY = 0.5  # Shen–Castan's exponential: weight of the next pixel
_STRONG = 0.4  # of the largest slope: an edge point
_WEAK = 0.2  # of the largest slope: a point of an edge that is strong elsewhere (Canny)


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Points on edges.

    Attributes
    ----------
    points
        (N, 2) pixels.
    normals
        (N, 2) unit directions towards the brighter side.
    strength
        (N,) slope of the grey levels across the edge, per pixel, as the operator smooths it.
    """

    points: Array
    normals: Array
    strength: Array


Slopes = Callable[[Singles], tuple[Singles, Singles]]


def _gradient(image: Singles) -> tuple[Singles, Singles]:
    kernel = np.array([[-0.5, 0.0, 0.5]], np.float32)
    return _filtered(image, kernel), _filtered(image, kernel.T)


def _sobel(image: Singles) -> tuple[Singles, Singles]:
    kernel = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]], np.float32) / 8.0
    return _filtered(image, kernel), _filtered(image, kernel.T)


def _kirsch(image: Singles) -> tuple[Singles, Singles]:
    """Slope along the strongest of eight compass masks; its direction is interpolated between them.

    The masks weigh their bright side more (5 against 3), which shifts a blurred edge to the dark side by
    about a tenth of a pixel.
    """
    ring = [(0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0)]
    gx, gy = np.zeros_like(image), np.zeros_like(image)
    strongest = np.full(image.shape, -np.inf, np.float32)
    for k in range(8):
        kernel = np.full((3, 3), -3.0, np.float32)
        kernel[1, 1] = 0.0
        for m in (-1, 0, 1):
            kernel[ring[(1 + k + m) % 8]] = 5.0
        # 24 = 5·3 + 3·3 is the response to a slope of one grey level per pixel along a row.
        response = _filtered(image, kernel / 24.0)
        y, x = ring[(1 + k) % 8]
        length = np.hypot(x - 1, y - 1)
        gx += response * np.float32((x - 1) / length)
        gy += response * np.float32((y - 1) / length)
        strongest = np.maximum(strongest, response)
    size = np.maximum(np.hypot(gx, gy), 1e-9)
    return (gx / size * strongest).astype(np.float32), (gy / size * strongest).astype(np.float32)


def _canny(image: Singles) -> tuple[Singles, Singles]:
    return _sobel(cv2.GaussianBlur(image, (0, 0), _SMOOTHING).astype(np.float32))


def _marr_hildreth(image: Singles) -> tuple[Singles, Singles, Singles]:
    smooth = cv2.GaussianBlur(image, (0, 0), _SMOOTHING).astype(np.float32)
    return (*_sobel(smooth), ndimage.laplace(smooth))


def _shen_castan(image: Singles) -> tuple[Singles, Singles, Singles]:
    """Symmetric exponential filter; smoothed minus original is its second derivative."""
    smooth = image
    for axis in (0, 1):
        forward = _exponential(smooth, axis)
        backward = np.flip(_exponential(np.flip(smooth, axis), axis), axis)
        # Both passes count the pixel itself.
        smooth = ((forward + backward - (1.0 - _DECAY) * smooth) / (1.0 + _DECAY)).astype(np.float32)
    return (*_sobel(smooth), image - smooth)


def _exponential(image: Singles, axis: int) -> Singles:
    """y[n] = (1 − b) x[n] + b y[n − 1] along an axis, as if the first pixel had gone on before."""
    moved = np.moveaxis(image, axis, 0)
    result = np.empty_like(moved)
    result[0] = moved[0]
    for n in range(1, len(moved)):
        result[n] = (1.0 - _DECAY) * moved[n] + _DECAY * result[n - 1]
    return np.moveaxis(result, 0, axis)


FIRST_ORDER: dict[str, Slopes] = {
    "gradient": _gradient,
    "sobel": _sobel,
    "kirsch": _kirsch,
    "canny": _canny,
}
SECOND_ORDER: dict[str, Callable[[Singles], tuple[Singles, Singles, Singles]]] = {
    "marr_hildreth": _marr_hildreth,
    "shen_castan": _shen_castan,
}
OPERATORS = (*FIRST_ORDER, *SECOND_ORDER)


def find_edges(image: Image, operator: str = "canny", strong: float = _STRONG) -> EdgePoints:
    """Edge points of an image.

    Parameters
    ----------
    image
        (height, width), one channel, 8 or 16 bit.
    operator
        One of `OPERATORS`.
    strong
        Least slope of an edge over the steepest one in the image.

    Raises
    ------
    DegenerateInputError
        When there is no such operator.
    """
    grey = image.astype(np.float32)
    if operator in FIRST_ORDER:
        gx, gy = FIRST_ORDER[operator](grey)
        return _crests(gx, gy, strong, linked=operator == "canny")
    if operator in SECOND_ORDER:
        return _zeros(*SECOND_ORDER[operator](grey), strong)
    raise DegenerateInputError(
        field="operator", expected=f"one of {', '.join(OPERATORS)}", seen=f"'{operator}'"
    )


def _filtered(image: Singles, kernel: Singles) -> Singles:
    return cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE).astype(np.float32)


def _crests(gx: Singles, gy: Singles, strong: float, linked: bool) -> EdgePoints:
    """Largest slopes along their own direction; the crest is the top of the parabola through three slopes."""
    slope = np.hypot(gx, gy)
    top = float(slope[2:-2, 2:-2].max(initial=0.0))
    if top <= 0.0:
        return _none()
    candidate = slope >= (min(_WEAK, strong) if linked else strong) * top
    candidate[:2] = candidate[-2:] = False
    candidate[:, :2] = candidate[:, -2:] = False
    y, x = np.nonzero(candidate)
    nx, ny = gx[y, x] / slope[y, x], gy[y, x] / slope[y, x]
    # One step along the larger component reaches the neighbouring row or column.
    reach = 1.0 / np.maximum(np.abs(nx), np.abs(ny))
    here = slope[y, x].astype(np.float64)
    ahead, behind = (
        ndimage.map_coordinates(slope, [y + s * reach * ny, x + s * reach * nx], order=1) for s in (1.0, -1.0)
    )
    crest = (here >= ahead) & (here > behind)
    if linked:
        thin = np.zeros_like(slope)
        thin[y[crest], x[crest]] = slope[y[crest], x[crest]]
        kept = _filters.apply_hysteresis_threshold(thin, _WEAK * top, strong * top)
        crest &= kept[y, x]
    curvature = np.maximum(2.0 * here - ahead - behind, 1e-12)
    shift = (0.5 * (ahead - behind) / curvature * reach)[crest]
    x, y, nx, ny = x[crest], y[crest], nx[crest], ny[crest]
    return EdgePoints(
        np.column_stack([x + shift * nx, y + shift * ny]),
        np.column_stack([nx, ny]).astype(np.float64),
        here[crest],
    )


def _zeros(gx: Singles, gy: Singles, curvature: Singles, strong: float) -> EdgePoints:
    """Changes of sign between neighbours in a row or column, interpolated, where the slope is large."""
    slope = np.hypot(gx, gy)
    top = float(slope[2:-2, 2:-2].max(initial=0.0))
    if top <= 0.0:
        return _none()
    parts = []
    for dy, dx in ((0, 1), (1, 0)):
        a = curvature[2 : -2 - dy, 2 : -2 - dx]
        b = curvature[2 + dy : curvature.shape[0] - 2, 2 + dx : curvature.shape[1] - 2]
        y, x = np.nonzero((a < 0.0) != (b < 0.0))
        share = a[y, x] / (a[y, x] - b[y, x])
        y, x = y + 2, x + 2
        near = (1.0 - share) * slope[y, x] + share * slope[y + dy, x + dx]
        keep = near >= strong * top
        y, x, share, near = y[keep], x[keep], share[keep], near[keep]
        ex = (1.0 - share) * gx[y, x] + share * gx[y + dy, x + dx]
        ey = (1.0 - share) * gy[y, x] + share * gy[y + dy, x + dx]
        length = np.maximum(np.hypot(ex, ey), 1e-12)
        parts.append(np.column_stack([x + share * dx, y + share * dy, ex / length, ey / length, near]))
    table = np.concatenate(parts).astype(np.float64)
    return EdgePoints(table[:, :2], table[:, 2:4], table[:, 4])


def _none() -> EdgePoints:
    return EdgePoints(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
