"""A simulated vehicle whose front wheels are steered about an axis, by a rack, with all that follows.

The wheel goes with its knuckle about the steering axis: normal, centre, and what leans on it. Where it rolls
on the road it turns by the scrub radius. Left out: the way of the vehicle's body on its springs while it is
steered, and the change of the scrub radius meanwhile (one per cent of the roll).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.vehicle import camber_toe, normal_from_angles
from sensors.simulation.scene import WheelPose
from sensors.simulation.vehicle import ROAD_Z_MM, Corner, Vehicle, side_of

FRONT_WHEELS = ("front_left", "front_right")
FULL_ANGLE = math.radians(10.0)
"""At which a bushing has given way by `SteeringGeometry.give`."""


@dataclass(frozen=True)
class SteeringGeometry:
    """The steering axis of a front wheel against the vehicle's own frame, straight ahead; angles radians.

    Attributes
    ----------
    caster, kpi
        Positive when the top leans rearward, and inboard.
    scrub_mm, trail_mm
        By which the axis meets the road inboard of the contact centre, and ahead of it.
    give
        By how much the axis leans further inboard at `FULL_ANGLE` to the left, growing with the cube of the
        angle: a bushing that gives way. 0: the axis stands still.
    bump_camber, bump_toe
        Change of camber and toe per millimetre by which the corner stands lower than designed, radians.
    """

    caster: float = math.radians(6.0)
    kpi: float = math.radians(12.0)
    scrub_mm: float = 12.0
    trail_mm: float = 22.0
    give: float = 0.0
    bump_camber: float = math.radians(-0.012)
    bump_toe: float = math.radians(0.004)


@dataclass(frozen=True, eq=False)
class SteeredVehicle:
    """A vehicle and how its front wheels are steered.

    Attributes
    ----------
    straight
        The vehicle with its steering straight ahead, at its design height.
    geometry
        By front wheel.
    ackermann
        Share of the angle by which an ideal linkage would turn the inner wheel farther: 1 rolls without slip.
    rolls
        Share of free rolling: 1 on the road, 0 with the brakes held on turn plates.
    lower_mm
        By corner, how much lower than designed it stands.
    """

    straight: Vehicle
    geometry: Mapping[str, SteeringGeometry]
    ackermann: float = 0.7
    rolls: float = 1.0
    lower_mm: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        missing = [wheel for wheel in FRONT_WHEELS if wheel not in self.geometry]
        if missing:
            raise DegenerateInputError(
                field="geometry", expected="an axis for each front wheel", seen=f"none for {missing[0]}"
            )

    def wheel_angles(self, steer: float) -> dict[str, float]:
        """Angles of the front wheels about their axes by that of the rack, radians, positive to the left."""
        spec = self.straight.spec
        out = {}
        for wheel, sign in zip(FRONT_WHEELS, (-1.0, 1.0), strict=True):
            # Both ideal wheels' axes meet on the line of the rear axle.
            tangent = math.tan(steer)
            half = 0.5 * spec.track_front_mm / spec.wheelbase_mm
            ideal = math.atan(tangent / (1.0 + sign * half * tangent))
            out[wheel] = steer + self.ackermann * (ideal - steer)
        return out

    def at(self, steer: float) -> Vehicle:
        """Return the vehicle with its steering turned by the rack, radians, positive to the left."""
        return replace(self.straight, corners={w: self.corner_at(steer, w) for w in self.straight.corners})

    def corner_at(self, steer: float, wheel: str) -> Corner:
        """Return one corner of `at`."""
        corner = self._lowered(wheel, self.straight.corners[wheel])
        angle = self.wheel_angles(steer).get(wheel)
        return corner if angle is None else self._turned(wheel, corner, angle)

    def axis(self, wheel: str) -> tuple[Array, Array]:
        """Direction (3,), upward, and where it meets the road (3,); vehicle's own frame, straight ahead."""
        corner, geometry = self.straight.corners[wheel], self.geometry[wheel]
        outboard = 1.0 if side_of(wheel) == "left" else -1.0
        direction = np.array([-math.tan(geometry.caster), -outboard * math.tan(geometry.kpi), 1.0])
        point = contact_centre(wheel, corner)
        point += [geometry.trail_mm, -outboard * geometry.scrub_mm, 0.0]
        return direction / np.linalg.norm(direction), point

    def _lowered(self, wheel: str, corner: Corner) -> Corner:
        lower = (self.lower_mm or {}).get(wheel, 0.0)
        if not lower:
            return corner
        geometry = self.geometry.get(wheel) or SteeringGeometry()
        return replace(
            corner,
            camber=corner.camber + lower * geometry.bump_camber,
            toe=corner.toe + lower * geometry.bump_toe,
        )

    def _turned(self, wheel: str, corner: Corner, angle: float) -> Corner:
        geometry, side = self.geometry[wheel], side_of(wheel)
        direction, point = self.axis(wheel)
        if geometry.give:
            outboard = 1.0 if side == "left" else -1.0
            direction = direction.copy()
            direction[1] -= outboard * geometry.give * (angle / FULL_ANGLE) ** 3
            direction /= np.linalg.norm(direction)
        turn = Rotation.from_rotvec(direction * angle)
        camber, toe = corner.angles
        centre = np.array(corner.centre_mm)
        # Rolled on the road about the outboard axis: a left wheel that is steered to the left goes back.
        level = normal_from_angles(camber, toe, side)[:2]
        arm = float(level @ (contact_centre(wheel, corner) - point)[:2]) / math.hypot(*level)
        rolled = -self.rolls * arm / (centre[2] - ROAD_Z_MM) * angle
        still = replace(corner.pose, camber=camber, toe=toe, run_out=0.0)
        carried = turn.as_matrix() @ still.vehicle_from_tyre(side)
        carried = carried @ Rotation.from_rotvec([0.0, 0.0, rolled]).as_matrix()
        new_camber, new_toe = camber_toe(turn.apply(normal_from_angles(camber, toe, side)), side)
        upright = WheelPose(camber=new_camber, toe=new_toe).vehicle_from_tyre(side)
        left_over = upright.T @ carried
        x, y, z = (float(c) for c in point + turn.apply(centre - point))
        return replace(
            corner,
            camber=corner.camber + new_camber - camber,
            toe=corner.toe + new_toe - toe,
            centre_mm=(x, y, z),
            pose=replace(corner.pose, spin=math.atan2(left_over[1, 0], left_over[0, 0])),
        )


def contact_centre(wheel: str, corner: Corner) -> Array:
    """(3,) where a wheel's plane, the vertical plane of its axis and the road meet; vehicle's own frame."""
    n = normal_from_angles(*corner.angles, side_of(wheel))
    middle = np.array(corner.centre_mm)
    height = middle[2] - ROAD_Z_MM
    lean = np.array([n[0], n[1], 0.0]) * n[2] / (n[0] ** 2 + n[1] ** 2)
    out: Array = middle + height * (lean - [0.0, 0.0, 1.0])
    return out


def draw_steering(
    vehicle: Vehicle, rolls: float = 1.0, give: float = 0.0, spread: float = math.radians(0.3)
) -> SteeredVehicle:
    """Draw the steering of a vehicle from its seed: axes about the usual ones, each wheel's another."""
    rng = np.random.default_rng([vehicle.seed, 12])
    geometry = {}
    for wheel in FRONT_WHEELS:
        usual = SteeringGeometry(give=give)
        caster, kpi = (float(v) for v in rng.normal((usual.caster, usual.kpi), spread))
        scrub, trail = (float(v) for v in rng.normal((usual.scrub_mm, usual.trail_mm), 2.0))
        geometry[wheel] = replace(usual, caster=caster, kpi=kpi, scrub_mm=scrub, trail_mm=trail)
    return SteeredVehicle(vehicle, geometry, rolls=rolls)


def straight_vehicle(vehicle: Vehicle) -> Vehicle:
    """Return a vehicle steered straight ahead: its front wheels have the same toe to the thrust line."""
    toe = {wheel: corner.angles[1] for wheel, corner in vehicle.corners.items()}
    thrust = 0.5 * (toe["rear_right"] - toe["rear_left"])
    off = 0.5 * (toe["front_left"] + thrust - (toe["front_right"] - thrust))
    corners = dict(vehicle.corners)
    for wheel, sign in zip(FRONT_WHEELS, (-1.0, 1.0), strict=True):
        corners[wheel] = replace(corners[wheel], toe=corners[wheel].toe + sign * off)
    return replace(vehicle, corners=corners)
