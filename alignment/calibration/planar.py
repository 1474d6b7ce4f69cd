"""A camera from views of a plane whose poses are unknown: start values from homographies (Zhang, 2000)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.calibration.one_camera import (
    Known,
    calibration_matrix,
    camera_model,
    nearest_rotation,
)
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel
from alignment.geometry.projective import camera_of_absolute_conic, fit_homography, null_vector
from alignment.geometry.transforms import RigidTransform

_TILT = "Tilt the plate by 20° to 40°, about different axes, between the views."


@dataclass(frozen=True, eq=False)
class PlanarCalibration:
    """A camera, and the pose of the plate in each view.

    Attributes
    ----------
    model
        Brown–Conrady with k1, k2.
    camera_from_plate
        One per view.
    residuals
        One (N, 2) per view, pixels, projected less seen.
    """

    model: CameraModel
    camera_from_plate: tuple[RigidTransform, ...]
    residuals: tuple[Array, ...]

    @property
    def rms_px(self) -> float:
        """Root mean square length of all residuals, pixels."""
        return float(np.sqrt(np.square(np.concatenate(self.residuals)).sum(axis=1).mean()))


def _constraint(h: Array, i: int, j: int) -> Array:
    """Row (5,) of hᵢᵀ ω hⱼ in (ω₁₁, ω₂₂, ω₁₃, ω₂₃, ω₃₃), ω the image of the absolute conic, no skew."""
    a, b = h[:, i], h[:, j]
    return np.array(
        [a[0] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[2]]
    )


def _intrinsics(homographies: Sequence[Array], size: tuple[int, int], known: Known) -> Array:
    """K (3, 3) from homographies; centre and aspect are believed where only one view is there."""
    cx, cy = known.centre_in(size)
    scale = float(max(size))
    to_unit = np.array([[1 / scale, 0, -cx / scale], [0, 1 / scale, -cy / scale], [0, 0, 1]])
    unit = [to_unit @ h for h in homographies]
    unit = [h / np.linalg.norm(h[:, :2], axis=0).mean() for h in unit]
    rows = np.array(
        [row for h in unit for row in (_constraint(h, 0, 1), _constraint(h, 0, 0) - _constraint(h, 1, 1))]
    )
    if len(homographies) == 1:
        # ω = diag(1/a², 1, f²) up to scale: two equations in f².
        of_one, of_f2 = rows[:, 0] / known.aspect**2 + rows[:, 1], rows[:, 4]
        f2 = -(of_f2 @ of_one) / max(of_f2 @ of_f2, 1e-300)
        if not np.square(of_f2).sum() > 1e-8 or f2 <= 0:
            raise DegenerateInputError(
                field="views",
                expected="a plate that is slanted to the image",
                seen="one parallel to it, which leaves focal length and distance open",
                cure=_TILT,
            )
        k = calibration_matrix(known.aspect * np.sqrt(f2), np.sqrt(f2), 0.0, 0.0)
    else:
        (w11, w22, w13, w23, w33), uniqueness = null_vector(rows)
        omega = np.array([[w11, 0.0, w13], [0.0, w22, w23], [w13, w23, w33]])
        try:
            k = camera_of_absolute_conic(omega)
        except DegenerateInputError:
            uniqueness = 0.0
        if uniqueness < 1e-7:
            raise DegenerateInputError(
                field="views",
                expected="views of the plate from different directions",
                seen="views too alike to separate focal length and distance",
                cure=_TILT,
            )
    return np.asarray(np.linalg.inv(to_unit) @ k)


def pose_of_plane(k: Array, homography: Array) -> RigidTransform:
    """Pose camera_from_plate of a plane z = 0 in front of a camera K (3, 3), from its homography (3, 3).

    Raises
    ------
    DegenerateInputError
        When the plane is seen from its edge.
    """
    m = np.linalg.solve(k, homography)
    length = np.linalg.norm(m[:, :2], axis=0).mean()
    if not length > 0:
        raise DegenerateInputError(field="homography", expected="a plane seen from its face", seen="its edge")
    m = m / (length if m[2, 2] > 0 else -length)
    rotation = nearest_rotation(np.column_stack([m[:, 0], m[:, 1], np.cross(m[:, 0], m[:, 1])]))
    return RigidTransform(rotation, m[:, 2])


def calibrate_planar(
    views: Sequence[tuple[Array, Array]], size: tuple[int, int], known: Known | None = None
) -> PlanarCalibration:
    """Find camera and plate poses from views of one plane; a start for the joint adjustment.

    Parameters
    ----------
    views
        Per view, points (N, 2) of the plate in its plane, millimetres, and pixels (N, 2). One view suffices
        where `known` is right; two give focal lengths and centre.
    size
        Width and height of the images, pixels.
    known
        Believed where there is one view only.

    Raises
    ------
    DegenerateInputError
        When no view is given, or the views are parallel to the image or to each other.
    """
    if not views:
        raise DegenerateInputError(field="views", expected="at least one view of the plate", seen="none")
    homographies = [fit_homography(points, pixels) for points, pixels in views]
    k = _intrinsics(homographies, size, known or Known())
    poses = tuple(pose_of_plane(k, h) for h in homographies)

    # k1, k2 linear: what the pinhole camera leaves, along the radius (Zhang's equation 13).
    rows, left = [], []
    for (points, pixels), pose in zip(views, poses, strict=True):
        in_camera = pose.apply(np.column_stack([points, np.zeros(len(points))]))
        if (in_camera[:, 2] <= 0).any():
            raise DegenerateInputError(
                field="views", expected="a plate in front of the camera", seen="points behind it", cure=_TILT
            )
        xy = in_camera[:, :2] / in_camera[:, 2:]
        r2 = np.square(xy).sum(axis=1)
        radial = xy * np.diag(k)[:2]
        rows.append(np.column_stack([(radial * r2[:, None]).ravel(), (radial * r2[:, None] ** 2).ravel()]))
        left.append((pixels - radial - k[:2, 2]).ravel())
    k1, k2 = np.linalg.lstsq(np.concatenate(rows), np.concatenate(left), rcond=None)[0]
    model = camera_model(size, k, "brown", (float(k1), float(k2), 0.0, 0.0, 0.0))
    residuals = tuple(
        model.project(pose.apply(np.column_stack([points, np.zeros(len(points))]))) - pixels
        for (points, pixels), pose in zip(views, poses, strict=True)
    )
    return PlanarCalibration(model, poses, residuals)
