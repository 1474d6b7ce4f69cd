"""The unknowns of the joint adjustment, laid out; the observations as tables; the working point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, Index, Mask
from alignment.calibration.observations import CalibrationInput, CameraKey
from alignment.calibration.projection import COEFFICIENTS, INTRINSICS
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform

POSE = 6
LOCAL = POSE + INTRINSICS + POSE  # columns that one observation can have: camera, lens, view


class LensKind(NamedTuple):
    """Kind and number of coefficients of a `CameraModel`, and which of them are estimated."""

    model: str
    coefficients: int
    estimated: tuple[int, ...]


MODELS: dict[str, LensKind] = {
    "division": LensKind("division", 1, (0,)),
    "radial": LensKind("brown", 5, (0, 1)),
    "brown5": LensKind("brown", 5, tuple(range(5))),
    "brown8": LensKind("brown", 8, tuple(range(8))),
    "thin_prism": LensKind("brown", 12, (0, 1, 2, 3, 4, 8, 9, 10, 11)),
    "tilted": LensKind("brown", 14, (0, 1, 2, 3, 4, 12, 13)),
}
"""Distortion models by name. ``radial`` is Brown–Conrady with k1 and k2 alone; thin prism and tilt come
without the rational terms k4 … k6, which together with them leave long valleys of equal fit."""

_LEAST_SIGMA_MM = 1e-6  # a mark that is taken for exact
# Weak priors: shares of the radius by which a term moves the image's corner; a sensor's tilt in radians.
_RADIAL_AT_CORNER, _TANGENTIAL_AT_CORNER, _TILT_SIGMA = 0.3, 0.01, 0.02


@dataclass(frozen=True)
class Priors:
    """What is known beforehand of the stage besides the sigma of its positions.

    Attributes
    ----------
    stage_axes
        Standard uncertainty, radians, of a rotation of the stage's axes against the plate's, common to all
        views; 0 for parallel axes. Along the cameras' axes it cannot be told from their principal points.
    view_tilt
        Standard uncertainty, radians, of the plate's rotation from stage view to stage view; 0 for a stage
        that moves it parallel.
    """

    stage_axes: float = 0.0
    view_tilt: float = 0.0


@dataclass(frozen=True, eq=False)
class State:
    """The working point: every array by camera (C), view (V) or seen mark (M).

    Attributes
    ----------
    rotations, centres
        (C, 3, 3) rig_from_camera, (C, 3) millimetres.
    packed
        (C, 20) `CameraModel.packed`.
    view_rotations, view_shifts
        (V, 3, 3), (V, 3): rig_from_plate.
    axes
        (3, 3) rotation of the stage's axes.
    deviations
        (M, 3) of the marks from the plate's points, millimetres.
    """

    rotations: Array
    centres: Array
    packed: Array
    view_rotations: Array
    view_shifts: Array
    axes: Array
    deviations: Array


@dataclass(frozen=True, eq=False)
class Problem:
    """Observations as tables and the columns of the unknowns.

    Attributes
    ----------
    data
        What it was made of.
    lens
        Kind of every camera's lens model.
    marks
        (M,) rows of the plate of the marks that were seen.
    camera, view, mark
        (N,) numbers of each observation; `mark` counts `marks`.
    pixels
        (N, 2) observed.
    whitening
        (N, 2, 2) W with Wᵀ W the inverse covariance.
    radius
        (N,) of the mark where the observation is the centre of its contour, millimetres; 0 where it is the
        mark's centre.
    points, mark_sigma
        (M, 3) of the seen marks.
    columns
        (N, 30) column of each local derivative, −1 for what is not estimated.
    camera_columns, view_columns
        (C, 24) and (V, 6) the same by camera and view.
    axes_columns
        (3,)
    size
        Number of columns; the marks are not among them.
    stage
        (V, 3) nominal positions; NaN for hand-held views.
    fixed_view
        View that is the rig frame itself because no stage says where the plate was; −1 for none.
    priors
        See `Priors`.
    coefficient_sigma
        (C, 14) weak priors of the lens terms.
    """

    data: CalibrationInput
    lens: LensKind
    marks: Index
    camera: Index
    view: Index
    mark: Index
    pixels: Array
    whitening: Array
    radius: Array
    points: Array
    mark_sigma: Array
    columns: Index
    camera_columns: Index
    view_columns: Index
    axes_columns: Index
    size: int
    stage: Array
    fixed_view: int
    priors: Priors
    coefficient_sigma: Array


def build_problem(
    data: CalibrationInput,
    start: dict[CameraKey, PosedCamera],
    model: str,
    priors: Priors,
    *,
    fixed_cameras: frozenset[CameraKey] = frozenset(),
    fixed_views: bool = False,
    frame_is_known: bool = False,
) -> Problem:
    """Lay out observations and unknowns.

    Parameters
    ----------
    data
        The observations.
    start
        Every camera of `data`, of the kind `model`; its values scale the weak priors.
    model
        Name of the distortion model, of `MODELS`.
    priors
        Of the stage.
    fixed_cameras
        Cameras that are not estimated.
    fixed_views
        True holds the pose of the plate in every view.
    frame_is_known
        True when the fixed cameras are the rig frame, so that no hand-held view has to be.

    Raises
    ------
    DegenerateInputError
        When nothing was observed, or a covariance is not positive.
    """
    keys, lens = data.cameras, MODELS[model]
    seen = _observed(data)
    marks, compressed = np.unique(seen.mark, return_inverse=True)
    stage = np.array([np.full(3, np.nan) if v.stage_mm is None else v.stage_mm for v in data.views])
    held = np.isnan(stage[:, 0])
    fixed_view = 0 if held.all() and not frame_is_known else -1

    camera_columns, size = _camera_columns(keys, lens, fixed_cameras)
    estimated_views = np.bincount(seen.view, minlength=len(data.views)) > 0
    if fixed_view >= 0:
        estimated_views[fixed_view] = False
    if fixed_views:
        estimated_views[:] = False
    turns = estimated_views & (held | (priors.view_tilt > 0))
    shifts = estimated_views & (held | (data.stage_sigma_mm > 0))
    view_columns, size = _view_columns(turns, shifts, size)
    axes_columns = np.full(3, -1, np.int64)
    if priors.stage_axes > 0 and data.stage_sigma_mm > 0 and not fixed_views:
        axes_columns[:] = size + np.arange(3)
        size += 3
    return Problem(
        data=data,
        lens=lens,
        marks=marks,
        camera=seen.camera,
        view=seen.view,
        mark=compressed.astype(np.int64),
        pixels=seen.pixels,
        whitening=_whitening(seen.covariance),
        radius=seen.radius,
        points=data.plate.points[marks],
        mark_sigma=np.maximum(data.plate.sigma_mm[marks], _LEAST_SIGMA_MM),
        columns=np.concatenate([camera_columns[seen.camera], view_columns[seen.view]], axis=1),
        camera_columns=camera_columns,
        view_columns=view_columns,
        axes_columns=axes_columns,
        size=size,
        stage=stage,
        fixed_view=fixed_view,
        priors=priors,
        coefficient_sigma=np.array([_coefficient_sigma(start[key].model) for key in keys]),
    )


class _Observed(NamedTuple):
    """All observations as tables (N, …): numbers of camera, view and mark; pixels; what the pixels are of."""

    camera: Index
    view: Index
    mark: Index
    pixels: Array
    covariance: Array
    radius: Array


def _observed(data: CalibrationInput) -> _Observed:
    """Table of what all cameras saw in all views; raises as `build_problem` where that is nothing."""
    number = {key: k for k, key in enumerate(data.cameras)}
    rows: list[_Observed] = []
    for v, plate_view in enumerate(data.views):
        for key, seen in plate_view.observations.items():
            count = len(seen.marks)
            radius = np.full(count, 0.0 if seen.corrected else data.plate.mark_radius_mm)
            camera, view = np.full(count, number[key], np.int64), np.full(count, v, np.int64)
            rows.append(_Observed(camera, view, seen.marks, seen.pixels, seen.covariance, radius))
    if not sum(len(row.mark) for row in rows):
        raise DegenerateInputError(
            field="views",
            expected="marks of the plate",
            seen="none in any view",
            cure="Check plate, light and lens caps.",
        )
    joined = _Observed(*(np.concatenate(column) for column in zip(*rows, strict=True)))
    return joined._replace(pixels=joined.pixels.astype(np.float64))


def _camera_columns(
    keys: Sequence[CameraKey], lens: LensKind, fixed: frozenset[CameraKey]
) -> tuple[Index, int]:
    """(C, 6 + intrinsics) column of each parameter of each camera, −1 for none, and how many there are."""
    estimated = np.array([*range(POSE + 4), *(POSE + 4 + c for c in lens.estimated)])
    columns, size = np.full((len(keys), POSE + INTRINSICS), -1, np.int64), 0
    for k, key in enumerate(keys):
        if key not in fixed:
            columns[k, estimated] = size + np.arange(len(estimated))
            size += len(estimated)
    return columns, size


def _view_columns(turns: Mask, shifts: Mask, size: int) -> tuple[Index, int]:
    """(V, 6) column of turn and shift of each view (V,) that has one, from `size` on, and where they end."""
    columns = np.full((len(turns), POSE), -1, np.int64)
    for v in range(len(turns)):
        for first, estimated in ((0, turns[v]), (3, shifts[v])):
            if estimated:
                columns[v, first : first + 3] = size + np.arange(3)
                size += 3
    return columns, size


def _whitening(covariance: Array) -> Array:
    """(N, 2, 2) upper triangles W with Wᵀ W the inverses of the covariances."""
    try:
        lower = np.linalg.cholesky(np.linalg.inv(covariance))
    except np.linalg.LinAlgError as error:
        raise DegenerateInputError(
            field="covariance", expected="positive covariances of the marks", seen="a singular one"
        ) from error
    return np.ascontiguousarray(lower.transpose(0, 2, 1))


def _coefficient_sigma(model: CameraModel) -> Array:
    """(14,) weak priors: a term's effect at the image's corner, relative to the corner's radius."""
    corner = np.array([model.cx, model.cy])
    far = np.maximum(corner, np.array([model.width - 1, model.height - 1]) - corner)
    r = max(float(np.hypot(far[0] / model.fx, far[1] / model.fy)), 1e-3)
    radial = [_RADIAL_AT_CORNER / r**2, _RADIAL_AT_CORNER / r**4, _RADIAL_AT_CORNER / r**6]
    decentering = _TANGENTIAL_AT_CORNER / r
    sigma = np.array(
        [radial[0], radial[1], decentering, decentering, radial[2], *radial]
        + [decentering, decentering / r**2] * 2
        + [_TILT_SIGMA] * 2
    )
    assert len(sigma) == COEFFICIENTS
    return sigma


def initial_state(
    problem: Problem, cameras: dict[CameraKey, PosedCamera], rig_from_plate: list[RigidTransform]
) -> State:
    """Working point of given cameras and poses of the plate (one per view), marks as the plate says."""
    posed = [cameras[key] for key in problem.data.cameras]
    return State(
        rotations=np.array([c.rig_from_camera.rotation for c in posed]),
        centres=np.array([c.rig_from_camera.translation for c in posed]),
        packed=np.array([c.model.packed() for c in posed]),
        view_rotations=np.array([t.rotation for t in rig_from_plate]),
        view_shifts=np.array([t.translation for t in rig_from_plate]),
        axes=np.eye(3),
        deviations=np.zeros((len(problem.marks), 3)),
    )


def _turn(rotations: Array, columns: Index, step: Array) -> Array:
    """R → R·exp(ω) where columns (K, 3) are not −1."""
    moved = columns[:, 0] >= 0
    if not moved.any():
        return rotations
    out = rotations.copy()
    turns = Rotation.from_rotvec(step[columns[moved]]).as_matrix()
    u, _, vt = np.linalg.svd(out[moved] @ turns)  # keep orthonormal over many steps
    out[moved] = u @ vt
    return out


def _shift(values: Array, columns: Index, step: Array) -> Array:
    return values + step[columns]  # the last element, 0, is that of column −1


def advanced(problem: Problem, state: State, step: Array, mark_step: Array) -> State:
    """Return the working point after a step (`size`,) of the unknowns and (M, 3) of the marks."""
    step = np.append(step, 0.0)
    cameras, views = problem.camera_columns, problem.view_columns
    packed = state.packed.copy()
    packed[:, :4] = _shift(packed[:, :4], cameras[:, 6:10], step)
    packed[:, 6:] = _shift(packed[:, 6:], cameras[:, 10:], step)
    axes = state.axes
    if problem.axes_columns[0] >= 0:
        axes = Rotation.from_rotvec(step[problem.axes_columns]).as_matrix() @ axes
    return replace(
        state,
        rotations=_turn(state.rotations, cameras[:, :3], step),
        centres=_shift(state.centres, cameras[:, 3:6], step),
        packed=packed,
        view_rotations=_turn(state.view_rotations, views[:, :3], step),
        view_shifts=_shift(state.view_shifts, views[:, 3:], step),
        axes=axes,
        deviations=state.deviations + mark_step,
    )


def cameras_of(problem: Problem, state: State) -> dict[CameraKey, PosedCamera]:
    """Cameras of a working point."""
    out = {}
    lens = problem.lens
    for k, key in enumerate(problem.data.cameras):
        p = state.packed[k]
        width, height = problem.data.sizes[key]
        coefficients = tuple(p[6 : 6 + lens.coefficients])
        model = CameraModel(width, height, p[0], p[1], p[2], p[3], lens.model, coefficients, p[4])
        out[key] = PosedCamera(model, RigidTransform(state.rotations[k], state.centres[k]))
    return out
