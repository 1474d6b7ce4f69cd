"""What a calibration's errors mean for one wheel after the other that stand differently before the same rig.

They are the same errors each time, so what wheels at different poses share is as much worth knowing as what
each has: of a wheel that is steered, the part that all positions have in common drops out of the axis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from alignment.arrays import Array
from alignment.calibration.prediction import NominalWheel, axis_sensitivity
from alignment.geometry.transforms import RigidTransform, cross_matrices
from alignment.values import HeadCalibration, RigCalibration

_POSE = 6  # numbers of a camera's pose, before its intrinsic ones


def posed_axis_sensitivity(
    calibration: RigCalibration, rig_from_wheel: RigidTransform, wheel: NominalWheel | None = None
) -> Array:
    """(5, P) change of camber, toe and reference point (vehicle frame) per change of each parameter.

    As `prediction.axis_sensitivity`, of a wheel that need not stand where the rig is made for.

    Parameters
    ----------
    calibration
        Of the rig.
    rig_from_wheel
        Where it stands: z of the wheel along its axis, outboard; its origin is the reference point.
    wheel
        The tyre.

    Raises
    ------
    DegenerateInputError
        When a head does not see the wheel.
    """
    wheel_from_rig = rig_from_wheel.inverse()
    heads = tuple(
        HeadCalibration(
            head.name,
            *(
                replace(camera, rig_from_camera=wheel_from_rig @ camera.rig_from_camera)
                for camera in head.cameras
            ),
        )
        for head in calibration.heads
    )
    moved = replace(calibration, heads=heads, vehicle_from_rig=calibration.vehicle_from_rig @ rig_from_wheel)
    return axis_sensitivity(moved, wheel) @ _by_rig(calibration, rig_from_wheel)


def _by_rig(calibration: RigCalibration, rig_from_wheel: RigidTransform) -> Array:
    """(P, P) change of the parameters of the rig as the wheel sees it by those of the rig."""
    turn = rig_from_wheel.rotation.T
    out = np.eye(len(calibration.parameter_names))
    at = 0
    for head in calibration.heads:
        for camera in head.cameras:
            # Camera centres are in the frame that changes; turns are about the cameras' own axes.
            out[at + 3 : at + _POSE, at + 3 : at + _POSE] = turn
            at += _POSE + len(camera.model.parameters)
    if calibration.vehicle_from_rig_measured:
        out[at : at + 3, at : at + 3] = turn
        lever = cross_matrices(rig_from_wheel.translation)
        out[at + 3 :, at : at + 3] = -calibration.vehicle_from_rig.rotation @ lever
    return out
