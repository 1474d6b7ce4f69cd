"""From the wheels' results and the vehicle type's limits to the angles that are judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from alignment.values import SIDES
from alignment.vehicle import (
    AxleAngles,
    VehicleAngles,
    WheelAngles,
    axle_angles,
    vehicle_angles,
)
from station.configuration import Tolerance, VehicleType
from station.cycle.positions import Failure, WheelResult
from station.cycle.verdict import Angle


@dataclass(frozen=True, eq=False)
class JudgedWheel:
    """One wheel with its two angles."""

    result: WheelResult
    camber: Angle
    toe: Angle

    @property
    def angles(self) -> tuple[Angle, ...]:
        """Camber and toe."""
        return self.camber, self.toe


@dataclass(frozen=True)
class JudgedAxle:
    """One axle; `values` is None when one of its wheels was not measured."""

    name: str
    values: AxleAngles | None
    total_toe: Angle
    camber_difference: Angle

    @property
    def angles(self) -> tuple[Angle, ...]:
        """Total toe and camber difference."""
        return self.total_toe, self.camber_difference


@dataclass(frozen=True)
class JudgedVehicle:
    """The angles that need all four wheels; `values` is None when one of them was not measured."""

    values: VehicleAngles | None
    thrust_angle: Angle

    @property
    def angles(self) -> tuple[Angle, ...]:
        """The thrust angle."""
        return (self.thrust_angle,)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All angles that were asked for.

    Attributes
    ----------
    wheels
        Every wheel that was asked for, measured or not.
    axles
        Every axle of which both wheels were asked for.
    vehicle
        None unless all four wheels of front and rear axle were asked for.
    coverage_factor
        k of the expanded uncertainties.
    """

    wheels: tuple[JudgedWheel, ...]
    axles: tuple[JudgedAxle, ...]
    vehicle: JudgedVehicle | None
    guard_band: bool
    coverage_factor: float

    @property
    def angles(self) -> Iterator[Angle]:
        """All angles, of wheels, axles and vehicle."""
        parts = (*self.wheels, *self.axles, *(() if self.vehicle is None else (self.vehicle,)))
        return (angle for part in parts for angle in part.angles)

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Why wheels have no angles."""
        found = (wheel.result.failure for wheel in self.wheels)
        return tuple(failure for failure in found if failure is not None)

    def without_images(self) -> Evaluation:
        """Return the same, to be kept."""
        wheels = tuple(replace(wheel, result=wheel.result.without_images()) for wheel in self.wheels)
        return replace(self, wheels=wheels)


def axle_of(wheel: str) -> str:
    """``front`` of ``front_left``."""
    return wheel.rpartition("_")[0]


def evaluate(kind: VehicleType, results: Sequence[WheelResult], coverage_factor: float) -> Evaluation:
    """Judge the results of a cycle.

    Parameters
    ----------
    kind
        The vehicle type; it has limits for the axle of every wheel in `results`.
    results
        One for each wheel that was asked for.
    coverage_factor
        k of the expanded uncertainty.
    """
    judge = _Judge(kind, {result.wheel: result for result in results}, coverage_factor)
    wheels = tuple(judge.wheel(result) for result in results)
    axles = tuple(
        judge.axle(axle)
        for axle in dict.fromkeys(axle_of(result.wheel) for result in results)
        if all(f"{axle}_{side}" in judge.results for side in SIDES)
    )
    whole = {"front", "rear"} <= {axle.name for axle in axles}
    return Evaluation(wheels, axles, judge.vehicle() if whole else None, kind.guard_band, coverage_factor)


@dataclass(frozen=True)
class _Judge:
    kind: VehicleType
    results: Mapping[str, WheelResult]
    k: float

    def wheel(self, result: WheelResult) -> JudgedWheel:
        tolerances = self.kind.axles[axle_of(result.wheel)]
        camber = self._declared(f"{result.wheel}.camber", tolerances.camber)
        toe = self._declared(f"{result.wheel}.toe", tolerances.toe)
        found = result.measurement
        if found is not None:
            camber = self._set(camber, found.camber, found.camber_u, result.wheel)
            toe = self._set(toe, found.toe, found.toe_u, result.wheel)
        return JudgedWheel(result, camber, toe)

    def axle(self, axle: str) -> JudgedAxle:
        tolerances = self.kind.axles[axle]
        total_toe = self._declared(f"{axle}.total_toe", tolerances.total_toe)
        difference = self._declared(f"{axle}.camber_difference", tolerances.camber_difference)
        names = tuple(f"{axle}_{side}" for side in SIDES)
        left, right = map(self._angles, names)
        if left is None or right is None:
            return JudgedAxle(axle, None, total_toe, difference)
        values = axle_angles(left, right)
        return JudgedAxle(
            axle,
            values,
            self._set(total_toe, values.total_toe, values.total_toe_u, *names),
            self._set(difference, values.camber_difference, values.camber_difference_u, *names),
        )

    def vehicle(self) -> JudgedVehicle:
        thrust = self._declared("thrust_angle", self.kind.thrust_angle)
        names = tuple(f"{axle}_{side}" for axle in ("front", "rear") for side in SIDES)
        front_left, front_right, rear_left, rear_right = map(self._angles, names)
        if front_left is None or front_right is None or rear_left is None or rear_right is None:
            return JudgedVehicle(None, thrust)
        values = vehicle_angles(front_left, front_right, rear_left, rear_right, self.kind.thrust_sign)
        return JudgedVehicle(values, self._set(thrust, values.thrust_angle, values.thrust_angle_u, *names))

    def _declared(self, name: str, tolerance: Tolerance | None) -> Angle:
        return Angle(name, None if tolerance is None else tolerance.limits(), self.kind.guard_band)

    def _set(self, angle: Angle, value: float, uncertainty: float, *wheels: str) -> Angle:
        valid = all(self.results[wheel].calibration_valid for wheel in wheels)
        return angle.measured(value, self.k * uncertainty, calibration_valid=valid)

    def _angles(self, wheel: str) -> WheelAngles | None:
        found = self.results[wheel].measurement
        if found is None:
            return None
        return WheelAngles(found.camber, found.toe, found.camber_u, found.toe_u)
