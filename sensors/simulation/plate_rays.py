"""Where the pixels of a camera look on a plane, and how much of a pixel lies on one side of an edge."""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array
from alignment.geometry import CameraModel
from alignment.kernels import njit

PIXEL_PARTS = 2
"""Parts that a pixel is split into, along each side."""
RAY_CELL = 4
"""Pixels between the nodes at which a camera's rays are computed; between them they are interpolated."""
EDGE_REACH = 0.75
"""Pixels: an edge beyond half the diagonal does not cross the pixel."""
_GRAZING = 1e-6  # rays that are flatter than this pass the plate


def ray_nodes(model: CameraModel) -> Array:
    """Normalised coordinates (·, ·, 2) that the corners of the cells look along."""
    rows, columns = -(-model.height // RAY_CELL), -(-model.width // RAY_CELL)
    v, u = np.mgrid[0 : rows + 1, 0 : columns + 1] * float(RAY_CELL) - 0.5
    nodes: Array = model.normalise(np.column_stack([u.ravel(), v.ravel()])).reshape(rows + 1, columns + 1, 2)
    return nodes


@njit(cache=True, nogil=True, error_model="numpy")
def covered(distance: float, gx: float, gy: float) -> float:
    """Share of a unit square on the inner side of a straight edge.

    Parameters
    ----------
    distance
        Of the edge from the square's centre, positive when the centre is inside, in sides of the square.
    gx, gy
        Direction across the edge, any length and sign.
    """
    length = max(math.sqrt(gx * gx + gy * gy), 1e-12)
    a, b = abs(gx) / length, abs(gy) / length
    if a < b:
        a, b = b, a
    if abs(distance) >= (a + b) / 2:
        return 1.0 if distance > 0 else 0.0
    if abs(distance) <= (a - b) / 2:
        return 0.5 + distance / a
    corner = ((a + b) / 2 - abs(distance)) ** 2 / (2 * a * b)
    return 1.0 - corner if distance > 0 else corner


@njit(cache=True, nogil=True, error_model="numpy")
def place(
    u: float, v: float, nodes: Array, rotation: Array, origin: Array
) -> tuple[bool, float, float, float, float, float, float, float, float]:
    """Where a pixel looks, through the cell of `nodes` that it lies in.

    Returns whether it looks towards the plate; x and y in the plate; how much x and y grow with the height
    over the plate; the derivatives dx/du, dy/du, dx/dv, dy/dv.
    """
    column, row = int((u + 0.5) / RAY_CELL), int((v + 0.5) / RAY_CELL)
    fu, fv = (u + 0.5) / RAY_CELL - column, (v + 0.5) / RAY_CELL - row
    x = y = xu = yu = xv = yv = 0.0
    for corner in range(4):
        right, below = corner % 2, corner // 2
        wu, wv = fu if right else 1.0 - fu, fv if below else 1.0 - fv
        su, sv = (2.0 * right - 1.0) * wv / RAY_CELL, (2.0 * below - 1.0) * wu / RAY_CELL
        nx, ny = nodes[row + below, column + right, 0], nodes[row + below, column + right, 1]
        x += wu * wv * nx
        y += wu * wv * ny
        xu += su * nx
        yu += su * ny
        xv += sv * nx
        yv += sv * ny
    dz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
    sx = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]) / dz
    sy = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]) / dz
    along = -origin[2] / dz
    dzu = rotation[2, 0] * xu + rotation[2, 1] * yu
    dzv = rotation[2, 0] * xv + rotation[2, 1] * yv
    return (
        dz < -_GRAZING,
        origin[0] - origin[2] * sx,
        origin[1] - origin[2] * sy,
        sx,
        sy,
        along * (rotation[0, 0] * xu + rotation[0, 1] * yu - sx * dzu),
        along * (rotation[1, 0] * xu + rotation[1, 1] * yu - sy * dzu),
        along * (rotation[0, 0] * xv + rotation[0, 1] * yv - sx * dzv),
        along * (rotation[1, 0] * xv + rotation[1, 1] * yv - sy * dzv),
    )
