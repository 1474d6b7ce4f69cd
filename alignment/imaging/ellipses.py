"""Ellipses through points: directly, and by least distances with the covariance of the centre."""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.robust import deviation_of

_STEPS = 30


def _design(points: Array) -> tuple[Array, Array, Array]:
    """Normalised points (..., P, 2) with their mean and scale: a conic's terms must be of one size."""
    mean = points.mean(axis=-2, keepdims=True)
    scale = np.sqrt(((points - mean) ** 2).sum(axis=-1).mean(axis=-1))[..., None, None]
    return (points - mean) / scale, mean[..., 0, :], scale[..., 0, 0]


def conic_centres(points: Array) -> Array:
    """Centres (N, 2) of the conics a x² + b xy + c y² + d x + e y = 1 through points (N, P, 2), P ≥ 5."""
    local, mean, scale = _design(np.asarray(points, dtype=np.float64))
    x, y = local[..., 0], local[..., 1]
    design = np.stack([x * x, x * y, y * y, x, y], axis=-1)
    normal = np.swapaxes(design, -1, -2) @ design
    right = design.sum(axis=-2)[..., None]
    a, b, c, d, e = np.moveaxis(np.linalg.solve(normal, right)[..., 0], -1, 0)
    det = 4.0 * a * c - b * b
    centre = np.stack([(b * e - 2.0 * c * d) / det, (b * d - 2.0 * a * e) / det], axis=-1)
    result: Array = mean + scale[..., None] * centre
    return result


def fit_ellipse(points: Array) -> tuple[Array, Array]:
    """Ellipse with the least algebraic distance under the ellipse condition (Halír–Flusser).

    Parameters
    ----------
    points
        (P, 2), at least 6, pixels.

    Returns
    -------
    centre
        (2,) pixels.
    shape
        (2, 2) matrix S of the outline pᵀ S⁻¹ p = 1, pixels².

    Raises
    ------
    DegenerateInputError
        When no ellipse goes through the points.
    """
    points = np.asarray(points, dtype=np.float64)
    if len(points) < 6:
        raise DegenerateInputError(field="points", expected="at least 6 points", seen=str(len(points)))
    local, mean, scale = _design(points)
    x, y = local.T
    quadratic = np.column_stack([x * x, x * y, y * y])
    linear = np.column_stack([x, y, np.ones_like(x)])
    s1, s2, s3 = quadratic.T @ quadratic, quadratic.T @ linear, linear.T @ linear
    try:
        reduce = -np.linalg.solve(s3, s2.T)
    except np.linalg.LinAlgError as error:
        raise DegenerateInputError(
            field="points", expected="points around an ellipse", seen="a line"
        ) from error
    m = s1 + s2 @ reduce
    values, vectors = np.linalg.eig(np.array([m[2] / 2.0, -m[1], m[0] / 2.0]))
    vectors = np.real(vectors[:, np.abs(np.imag(values)) < 1e-9])
    condition = 4.0 * vectors[0] * vectors[2] - vectors[1] ** 2
    if not (condition > 0.0).any():
        raise DegenerateInputError(field="points", expected="points around an ellipse", seen="none fits")
    a, b, c = vectors[:, int(np.argmax(condition))]
    d, e, f = reduce @ np.array([a, b, c])
    matrix = np.array([[a, b / 2.0], [b / 2.0, c]])
    centre = -0.5 * np.linalg.solve(matrix, np.array([d, e]))
    level = float(centre @ matrix @ centre) - f
    shape = np.linalg.inv(matrix / level)
    if not np.linalg.eigvalsh(shape).min() > 0.0:
        raise DegenerateInputError(field="points", expected="points around an ellipse", seen="none fits")
    return mean + scale * centre, scale**2 * shape


def refine_ellipse(points: Array, centre: Array, shape: Array) -> tuple[Array, Array, Array, float]:
    """Ellipse with the least squares of the distances of first order, far points weighted down (Huber).

    Parameters
    ----------
    points
        (P, 2), at least 6, pixels.
    centre, shape
        To begin with, as `fit_ellipse` gives them.

    Returns
    -------
    centre, shape
        As `fit_ellipse`.
    covariance
        (2, 2) of the centre for independent points, pixels².
    rms
        Of the distances, pixels.
    """
    inverse = np.linalg.cholesky(np.linalg.inv(shape)).T
    p = np.array([centre[0], centre[1], inverse[0, 0], inverse[0, 1], inverse[1, 1]])
    rms = math.inf
    for _ in range(_STEPS):
        distance, j = _distances(points, p)
        # Two and a half deviations part the far from the near.
        clip = max(2.5 * deviation_of(distance), 1e-9)
        weight = np.minimum(1.0, clip / np.maximum(np.abs(distance), 1e-12))
        normal = j.T @ (weight[:, None] * j)
        step = np.linalg.solve(normal, -j.T @ (weight * distance))
        p = p + step
        rms = math.sqrt(float(weight @ distance**2) / max(len(points) - 5, 1))
        if np.abs(step[:2]).max() < 1e-6:
            break
    factor = np.array([[p[2], p[3]], [0.0, p[4]]])
    covariance = rms**2 * np.asarray(np.linalg.inv(normal)[:2, :2], np.float64)
    return p[:2], np.asarray(np.linalg.inv(factor.T @ factor), np.float64), covariance, rms


def _distances(points: Array, p: Array) -> tuple[Array, Array]:
    """Signed distances (P,) from an ellipse (centre, u11, u12, u22), outward, and their Jacobian (P, 5)."""
    x, y = (points - p[:2]).T
    a, b, c = p[2:]
    u0, u1 = a * x + b * y, c * y
    rho = np.hypot(u0, u1)
    w0, w1 = a * u0, b * u0 + c * u1
    # Near the outline d = (ρ − 1)/|∇ρ|; the gradient's own change counts for nothing there.
    slope = np.hypot(w0, w1) / rho
    j = np.column_stack([-w0, -w1, u0 * x, u0 * y, u1 * y]) / (rho * slope)[:, None]
    return (rho - 1.0) / slope, j
