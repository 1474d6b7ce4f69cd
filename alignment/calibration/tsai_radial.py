"""Tsai with radial distortion (1987): the linear solution, then all parameters together.

Tsai's distortion is undistorted = distorted · (1 + κ ρ²), ρ the distorted radius in focal lengths; his κ₁ in
1/mm² on the sensor is κ/f² with f in millimetres. `kappa_of` and `brown_from_kappa` translate it.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from alignment.arrays import Array
from alignment.calibration.lenz import calibrate_lenz
from alignment.calibration.one_camera import (
    CalibratedCamera,
    Known,
    calibration_matrix,
    camera_model,
    checked,
    posed,
)
from alignment.calibration.tsai import calibrate_tsai
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel
from alignment.geometry.transforms import RigidTransform

_RADII = np.linspace(0.02, 1.0, 50)


def brown_from_kappa(kappa: float, radius: float) -> tuple[float, float, float, float, float]:
    """Coefficients (k1, k2, 0, 0, k3) of Brown's model nearest to Tsai's κ out to a distorted radius.

    Parameters
    ----------
    kappa
        κ, focal lengths⁻².
    radius
        Largest distorted radius that counts, focal lengths.

    Raises
    ------
    DegenerateInputError
        When the distortion folds within that radius.
    """
    distorted = radius * _RADII
    undistorted = distorted * (1.0 + kappa * distorted**2)
    if 1.0 + 3.0 * kappa * radius**2 <= 0:
        raise DegenerateInputError(
            field="kappa",
            expected=f"a distortion that can be inverted out to radius {radius:.3g}",
            seen=f"{kappa:.3g}",
        )
    powers = undistorted[:, None] ** (3, 5, 7)
    scale = powers[-1]
    k1, k2, k3 = np.linalg.lstsq(powers / scale, distorted - undistorted, rcond=None)[0] / scale
    return float(k1), float(k2), 0.0, 0.0, float(k3)


def kappa_of(model: CameraModel) -> float:
    """Tsai's κ nearest to the radial distortion of any camera model, evenly over its image."""
    axes = [
        (np.linspace(0, n - 1, 41) - c) / f
        for n, c, f in ((model.width, model.cx, model.fx), (model.height, model.cy, model.fy))
    ]
    distorted = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    undistorted = model.normalise(distorted * (model.fx, model.fy) + (model.cx, model.cy))
    basis = distorted * np.square(distorted).sum(axis=1, keepdims=True)
    return float((basis * (undistorted - distorted)).sum() / np.square(basis).sum())


def calibrate_tsai_radial(
    points: Array, pixels: Array, size: tuple[int, int], known: Known | None = None
) -> CalibratedCamera:
    """Find a camera with one radial coefficient; see `OneCameraMethod`.

    Points in space: `calibrate_tsai` starts with `known`, and nothing of it is believed in the end. Points of
    one height: `calibrate_lenz` starts, and aspect and centre stay as `known` says. Minimises the distance of
    undistorted pixels from projected points.

    Raises
    ------
    DegenerateInputError
        As the methods that start, and for fewer than 11 points.
    """
    points, pixels = checked(points, pixels, 11)
    flat = float(np.ptp(points[:, 2])) < 1e-3 * float(np.ptp(points[:, :2], axis=0).max())
    start = (calibrate_lenz if flat else calibrate_tsai)(points, pixels, size, known).camera
    pose, k = start.rig_from_camera.inverse(), start.model
    distance = pose.translation[2]
    # Rotation, translation, focal length, κ, then what one plane does not give: aspect, centre.
    first = np.array([*pose.rotvec(), *pose.translation, k.fy, 0.0, k.fx / k.fy, k.cx, k.cy])
    sizes = np.array([1.0, 1.0, 1.0, distance, distance, distance, k.fy, 10.0, 1.0, k.fy, k.fy])
    free = slice(0, 8 if flat else 11)

    def camera(q: Array) -> tuple[RigidTransform, Array, Array]:
        whole = np.concatenate([q, first[len(q) :]])
        focal = np.array([whole[6] * whole[8], whole[6]])
        return RigidTransform.from_rotvec(whole[:3], whole[3:6]), focal, whole[9:]

    def residuals(q: Array) -> Array:
        camera_from_points, focal, centre = camera(q)
        x = camera_from_points.apply(points)
        distorted = (pixels - centre) / focal
        undistorted = distorted * (1.0 + q[7] * np.square(distorted).sum(axis=1, keepdims=True))
        return np.asarray((focal * (undistorted - x[:, :2] / x[:, 2:])).ravel())

    t = 1e-14
    found = least_squares(residuals, first[free], x_scale=sizes[free], xtol=t, ftol=t, gtol=t).x
    camera_from_points, focal, centre = camera(found)
    radius = float(np.sqrt(np.square((pixels - centre) / focal).sum(axis=1).max()))
    coefficients = brown_from_kappa(float(found[7]), radius)
    model = camera_model(size, calibration_matrix(*focal, *centre), "brown", coefficients)
    return posed(model, camera_from_points.rotation, camera_from_points.translation, points, pixels)
