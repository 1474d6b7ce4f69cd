"""Angles of axles and of the vehicle, from the angles of single wheels, whatever measured them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

EndPoints = Literal["sidewalls", "wheel_centres", "contact_centres"]
"""Between what wheelbase, track and setback are measured."""
ThrustSign = Literal["left_positive", "right_positive"]


@dataclass(frozen=True)
class WheelAngles:
    """Camber and toe of one wheel, radians, with standard uncertainties (0 where none is stated)."""

    camber: float
    toe: float
    camber_u: float = 0.0
    toe_u: float = 0.0


@dataclass(frozen=True)
class AxleAngles:
    """Angles of one axle, radians.

    Attributes
    ----------
    total_toe
        Left plus right; positive is toe-in.
    camber_difference
        Left minus right.
    total_toe_u, camber_difference_u
        Standard uncertainties, the two wheels taken as independent.
    """

    total_toe: float
    camber_difference: float
    total_toe_u: float
    camber_difference_u: float


@dataclass(frozen=True)
class VehicleAngles:
    """Angles of the whole vehicle, radians.

    Attributes
    ----------
    front, rear
        Of the two axles.
    thrust_angle
        Half the difference of the rear toes, signed by `thrust_sign`.
    thrust_sign
        The convention, printed beside the value: ``left_positive`` is the default.
    front_toe_left_to_thrust, front_toe_right_to_thrust
        Toe of the front wheels measured from the thrust line instead of the vehicle axis.
    """

    front: AxleAngles
    rear: AxleAngles
    thrust_angle: float
    thrust_angle_u: float
    thrust_sign: ThrustSign
    front_toe_left_to_thrust: float
    front_toe_right_to_thrust: float


def axle_angles(left: WheelAngles, right: WheelAngles) -> AxleAngles:
    """Angles of one axle from its two wheels."""
    return AxleAngles(
        total_toe=left.toe + right.toe,
        camber_difference=left.camber - right.camber,
        total_toe_u=(left.toe_u**2 + right.toe_u**2) ** 0.5,
        camber_difference_u=(left.camber_u**2 + right.camber_u**2) ** 0.5,
    )


def vehicle_angles(
    front_left: WheelAngles,
    front_right: WheelAngles,
    rear_left: WheelAngles,
    rear_right: WheelAngles,
    thrust_sign: ThrustSign = "left_positive",
) -> VehicleAngles:
    """Angles of a two-axle vehicle from its four wheels.

    The thrust line is the direction in which the rear axle rolls; it leaves the vehicle axis by
    (toe of rear right − toe of rear left)/2, positive to the left. A toe-in left front wheel points to the
    right, so the thrust angle to the left adds to the left wheel's toe and is taken from the right one's.
    """
    thrust = (rear_right.toe - rear_left.toe) / 2.0
    return VehicleAngles(
        front=axle_angles(front_left, front_right),
        rear=axle_angles(rear_left, rear_right),
        thrust_angle=thrust if thrust_sign == "left_positive" else -thrust,
        thrust_angle_u=(rear_right.toe_u**2 + rear_left.toe_u**2) ** 0.5 / 2.0,
        thrust_sign=thrust_sign,
        front_toe_left_to_thrust=front_left.toe + thrust,
        front_toe_right_to_thrust=front_right.toe - thrust,
    )
