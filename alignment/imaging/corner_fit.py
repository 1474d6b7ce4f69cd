"""Locates corners of squares below the pixel: a blurred saddle fitted to the grey levels around each.

The model is I(p) = L(p) (m + a E(d₁/σ) E(d₂/σ)) with the light L(p) = 1 + l·(p − c) that changes linearly,
the distances d of p from the two edges that cross in the corner c, the blur σ and E(x) = erf(x/√2). All of it
is even about the corner, as the blurred corner is, whatever the angle of its edges: what the product lacks of
an oblique corner does not move it. Neither does perspective: edges stay straight and cross where the corner
is. Gauss–Newton with damping over all corners at once, pixels far from the model weighted down (Huber).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from alignment.arrays import Array, Mask
from alignment.values import Image

_CX, _CY, _FIRST, _SECOND, _BLUR, _MIDDLE, _HEIGHT, _SLOPE_X, _SLOPE_Y = range(9)
_PARAMETERS = 9
_REACH = 0.7  # of the distance of the next edges
_LEAST_REACH, _MOST_REACH = 3.0, 15.0  # pixels
_FIRST_BLUR = 0.8
_STEPS = 15
_CONVERGED = 1e-3  # pixels that the corner still moves
_ENOUGH = 0.97  # of the corners that have converged: what is hidden never does
_SETTLED = 4  # steps after which the clipping of residuals no longer changes
_HUBER = 4.0
_LEAST_SIGMA = 0.001  # pixels: what the model itself may be wrong by
_WORST_FIT = 0.2  # RMS residual over contrast of a corner that is believed
_FARTHEST = 0.35  # of the shorter step, from where the corner was looked for
_AT_ONCE = 200
_DENSITY = np.sqrt(2.0 / np.pi)


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of squares located in one image.

    Attributes
    ----------
    points, covariance
        (N, 2) pixels, (N, 2, 2) pixels²: the image's noise and misfit.
    blur, contrast
        (N,) standard deviation of the edges' blur, pixels; grey levels between light and dark squares,
        negative where those between the steps' directions are dark.
    good
        (N,) whether the fit converged and is believed.
    """

    points: Array
    covariance: Array
    blur: Array
    contrast: Array
    good: Mask

    def only(self, rows: Mask) -> Corners:
        """Return some of the corners."""
        return Corners(*(getattr(self, name)[rows] for name in _FIELDS))


def locate_corners(
    image: Image, points: Array, steps: Array, noise: float, marker_margin: float | None = None
) -> Corners:
    """Locate corners of squares.

    Parameters
    ----------
    image
        (height, width), 8 or 16 bit.
    points
        (N, 2) where they are within a pixel or two.
    steps
        (N, 2, 2) pixels to the next corner along the columns and along the rows, as rows.
    noise
        Standard deviation of a pixel's noise, grey levels.
    marker_margin
        Where the light squares hold markers: how far the markers are from the squares' edges, shares of a
        square; the pixels there do not count.
    """
    parts = []
    for k in range(0, max(len(points), 1), _AT_ONCE):
        there, along = points[k : k + _AT_ONCE], steps[k : k + _AT_ONCE]
        first = _located(image, there, along, noise, marker_margin)
        # Once more from there: a window that is not about the corner would let what the model lacks move it.
        again = _located(
            image, np.where(first.good[:, None], first.points, there), along, noise, marker_margin
        )
        shorter = np.hypot(along[..., 0], along[..., 1]).min(axis=1)
        near = np.hypot(*(again.points - there).T) < _FARTHEST * shorter
        parts.append(replace(again, good=first.good & again.good & near))
    return joined_corners(*parts)


def joined_corners(*parts: Corners) -> Corners:
    """Return the corners of several."""
    return Corners(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))


_FIELDS = ("points", "covariance", "blur", "contrast", "good")


def _located(image: Image, points: Array, steps: Array, noise: float, margin: float | None) -> Corners:
    """Locate corners (N ≤ _AT_ONCE) at once; see `locate_corners`."""
    count = len(points)
    height, width = image.shape
    area = np.abs(steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0])
    lengths = np.hypot(steps[..., 0], steps[..., 1])
    reach = np.clip(_REACH * area / np.maximum(lengths.max(axis=1), 1e-9), _LEAST_REACH, _MOST_REACH)
    half = int(np.ceil(reach.max())) if count else 3
    v, u = np.mgrid[-half : half + 1, -half : half + 1]
    corner = np.rint(points).astype(np.int64)
    x = corner[:, 0, None] + u.ravel()
    y = corner[:, 1, None] + v.ravel()
    near = np.hypot(x - points[:, :1], y - points[:, 1:]) <= reach[:, None]
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    whole = (inside | ~near).all(axis=1)
    grey = image[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)].astype(np.float64)
    p = _start(points, steps)
    used = near & inside
    p = _with_levels(grey, x, y, used, p)
    if margin is not None:
        used &= ~_markers(x, y, points, steps, p[:, _HEIGHT], margin)
    weight = used.astype(np.float64)
    damping = np.full(count, 1e-4)
    cost = np.full(count, np.inf)
    best, moved = p.copy(), np.full(count, np.inf)
    for number in range(_STEPS):
        model, slopes = _model(x, y, p)
        residual = grey - model
        spread = np.sqrt((weight * residual**2).sum(axis=1) / np.maximum(weight.sum(axis=1), 1.0))
        if number < _SETTLED:
            far = _HUBER * np.maximum(spread, noise)[:, None]
            weight = used * np.minimum(1.0, far / np.maximum(np.abs(residual), 1e-12))
            cost[:] = np.inf
        now = (weight * residual**2).sum(axis=1)
        better = now <= cost * (1.0 + 1e-9)
        best[better], cost[better] = p[better], now[better]
        damping = np.where(better, np.maximum(damping * 0.2, 1e-7), damping * 10.0)
        if number > _SETTLED and np.mean(moved < _CONVERGED) >= _ENOUGH:
            break
        if not better.all():
            model, slopes = _model(x, y, best)
            residual = grey - model
        normal = np.swapaxes(slopes, 1, 2) @ (weight[..., None] * slopes)
        pull = np.einsum("npi,np->ni", slopes, weight * residual)
        step = _solved(normal, pull, damping)
        step[:, :2] = np.clip(step[:, :2], -1.0, 1.0)
        step[:, [_FIRST, _SECOND]] = np.clip(step[:, [_FIRST, _SECOND]], -0.2, 0.2)
        p = best + step
        p[:, _BLUR] = np.clip(p[:, _BLUR], 0.2, reach)
        moved = np.hypot(step[:, 0], step[:, 1])
    return _judged(best, (x, y, grey, weight), whole & (moved < 10.0 * _CONVERGED))


def _judged(p: Array, pixels: tuple[Array, Array, Array, Array], settled: Mask) -> Corners:
    """Covariance of the corners from the residual of every pixel (sandwich), and which are believed."""
    x, y, grey, weight = pixels
    model, slopes = _model(x, y, p)
    residual = grey - model
    normal = np.swapaxes(slopes, 1, 2) @ (weight[..., None] * slopes)
    inverse = np.linalg.pinv(normal + 1e-12 * np.eye(_PARAMETERS), hermitian=True)
    owed = np.einsum("nij,npj->npi", inverse[:, :2], slopes) * (weight * residual)[..., None]
    freedom = weight.sum(axis=1) / np.maximum(weight.sum(axis=1) - _PARAMETERS, 1.0)
    covariance = np.einsum("npi,npj->nij", owed, owed) * freedom[:, None, None]
    # Between both steps the distances from the edges have different signs.
    contrast = -2.0 * p[:, _HEIGHT]
    rms = np.sqrt((weight * residual**2).sum(axis=1) / np.maximum(weight.sum(axis=1), 1.0))
    good = settled & (weight.sum(axis=1) > 3 * _PARAMETERS) & (rms < _WORST_FIT * np.abs(contrast))
    good &= np.isfinite(covariance).all(axis=(1, 2))
    return Corners(
        p[:, :2], np.nan_to_num(covariance) + _LEAST_SIGMA**2 * np.eye(2), p[:, _BLUR], contrast, good
    )


def _start(points: Array, steps: Array) -> Array:
    p = np.zeros((len(points), _PARAMETERS))
    p[:, :2] = points
    p[:, _FIRST] = np.arctan2(steps[:, 0, 1], steps[:, 0, 0])
    p[:, _SECOND] = np.arctan2(steps[:, 1, 1], steps[:, 1, 0])
    p[:, _BLUR] = _FIRST_BLUR
    return p


def _with_levels(grey: Array, x: Array, y: Array, used: Mask, p: Array) -> Array:
    """Put in the levels of the squares, which the model has linearly."""
    out = p.copy()
    weight = used.astype(np.float64)
    total = np.maximum(weight.sum(axis=1), 1.0)
    product = _edges(x, y, p)[0]
    mean, mean_product = (weight * grey).sum(axis=1) / total, (weight * product).sum(axis=1) / total
    away = product - mean_product[:, None]
    spread = np.maximum((weight * away**2).sum(axis=1), 1e-9)
    out[:, _HEIGHT] = (weight * away * (grey - mean[:, None])).sum(axis=1) / spread
    out[:, _MIDDLE] = mean - out[:, _HEIGHT] * mean_product
    return out


def _edges(x: Array, y: Array, p: Array) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """E₁E₂ of every pixel, E₁, E₂, and the distances from both edges, and from the corner along x and y."""
    px, py = x - p[:, _CX, None], y - p[:, _CY, None]
    first, second, blur = p[:, _FIRST, None], p[:, _SECOND, None], p[:, _BLUR, None]
    d1 = -np.sin(first) * px + np.cos(first) * py
    d2 = -np.sin(second) * px + np.cos(second) * py
    e1, e2 = erf(d1 / blur / np.sqrt(2.0)), erf(d2 / blur / np.sqrt(2.0))
    return e1 * e2, e1, e2, d1, d2, px, py


def _model(x: Array, y: Array, p: Array) -> tuple[Array, Array]:
    """Grey levels (N, P) of the model and their derivatives (N, P, 9)."""
    product, e1, e2, d1, d2, px, py = _edges(x, y, p)
    first, second, blur = p[:, _FIRST, None], p[:, _SECOND, None], p[:, _BLUR, None]
    middle, height = p[:, _MIDDLE, None], p[:, _HEIGHT, None]
    light = 1.0 + p[:, _SLOPE_X, None] * px + p[:, _SLOPE_Y, None] * py
    level = middle + height * product
    # Derivatives of E by the distance.
    g1 = _DENSITY / blur * np.exp(-0.5 * (d1 / blur) ** 2) * e2 * height * light
    g2 = _DENSITY / blur * np.exp(-0.5 * (d2 / blur) ** 2) * e1 * height * light
    out = np.empty((*x.shape, _PARAMETERS))
    out[..., _CX] = np.sin(first) * g1 + np.sin(second) * g2 - level * p[:, _SLOPE_X, None]
    out[..., _CY] = -np.cos(first) * g1 - np.cos(second) * g2 - level * p[:, _SLOPE_Y, None]
    out[..., _FIRST] = g1 * (-np.cos(first) * px - np.sin(first) * py)
    out[..., _SECOND] = g2 * (-np.cos(second) * px - np.sin(second) * py)
    out[..., _BLUR] = -(g1 * d1 + g2 * d2) / blur
    out[..., _MIDDLE] = light
    out[..., _HEIGHT] = light * product
    out[..., _SLOPE_X] = level * px
    out[..., _SLOPE_Y] = level * py
    return light * level, out


def _solved(normal: Array, pull: Array, damping: Array) -> Array:
    """Damped steps; none where the pixels tell nothing."""
    diagonal = np.maximum(np.einsum("nii->ni", normal), 1e-9)
    scale = 1.0 / np.sqrt(diagonal)
    scaled = normal * scale[:, :, None] * scale[:, None, :]
    scaled += (damping[:, None] + 1e-9)[:, :, None] * np.eye(_PARAMETERS)
    step: Array = scale * np.linalg.solve(scaled, (pull * scale)[..., None])[..., 0]
    return step


def _markers(x: Array, y: Array, points: Array, steps: Array, height: Array, margin: float) -> Mask:
    """Tell which pixels may show a marker: those in light squares, a margin less the blur from the edges."""
    inverse = np.linalg.inv(np.swapaxes(steps, 1, 2))
    away = np.stack([x - points[:, :1], y - points[:, 1:]], axis=-1)
    place = np.einsum("nij,npj->npi", inverse, away)
    shorter = np.hypot(steps[..., 0], steps[..., 1]).min(axis=1)
    edge = np.maximum(margin - 2.0 / shorter, 0.0)[:, None]
    # Of the product of both distances the sign is that of −s t at the place (s, t), however the edges turn.
    light = -np.sign(place[..., 0]) * np.sign(place[..., 1]) * np.sign(height)[:, None] > 0
    found: Mask = light & (np.abs(place) > edge[..., None]).all(axis=-1)
    return found
