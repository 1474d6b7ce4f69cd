"""A front wheel at many positions of the steering, from images: what `vehicle.steering_axis` takes.

What the positions have in common is worth as much as what each has. The errors of the calibration are the
same at all of them, but act on a wheel that is steered a little otherwise than on one that stands straight:
what each of them does is computed for the wheel as it stands. And the wheel carries the same load: what all
positions tell of it together is taken off each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.calibration.posed_wheels import posed_axis_sensitivity
from alignment.geometry.transforms import RigidTransform
from alignment.measure import measure_and_show
from alignment.measure_load import LoadSeen, shared_load
from alignment.measure_spin import heads_judged
from alignment.prepared import PreparedRig
from alignment.values import (
    MeasureSettings,
    Refusal,
    RefusalCode,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
)
from alignment.vehicle.angles import camber_toe
from alignment.vehicle.steering_values import SteeredWheel
from alignment.vehicle.wheel_axes import AXIS_SIZE, WheelAxis

LARGEST_STEER = math.radians(12.0)
"""To which wheels are steered to both sides in full images."""
_BESIDE = math.radians(2.0)  # camber and toe that a steered wheel has besides
_DEPTH_MM = 80.0  # to which the tyre of a wheel that is steered that far reaches
_COMPUTED = 9  # positions for which errors of the calibration are computed; between them they are smooth
_ORDER = 4  # of the polynomial by which they are


def steered_settings(settings: MeasureSettings) -> MeasureSettings:
    """Return settings with the measuring volume of wheels that are steered by up to `LARGEST_STEER`.

    Heads are judged by all positions together, but where one may be left out.
    """
    low, high = settings.depth_range_mm
    return replace(
        settings,
        maximum_angle=max(settings.maximum_angle, LARGEST_STEER + _BESIDE),
        depth_range_mm=(min(low, -_DEPTH_MM), max(high, _DEPTH_MM)),
        judge_heads=settings.allow_lost_head,
    )


def measure_steered(
    shots: Iterable[Sequence[StereoImages]],
    rig: PreparedRig,
    settings: MeasureSettings,
    shot_done: Callable[[WheelMeasurement], None] = lambda _: None,
) -> list[SteeredWheel] | Refusal:
    """Measure one wheel at positions of the steering.

    Parameters
    ----------
    shots
        Six images of each position; each is let go once measured.
    rig, settings
        As `steered_settings` makes them; the rig prepared for them.
    shot_done
        Given the tyre plane of each shot.

    Returns
    -------
    list of SteeredWheel, or Refusal
        The refusal of a single shot names it.
    """
    planes: list[WheelMeasurement] = []
    loads: list[LoadSeen | None] = []
    for number, images in enumerate(shots, start=1):
        found, load = _with_load(images, rig, settings)
        if isinstance(found, Refusal):
            return replace(found, reason=f"position {number}: {found.reason}")
        if found.reference is None:
            return Refusal(
                RefusalCode.OUTSIDE_VOLUME,
                f"position {number}: the outermost ring of the sidewall was not seen, so that the wheel's "
                "place is not known; check that the heads see the widest part of the tyre",
            )
        planes.append(found)
        loads.append(load)
        shot_done(found)
    judged = heads_judged(planes, rig)
    if isinstance(judged, Refusal):
        return judged
    return steered_wheels(planes, rig, loads, None if judged is None else judged.covariance)


def _with_load(
    images: Sequence[StereoImages], rig: PreparedRig, settings: MeasureSettings
) -> tuple[WheelMeasurement | Refusal, LoadSeen | None]:
    """Measure one position, and keep what it tells of the load."""
    found, sight = measure_and_show(images, rig, settings)
    return found, None if sight is None or sight.loaded is None else LoadSeen.of(sight.loaded)


def steered_wheels(
    planes: Sequence[WheelMeasurement],
    rig: PreparedRig,
    loads: Sequence[LoadSeen | None] | None = None,
    moved: Array | None = None,
) -> list[SteeredWheel]:
    """Return positions of the steering from the tyre planes of one wheel, all of which have a place.

    What is stated of a tyre plane is parted into what the calibration does at all positions and what is each
    one's own.

    Parameters
    ----------
    planes
        Of the positions.
    rig
        Before which they stood.
    loads
        What each tells of the load; where all do, it is taken off by all together, and what is not known of
        it is no position's own. Otherwise each one's own counts.
    moved
        (2, 2) covariance of camber and toe by heads that may have moved since the calibration, the same at
        all positions, radians².
    """
    calibration = rig.calibration
    poses = [rig_from_wheel(p.normal, p.reference.point) for p in planes if p.reference is not None]
    common = errors_at_positions(calibration, poses, np.array([plane.toe for plane in planes]))
    if moved is not None:
        heads = np.zeros((len(planes), AXIS_SIZE, 2))
        heads[:, :2] = _root(moved)
        common = np.concatenate([common, heads], axis=2)
    told = [load for load in loads or () if load is not None]
    together = len(told) == len(planes)
    if together:
        planes = _with_one_load(planes, told, rig)
    out = []
    for plane, shared in zip(planes, common, strict=True):
        reference = plane.reference
        assert reference is not None
        axis = WheelAxis.of(plane, reference, calibration)
        own = np.array(axis.covariance)
        if rig.axis_covariance is not None:
            own -= rig.axis_covariance
        if together and plane.load_covariance is not None:
            own[:2, :2] -= plane.load_covariance
        out.append(SteeredWheel(replace(axis, covariance=_positive(own)), shared, plane.load_covariance))
    return out


def _with_one_load(
    planes: Sequence[WheelMeasurement], loads: Sequence[LoadSeen], rig: PreparedRig
) -> list[WheelMeasurement]:
    """Tyre planes as the load of all positions leaves them; their places move by less than a micrometre."""
    lift = shared_load(loads)
    turn, side = rig.calibration.vehicle_from_rig.rotation, rig.calibration.side
    out = []
    for plane, load in zip(planes, loads, strict=True):
        normal = plane.normal + load.turned(lift)
        normal /= np.linalg.norm(normal)
        camber, toe = camber_toe(turn @ normal, side)
        out.append(replace(plane, normal=normal, camber=camber, toe=toe))
    return out


def errors_at_positions(calibration: RigCalibration, poses: Sequence[RigidTransform], toes: Array) -> Array:
    """(N, 5, M) what independent errors of a calibration do to camber, toe and place at N positions.

    Parameters
    ----------
    calibration
        Of the rig; one that states no covariance gives M = 0.
    poses
        Of the wheel before the rig, as `rig_from_wheel`.
    toes
        (N,) toe there, radians, over which errors are smooth.
    """
    if calibration.covariance is None or not poses:
        return np.zeros((len(poses), AXIS_SIZE, 0))
    root = _root(calibration.covariance)
    order = np.argsort(toes)
    few = np.linspace(0, len(poses) - 1, min(_COMPUTED, len(poses))).round().astype(int)
    chosen = order[few]
    there = np.array([posed_axis_sensitivity(calibration, poses[k]) @ root for k in chosen])
    if len(chosen) == len(poses):
        return there[np.argsort(order)]
    u = (toes - toes.mean()) / max(float(np.ptp(toes)), 1e-9)
    rows = np.vander(u[chosen], _ORDER + 1)
    smooth = np.linalg.lstsq(rows, there.reshape(len(chosen), -1), rcond=None)[0]
    out: Array = (np.vander(u, _ORDER + 1) @ smooth).reshape(len(poses), AXIS_SIZE, -1)
    return out


def rig_from_wheel(normal: Array, point: Array) -> RigidTransform:
    """Where a wheel stands: z along its normal (3,), outboard; its origin the reference point (3,)."""
    across = np.cross([0.0, 0.0, 1.0], normal)
    sine = float(np.linalg.norm(across))
    turn = math.atan2(sine, float(normal[2])) / sine if sine > 0.0 else 0.0
    return RigidTransform(Rotation.from_rotvec(turn * across).as_matrix(), point)


def _positive(covariance: Array) -> Array:
    """Without what rounding leaves below zero."""
    root = _root(covariance)
    return root @ root.T


def _root(covariance: Array) -> Array:
    """Matrix whose product with its transpose is a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    out: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return out
