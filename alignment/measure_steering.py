"""A front wheel at many positions of the steering, from images: what `vehicle.steering_axis` takes.

What the positions have in common is worth as much as what each has. The errors of the calibration are the
same at all of them, but act on a wheel that is steered a little otherwise than on one that stands straight:
what each of them does is computed for the wheel as it stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.calibration.posed import posed_axis_sensitivity
from alignment.geometry.transforms import RigidTransform
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.values import (
    MeasureSettings,
    Refusal,
    RefusalCode,
    StereoImages,
    WheelMeasurement,
)
from alignment.vehicle.steering_values import SteeredWheel
from alignment.vehicle.wheel_axes import AXIS_SIZE, WheelAxis

LARGEST_STEER = math.radians(12.0)
"""To which wheels are steered to both sides in full images."""
_BESIDE = math.radians(2.0)  # camber and toe that a steered wheel has besides
_DEPTH_MM = 80.0  # to which the tyre of a wheel that is steered that far reaches
_COMPUTED = 9  # positions for which errors of the calibration are computed; between them they are smooth
_ORDER = 4  # of the polynomial by which they are


def steered_settings(settings: MeasureSettings) -> MeasureSettings:
    """Return settings with the measuring volume of wheels that are steered by up to `LARGEST_STEER`."""
    low, high = settings.depth_range_mm
    return replace(
        settings,
        maximum_angle=max(settings.maximum_angle, LARGEST_STEER + _BESIDE),
        depth_range_mm=(min(low, -_DEPTH_MM), max(high, _DEPTH_MM)),
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
    planes = []
    for number, images in enumerate(shots, start=1):
        found = measure_wheel(images, rig, settings)
        if isinstance(found, Refusal):
            return replace(found, reason=f"position {number}: {found.reason}")
        if found.reference is None:
            return Refusal(
                RefusalCode.OUTSIDE_VOLUME,
                f"position {number}: the outermost ring of the sidewall was not seen, so that the wheel's "
                "place is not known; check that the heads see the widest part of the tyre",
            )
        planes.append(found)
        shot_done(found)
    return steered_wheels(planes, rig)


def steered_wheels(planes: Sequence[WheelMeasurement], rig: PreparedRig) -> list[SteeredWheel]:
    """Return positions of the steering from the tyre planes of one wheel, all of which have a place.

    What is stated of a tyre plane is parted into what the calibration does at all positions and what is each
    one's own: its noise, and what it makes of the load anew.
    """
    calibration = rig.calibration
    common = _common(planes, rig)
    out = []
    for plane, shared in zip(planes, common, strict=True):
        reference = plane.reference
        assert reference is not None
        axis = WheelAxis.of(plane, reference, calibration)
        own = np.array(axis.covariance)
        if rig.axis_covariance is not None:
            own -= rig.axis_covariance
        out.append(SteeredWheel(replace(axis, covariance=_positive(own)), shared, plane.load_covariance))
    return out


def _common(planes: Sequence[WheelMeasurement], rig: PreparedRig) -> Array:
    """(N, 5, M) what independent errors of the calibration do at each position."""
    calibration = rig.calibration
    if calibration.covariance is None or not planes:
        return np.zeros((len(planes), AXIS_SIZE, 0))
    values, vectors = np.linalg.eigh(calibration.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    toes = np.array([plane.toe for plane in planes])
    order = np.argsort(toes)
    count = min(_COMPUTED, len(planes))
    chosen = order[np.unique(np.linspace(0, len(planes) - 1, count).round().astype(int))]
    there = np.array([posed_axis_sensitivity(calibration, rig_from_wheel(planes[k])) @ root for k in chosen])
    if count < _COMPUTED:
        return there[np.argsort(toes[chosen]).argsort()][np.argsort(order)]
    u = (toes - toes.mean()) / max(float(np.ptp(toes)), 1e-9)
    rows = np.vander(u[chosen], _ORDER + 1)
    smooth = np.linalg.lstsq(rows, there.reshape(len(chosen), -1), rcond=None)[0]
    out: Array = (np.vander(u, _ORDER + 1) @ smooth).reshape(len(planes), AXIS_SIZE, -1)
    return out


def rig_from_wheel(plane: WheelMeasurement) -> RigidTransform:
    """Where a wheel stands before its rig: z along its axis, outboard, from its reference point."""
    assert plane.reference is not None
    z = np.array([0.0, 0.0, 1.0])
    across = np.cross(z, plane.normal)
    sine = float(np.linalg.norm(across))
    turn = math.atan2(sine, float(plane.normal[2])) / sine if sine > 0.0 else 0.0
    return RigidTransform(Rotation.from_rotvec(turn * across).as_matrix(), plane.reference.point)


def _positive(covariance: Array) -> Array:
    """Without what rounding leaves below zero."""
    values, vectors = np.linalg.eigh(covariance)
    out: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return out
