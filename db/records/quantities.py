"""Every quantity that is stored and judged: what people call it, its unit, and of what it is.

The one table behind queries, reports, exports and certificates. Databases hold radians and millimetres;
people and other programs get degrees and millimetres.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

VEHICLE = "vehicle"
"""The part that quantities of a whole vehicle belong to."""


class Quantity(enum.StrEnum):
    """The values that are stored: of a wheel, an axle, the vehicle, its geometry, its steering."""

    CAMBER = "camber"
    TOE = "toe"
    RUN_OUT = "run_out"
    TOTAL_TOE = "total_toe"
    CAMBER_DIFFERENCE = "camber_difference"
    THRUST_ANGLE = "thrust_angle"
    FRONT_TOE_LEFT_TO_THRUST = "front_toe_left_to_thrust"
    FRONT_TOE_RIGHT_TO_THRUST = "front_toe_right_to_thrust"
    YAW = "yaw"
    WHEELBASE_LEFT = "wheelbase_left"
    WHEELBASE_RIGHT = "wheelbase_right"
    WHEELBASE_DIFFERENCE = "wheelbase_difference"
    TRACK_FRONT = "track_front"
    TRACK_REAR = "track_rear"
    SIDEWALL_TRACK_FRONT = "sidewall_track_front"
    SIDEWALL_TRACK_REAR = "sidewall_track_rear"
    SETBACK_FRONT = "setback_front"
    SETBACK_REAR = "setback_rear"
    AXLE_OFFSET = "axle_offset"
    OFFSET_FRONT = "offset_front"
    OFFSET_REAR = "offset_rear"
    PLACE_X = "place_x"
    PLACE_Y = "place_y"
    STEERING_WHEEL = "steering_wheel"
    STEERING_WHEEL_OFFSET = "steering_wheel_offset"
    CASTER_DIFFERENCE = "caster_difference"
    KPI_DIFFERENCE = "kpi_difference"
    CASTER = "caster"
    KPI = "kpi"
    INCLUDED_ANGLE = "included_angle"
    TOE_OUT = "toe_out"
    TRAIL = "trail"
    SCRUB = "scrub"
    LOCK_LEFT = "lock_left"
    LOCK_RIGHT = "lock_right"


class Unit(enum.StrEnum):
    """Units in which values leave a database; the ends of columns' names."""

    DEGREES = "deg"
    MILLIMETRES = "mm"

    @property
    def sign(self) -> str:
        """As it is written behind a value."""
        return {Unit.DEGREES: "°", Unit.MILLIMETRES: " mm"}[self]

    @property
    def word(self) -> str:
        """As it is written beside an axis."""
        return {Unit.DEGREES: "degrees", Unit.MILLIMETRES: "millimetres"}[self]

    @property
    def decimals(self) -> int:
        """That a person reads: about a third of an arcsecond, and a micrometre."""
        return {Unit.DEGREES: 4, Unit.MILLIMETRES: 3}[self]

    @property
    def factor(self) -> float:
        """By which what is stored is multiplied."""
        return {Unit.DEGREES: math.degrees(1.0), Unit.MILLIMETRES: 1.0}[self]


Level = Literal["wheel", "axle", "vehicle", "geometry", "steering", "steering_axis"]
"""Which of the tables of results holds a quantity."""


@dataclass(frozen=True)
class Told:
    """What is known of a quantity.

    Attributes
    ----------
    label
        As people call it.
    unit
        In which it leaves the database.
    level
        Where it is stored.
    limited
        Whether a vehicle type may have limits for it.
    """

    label: str
    unit: Unit
    level: Level
    limited: bool = True


_DEG, _MM = Unit.DEGREES, Unit.MILLIMETRES
QUANTITIES: Mapping[Quantity, Told] = MappingProxyType(
    {
        Quantity.CAMBER: Told("Camber", _DEG, "wheel"),
        Quantity.TOE: Told("Toe", _DEG, "wheel"),
        Quantity.RUN_OUT: Told("Run-out", _MM, "wheel"),
        Quantity.TOTAL_TOE: Told("Total toe", _DEG, "axle"),
        Quantity.CAMBER_DIFFERENCE: Told("Camber difference", _DEG, "axle"),
        Quantity.THRUST_ANGLE: Told("Thrust angle", _DEG, "vehicle"),
        Quantity.FRONT_TOE_LEFT_TO_THRUST: Told("Front toe left to thrust line", _DEG, "vehicle", False),
        Quantity.FRONT_TOE_RIGHT_TO_THRUST: Told("Front toe right to thrust line", _DEG, "vehicle", False),
        Quantity.YAW: Told("Yaw on the stand", _DEG, "geometry"),
        Quantity.WHEELBASE_LEFT: Told("Wheelbase left", _MM, "geometry"),
        Quantity.WHEELBASE_RIGHT: Told("Wheelbase right", _MM, "geometry"),
        Quantity.WHEELBASE_DIFFERENCE: Told("Wheelbase difference", _MM, "geometry"),
        Quantity.TRACK_FRONT: Told("Track front", _MM, "geometry"),
        Quantity.TRACK_REAR: Told("Track rear", _MM, "geometry"),
        Quantity.SIDEWALL_TRACK_FRONT: Told("Track front between sidewalls", _MM, "geometry", False),
        Quantity.SIDEWALL_TRACK_REAR: Told("Track rear between sidewalls", _MM, "geometry", False),
        Quantity.SETBACK_FRONT: Told("Setback front", _MM, "geometry"),
        Quantity.SETBACK_REAR: Told("Setback rear", _MM, "geometry"),
        Quantity.AXLE_OFFSET: Told("Axle offset", _MM, "geometry"),
        Quantity.OFFSET_FRONT: Told("Front axle off the stand's middle", _MM, "geometry"),
        Quantity.OFFSET_REAR: Told("Rear axle off the stand's middle", _MM, "geometry"),
        Quantity.PLACE_X: Told("Place along the stand", _MM, "geometry", False),
        Quantity.PLACE_Y: Told("Place across the stand", _MM, "geometry", False),
        Quantity.STEERING_WHEEL: Told("Steering wheel as it stood", _DEG, "steering", False),
        Quantity.STEERING_WHEEL_OFFSET: Told("Steering wheel offset", _DEG, "steering"),
        Quantity.CASTER_DIFFERENCE: Told("Caster difference", _DEG, "steering"),
        Quantity.KPI_DIFFERENCE: Told("Kingpin inclination difference", _DEG, "steering"),
        Quantity.CASTER: Told("Caster", _DEG, "steering_axis"),
        Quantity.KPI: Told("Kingpin inclination", _DEG, "steering_axis"),
        Quantity.INCLUDED_ANGLE: Told("Included angle", _DEG, "steering_axis"),
        Quantity.TOE_OUT: Told("Toe-out on turns", _DEG, "steering_axis"),
        Quantity.TRAIL: Told("Caster trail", _MM, "steering_axis"),
        Quantity.SCRUB: Told("Scrub radius", _MM, "steering_axis"),
        Quantity.LOCK_LEFT: Told("Lock to the left", _DEG, "steering_axis", False),
        Quantity.LOCK_RIGHT: Told("Lock to the right", _DEG, "steering_axis", False),
    }
)
"""By quantity, in the order in which people read them."""


def of_level(level: Level) -> tuple[Quantity, ...]:
    """The quantities that one of the tables of results holds, in their order."""
    return tuple(quantity for quantity, told in QUANTITIES.items() if told.level == level)


OF_WHEEL, OF_AXLE = of_level("wheel"), of_level("axle")
OF_VEHICLE, OF_GEOMETRY = of_level("vehicle"), of_level("geometry")
OF_STEERING, OF_STEERING_AXIS = of_level("steering"), of_level("steering_axis")
GEOMETRY_LIMITED = tuple(quantity for quantity in OF_GEOMETRY if QUANTITIES[quantity].limited)
"""Quantities of a vehicle's geometry that a vehicle type may have limits for."""
