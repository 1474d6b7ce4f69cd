"""What a measurement of a simulated vehicle should find, from where its wheels truly stood."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.vehicle import FOUR_WHEELS, normal_from_angles
from sensors.formats.truth import LoadOptions, WheelTruth
from sensors.formats.vehicle import VehicleTruthFile, WheelOnVehicle
from sensors.simulation.vehicle import ROAD_Z_MM, SimulatedStand, Vehicle, side_of


@dataclass(frozen=True, eq=False)
class _Stood:
    """Points (3,) of a wheel as it stood, stand's frame."""

    reference: Array
    middle: Array
    contact: Array


def truth_of_vehicle(
    vehicle: Vehicle, stand: SimulatedStand, truths: Mapping[str, WheelTruth], turned: bool
) -> VehicleTruthFile:
    """Return the truth of a vehicle.

    Parameters
    ----------
    vehicle, stand
        As rendered.
    truths
        Of each wheel, angles against the stand's axes: of one exposure the tyre plane, of several the mean
        axis.
    turned
        Whether the wheels were turned between exposures.
    """
    wheels: dict[str, _Stood] = {wheel: _stood(vehicle, stand, wheel, truths[wheel]) for wheel in FOUR_WHEELS}
    front, rear = (
        0.5 * (wheels[f"{axle}_left"].middle + wheels[f"{axle}_right"].middle) for axle in ("front", "rear")
    )
    along = front - rear
    yaw = math.atan2(along[1], along[0])
    x, y = np.array([math.cos(yaw), math.sin(yaw), 0.0]), np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    # A vehicle that has turned to the left shows the stand less toe on the left.
    own = {wheel: math.degrees(yaw if side_of(wheel) == "left" else -yaw) for wheel in FOUR_WHEELS}
    toe = {wheel: truths[wheel].toe_deg + own[wheel] for wheel in FOUR_WHEELS}
    across = {
        axle: wheels[f"{axle}_left"].contact - wheels[f"{axle}_right"].contact for axle in ("front", "rear")
    }
    walls = {
        axle: wheels[f"{axle}_left"].reference - wheels[f"{axle}_right"].reference
        for axle in ("front", "rear")
    }
    lengths = {
        side: float(x @ (wheels[f"front_{side}"].contact - wheels[f"rear_{side}"].contact))
        for side in ("left", "right")
    }
    place = 0.5 * (front + rear)
    return VehicleTruthFile(
        seed=vehicle.seed,
        wheels={
            wheel: _wheel(vehicle, wheel, truths[wheel], toe[wheel], own[wheel], wheels[wheel], turned)
            for wheel in FOUR_WHEELS
        },
        total_toe_front_deg=toe["front_left"] + toe["front_right"],
        total_toe_rear_deg=toe["rear_left"] + toe["rear_right"],
        thrust_angle_deg=0.5 * (toe["rear_right"] - toe["rear_left"]),
        yaw_deg=math.degrees(yaw),
        place_mm=(float(place[0]), float(place[1])),
        wheelbase_left_mm=lengths["left"],
        wheelbase_right_mm=lengths["right"],
        track_front_mm=float(y @ across["front"]),
        track_rear_mm=float(y @ across["rear"]),
        sidewall_track_front_mm=float(y @ walls["front"]),
        sidewall_track_rear_mm=float(y @ walls["rear"]),
        setback_front_mm=float(x @ across["front"]),
        setback_rear_mm=float(x @ across["rear"]),
    )


def _stood(vehicle: Vehicle, stand: SimulatedStand, wheel: str, truth: WheelTruth) -> _Stood:
    side = side_of(wheel)
    normal = normal_from_angles(math.radians(truth.camber_deg), math.radians(truth.toe_deg), side)
    origin = stand.rigs[wheel].vehicle_from_rig.apply(np.array(truth.centre_mm))
    reference = origin + vehicle.tyre.outermost_mm * normal
    middle = reference - 0.5 * vehicle.corners[wheel].tyre_width_mm * normal
    # Down in the wheel's plane, in the vertical plane of its axis, to the road.
    down = np.array([normal[0], normal[1], 0.0]) * normal[2] / (normal[0] ** 2 + normal[1] ** 2)
    contact = middle + (middle[2] - ROAD_Z_MM) * (down - [0.0, 0.0, 1.0])
    return _Stood(reference, middle, contact)


def _wheel(
    vehicle: Vehicle,
    wheel: str,
    truth: WheelTruth,
    toe_deg: float,
    own_deg: float,
    stood: _Stood,
    turned: bool,
) -> WheelOnVehicle:
    corner = vehicle.corners[wheel]
    a, b, c = (float(value) for value in stood.reference)
    return WheelOnVehicle(
        kind="spin_axis" if turned else "tyre_plane",
        camber_deg=truth.camber_deg,
        toe_deg=toe_deg,
        stand_toe_deg=truth.toe_deg,
        spin_camber_deg=truth.spin_camber_deg,
        spin_toe_deg=truth.spin_toe_deg + own_deg,
        reference_mm=(a, b, c),
        tyre_width_mm=corner.tyre_width_mm,
        runout_mm=truth.runout_mm,
        load=None if corner.load is None else LoadOptions.of(corner.load),
        rod_turns=corner.rod_turns,
        bolt_turns=corner.bolt_turns,
    )
