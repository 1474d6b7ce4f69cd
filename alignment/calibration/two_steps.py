"""The thesis's way to calibrate a rig: each head alone, then the poses of the heads from one large plate.

Plate and stage are taken for exact, and what the heads have in common is not used, so it falls behind the
joint adjustment by what plate and stage err; it stays as a method to compare with.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array, Index
from alignment.calibration.adjustment import AdjustmentSettings, adjust
from alignment.calibration.observations import CalibrationInput, CameraKey, PlateView
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.projective import require_finite
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import MarkObservations
from alignment.stereo.triangulation import triangulate

_LEAST_MARKS = 8


@dataclass(frozen=True, eq=False)
class HeadsThenPoses:
    """Cameras in the rig frame, and the RMS length of the residuals of all heads, pixels."""

    cameras: dict[CameraKey, PosedCamera]
    rms_px: float


def heads_then_poses(data: CalibrationInput, settings: AdjustmentSettings | None = None) -> HeadsThenPoses:
    """Calibrate each head alone, then fit its triangulated marks to the plate at the reference position.

    Parameters
    ----------
    data
        Observations; the stage view nearest to 0 is the reference in which every head sees the large plate.
    settings
        Lens model; None for the defaults.

    Raises
    ------
    DegenerateInputError
        When no view has a stage position, a head lacks a camera, or does not see the reference.
    """
    on_stage = [view for view in data.views if view.stage_mm is not None]
    if not on_stage:
        raise DegenerateInputError(
            field="views",
            expected="a view at a known stage position, to put the heads into one frame",
            seen="views held by hand only",
            cure="Use the joint adjustment.",
        )
    reference = min(on_stage, key=_from_origin)
    cameras: dict[CameraKey, PosedCamera] = {}
    squares = count = 0.0
    for head in data.heads:
        alone = adjust(_of_head(data, head), settings)
        squares += float(alone.weights @ np.square(alone.residuals).sum(axis=1))
        count += float(alone.weights.sum())
        pose = _pose(data, head, alone.cameras, reference)
        for key, camera in alone.cameras.items():
            cameras[key] = replace(camera, rig_from_camera=pose @ camera.rig_from_camera)
    return HeadsThenPoses({key: cameras[key] for key in data.cameras}, float(np.sqrt(squares / count)))


def _from_origin(view: PlateView) -> float:
    return np.inf if view.stage_mm is None else float(np.linalg.norm(view.stage_mm))


def _of_head(data: CalibrationInput, head: str) -> CalibrationInput:
    """Observations of one head, with an exact plate and stage."""
    views = tuple(
        replace(view, observations={k: v for k, v in view.observations.items() if k[0] == head})
        for view in data.views
    )
    return replace(
        data,
        plate=replace(data.plate, sigma_mm=np.zeros_like(data.plate.sigma_mm)),
        views=tuple(view for view in views if view.observations),
        sizes={key: size for key, size in data.sizes.items() if key[0] == head},
        stage_sigma_mm=0.0,
    )


def _pose(
    data: CalibrationInput, head: str, cameras: dict[CameraKey, PosedCamera], reference: PlateView
) -> RigidTransform:
    """rig_from_head: the rigid motion that brings the head's triangulated marks onto the plate."""
    left, right = (reference.observations.get((head, side)) for side in ("left", "right"))
    common = np.intersect1d(left.marks, right.marks) if left and right else np.zeros(0, np.int64)
    if left is None or right is None or len(common) < _LEAST_MARKS:
        raise DegenerateInputError(
            field=f"views[{reference.name}].{head}",
            expected=f"at least {_LEAST_MARKS} marks that both cameras of the head see",
            seen=str(len(common)),
            cure="Add the view in which all heads see the large plate.",
        )
    pixels = [_pixels_of(seen, common) for seen in (left, right)]
    points, _ = triangulate(cameras[head, "left"], cameras[head, "right"], *pixels)
    assert reference.stage_mm is not None
    return rigid_fit(points, data.plate.points[common] + reference.stage_mm)


def _pixels_of(seen: MarkObservations, marks: Index) -> Array:
    order = np.argsort(seen.marks)
    out: Array = seen.pixels[order[np.searchsorted(seen.marks, marks, sorter=order)]]
    return out


def rigid_fit(source: Array, target: Array) -> RigidTransform:
    """target_from_source of least squares for corresponding points (N, 3) (Umeyama 1991, without scale).

    Raises
    ------
    DegenerateInputError
        For fewer than three points, points that are not finite, or all on one line.
    """
    for points in (source, target):
        require_finite(points, 3)
    a, b = source.mean(axis=0), target.mean(axis=0)
    u, values, vt = np.linalg.svd((target - b).T @ (source - a))
    if values[1] <= 1e-12 * values[0]:
        raise DegenerateInputError(
            field="points", expected="points that span a plane", seen="a line or a point"
        )
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return RigidTransform(rotation, b - rotation @ a)
