"""Views of a plate computed without images: what the calibration's studies repeat hundreds of times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.calibration import (
    FLATNESS_SIGMA_MM,
    MARK_SIGMA_MM,
    STAGE_SIGMA_MM,
    CalibrationInput,
    CameraKey,
    PlateView,
    contour_shift,
)
from alignment.geometry import PosedCamera, RigidTransform
from alignment.imaging import MarkObservations, Plate

STAGES: tuple[tuple[float, float, float], ...] = (
    (0.0, 0.0, 0.0),
    (0.0, 0.0, -30.0),
    (0.0, 0.0, -15.0),
    (0.0, 0.0, 15.0),
    (0.0, 0.0, 30.0),
    (7.5, 4.0, 8.0),
    (-5.0, -7.5, -22.0),
)
"""Seven stage positions, millimetres."""
_MARGIN = 1.5  # mark radii that a mark keeps from the image's edge


@dataclass(frozen=True)
class ViewErrors:
    """Standard deviations of the simulated errors; marks and stage are evenly distributed, pixels normal."""

    pixel: float = 0.02
    mark_mm: float = MARK_SIGMA_MM
    flatness_mm: float = FLATNESS_SIGMA_MM
    stage_mm: float = STAGE_SIGMA_MM


@dataclass(frozen=True, eq=False)
class SimulatedViews:
    """Observations, and what was true: marks (M, 3) in the plate's frame, pose of the plate per view."""

    data: CalibrationInput
    marks: Array
    rig_from_plate: tuple[RigidTransform, ...]


def square_plate(
    half: int = 22, pitch_mm: float = 15.0, radius_mm: float = 4.0, errors: ViewErrors | None = None
) -> Plate:
    """Plate of (2 · half + 1)² full marks around the origin, with the uncertainties of `errors`."""
    errors = errors or ViewErrors()
    i, j = np.meshgrid(np.arange(-half, half + 1), np.arange(-half, half + 1))
    indices = np.column_stack([i.ravel(), j.ravel()]).astype(np.int64)
    points = np.column_stack([indices * pitch_mm, np.zeros(len(indices))])
    sigma = np.tile([errors.mark_mm, errors.mark_mm, errors.flatness_mm], (len(points), 1))
    return Plate(indices, points, sigma, radius_mm, np.zeros(len(points), bool), 0.0)


def observe(
    cameras: dict[CameraKey, PosedCamera],
    plate: Plate,
    stages: Sequence[tuple[float, float, float] | RigidTransform],
    rng: np.random.Generator,
    errors: ViewErrors | None = None,
    *,
    corrected: bool = True,
) -> SimulatedViews:
    """Observe a plate with random errors of marks, stage and pixels.

    Parameters
    ----------
    cameras
        True cameras.
    plate
        As it is described; its true marks differ by the errors.
    stages
        Per view, a nominal stage position or the true pose of a plate held by hand.
    rng
        Source of the errors.
    errors
        Their sizes.
    corrected
        False gives the centres of the imaged contours.
    """
    errors = errors or ViewErrors()
    half_width = math.sqrt(3.0)
    spread = np.array([errors.mark_mm, errors.mark_mm, errors.flatness_mm]) * half_width
    marks = plate.points + rng.uniform(-1.0, 1.0, plate.points.shape) * spread
    views, poses = [], []
    for number, stage in enumerate(stages, start=1):
        if isinstance(stage, RigidTransform):
            nominal, pose = None, stage
        else:
            nominal = np.array(stage)
            off = rng.uniform(-1.0, 1.0, 3) * errors.stage_mm * half_width
            pose = RigidTransform(np.eye(3), nominal + off)
        poses.append(pose)
        seen = {
            key: found
            for key, camera in cameras.items()
            if (found := _observe(camera, plate, marks, pose, rng, errors.pixel, corrected)) is not None
        }
        views.append(PlateView(f"view_{number}", nominal, seen))
    sizes = {key: (c.model.width, c.model.height) for key, c in cameras.items()}
    return SimulatedViews(
        CalibrationInput(plate, tuple(views), sizes, max(errors.stage_mm, 1e-6)), marks, tuple(poses)
    )


def _observe(
    camera: PosedCamera,
    plate: Plate,
    marks: Array,
    rig_from_plate: RigidTransform,
    rng: np.random.Generator,
    noise_px: float,
    corrected: bool,
) -> MarkObservations | None:
    camera_from_plate = camera.rig_from_camera.inverse() @ rig_from_plate
    inside = camera_from_plate.apply(marks)
    model = camera.model
    depth = np.maximum(inside[:, 2], 1e-9)
    # Pinhole first: far outside the field the lens model may fold.
    rough = inside[:, :2] / depth[:, None] * [model.fx, model.fy] + [model.cx, model.cy]
    size = np.array([model.width, model.height])
    near = (np.abs(rough - size / 2) < 0.7 * size).all(axis=1) & (inside[:, 2] > 1.0)
    rows = np.flatnonzero(near)
    if not len(rows):
        return None
    pixels = model.project(inside[rows])
    edge = _MARGIN * plate.mark_radius_mm * model.fx / inside[rows, 2]
    whole = (pixels > edge[:, None]).all(axis=1) & (pixels < size - 1 - edge[:, None]).all(axis=1)
    rows, pixels = rows[whole].astype(np.int64), pixels[whole]
    if len(rows) < 4:
        return None
    if not corrected:
        x, y = camera_from_plate.rotation[:, 0].copy(), camera_from_plate.rotation[:, 1].copy()
        packed = model.packed()
        shifts = [contour_shift(inside[r], x, y, plate.mark_radius_mm, packed)[:2] for r in rows]
        pixels = pixels + np.array(shifts)
    pixels = pixels + noise_px * rng.standard_normal(pixels.shape)
    covariance = np.tile(max(noise_px, 1e-3) ** 2 * np.eye(2), (len(rows), 1, 1))
    return MarkObservations(rows, pixels, covariance, corrected)
