"""What a gauge frame leaves unknown of wheels whose rigs it placed: much of it they have in common.

A frame that rests askew on the wheel supports, or that is longer than its certificate says, moves all rigs
that one view placed together. What is turned together leaves toes and thrust angle against the vehicle's own
centreline as they are, and takes the road with it; what is longer makes wheelbase and track longer.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from alignment.arrays import Array
from alignment.geometry.transforms import RigidTransform, cross_matrices
from alignment.values import SHARED_SIZE, RigCalibration
from alignment.vehicle.angles import camber_toe_jacobian
from alignment.vehicle.wheel_axes import AXIS_SIZE, FOUR_WHEELS, WheelAxis


def pose_by_frame(vehicle_from_rig: RigidTransform) -> Array:
    """(6, 7) change of a rig's pose (rotation about its axes, position) per number of the whole frame."""
    place = vehicle_from_rig.translation
    out = np.zeros((6, SHARED_SIZE))
    out[:3, :3] = vehicle_from_rig.rotation.T
    out[3:, :3] = -cross_matrices(place)
    out[3:, 3:6] = np.eye(3)
    out[3:, 6] = place
    return out


def axis_by_pose(wheel: WheelAxis, vehicle_from_rig: RigidTransform) -> Array:
    """(5, 6) change of a wheel's axis (camber, toe, reference point) per change of its rig's pose."""
    turned = vehicle_from_rig.rotation
    out = np.zeros((AXIS_SIZE, 6))
    out[:2, :3] = -camber_toe_jacobian(wheel.normal, wheel.side) @ cross_matrices(wheel.normal) @ turned
    out[2:, :3] = -cross_matrices(wheel.point - vehicle_from_rig.translation) @ turned
    out[2:, 3:] = np.eye(3)
    return out


def placing_covariance(wheels: Mapping[str, WheelAxis], rigs: Mapping[str, RigCalibration]) -> Array:
    """(5 N, 5 N) what the placing of their rigs adds to the own covariances of N wheels.

    Between rigs of one view stands what they share. Rigs of different views, and those that do not say how
    they were placed, are taken to share nothing. A rig whose covariance is known has its pose in that of its
    wheel; of the others the pose is added.

    Parameters
    ----------
    wheels
        By name, of `FOUR_WHEELS`.
    rigs
        The calibration of the rig of each.
    """
    names = [name for name in FOUR_WHEELS if name in wheels]
    out = np.zeros((AXIS_SIZE * len(names),) * 2)
    of_pose = {name: axis_by_pose(wheels[name], rigs[name].vehicle_from_rig) for name in names}
    of_frame = {name: of_pose[name] @ pose_by_frame(rigs[name].vehicle_from_rig) for name in names}
    for k, name in enumerate(names):
        placing = rigs[name].placing
        if placing is None:
            continue
        mine = slice(AXIS_SIZE * k, AXIS_SIZE * (k + 1))
        if rigs[name].covariance is None:
            out[mine, mine] = of_pose[name] @ placing.pose_covariance @ of_pose[name].T
        for n, other in enumerate(names):
            there = rigs[other].placing
            if other != name and there is not None and there.view == placing.view:
                theirs = slice(AXIS_SIZE * n, AXIS_SIZE * (n + 1))
                out[mine, theirs] = of_frame[name] @ placing.shared_covariance @ of_frame[other].T
    return out
