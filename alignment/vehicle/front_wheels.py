"""Both front wheels of one sweep: what one does while the other is steered, and how alike their axes are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.vehicle.angles import SIGN
from alignment.vehicle.steering_values import SteeredWheel, SteeringAxis

INNER_ANGLE = math.radians(10.0)
"""Of the inner wheel, at which toe-out on turns is told where nothing else is asked; 20° is the trade's."""
_AT_LEAST = math.radians(3.0)


@dataclass(frozen=True, eq=False)
class SteeredPair:
    """The front wheels of one sweep.

    Angles are in radians.

    Attributes
    ----------
    inner_angle
        Angle of the inner wheel, about the vertical, at which toe-out on turns is told; the largest that both
        turns reach, where they do not reach what was asked.
    toe_out_left, toe_out_right
        Toe-out on turns of the turn to that side: the angle of the inner wheel less that of the outer one.
    lock_left, lock_right
        (left, right) angles of both wheels at the end of the sweep to that side, positive; None where the
        steering was not turned to its stop.
    differences
        Left less right, of the quantities of the axes that both have.
    differences_u
        Standard uncertainties of these; what the rigs share is counted as if they did not.
    """

    inner_angle: float
    toe_out_left: float
    toe_out_right: float
    lock_left: tuple[float, float] | None
    lock_right: tuple[float, float] | None
    differences: Mapping[str, float]
    differences_u: Mapping[str, float]


def straight_toe(left: Sequence[SteeredWheel], right: Sequence[SteeredWheel], heading: float) -> float:
    """Toe of both front wheels to the thrust line where it is the same: the steering stands straight ahead.

    Parameters
    ----------
    left, right
        Positions of the wheels, in the same order.
    heading
        Direction of the thrust line, radians.

    Raises
    ------
    DegenerateInputError
        When the series are not of one sweep, or it does not pass straight ahead.
    """
    toes = _toes(left, right, heading)
    off = toes[0] - toes[1]
    order = np.argsort(off)
    if not (len(off) and off.min() <= 0.0 <= off.max()):
        raise DegenerateInputError(
            field="series",
            expected="a sweep through straight ahead",
            seen="toes of left and right that are never the same",
            cure="Turn the steering from one side to the other.",
        )
    return float(np.interp(0.0, off[order], 0.5 * (toes[0] + toes[1])[order]))


def steered_pair(
    left: SteeringAxis,
    right: SteeringAxis,
    asked: float = INNER_ANGLE,
    *,
    stop_left: bool = False,
    stop_right: bool = False,
) -> SteeredPair:
    """Return what both wheels of a sweep say together.

    Parameters
    ----------
    left, right
        Axes of the wheels from the same positions, in the same order.
    asked
        Angle of the inner wheel at which toe-out on turns is told, radians.
    stop_left, stop_right
        Whether the steering was turned to its stop on that side.

    Raises
    ------
    DegenerateInputError
        When they are not of one sweep.
    """
    if left.side != "left" or right.side != "right" or len(left.toes) != len(right.toes):
        raise DegenerateInputError(
            field="left, right",
            expected="both wheels of one sweep",
            seen=f"{left.side} at {len(left.toes)} positions, {right.side} at {len(right.toes)}",
        )
    inner = min(asked, float(left.turns.max()), float(-right.turns.min()))
    if inner < _AT_LEAST:
        raise DegenerateInputError(
            field="series",
            expected=f"wheels steered to both sides by {math.degrees(_AT_LEAST):g}° at least",
            seen=f"{math.degrees(inner):.1f}°",
        )
    names = [name for name in left.values if name in right]
    return SteeredPair(
        inner_angle=inner,
        toe_out_left=inner - _other(left.turns, right.turns, inner),
        toe_out_right=inner + _other(right.turns, left.turns, -inner),
        lock_left=(float(left.turns.max()), float(right.turns.max())) if stop_left else None,
        lock_right=(float(-left.turns.min()), float(-right.turns.min())) if stop_right else None,
        differences={name: left.value(name) - right.value(name) for name in names},
        differences_u={name: math.hypot(left.u(name), right.u(name)) for name in names},
    )


def _toes(left: Sequence[SteeredWheel], right: Sequence[SteeredWheel], heading: float) -> Array:
    """(2, N) toes of both wheels to the thrust line."""
    if len(left) != len(right):
        raise DegenerateInputError(
            field="series", expected="as many positions of both wheels", seen=f"{len(left)} and {len(right)}"
        )
    return np.array(
        [[wheel.axis.toe + SIGN[wheel.axis.side] * heading for wheel in series] for series in (left, right)]
    ).reshape(2, -1)


def _other(mine: Array, other: Array, at: float) -> float:
    """Angle of the other wheel where mine is at an angle."""
    order = np.argsort(mine)
    return float(np.interp(at, mine[order], other[order]))
