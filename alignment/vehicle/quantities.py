"""Quantities of a vehicle and their derivatives by the axes of its wheels and the widths of its tyres."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.values import SIDES
from alignment.vehicle.angles import SIGN
from alignment.vehicle.axles import EndPoints, ThrustSign
from alignment.vehicle.wheel_axes import AXIS_SIZE, FOUR_WHEELS, FRONT, REAR, Stand, TyreWidths, WheelAxis

SHORTEST_WHEELBASE_MM, LARGEST_YAW = 500.0, math.radians(10.0)


@dataclass(frozen=True, eq=False)
class Scalar:
    """A number and its derivatives (S,) by the state: the wheels' axes, then their tyres' widths."""

    value: float
    by_state: Array

    def __add__(self, other: Scalar) -> Scalar:
        return Scalar(self.value + other.value, self.by_state + other.by_state)

    def __sub__(self, other: Scalar) -> Scalar:
        return self + other * -1.0

    def __mul__(self, factor: float) -> Scalar:
        return Scalar(factor * self.value, factor * self.by_state)


@dataclass(frozen=True, eq=False)
class _Point:
    """A point (3,) of the stand's frame and its derivatives (3, S)."""

    value: Array
    by_state: Array

    def __add__(self, other: _Point) -> _Point:
        return _Point(self.value + other.value, self.by_state + other.by_state)

    def __sub__(self, other: _Point) -> _Point:
        return self + other * -1.0

    def __mul__(self, factor: float) -> _Point:
        return _Point(factor * self.value, factor * self.by_state)


class VehicleState:
    """The wheels as numbers with derivatives."""

    def __init__(self, names: tuple[str, ...], wheels: list[WheelAxis], tyres: TyreWidths) -> None:
        self.names = names
        self._wheels = dict(zip(names, wheels, strict=True))
        self._size = len(names) * (AXIS_SIZE + 1)
        self._widths = {FRONT: tyres.front_mm, REAR: tyres.rear_mm}

    def _first(self, name: str) -> int:
        return AXIS_SIZE * self.names.index(name)

    def _angle(self, name: str, value: float, place: int) -> Scalar:
        by_state = np.zeros(self._size)
        by_state[self._first(name) + place] = 1.0
        return Scalar(value, by_state)

    def camber(self, name: str) -> Scalar:
        """Against the normal of the road plane."""
        return self._angle(name, self._wheels[name].camber, 0)

    def toe(self, name: str) -> Scalar:
        """Against the stand's axis."""
        return self._angle(name, self._wheels[name].toe, 1)

    def sidewall(self, name: str) -> _Point:
        """The reference point."""
        by_state = np.zeros((3, self._size))
        first = self._first(name) + 2
        by_state[:, first : first + 3] = np.eye(3)
        return _Point(self._wheels[name].point, by_state)

    def centre(self, name: str) -> _Point:
        """Middle of the wheel, half a width inboard; of an unknown width the reference point, which the
        spread of widths moves all the same."""
        wheel, point = self._wheels[name], self.sidewall(name)
        half = 0.5 * (self._widths[name.rpartition("_")[0]] or 0.0)
        first = self._first(name)
        by_state = point.by_state
        by_state[:, first : first + 2] = -half * wheel.normal_by_angles
        by_state[:, AXIS_SIZE * len(self.names) + self.names.index(name)] = -0.5 * wheel.normal
        return _Point(point.value - half * wheel.normal, by_state)

    def contact(self, name: str, road_z: float) -> _Point:
        """Contact centre: in the wheel's plane and the vertical plane of its axis, on the road."""
        centre, n = self.centre(name), self._wheels[name].normal
        flat = np.array([n[0], n[1], 0.0])
        level = n[0] ** 2 + n[1] ** 2
        height = float(centre.value[2]) - road_z
        lean = n[2] / level
        by_normal = height * (
            lean * np.diag([1.0, 1.0, 0.0])
            + np.outer(flat, np.array([0.0, 0.0, 1.0]) / level - 2.0 * lean / level * flat)
        )
        by_state = centre.by_state.copy()
        by_state += lean * np.outer(flat, centre.by_state[2])
        first = self._first(name)
        by_state[:, first : first + 2] += by_normal @ self._wheels[name].normal_by_angles
        by_state[2] = 0.0
        value = centre.value + height * lean * flat
        value[2] = road_z
        return _Point(value, by_state)


def of_axles(state: VehicleState) -> dict[str, Scalar]:
    """Total toe and camber difference of every axle of which both wheels are known; no yaw changes them."""
    rows: dict[str, Scalar] = {}
    for axle in (FRONT, REAR):
        left, right = (f"{axle}_{side}" for side in SIDES)
        if left in state.names and right in state.names:
            rows[f"{axle}.total_toe"] = state.toe(left) + state.toe(right)
            rows[f"{axle}.camber_difference"] = state.camber(left) - state.camber(right)
    return rows


def of_four_wheels(
    state: VehicleState, stand: Stand, tyres: TyreWidths, thrust_sign: ThrustSign
) -> tuple[EndPoints, dict[str, Scalar]]:
    """Between what lengths are measured, and all quantities by name; raises as `vehicle_geometry`."""
    middles = {
        axle: (state.centre(f"{axle}_left") + state.centre(f"{axle}_right")) * 0.5 for axle in (FRONT, REAR)
    }
    along = middles[FRONT] - middles[REAR]
    yaw = _yaw(along)
    _check(state, yaw, along)
    frame = _Frame(yaw)
    rows: dict[str, Scalar] = {}
    toe: dict[str, Scalar] = {}
    for name in FOUR_WHEELS:
        # A vehicle that has turned to the left shows the stand less toe on the left.
        toe[name] = state.toe(name) + yaw * (SIGN["left"] if name.endswith("left") else SIGN["right"])
        rows[f"{name}.camber"], rows[f"{name}.toe"] = state.camber(name), toe[name]
    thrust = (toe["rear_right"] - toe["rear_left"]) * 0.5
    rows["front_left.toe_to_thrust"] = toe["front_left"] + thrust
    rows["front_right.toe_to_thrust"] = toe["front_right"] - thrust
    rows |= of_axles(state)
    rows["thrust_angle"] = thrust * (1.0 if thrust_sign == "left_positive" else -1.0)
    rows["yaw"] = yaw
    between, ends = _ends(state, stand, tyres)
    rows |= _lengths(state, frame, ends)
    length = frame.x(along)
    # The thrust line runs through the middle of the rear axle and leaves the centreline by the thrust angle.
    sine, cosine = math.sin(thrust.value), math.cos(thrust.value)
    rows["axle_offset"] = Scalar(
        -length.value * sine, -sine * length.by_state - length.value * cosine * thrust.by_state
    )
    middle = (middles[FRONT] + middles[REAR]) * 0.5
    for length_name, point, axis in (
        ("offset_front", middles[FRONT], 1),
        ("offset_rear", middles[REAR], 1),
        ("place_x", middle, 0),
        ("place_y", middle, 1),
    ):
        rows[length_name] = Scalar(float(point.value[axis]), point.by_state[axis])
    return between, rows


def _ends(state: VehicleState, stand: Stand, tyres: TyreWidths) -> tuple[EndPoints, dict[str, _Point]]:
    """Points between which lengths are measured."""
    if tyres.front_mm is None or tyres.rear_mm is None:
        return "sidewalls", {name: state.sidewall(name) for name in FOUR_WHEELS}
    if stand.road_z_mm is None:
        return "wheel_centres", {name: state.centre(name) for name in FOUR_WHEELS}
    return "contact_centres", {name: state.contact(name, stand.road_z_mm) for name in FOUR_WHEELS}


def _lengths(state: VehicleState, frame: _Frame, ends: Mapping[str, _Point]) -> dict[str, Scalar]:
    left, right = (frame.x(ends[f"{FRONT}_{side}"] - ends[f"{REAR}_{side}"]) for side in SIDES)
    rows = {"wheelbase_left": left, "wheelbase_right": right, "wheelbase_difference": left - right}
    for axle in (FRONT, REAR):
        across = ends[f"{axle}_left"] - ends[f"{axle}_right"]
        walls = state.sidewall(f"{axle}_left") - state.sidewall(f"{axle}_right")
        rows[f"track_{axle}"], rows[f"sidewall_track_{axle}"] = frame.y(across), frame.y(walls)
        rows[f"setback_{axle}"] = frame.x(across)
    return rows


def _yaw(along: _Point) -> Scalar:
    """Direction of a vector in the road plane, counter-clockwise from the stand's X seen from above."""
    x, y = float(along.value[0]), float(along.value[1])
    by_state = (x * along.by_state[1] - y * along.by_state[0]) / max(x * x + y * y, 1e-12)
    return Scalar(math.atan2(y, x), by_state)


class _Frame:
    """Axes of the vehicle in the road plane."""

    def __init__(self, yaw: Scalar) -> None:
        self._yaw = yaw
        self._x = np.array([math.cos(yaw.value), math.sin(yaw.value), 0.0])
        self._y = np.array([-math.sin(yaw.value), math.cos(yaw.value), 0.0])

    def x(self, vector: _Point) -> Scalar:
        """Part of a vector along the centreline."""
        turned = float(self._y @ vector.value) * self._yaw.by_state
        return Scalar(float(self._x @ vector.value), self._x @ vector.by_state + turned)

    def y(self, vector: _Point) -> Scalar:
        """Part of a vector to the left."""
        turned = float(self._x @ vector.value) * self._yaw.by_state
        return Scalar(float(self._y @ vector.value), self._y @ vector.by_state - turned)


def _check(state: VehicleState, yaw: Scalar, along: _Point) -> None:
    """Refuse wheels that do not stand as those of a vehicle."""
    length = float(np.hypot(*along.value[:2]))
    widths = {
        axle: float((state.sidewall(f"{axle}_left") - state.sidewall(f"{axle}_right")).value[1])
        for axle in (FRONT, REAR)
    }
    if length < SHORTEST_WHEELBASE_MM or min(widths.values()) < SHORTEST_WHEELBASE_MM:
        raise DegenerateInputError(
            field="wheels",
            expected=f"axles and wheels of an axle at least {SHORTEST_WHEELBASE_MM:g} mm apart, left to the "
            "left of right",
            seen=f"axles {length:.0f} mm apart, wheels {widths[FRONT]:.0f} and {widths[REAR]:.0f} mm",
            cure="Measure the rigs' poses in one frame with a gauge frame.",
        )
    if abs(yaw.value) > LARGEST_YAW:
        raise DegenerateInputError(
            field="wheels",
            expected=f"a vehicle that stands within {math.degrees(LARGEST_YAW):g}° of the stand's X",
            seen=f"{math.degrees(yaw.value):.1f}°",
            cure="Check that front and rear are not exchanged, and the rigs' poses.",
        )
