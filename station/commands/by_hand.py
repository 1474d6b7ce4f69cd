"""Steering wheel and ride heights said by hand: the angles of a recorded vehicle at straight ahead."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from alignment.vehicle import VehicleGeometry
    from station.configuration import VehicleType
    from station.cycle import Corrections

_FARTHEST_DEG = 1080.0


def corrections_by_hand(
    vehicle_type: Path | None,
    steering_wheel_deg: float | None,
    ride_heights: Sequence[str],
    wheels: Sequence[str],
) -> tuple[VehicleType, Corrections] | None:
    """Return the vehicle type and what is done to the angles of a vehicle; None where nothing was said.

    Raises
    ------
    InputError
        When what was said cannot be read, or there is no vehicle type that says what it means.
    """
    from alignment.errors import InputError
    from station.configuration import read_vehicle_type
    from station.cycle import RideHeights, SteeringSource, SteeringWheel, ToldOfVehicle, corrections_of

    if vehicle_type is None:
        said = [("steering wheel deg", steering_wheel_deg is not None), ("ride height", bool(ride_heights))]
        for choice, given in said:
            if given:
                raise InputError(
                    choice=choice,
                    expected="a vehicle type beside it, which says what it does to the angles",
                    seen="none",
                    cure="Name the file of the vehicle type",
                )
        return None
    kind = read_vehicle_type(vehicle_type)
    if steering_wheel_deg is not None and not abs(steering_wheel_deg) <= _FARTHEST_DEG:
        raise InputError(
            choice="steering wheel deg",
            expected=f"an angle within ±{_FARTHEST_DEG:g}°, positive to the left",
            seen=f"{steering_wheel_deg:g}",
        )
    steering = (
        None
        if steering_wheel_deg is None
        else SteeringWheel(steering_wheel_deg, source=SteeringSource.OPERATOR)
    )
    told = ToldOfVehicle(steering, RideHeights(_heights(ride_heights, wheels)))
    return kind, corrections_of(kind, tuple(wheels), (told,))


def _heights(said: Sequence[str], wheels: Sequence[str]) -> dict[str, float]:
    from alignment.errors import InputError

    found: dict[str, float] = {}
    for text in said:
        wheel, mark, number = text.partition("=")
        try:
            height = float(number)
        except ValueError:
            height = math.nan
        if not mark or wheel not in wheels or wheel in found or not math.isfinite(height):
            raise InputError(
                choice="ride height",
                expected=f"WHEEL=MILLIMETRES, each wheel of {', '.join(wheels)} at most once",
                seen=repr(text),
            )
        found[wheel] = height
    return found


def corrected_json(
    told: dict[str, Any],
    geometry: VehicleGeometry | None,
    kind: VehicleType,
    corrections: Corrections,
    coverage_factor: float,
) -> dict[str, Any]:
    """Return what is printed of a vehicle with its angles as they are judged, those as measured beside them.

    Parameters
    ----------
    told
        What is printed without any correction.
    geometry
        The vehicle; None where its wheels make none.
    kind, corrections
        The vehicle type, and what is done to the angles.
    coverage_factor
        k of the expanded uncertainties.
    """
    from alignment.vehicle import FOUR_WHEELS

    straight, whole = corrections.straight, geometry is not None and not geometry.missing
    wheels = {
        name: wheel | _wheel(name, wheel, corrections, coverage_factor)
        for name, wheel in told["wheels"].items()
    }
    out = told | {
        "vehicle_type": kind.name,
        "wheels": wheels,
        "straight_ahead": straight.state.value,
        "steering_wheel_deg": _deg(straight.wheel),
        "steering_wheel_u95_deg": _deg(straight.wheel_u, coverage_factor),
        "steer_deg": math.degrees(straight.steer),
        "steering_wheel_offset_deg": None,
        "steering_wheel_offset_u95_deg": None,
    }
    if geometry is not None:
        out["axles"] = {
            name: axle | _axle(name, axle, geometry, corrections, coverage_factor)
            for name, axle in told["axles"].items()
        }
    if geometry is not None and whole:
        angles = corrections.vehicle(geometry.angles)
        out["thrust_angle_deg"] = math.degrees(angles.thrust_angle)
        out["thrust_angle_u95_deg"] = _deg(angles.thrust_angle_u, coverage_factor)
        out |= _offset(geometry, kind, corrections, coverage_factor)
        to_thrust = (angles.front_toe_left_to_thrust, angles.front_toe_right_to_thrust)
        for name, toe in zip(FOUR_WHEELS, to_thrust, strict=False):
            wheels[name]["toe_to_thrust_deg"] = math.degrees(toe)
    said = [*corrections.refusals]
    said += [straight.reason] if straight.reason is not None and not straight.refused else []
    reasons = [*([] if told["reason"] is None else [told["reason"]]), *said]
    outcome = "refused" if corrections.refusals else told["outcome"]
    return out | {"reason": "; ".join(reasons) or None, "outcome": outcome}


def _wheel(name: str, told: dict[str, Any], corrections: Corrections, k: float) -> dict[str, Any]:
    from alignment.vehicle import WheelAngles

    height = corrections.height(name)
    out: dict[str, Any] = {
        "raw_camber_deg": told["camber_deg"],
        "raw_toe_deg": told["toe_deg"],
        "ride_height": height.outcome.value,
        "ride_height_mm": height.height_mm,
        "design_height_mm": height.design_mm,
    }
    if told["camber_deg"] is None:
        return out
    toe_known = told["toe_deg"] is not None
    camber, camber_u, toe, toe_u = (
        math.radians(told[key] or 0.0) for key in ("camber_deg", "camber_u95_deg", "toe_deg", "toe_u95_deg")
    )
    judged = corrections.wheel(name, WheelAngles(camber, toe, camber_u / k, toe_u / k))
    out |= {"camber_deg": math.degrees(judged.camber), "camber_u95_deg": _deg(judged.camber_u, k)}
    if toe_known:
        out |= {"toe_deg": math.degrees(judged.toe), "toe_u95_deg": _deg(judged.toe_u, k)}
    return out


def _axle(
    name: str, told: dict[str, Any], geometry: VehicleGeometry, corrections: Corrections, k: float
) -> dict[str, Any]:
    if told["total_toe_deg"] is None:
        return {}
    angles = corrections.axle(name, geometry.axle(name))
    return {
        "total_toe_deg": math.degrees(angles.total_toe),
        "total_toe_u95_deg": _deg(angles.total_toe_u, k),
        "camber_difference_deg": math.degrees(angles.camber_difference),
        "camber_difference_u95_deg": _deg(angles.camber_difference_u, k),
    }


def _offset(
    geometry: VehicleGeometry, kind: VehicleType, corrections: Corrections, k: float
) -> dict[str, Any]:
    from station.cycle import steering_wheel_offset

    straight, steering = corrections.straight, kind.steering
    if steering is None or straight.state.value != "checked" or corrections.refusals:
        return {}
    angles = corrections.vehicle(geometry.angles)
    left, right = "front_left.toe_to_thrust", "front_right.toe_to_thrust"
    half_toe = 0.5 * (angles.front_toe_left_to_thrust - angles.front_toe_right_to_thrust) - straight.steer
    half_toe_u = corrections.half_toe_u(geometry.u_of({left: 0.5, right: -0.5}))
    value, u = steering_wheel_offset(straight, steering, half_toe, half_toe_u)
    return {"steering_wheel_offset_deg": math.degrees(value), "steering_wheel_offset_u95_deg": _deg(u, k)}


def _deg(value: float | None, factor: float = 1.0) -> float | None:
    return None if value is None else math.degrees(factor * value)


def corrected_lines(told: dict[str, Any]) -> list[str]:
    """What is printed for people beside the table."""
    lines = []
    if told["straight_ahead"] == "checked":
        lines.append(
            f"toe is that of straight ahead: the steering wheel stood at {told['steering_wheel_deg']:+.2f}°, "
            f"which turns the front wheels by {told['steer_deg']:+.4f}° (positive to the left)"
        )
    if told["steering_wheel_offset_deg"] is not None:
        lines.append(
            f"steering wheel when driving straight ahead {told['steering_wheel_offset_deg']:+.2f}° ± "
            f"{told['steering_wheel_offset_u95_deg']:.2f}"
        )
    for name, wheel in told["wheels"].items():
        if wheel["ride_height"] == "corrected":
            lines.append(
                f"{name} stood at {wheel['ride_height_mm']:g} mm and is judged at "
                f"{wheel['design_height_mm']:g} mm: camber measured {wheel['raw_camber_deg']:+.4f}°"
            )
    return lines
