"""What is believed of a number that a person types or a file gives, and the slip that explains another.

Such a number shifts every later result and shows in none of them, so it is judged where it comes in.
"""

from __future__ import annotations

import math

import numpy as np

from alignment.geometry.transforms import RigidTransform
from alignment.values import Side, nominal_vehicle_from_rig

LARGEST_SHIFT = math.radians(10.0 / 60.0)
"""Largest turn of every later wheel that is believed without a reason, radians."""
LARGEST_LENGTH_SHIFT_MM = 4.0
"""Largest error of a length of a master vehicle that is believed: such a turn over half a wheelbase."""
LARGEST_MOUNTING = math.radians(2.0)
"""Largest angle between a rig's axes and the vehicle's that is believed without a reason, radians."""
LARGEST_TURN = math.radians(10.0)
"""Largest angle between a rig's axes and the vehicle's that is believed at all, radians."""
NEAREST_MM, FARTHEST_MM = 100.0, 20_000.0
"""Between these a rig or its plate lies from the origin of the vehicle frame, millimetres."""

_OTHER: dict[Side, Side] = {"left": "right", "right": "left"}
_SIGN = {"left": 1.0, "right": -1.0}
_WORD = {"left": "positive", "right": "negative"}
_ABOUT_Z = {"a quarter turn": 1, "half a turn": 2, "three quarters of a turn": 3}


def certificate_slip(
    measured: tuple[float, float], certified: tuple[float, float], within: tuple[float, float]
) -> str | None:
    """Return the slip of the pen with which certified angles would fit the measured ones; None without one.

    Parameters
    ----------
    measured, certified
        Camber and toe, radians.
    within
        How near each must come, radians.
    """
    camber, toe = certified
    for explanation, tried in (
        ("the opposite sign of the camber", (-camber, toe)),
        ("the opposite sign of the toe", (camber, -toe)),
        ("both signs turned round", (-camber, -toe)),
        ("camber and toe exchanged", (toe, camber)),
        ("arcminutes taken for degrees", (camber / 60.0, toe / 60.0)),
        ("radians taken for degrees", (math.degrees(camber), math.degrees(toe))),
    ):
        if all(abs(m - c) <= w for m, c, w in zip(measured, tried, within, strict=True)):
            return explanation
    return None


def turn_from_nominal(vehicle_from_rig: RigidTransform, side: Side) -> float:
    """Angle between the axes of a rig and those of a nominal one of this side, radians."""
    return float(np.linalg.norm((nominal_vehicle_from_rig(side).inverse() @ vehicle_from_rig).rotvec()))


def pose_slip(vehicle_from_rig: RigidTransform, side: Side) -> str | None:
    """Return the slip with which a pose far from nominal would be believed; None when none explains it."""
    about_z = {
        f"{part} about its z axis": vehicle_from_rig
        @ RigidTransform.from_rotvec(np.array([0.0, 0.0, -number * math.pi / 2.0]), np.zeros(3))
        for part, number in _ABOUT_Z.items()
    }
    if turn_from_nominal(vehicle_from_rig, _OTHER[side]) <= LARGEST_TURN:
        return "left and right exchanged"
    for explanation, tried in {
        "the rotation transposed, which takes vehicle coordinates to the rig's": vehicle_from_rig.inverse(),
        **about_z,
    }.items():
        if turn_from_nominal(tried, side) <= LARGEST_TURN:
            return explanation
    return None


def place_problem(position_mm: tuple[float, float, float], side: Side | None) -> tuple[str, str, str] | None:
    """Return what was expected, what was seen and the cure of a place where no rig stands; None when one may.

    Parameters
    ----------
    position_mm
        In the vehicle frame (X forward, Y left, Z up); the origin itself stands for an unknown place.
    side
        Of the vehicle; None where it is not known.
    """
    distance = float(np.linalg.norm(position_mm))
    seen = f"{', '.join(f'{x:g}' for x in position_mm)}"
    if distance and not NEAREST_MM <= distance <= FARTHEST_MM:
        fits = [
            unit
            for unit, factor in (("metres", 1000.0), ("inches", 25.4), ("micrometres", 0.001))
            if NEAREST_MM <= factor * distance <= FARTHEST_MM
        ]
        return (
            f"a place {NEAREST_MM:g} to {FARTHEST_MM:g} mm from the vehicle's origin",
            seen,
            f"It would fit with {fits[0]}: millimetres are asked for" if fits else "Check the unit",
        )
    if side is not None and _SIGN[side] * position_mm[1] < -NEAREST_MM:
        return (
            f"a place on the {side} of the vehicle, where Y is {_WORD[side]}",
            seen,
            "It would fit with left and right exchanged, or the opposite sign of Y",
        )
    return None


def side_in_name(rig: str) -> Side | None:
    """Return the side that the name of a rig says, such as ``front_left``; None when it says none."""
    if rig.endswith("_left"):
        return "left"
    return "right" if rig.endswith("_right") else None
