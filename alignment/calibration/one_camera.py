"""What the methods that calibrate one camera from one set of points share: their protocol and its values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform

_FLAT = 1e-3


@dataclass(frozen=True)
class Known:
    """What is taken from data sheets by the methods that cannot find it; the others do not read it.

    Attributes
    ----------
    aspect
        p_x / p_y, the ratio of the scale factors in x and y (CV-M50 of the thesis: 116.589 / 120.248).
    centre
        Principal point, pixels; None for the middle of the image.
    """

    aspect: float = 1.0
    centre: tuple[float, float] | None = None

    def centre_in(self, size: tuple[int, int]) -> Array:
        """Principal point (2,), pixels, of an image of `size` (width, height)."""
        middle = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
        return np.array(self.centre or middle)


@dataclass(frozen=True, eq=False)
class CalibratedCamera:
    """One camera as a method found it.

    Attributes
    ----------
    camera
        Its model, and its pose in the frame of the points (`rig_from_camera` maps camera to that frame).
    residuals
        (N, 2) pixels, projected less seen.
    """

    camera: PosedCamera
    residuals: Array

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals, pixels."""
        return float(math.sqrt(np.square(self.residuals).sum(axis=1).mean()))


class OneCameraMethod(Protocol):
    """Calibrates one camera."""

    def __call__(
        self, points: Array, pixels: Array, size: tuple[int, int], known: Known | None = None
    ) -> CalibratedCamera:
        """Find the camera from points (N, 3), mm, and where it sees them (N, 2), pixels.

        Parameters
        ----------
        points
            (N, 3) in any right-handed frame, millimetres.
        pixels
            (N, 2).
        size
            Width and height of the image, pixels.
        known
            What the method takes from data sheets; None for the defaults.

        Raises
        ------
        DegenerateInputError
            When the points cannot determine what the method estimates; the message holds the cure.
        """
        ...


def checked(points: Array, pixels: Array, least: int) -> tuple[Array, Array]:
    """Return points (N, 3) and pixels (N, 2) as float64 when there are `least` finite pairs of them.

    Raises
    ------
    DegenerateInputError
        Otherwise.
    """
    points, pixels = np.asarray(points, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or pixels.shape != (len(points), 2):
        raise DegenerateInputError(
            field="points, pixels",
            expected="arrays of shapes (N, 3) and (N, 2)",
            seen=f"{points.shape} and {pixels.shape}",
        )
    if len(points) < least:
        raise DegenerateInputError(
            field="points",
            expected=f"at least {least} points",
            seen=str(len(points)),
            cure="Use a plate with more marks, or more positions of it.",
        )
    if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise DegenerateInputError(field="points, pixels", expected="finite numbers", seen="NaN or infinity")
    return points, pixels


def require_spread(points: Array, dimensions: int) -> None:
    """Refuse points (N, 3) that lie in a plane (`dimensions` 3) or on a line (2).

    Raises
    ------
    DegenerateInputError
        When the smallest of the asked extents is under a thousandth of the largest.
    """
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not extent[dimensions - 1] > _FLAT * extent[0]:
        shape = "in space, not in one plane" if dimensions == 3 else "in a plane, not on one line"
        cure = (
            "Add positions of the plate at other heights."
            if dimensions == 3
            else "Use marks of several rows."
        )
        raise DegenerateInputError(
            field="points",
            expected=f"points spread {shape}",
            seen=f"extents in the ratio {extent[dimensions - 1] / max(extent[0], 1e-300):.1e}",
            cure=cure,
        )


def camera_model(
    size: tuple[int, int], k: Array, model: str = "division", coefficients: tuple[float, ...] = (0.0,)
) -> CameraModel:
    """Camera model of a calibration matrix K (3, 3) with K₃₃ = 1."""
    fx, fy, cx, cy, skew = (float(value) for value in (k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1]))
    return CameraModel(*size, fx, fy, cx, cy, model, coefficients, skew)


def calibration_matrix(fx: float, fy: float, cx: float, cy: float) -> Array:
    """K (3, 3) without skew."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def posed(
    model: CameraModel, rotation: Array, translation: Array, points: Array, pixels: Array
) -> CalibratedCamera:
    """Build the result from a camera X_camera = R X + t.

    Parameters
    ----------
    model
        Intrinsic parameters.
    rotation, translation
        (3, 3) proper rotation R and (3,) t, millimetres.
    points, pixels
        (N, 3) millimetres and (N, 2) pixels, as seen.

    Raises
    ------
    DegenerateInputError
        When a point comes to lie behind the camera: the points do not fit any camera.
    """
    camera = PosedCamera(model, RigidTransform(rotation, translation).inverse())
    return CalibratedCamera(camera, camera.project(points) - pixels)


def nearest_rotation(matrix: Array) -> Array:
    """Proper rotation (3, 3) nearest to a matrix (3, 3) in the Frobenius norm."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
