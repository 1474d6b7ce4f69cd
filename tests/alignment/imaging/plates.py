"""Plates and views of them for the tests of marks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.imaging.plate import Plate
from station.studies.rendered_marks import as_camera, render_plate

SIZE = (640, 480)
PITCH = 15.0
RADIUS = 4.0
HOLE = 1.5
L_SHAPE = ((0, 0), (2, 0), (0, 1))


def plate(
    columns: int = 11, rows: int = 9, rings: tuple[tuple[int, int], ...] = ((5, 4), (7, 4), (5, 5))
) -> Plate:
    indices = np.array([(i, j) for j in range(rows) for i in range(columns)])
    count = len(indices)
    return Plate(
        indices=indices,
        points=np.column_stack([indices * PITCH, np.zeros(count)]),
        sigma_mm=np.full((count, 3), 0.006),
        mark_radius_mm=RADIUS,
        hollow=np.array([tuple(index) in rings for index in indices.tolist()]),
        hollow_radius_mm=HOLE,
    )


def view(
    target: tuple[float, float] = (75.0, 60.0),
    *,
    tilt: float = 0.0,
    azimuth: float = 0.0,
    turn: float = 0.0,
    distance: float = 300.0,
    focal: float = 900.0,
    size: tuple[int, int] = SIZE,
) -> Array:
    """Homography of a pinhole camera that looks at a place of the plate from its marked side; degrees."""
    t, a, r = np.radians([tilt, azimuth, turn])
    back = np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
    up = np.array([-np.sin(r), np.cos(r), 0.0])
    forward = -back
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    rotation = np.array([right, down, forward])
    centre = np.array([*target, 0.0]) + distance * back
    k = np.array([[focal, 0.0, size[0] / 2 + 3.7], [0.0, focal, size[1] / 2 - 2.2], [0.0, 0.0, 1.0]])
    return np.asarray(k @ np.column_stack([rotation[:, 0], rotation[:, 1], -rotation @ centre]))


def photograph(
    seen: Plate,
    homography: Array,
    *,
    size: tuple[int, int] = SIZE,
    blur: float = 0.9,
    noise: float = 2.0,
    without: tuple[tuple[int, int], ...] = (),
    slope: tuple[float, float] = (0.0, 0.0),
    seed: int = 0,
    **levels: float,
) -> NDArray[np.uint8]:
    shown = np.array([tuple(index) not in without for index in seen.indices.tolist()])
    holes = np.where(seen.hollow, seen.hollow_radius_mm / seen.mark_radius_mm, 0.0)
    grey = render_plate(
        homography,
        seen.points[shown, :2],
        seen.mark_radius_mm,
        holes[shown],
        size,
        blur=blur,
        slope=slope,
        **levels,
    )
    return as_camera(grey, noise, np.random.default_rng(seed))


def project(homography: Array, points: Array) -> Array:
    image = np.column_stack([points[:, :2], np.ones(len(points))]) @ homography.T
    return np.asarray(image[:, :2] / image[:, 2:])
