"""Plates without ring marks, and rendered images of them, for the tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import Plate
from sensors.formats.pattern_plate import PatternPlateFile
from sensors.formats.plate import describe_plate
from sensors.simulation.optics import Optics
from sensors.simulation.plate import PlateLight, PlateLook, plate_image

SIZE = (640, 480)
CIRCLES = {"pattern": "circles", "mark_diameter_mm": 8.0, "orientation": "upright"}
PATTERNS: dict[str, dict[str, Any]] = {
    "circles": CIRCLES,
    "white": CIRCLES | {"bright": True},
    "wide": CIRCLES | {"pitch_x_mm": 20.0},
    "almost_square": CIRCLES | {"pitch_x_mm": 16.5},
    "asymmetric": {
        "pattern": "asymmetric_circles", "mark_diameter_mm": 8.0, "pitch_x_mm": 10.0, "pitch_y_mm": 10.0,
        "columns": (0, 13), "rows": (0, 10),
    },
    "chessboard": {"pattern": "chessboard", "columns": (0, 8), "rows": (0, 7)},
    "charuco": {"pattern": "charuco", "dictionary": "DICT_4X4_100", "marker_mm": 11.0},
}  # fmt: skip


def board(name: str, **fields: Any) -> Plate:
    """A plate of one of the patterns, 9 × 8 places unless told otherwise."""
    described = {
        "schema": "truewheel.pattern-plate/1", "name": name.replace("_", "-"),
        "columns": (0, 8), "rows": (0, 7),
        "pitch_x_mm": 15.0, "pitch_y_mm": 15.0,
    }  # fmt: skip
    return describe_plate(PatternPlateFile.model_validate(described | PATTERNS[name] | fields)).plate


def looking_at(
    plate: Plate,
    *,
    tilt: float = 0.0,
    azimuth: float = 0.0,
    turn: float = 0.0,
    distance: float = 300.0,
    aside: tuple[float, float] = (0.0, 0.0),
    bend: float = -0.05,
    size: tuple[int, int] = SIZE,
) -> PosedCamera:
    """A camera before the plate's middle, shifted aside by millimetres; angles in degrees.

    With no turn the plate's y axis points up in the image.
    """
    t, a, r = np.radians([tilt, azimuth, turn])
    back = np.array([math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), math.cos(t)])
    up = np.array([-math.sin(r), math.cos(r), 0.0])
    right = np.cross(-back, up)
    right /= np.linalg.norm(right)
    down = np.cross(-back, right)
    low, high = plate.points.min(axis=0), plate.points.max(axis=0)
    target = (low + high) / 2 + np.array([*aside, 0.0])
    model = CameraModel(
        *size, 900.0, 900.0, size[0] / 2 + 3.7, size[1] / 2 - 2.2, "brown", (bend, 0.0, 0.0, 0.0, 0.0)
    )
    rotation = np.column_stack([right, down, -back])
    return PosedCamera(model, RigidTransform(rotation, target + distance * back))


def image_of(
    plate: Plate, camera: PosedCamera, *, seed: int | None = 0, blur: float = 0.7, **look: Any
) -> NDArray[np.uint8]:
    """What the camera sees of the plate."""
    light = PlateLight(look.pop("top", (0.0, 0.0)), look.pop("fall_off", 0.1))
    rng = None if seed is None else np.random.default_rng(seed)
    pose, optics = RigidTransform.identity(), Optics(blur_px=blur)
    image = plate_image(plate, camera, pose, rng, look=PlateLook(**look), optics=optics, light=light)
    assert image.dtype == np.uint8
    return image  # type: ignore[return-value]


def projected(plate: Plate, camera: PosedCamera) -> Array:
    """Where the camera sees every mark."""
    return camera.project(plate.points)
