"""Start values of the joint adjustment from the plate's views alone; nothing is known of the cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from alignment.calibration.faugeras import calibrate_faugeras
from alignment.calibration.observations import CalibrationInput, CameraKey
from alignment.calibration.planar import calibrate_planar, pose_of_plane
from alignment.calibration.problem import MODELS
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.projective import fit_homography
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import MarkObservations, Plate

_LEAST_MARKS = 8
_FLAT = 0.01


@dataclass(frozen=True, eq=False)
class Start:
    """Start values: every camera in the rig frame, and the pose of the plate in every view."""

    cameras: dict[CameraKey, PosedCamera]
    rig_from_plate: tuple[RigidTransform, ...]


def converted(model: CameraModel, name: str) -> CameraModel:
    """Camera of a kind named in `MODELS` that is the given one as far as that kind can be."""
    kind, count, estimated = MODELS[name]
    old = model.coefficients
    coefficients: tuple[float, ...]
    if kind == "division":
        # To first order in ρ², undistorted = distorted / (1 + d ρ²) is distorted = undistorted (1 + d ρ²).
        coefficients = (old[0],)
    elif model.model == "division":
        coefficients = (old[0], *(0.0,) * (count - 1))
    else:
        padded = (*old, *(0.0,) * 14)
        coefficients = tuple(padded[c] if c in estimated else 0.0 for c in range(count))
    return replace(model, model=kind, coefficients=coefficients)


def with_model(start: Start, name: str) -> Start:
    """Return the start with every camera of the kind `name` of `MODELS`."""
    cameras = {key: replace(c, model=converted(c.model, name)) for key, c in start.cameras.items()}
    return replace(start, cameras=cameras)


def start_values(data: CalibrationInput, model: str) -> Start:
    """Find start values.

    A camera that saw the plate at known stage positions in more than one plane is found linearly; the others
    from the homographies of their views. Poses of hand-held views follow from a camera that sees them, and
    cameras from views, until all are known; without any stage the first view is the rig frame.

    Raises
    ------
    DegenerateInputError
        When a camera saw too little, or no chain of views links it to the others.
    """
    cameras: dict[CameraKey, PosedCamera] = {}
    models: dict[CameraKey, CameraModel] = {}
    for key in data.cameras:
        camera = _from_stage(data, key)
        if camera is None:
            models[key] = _from_views(data, key)
        else:
            cameras[key], models[key] = camera, camera.model
    views: list[RigidTransform | None] = [
        None if v.stage_mm is None else RigidTransform(np.eye(3), v.stage_mm) for v in data.views
    ]
    if all(v is None for v in views):
        views[0] = RigidTransform.identity()
    _propagate(data, models, cameras, views)
    poses = [pose for pose in views if pose is not None]
    start = Start({key: cameras[key] for key in data.cameras}, tuple(poses))
    return with_model(start, model)


def _from_stage(data: CalibrationInput, key: CameraKey) -> PosedCamera | None:
    """Camera from marks at known places of more than one plane; None where there are none."""
    points, pixels = [], []
    for view in data.views:
        seen = view.observations.get(key)
        if seen is not None and view.stage_mm is not None:
            points.append(data.plate.points[seen.marks] + view.stage_mm)
            pixels.append(seen.pixels)
    if not points:
        return None
    x = np.concatenate(points)
    if len(x) < 2 * _LEAST_MARKS:
        return None
    extent = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    if extent[2] < _FLAT * extent[0]:
        return None
    try:
        return calibrate_faugeras(x, np.concatenate(pixels), data.sizes[key]).camera
    except DegenerateInputError as error:
        raise _about(key, error) from error


def _from_views(data: CalibrationInput, key: CameraKey) -> CameraModel:
    """Lens of a camera from the homographies of its views, each counted once per orientation."""
    views = []
    for view in data.views:
        seen = view.observations.get(key)
        if seen is not None and len(seen.marks) >= _LEAST_MARKS:
            views.append((data.plate.points[seen.marks][:, :2], seen.pixels))
    try:
        return calibrate_planar(views, data.sizes[key]).model
    except DegenerateInputError as error:
        raise _about(key, error) from error


def _about(key: CameraKey, error: DegenerateInputError) -> DegenerateInputError:
    return DegenerateInputError(
        field=f"{key[0]} {key[1]}: {error.field}",
        expected=error.expected,
        seen=error.seen,
        cure=error.cure,
        remedy=error.remedy,
    )


def _propagate(
    data: CalibrationInput,
    models: dict[CameraKey, CameraModel],
    cameras: dict[CameraKey, PosedCamera],
    views: list[RigidTransform | None],
) -> None:
    """Fill in the poses that follow from known ones, camera by view by camera."""
    relative = {
        (v, key): camera_from_plate(data.plate, models[key], seen)
        for v, view in enumerate(data.views)
        for key, seen in view.observations.items()
        if len(seen.marks) >= _LEAST_MARKS
    }
    progress = True
    while progress:
        progress = False
        for (v, key), pose in relative.items():
            rig_from_plate = views[v]
            if key in cameras and rig_from_plate is None:
                views[v] = cameras[key].rig_from_camera @ pose
                progress = True
            elif key not in cameras and rig_from_plate is not None:
                cameras[key] = PosedCamera(models[key], rig_from_plate @ pose.inverse())
                progress = True
    lost = [f"camera {key[0]} {key[1]}" for key in data.cameras if key not in cameras]
    lost += [f"view {view.name}" for view, pose in zip(data.views, views, strict=True) if pose is None]
    if lost:
        raise DegenerateInputError(
            field="views",
            expected="views that link every camera to the others",
            seen=f"no link to {', '.join(lost)}",
            cure="Add views in which these cameras and others see the plate together.",
        )


def camera_from_plate(plate: Plate, model: CameraModel, seen: MarkObservations) -> RigidTransform:
    """Pose of the plate in a camera of known lens from one view, linearly.

    Raises
    ------
    DegenerateInputError
        For fewer than four marks, or marks on one line.
    """
    undistorted = model.normalise(seen.pixels)
    homography = fit_homography(plate.points[seen.marks][:, :2], undistorted)
    return pose_of_plane(np.eye(3), homography)
