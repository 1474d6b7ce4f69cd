"""A camera of the thesis (CV-M50, CCIR) before a plate with 121 marks."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.geometry.cameras import Array, CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform

SIZE = (752, 582)
ASPECT = 116.589 / 120.248


def plate_points(*heights: float, pitch: float = 15.0) -> Array:
    """(121 · heights, 3)."""
    across = np.arange(-5, 6) * pitch
    x, y = np.meshgrid(across, across)
    return np.concatenate([np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)]) for z in heights])


def camera(
    tilt: float = 0.5,
    turn: float = 0.3,
    distance: float = 400.0,
    d: float = 0.0,
    centre: tuple[float, float] = (375.5, 290.5),
    aspect: float = ASPECT,
) -> PosedCamera:
    """Looks at the plate from +z, tilted about x and turned about its axis, radians."""
    fy = 1443.0
    model = CameraModel(*SIZE, aspect * fy, fy, *centre, "division", (d,))
    look = Rotation.from_euler("zyx", [turn, 0.1, np.pi - tilt]).as_matrix()
    return PosedCamera(model, RigidTransform(look, np.array([4.0, -7.0, distance])).inverse())
