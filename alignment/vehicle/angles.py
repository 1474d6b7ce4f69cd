"""Camber and toe of one wheel from its outboard normal; projections about the vehicle axes, ISO 8855."""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.values import Side

SIGN: dict[str, float] = {"left": 1.0, "right": -1.0}


def camber_toe(normal: Array, side: Side) -> tuple[float, float]:
    """Camber and toe, radians, of an outboard unit normal (3,) in the vehicle frame.

    camber = −asin(n_Z), positive when the top leans outboard; toe = atan2(n_X, s·n_Y) with s = +1 left,
    −1 right, positive is toe-in on both sides.

    Raises
    ------
    DegenerateInputError
        When the normal does not point outboard.
    """
    n = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    outboard = SIGN[side] * n[1]
    if not outboard > 0:
        raise DegenerateInputError(
            field="normal", expected=f"an outboard normal of a {side} wheel", seen=f"{n.tolist()}"
        )
    return -math.asin(n[2]), math.atan2(n[0], outboard)


def normal_from_angles(camber: float, toe: float, side: Side) -> Array:
    """Outboard unit normal (3,), vehicle frame, of camber and toe in radians: the inverse of `camber_toe`."""
    horizontal = math.cos(camber)
    return np.array(
        [
            horizontal * math.sin(toe),
            SIGN[side] * horizontal * math.cos(toe),
            -math.sin(camber),
        ]
    )


def camber_toe_jacobian(normal: Array, side: Side) -> Array:
    """(2, 3) derivatives of (camber, toe) with respect to the unit normal, vehicle frame."""
    n = np.asarray(normal, dtype=np.float64)
    s = SIGN[side]
    horizontal = n[0] ** 2 + n[1] ** 2
    return np.array(
        [
            [0.0, 0.0, -1.0 / math.sqrt(max(1.0 - n[2] ** 2, 1e-300))],
            [s * n[1] / horizontal, -s * n[0] / horizontal, 0.0],
        ]
    )
