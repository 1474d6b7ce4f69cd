"""A calibration in force against a new plate session: does every camera still stand where it says?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from alignment.arrays import Array
from alignment.calibration.contour import contour_shift
from alignment.calibration.observations import CalibrationInput, CameraKey, cameras_of_rig
from alignment.calibration.prediction import NominalWheel, angle_sensitivity, camera_derivatives
from alignment.calibration.scale import common_scale, scale_sentence
from alignment.calibration.start import camera_from_plate
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform, cross_matrices
from alignment.imaging.plate import MarkObservations
from alignment.values import RigCalibration

_POSE = 6
_STEPS = 4
_LEVER_MM = 400.0  # a typical distance: it makes turns and shifts of the unknowns comparable
_FAR = 4.0  # standard deviations at which an observation keeps half its weight
_FEWEST_MARKS = 6
_DISAGREE = ("calibration disagree in every camera", "with what plate the calibration in force was made")
_CENTRE_SIGMA_MM = 0.3  # of a camera's centre by one view; a turn goes for a shift


@dataclass(frozen=True)
class CameraChange:
    """What one camera says of the calibration in force.

    Attributes
    ----------
    camera
        Head and side.
    marks
        Observations, over all views.
    rms_px
        RMS length of the residuals with the calibration in force, pixels.
    shift_px
        Mean residual (u, v), projected less observed: how far the image has moved.
    turn
        Rotation about the camera's own axes that explains the marks, radians.
    move_mm
        Shift of the camera's centre, rig frame, that explains them; turn and shift are all but
        interchangeable, only their sum is well known.
    rms_left_px
        RMS that remains with it; more than noise tells of a lens that changed.
    """

    camera: CameraKey
    marks: int
    rms_px: float
    shift_px: tuple[float, float]
    turn: tuple[float, float, float]
    move_mm: tuple[float, float, float]
    rms_left_px: float


@dataclass(frozen=True)
class PlateCheck:
    """A calibration in force against a plate session.

    Attributes
    ----------
    cameras
        Each camera that saw marks.
    rms_px, rms_left_px
        As `CameraChange`, over all cameras.
    camber_change, toe_change
        What camber and toe would change by, radians, if the cameras' poses were corrected.
    scale
        How many times too far apart the plate's marks are stated, where one factor explains what all cameras
        see; else None.
    scale_reason
        The sentence that says so, and names the pitch that would fit; None without.
    """

    cameras: tuple[CameraChange, ...]
    rms_px: float
    rms_left_px: float
    camber_change: float
    toe_change: float
    scale: float | None = None
    scale_reason: str | None = None


class _Sight(NamedTuple):
    """One camera in one view: its number, the view's, where the marks are in the plate, and in the image."""

    camera: int
    view: int
    marks: Array
    pixels: Array
    sigma: Array


def check_with_plate(
    data: CalibrationInput, calibration: RigCalibration, wheel: NominalWheel | None = None
) -> PlateCheck:
    """Compare a calibration with views of a plate, of which one is enough.

    The poses of all cameras are estimated from the views, lenses held; what that does to camber and toe of a
    nominal wheel is the error of the calibration in force. Views on the stage hold the plate's axes to the
    rig's, so a common turn of all cameras counts; with views held by hand alone it cannot be seen.

    Parameters
    ----------
    data
        Plate and observations; its cameras must be those of the calibration.
    calibration
        In force.
    wheel
        The tyre for which angles are predicted; None for the nominal one.

    Raises
    ------
    DegenerateInputError
        When cameras or image sizes differ, or a camera saw hardly any marks.
    """
    cameras = _cameras(data, calibration)
    poses = [_view_pose(data, v, cameras) for v in range(len(data.views))]
    sights = _sights(data, cameras, poses)
    before = _residuals(sights, cameras, poses)
    for number, key in enumerate(data.cameras):
        seen = sum(len(s.marks) for s in sights if s.camera == number)
        if seen < _FEWEST_MARKS:
            raise DegenerateInputError(
                field=" ".join(key),
                expected=f"at least {_FEWEST_MARKS} marks in all views together",
                seen=str(seen),
                cure="Add a view in which the plate fills its image.",
            )
    changed, after = _estimate(data, sights, cameras, poses)
    step = np.zeros(len(calibration.parameter_names))
    changes, first = [], 0
    for number, (key, old, new) in enumerate(zip(data.cameras, cameras, changed, strict=True)):
        turn = (old.rig_from_camera.inverse() @ new.rig_from_camera).rotvec()
        move = new.rig_from_camera.translation - old.rig_from_camera.translation
        step[first : first + _POSE] = *turn, *move
        first += _POSE + len(old.model.parameters)
        mine = [n for n, sight in enumerate(sights) if sight.camera == number]
        found = np.concatenate([before[n] for n in mine])
        changes.append(
            CameraChange(
                camera=key,
                marks=len(found),
                rms_px=_rms(found),
                shift_px=(float(found[:, 0].mean()), float(found[:, 1].mean())),
                turn=(float(turn[0]), float(turn[1]), float(turn[2])),
                move_mm=(float(move[0]), float(move[1]), float(move[2])),
                rms_left_px=_rms(np.concatenate([after[n] for n in mine])),
            )
        )
    camber, toe = angle_sensitivity(calibration, wheel) @ step
    scale = common_scale(_centres_of(cameras), _centres_of(changed), _CENTRE_SIGMA_MM)
    return PlateCheck(
        tuple(changes),
        _rms(np.concatenate(before)),
        _rms(np.concatenate(after)),
        float(camber),
        float(toe),
        scale,
        None if scale is None else scale_sentence(data.plate, scale, *_DISAGREE),
    )


def _centres_of(cameras: list[PosedCamera]) -> Array:
    return np.array([camera.rig_from_camera.translation for camera in cameras])


def _cameras(data: CalibrationInput, calibration: RigCalibration) -> list[PosedCamera]:
    known = cameras_of_rig(calibration)
    sizes = {key: (camera.model.width, camera.model.height) for key, camera in known.items()}
    if sizes != data.sizes:
        differ = sorted(
            " ".join(key) for key in {*sizes, *data.sizes} if sizes.get(key) != data.sizes.get(key)
        )
        raise DegenerateInputError(
            field="heads",
            expected=f"the cameras and image sizes of calibration {calibration.id}",
            seen=f"a difference in {', '.join(differ)}",
            cure="Name the calibration of the rig that took the session.",
        )
    return [known[key] for key in data.cameras]


def _view_pose(data: CalibrationInput, number: int, cameras: list[PosedCamera]) -> RigidTransform:
    view = data.views[number]
    if view.stage_mm is not None:
        return RigidTransform(np.eye(3), view.stage_mm)
    keys = list(data.cameras)
    best = max(view.observations, key=lambda key: len(view.observations[key].marks), default=None)
    if best is None:
        return RigidTransform.identity()
    camera = cameras[keys.index(best)]
    return camera.rig_from_camera @ camera_from_plate(data.plate, camera.model, view.observations[best])


def _sights(data: CalibrationInput, cameras: list[PosedCamera], poses: list[RigidTransform]) -> list[_Sight]:
    plate, out = data.plate, []
    for v, view in enumerate(data.views):
        for c, key in enumerate(data.cameras):
            seen = view.observations.get(key)
            if seen is None or not len(seen.marks):
                continue
            camera, marks = cameras[c], plate.points[seen.marks]
            inside = (camera.rig_from_camera.inverse() @ poses[v]).apply(marks)
            # The plate's own error in the image comes on top of that of finding the mark.
            plate_px = camera.model.fx / inside[:, 2] * plate.sigma_mm[seen.marks, :2].mean(axis=1)
            found_px = np.trace(seen.covariance, axis1=1, axis2=2) / 2.0
            pixels = _centres(seen, camera, poses[v], inside, plate.mark_radius_mm)
            out.append(_Sight(c, v, marks, pixels, np.sqrt(found_px + plate_px**2)))
    return out


def _centres(
    seen: MarkObservations, camera: PosedCamera, pose: RigidTransform, inside: Array, radius: float
) -> Array:
    """Images of the marks' centres, for contours too."""
    if seen.corrected:
        return seen.pixels
    turn = camera.rig_from_camera.rotation.T @ pose.rotation
    along_x, along_y = np.ascontiguousarray(turn[:, 0]), np.ascontiguousarray(turn[:, 1])
    packed = camera.model.packed()
    shifts = [contour_shift(point, along_x, along_y, radius, packed)[:2] for point in inside]
    out: Array = seen.pixels - np.array(shifts)
    return out


def _residuals(sights: list[_Sight], cameras: list[PosedCamera], poses: list[RigidTransform]) -> list[Array]:
    return [cameras[s.camera].project(poses[s.view].apply(s.marks)) - s.pixels for s in sights]


def _estimate(
    data: CalibrationInput, sights: list[_Sight], cameras: list[PosedCamera], poses: list[RigidTransform]
) -> tuple[list[PosedCamera], list[Array]]:
    """Cameras' poses that fit the views, and the residuals then; of equal fits the nearest to those given."""
    staged = [view.stage_mm is not None for view in data.views]
    views = _POSE * len(cameras) + _POSE * np.arange(len(poses))
    size = _POSE * (len(cameras) + len(poses))
    scale = np.tile([1 / _LEVER_MM] * 3 + [1.0] * 3, len(cameras) + len(poses))
    shift = np.zeros((len(poses), 3))
    now_cameras, now_poses = list(cameras), list(poses)
    for number in range(_STEPS):
        residuals = _residuals(sights, now_cameras, now_poses)
        weights = _weights(sights, residuals, robust=number > 0)
        rows, right = [], []
        for sight, residual, weight in zip(sights, residuals, weights, strict=True):
            pose = now_poses[sight.view]
            by_point, by_camera = camera_derivatives(now_cameras[sight.camera], pose.apply(sight.marks))
            block = np.zeros((len(residual), 2, size))
            block[:, :, _POSE * sight.camera : _POSE * (sight.camera + 1)] = by_camera[:, :, :_POSE]
            first = views[sight.view]
            block[:, :, first + 3 : first + _POSE] = by_point
            if not staged[sight.view]:
                block[:, :, first : first + 3] = -by_point @ pose.rotation @ cross_matrices(sight.marks)
            rows.append((block * weight[:, None, None]).reshape(-1, size))
            right.append((residual * weight[:, None]).ravel())
        for v in (v for v, held in enumerate(staged) if held):
            prior = np.zeros((3, size))
            prior[:, views[v] + 3 : views[v] + _POSE] = np.eye(3) / data.stage_sigma_mm
            rows.append(prior)
            right.append(shift[v] / data.stage_sigma_mm)
        step = scale * np.linalg.lstsq(np.concatenate(rows) * scale, -np.concatenate(right), rcond=1e-9)[0]
        for c, camera in enumerate(now_cameras):
            turn, move = step[_POSE * c : _POSE * c + 3], step[_POSE * c + 3 : _POSE * (c + 1)]
            now_cameras[c] = PosedCamera(camera.model, camera.rig_from_camera.perturbed(turn, move))
        for v, pose in enumerate(now_poses):
            turn, move = step[views[v] : views[v] + 3], step[views[v] + 3 : views[v] + _POSE]
            now_poses[v] = pose.perturbed(turn, move)
            shift[v] += move
    return now_cameras, _residuals(sights, now_cameras, now_poses)


def _weights(sights: list[_Sight], residuals: list[Array], *, robust: bool) -> list[Array]:
    scaled = [np.linalg.norm(r, axis=1) / sight.sigma for sight, r in zip(sights, residuals, strict=True)]
    if not robust:
        # Where cameras have moved, residuals are large at first.
        return [1.0 / sight.sigma for sight in sights]
    far = _FAR * max(1.0, float(np.median(np.concatenate(scaled))) / 1.1774)
    return [
        1.0 / (sight.sigma * np.sqrt(1.0 + (each / far) ** 2))
        for sight, each in zip(sights, scaled, strict=True)
    ]


def _rms(residuals: Array) -> float:
    return math.sqrt(float(np.square(residuals).sum(axis=1).mean()))
