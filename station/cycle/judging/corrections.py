"""Measured angles brought to where they are judged: straight ahead, and at the design height."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from alignment.values import SIDES
from alignment.vehicle import FOUR_WHEELS, AxleAngles, VehicleAngles, WheelAngles
from station.configuration import VehicleType
from station.cycle.judging.ride_height import NO_HEIGHT, HeightOutcome, HeightUsed, ride_height
from station.cycle.judging.straight_ahead import (
    NOTHING_ASKED,
    STEERED,
    SteeringFound,
    StraightAheadState,
    straight_ahead,
)
from station.cycle.words import ToldOfVehicle


@dataclass(frozen=True)
class Corrections:
    """What is done to the angles of a vehicle before they are judged, and what is not judged for that.

    Attributes
    ----------
    straight
        What is known of straight ahead.
    heights
        By wheel.
    """

    straight: SteeringFound = NOTHING_ASKED
    heights: Mapping[str, HeightUsed] = field(default_factory=dict)

    def height(self, wheel: str) -> HeightUsed:
        """The ride height of a wheel."""
        return self.heights.get(wheel, NO_HEIGHT)

    def changes(self, wheel: str) -> bool:
        """Whether the angles of a wheel are corrected."""
        steered = wheel in STEERED and self.straight.state is StraightAheadState.CHECKED
        return steered or self.height(wheel).outcome is HeightOutcome.CORRECTED

    def height_refused(self, wheels: Iterable[str]) -> bool:
        """Whether one of these wheels has a ride height with which it is not judged."""
        return any(self.height(wheel).refused for wheel in wheels)

    def toe_refused(self, wheel: str) -> bool:
        """Whether the individual toe of a wheel is not judged."""
        return self.height(wheel).refused or (wheel in STEERED and self.straight.refused)

    @property
    def refusals(self) -> tuple[str, ...]:
        """Why something is not judged, in words; empty when all is."""
        said = [self.straight.reason] if self.straight.refused else []
        said += [f"{wheel} {used.reason}" for wheel, used in self.heights.items() if used.refused]
        return tuple(reason for reason in said if reason is not None)

    def wheel(self, name: str, raw: WheelAngles) -> WheelAngles:
        """Return the angles of a wheel as they are judged."""
        return self.straight.wheel_at_straight(name, self.height(name).at_design(raw))

    def axle(self, name: str, raw: AxleAngles) -> AxleAngles:
        """Return the angles of an axle as they are judged."""
        left, right = (self.height(f"{name}_{side}") for side in SIDES)
        at_design = AxleAngles(
            raw.total_toe + left.toe + right.toe,
            raw.camber_difference + left.camber - right.camber,
            math.hypot(raw.total_toe_u, left.toe_u, right.toe_u),
            math.hypot(raw.camber_difference_u, left.camber_u, right.camber_u),
        )
        return self.straight.axle_at_straight(name, at_design)

    def vehicle(self, raw: VehicleAngles) -> VehicleAngles:
        """Return the angles of a vehicle as they are judged."""
        front_left, front_right, rear_left, rear_right = map(self.height, FOUR_WHEELS)
        # To the left, whatever the sign of the thrust angle.
        thrust = 0.5 * (rear_right.toe - rear_left.toe)
        sign = 1.0 if raw.thrust_sign == "left_positive" else -1.0
        steer = self.straight.steer
        return replace(
            raw,
            front=self.axle("front", raw.front),
            rear=self.axle("rear", raw.rear),
            thrust_angle=raw.thrust_angle + sign * thrust,
            thrust_angle_u=math.hypot(raw.thrust_angle_u, 0.5 * rear_left.toe_u, 0.5 * rear_right.toe_u),
            front_toe_left_to_thrust=raw.front_toe_left_to_thrust + front_left.toe + thrust + steer,
            front_toe_right_to_thrust=raw.front_toe_right_to_thrust + front_right.toe - thrust - steer,
        )

    def half_toe_u(self, raw_u: float) -> float:
        """Return the standard uncertainty of half the difference of front toes at design height, radians."""
        return math.hypot(raw_u, *(0.5 * self.height(wheel).toe_u for wheel in FOUR_WHEELS))


NO_CORRECTIONS = Corrections()


def corrections_of(kind: VehicleType, wheels: Sequence[str], told: Sequence[ToldOfVehicle]) -> Corrections:
    """Return what is done to the angles of some wheels.

    Parameters
    ----------
    kind
        The vehicle type, which says what is corrected.
    wheels
        Those that were asked for.
    told
        What the line told at several moments, in their order: before the exposures and after them. The last
        ride heights count, and all angles of the steering wheel.
    """
    steered = kind.steering if any(wheel in STEERED for wheel in wheels) else None
    heights = told[-1].heights if told else None
    return Corrections(
        straight_ahead(steered, [each.steering for each in told]),
        {wheel: ride_height(kind.ride_height, wheel, heights) for wheel in wheels},
    )
