"""From the wheels' results and the vehicle type's limits to the angles that are judged."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from alignment.values import SIDES
from alignment.vehicle import (
    FOUR_WHEELS,
    LENGTHS,
    AxleAngles,
    VehicleAngles,
    VehicleGeometry,
    WheelAngles,
    axle_angles,
    vehicle_angles,
)
from alignment.wheel import run_out_mm
from db.records import Reference
from station.configuration import LengthTolerance, Limits, Tolerance, VehicleType
from station.cycle.failure import Failure
from station.cycle.frame import CommonFrame, geometry_of, whole_vehicle
from station.cycle.positions import WheelResult
from station.cycle.verdict import Angle, Status, missed_in_words


@dataclass(frozen=True)
class JudgedRunOut:
    """Run-out of a tyre, which has a verdict of its own: no turn of a tie rod changes it.

    The wheel's verdict is that of its angles, for whoever adjusts them; the vehicle's holds the run-out too.

    Attributes
    ----------
    size
        Millimetres peak to peak, with its limits; 0 with what may hide where none was told.
    u_mm
        Its standard uncertainty.
    radius_mm
        At which it is told.
    high_spot, high_spot_u
        Where the tyre stood out farthest at the last exposure, radians from the top, counter-clockwise seen
        from outboard, and its standard uncertainty; None where no run-out was told.
    """

    size: Angle
    u_mm: float
    radius_mm: float
    high_spot: float | None
    high_spot_u: float | None

    @property
    def value_mm(self) -> float:
        """Peak to peak."""
        return self.size.value or 0.0

    @property
    def u95_mm(self) -> float:
        """Expanded uncertainty."""
        return self.size.expanded_uncertainty or 0.0

    @property
    def most_mm(self) -> float | None:
        """Largest accepted value; None without a limit."""
        return None if self.size.limits is None else self.size.limits.high


@dataclass(frozen=True, eq=False)
class JudgedWheel:
    """One wheel with its two angles, and the run-out where a series told of it.

    Attributes
    ----------
    values
        Its angles and their uncertainties: toe against the vehicle's centreline where that is what toes refer
        to and `toe` has a value, else against the stand's axis; None when it was not measured.
    toe
        Unset where it refers to a vehicle that was not wholly measured.
    """

    result: WheelResult
    values: WheelAngles | None
    camber: Angle
    toe: Angle
    run_out: JudgedRunOut | None = None

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
    """What needs all four wheels; `values` is None when one of them was not measured.

    Attributes
    ----------
    geometry
        Everything that the axes of its wheels say; None also where the rigs stand in no common frame.
    lengths
        Those lengths, and the yaw, for which the vehicle type has limits; empty without a common frame.
    """

    values: VehicleAngles | None
    thrust_angle: Angle
    geometry: VehicleGeometry | None = None
    lengths: tuple[Angle, ...] = ()

    @property
    def angles(self) -> tuple[Angle, ...]:
        """The thrust angle, and the lengths that are judged."""
        return (self.thrust_angle, *self.lengths)


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
    reference
        What individual toe and thrust angle refer to.
    problem
        Why the wheels make no vehicle, in words; None where they do, and where nobody asked.
    """

    wheels: tuple[JudgedWheel, ...]
    axles: tuple[JudgedAxle, ...]
    vehicle: JudgedVehicle | None
    guard_band: bool
    coverage_factor: float
    reference: Reference = "stand"
    problem: str | None = None

    @property
    def angles(self) -> Iterator[Angle]:
        """All angles, of wheels, axles and vehicle."""
        parts = (*self.wheels, *self.axles, *(() if self.vehicle is None else (self.vehicle,)))
        return (angle for part in parts for angle in part.angles)

    @property
    def judged(self) -> Iterator[Angle]:
        """All that decides of the vehicle: the angles, and the run-outs."""
        yield from self.angles
        yield from (wheel.run_out.size for wheel in self.wheels if wheel.run_out is not None)

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


def evaluate(
    kind: VehicleType,
    results: Sequence[WheelResult],
    coverage_factor: float,
    frame: CommonFrame | None = None,
) -> Evaluation:
    """Judge the results of a cycle.

    Parameters
    ----------
    kind
        The vehicle type; it has limits for the axle of every wheel in `results`.
    results
        One for each wheel that was asked for.
    coverage_factor
        k of the expanded uncertainty.
    frame
        Common frame of the rigs, and what toes refer to; None where there is none: they refer to the stand.
    """
    by_name = {result.wheel: result for result in results}
    geometry, problem = geometry_of(frame, kind, by_name, coverage_factor)
    judge = _Judge(kind, by_name, coverage_factor, frame, geometry)
    wheels = tuple(judge.wheel(result) for result in results)
    axles = tuple(
        judge.axle(axle)
        for axle in dict.fromkeys(axle_of(result.wheel) for result in results)
        if all(f"{axle}_{side}" in judge.results for side in SIDES)
    )
    whole = {"front", "rear"} <= {axle.name for axle in axles}
    return Evaluation(
        wheels,
        axles,
        judge.vehicle() if whole else None,
        kind.guard_band,
        coverage_factor,
        judge.reference,
        problem,
    )


def missed_limits(evaluation: Evaluation) -> list[str]:
    """What is out of its limits, each in words."""
    missed = [angle for angle in evaluation.angles if angle.status is Status.NOK]
    said = [missed_in_words(angle) if angle.name not in LENGTHS else _in_words(angle) for angle in missed]
    for wheel in evaluation.wheels:
        found = wheel.run_out
        if found is not None and found.size.status is Status.NOK:
            said.append(
                f"{wheel.result.wheel} run-out {found.value_mm:.3f} ± {found.u95_mm:.3f} mm, limit "
                f"{found.most_mm:g} mm"
            )
    return said


def lengths_missed(evaluation: Evaluation) -> str | None:
    """The sentence that says which lengths, or the yaw, are out of their limits; None when none is."""
    vehicle = evaluation.vehicle
    missed = [] if vehicle is None else [each for each in vehicle.lengths if each.status is Status.NOK]
    return "; ".join(map(_in_words, missed)) or None


def _in_words(angle: Angle) -> str:
    assert angle.value is not None
    assert angle.limits is not None
    assert angle.expanded_uncertainty is not None
    factor, unit = (1.0, " mm") if angle.name in LENGTHS else (math.degrees(1.0), "°")
    value, u95, low, high = (
        factor * each
        for each in (angle.value, angle.expanded_uncertainty, angle.limits.low, angle.limits.high)
    )
    return f"{angle.name} is {value:.3f} ± {u95:.3f}{unit}, accepted are {low:g} to {high:g}{unit}"


@dataclass(frozen=True)
class _Judge:
    kind: VehicleType
    results: Mapping[str, WheelResult]
    k: float
    frame: CommonFrame | None = None
    geometry: VehicleGeometry | None = None

    @property
    def reference(self) -> Reference:
        return "stand" if self.frame is None else self.frame.reference

    @property
    def own(self) -> VehicleGeometry | None:
        """The vehicle, where toes refer to it and it is known."""
        return self.geometry if self.reference == "vehicle" else None

    def wheel(self, result: WheelResult) -> JudgedWheel:
        tolerances = self.kind.axles[axle_of(result.wheel)]
        camber = self._declared(f"{result.wheel}.camber", tolerances.camber)
        toe = self._declared(f"{result.wheel}.toe", tolerances.toe)
        values = self._angles(result.wheel)
        if values is not None:
            camber = self._set(camber, values.camber, values.camber_u, result.wheel)
            if self.reference == "stand":
                toe = self._set(toe, values.toe, values.toe_u, result.wheel)
            elif self.own is not None and result.wheel in FOUR_WHEELS:
                # What the other wheels rest on is in the centreline.
                toe = self._set(toe, values.toe, values.toe_u, *FOUR_WHEELS)
        return JudgedWheel(result, values, camber, toe, self._run_out(result))

    def _run_out(self, result: WheelResult) -> JudgedRunOut | None:
        spin = result.spin
        if spin is None:
            return None
        radius_mm, most_mm = self.kind.run_out_radius_mm, self.kind.axles[axle_of(result.wheel)].run_out_mm
        # It has a size and no sign; the lower limit is there for the form.
        limits = None if most_mm is None else Limits(-most_mm, most_mm)
        value_mm, u_mm = (run_out_mm(tilt, radius_mm) for tilt in (spin.run_out or 0.0, spin.run_out_u))
        size = Angle(f"{result.wheel}.run_out", limits, self.kind.guard_band)
        size = self._set(size, value_mm, u_mm, result.wheel)
        return JudgedRunOut(size, u_mm, radius_mm, spin.high_spot, spin.high_spot_u)

    def axle(self, axle: str) -> JudgedAxle:
        tolerances = self.kind.axles[axle]
        total_toe = self._declared(f"{axle}.total_toe", tolerances.total_toe)
        difference = self._declared(f"{axle}.camber_difference", tolerances.camber_difference)
        names = tuple(f"{axle}_{side}" for side in SIDES)
        left, right = map(self._angles, names)
        if left is None or right is None:
            return JudgedAxle(axle, None, total_toe, difference)
        known = self.own is not None and f"{axle}.total_toe" in self.own
        values = self.own.axle(axle) if known and self.own is not None else axle_angles(left, right)
        return JudgedAxle(
            axle,
            values,
            self._set(total_toe, values.total_toe, values.total_toe_u, *names),
            self._set(difference, values.camber_difference, values.camber_difference_u, *names),
        )

    def vehicle(self) -> JudgedVehicle:
        thrust = self._declared("thrust_angle", self.kind.thrust_angle)
        lengths = self._lengths()
        values = self._vehicle_angles()
        if values is None:
            return JudgedVehicle(None, thrust, self.geometry, lengths)
        thrust = self._set(thrust, values.thrust_angle, values.thrust_angle_u, *FOUR_WHEELS)
        return JudgedVehicle(values, thrust, self.geometry, lengths)

    def _vehicle_angles(self) -> VehicleAngles | None:
        if self.reference == "vehicle":
            return None if self.own is None else self.own.angles
        front_left, front_right, rear_left, rear_right = map(self._angles, FOUR_WHEELS)
        if front_left is None or front_right is None or rear_left is None or rear_right is None:
            return None
        return vehicle_angles(front_left, front_right, rear_left, rear_right, self.kind.thrust_sign)

    def _lengths(self) -> tuple[Angle, ...]:
        """Judge lengths and yaw for which there are limits, of a vehicle that was asked for as a whole."""
        if self.frame is None or not whole_vehicle(self.results):
            return ()
        limits: dict[str, LengthTolerance | Tolerance] = dict(self.kind.lengths.stated)
        if self.kind.yaw is not None:
            limits["yaw"] = self.kind.yaw
        declared = [self._declared(name, tolerance) for name, tolerance in limits.items()]
        if self.geometry is None:
            return tuple(declared)
        found = self.geometry
        return tuple(
            self._set(each, found.value(each.name), found.u(each.name), *FOUR_WHEELS) for each in declared
        )

    def _declared(self, name: str, tolerance: Tolerance | LengthTolerance | None) -> Angle:
        return Angle(name, None if tolerance is None else tolerance.limits(), self.kind.guard_band)

    def _set(self, angle: Angle, value: float, uncertainty: float, *wheels: str) -> Angle:
        valid = all(self.results[wheel].calibration_valid for wheel in wheels)
        return angle.measured(value, self.k * uncertainty, calibration_valid=valid)

    def _angles(self, wheel: str) -> WheelAngles | None:
        found = self.results[wheel].measurement
        if found is None:
            return None
        own = self.own
        if own is None or f"{wheel}.toe" not in own:
            return WheelAngles(found.camber, found.toe, found.camber_u, found.toe_u)
        camber, toe = f"{wheel}.camber", f"{wheel}.toe"
        return WheelAngles(own.value(camber), own.value(toe), own.u(camber), own.u(toe))
