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
from station.cycle.judging.corrections import NO_CORRECTIONS, Corrections, corrections_of
from station.cycle.judging.straight_ahead import StraightAheadState, steering_wheel_offset
from station.cycle.judging.verdict import Angle, Status, missed_in_words
from station.cycle.wheels import CommonFrame, WheelResult, geometry_of, whole_vehicle
from station.cycle.words import Failure, ToldOfVehicle


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
        to and `toe` has a value, else against the stand's axis; None when it was not measured. They are those
        of straight ahead and of the design height as far as `Evaluation.corrections` say.
    camber, toe
        Unset where its ride height forbids to judge it. Toe also where straight ahead is not known, and where
        it refers to a vehicle that was not wholly measured.
    raw
        The same angles as measured, before any correction.
    """

    result: WheelResult
    values: WheelAngles | None
    camber: Angle
    toe: Angle
    run_out: JudgedRunOut | None = None
    raw: WheelAngles | None = None

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
    steering_wheel_offset
        How the steering wheel stands when the vehicle drives straight ahead; unset where straight ahead is to
        be checked and is not known, None where nobody asked or the vehicle type does without.
    steering_wheel_offset_u
        Its standard uncertainty; None without a value.
    """

    values: VehicleAngles | None
    thrust_angle: Angle
    geometry: VehicleGeometry | None = None
    lengths: tuple[Angle, ...] = ()
    steering_wheel_offset: Angle | None = None
    steering_wheel_offset_u: float | None = None

    @property
    def angles(self) -> tuple[Angle, ...]:
        """The thrust angle, the lengths that are judged, and the steering wheel's offset."""
        offset = () if self.steering_wheel_offset is None else (self.steering_wheel_offset,)
        return (self.thrust_angle, *self.lengths, *offset)


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
    corrections
        What was done to the angles before they were judged, and what is not judged for that.
    """

    wheels: tuple[JudgedWheel, ...]
    axles: tuple[JudgedAxle, ...]
    vehicle: JudgedVehicle | None
    guard_band: bool
    coverage_factor: float
    reference: Reference = "stand"
    problem: str | None = None
    corrections: Corrections = NO_CORRECTIONS

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
    told: Sequence[ToldOfVehicle] = (),
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
    told
        What the line told of steering wheel and ride heights before the exposures and after them. Nothing
        unless it is given: what a vehicle type requires of them is then not known.
    """
    by_name = {result.wheel: result for result in results}
    geometry, problem = geometry_of(frame, kind, by_name, coverage_factor)
    corrected = corrections_of(kind, tuple(by_name), told)
    judge = _Judge(kind, by_name, coverage_factor, corrected, frame, geometry)
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
        corrected,
    )


REAR_WHEELS = tuple(wheel for wheel in FOUR_WHEELS if axle_of(wheel) == "rear")
STEERING_WHEEL_OFFSET = "steering_wheel_offset"


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
    corrections: Corrections
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
        raw = self._raw(result.wheel)
        if raw is None:
            return JudgedWheel(result, None, camber, toe, self._run_out(result))
        values = self.corrections.wheel(result.wheel, raw)
        if not self.corrections.height_refused([result.wheel]):
            camber = self._set(camber, values.camber, values.camber_u, result.wheel)
        if not self.corrections.toe_refused(result.wheel):
            if self.reference == "stand":
                toe = self._set(toe, values.toe, values.toe_u, result.wheel)
            elif self.own is not None and result.wheel in FOUR_WHEELS:
                # What the other wheels rest on is in the centreline.
                toe = self._set(toe, values.toe, values.toe_u, *FOUR_WHEELS)
        return JudgedWheel(result, values, camber, toe, self._run_out(result), raw)

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
        left, right = map(self._raw, names)
        if left is None or right is None:
            return JudgedAxle(axle, None, total_toe, difference)
        known = self.own is not None and f"{axle}.total_toe" in self.own
        raw = self.own.axle(axle) if known and self.own is not None else axle_angles(left, right)
        values = self.corrections.axle(axle, raw)
        if not self.corrections.height_refused(names):
            total_toe = self._set(total_toe, values.total_toe, values.total_toe_u, *names)
            difference = self._set(difference, values.camber_difference, values.camber_difference_u, *names)
        return JudgedAxle(axle, values, total_toe, difference)

    def vehicle(self) -> JudgedVehicle:
        thrust = self._declared("thrust_angle", self.kind.thrust_angle)
        lengths = self._lengths()
        raw = self._raw_vehicle()
        if raw is None:
            return JudgedVehicle(None, thrust, self.geometry, lengths, self._declared_offset())
        values = self.corrections.vehicle(raw)
        if not self.corrections.height_refused(REAR_WHEELS):
            thrust = self._set(thrust, values.thrust_angle, values.thrust_angle_u, *FOUR_WHEELS)
        return JudgedVehicle(values, thrust, self.geometry, lengths, *self._offset(raw, values))

    def _raw_vehicle(self) -> VehicleAngles | None:
        if self.reference == "vehicle":
            return None if self.own is None else self.own.angles
        front_left, front_right, rear_left, rear_right = map(self._raw, FOUR_WHEELS)
        if front_left is None or front_right is None or rear_left is None or rear_right is None:
            return None
        return vehicle_angles(front_left, front_right, rear_left, rear_right, self.kind.thrust_sign)

    def _declared_offset(self) -> Angle | None:
        steering = self.kind.steering
        known = self.corrections.straight.state in (StraightAheadState.CHECKED, StraightAheadState.REFUSED)
        return (
            None if steering is None or not known else self._declared(STEERING_WHEEL_OFFSET, steering.offset)
        )

    def _offset(self, raw: VehicleAngles, values: VehicleAngles) -> tuple[Angle | None, float | None]:
        """How the steering wheel stands when the vehicle drives straight ahead, and its uncertainty."""
        declared, straight, steering = self._declared_offset(), self.corrections.straight, self.kind.steering
        checked = straight.state is StraightAheadState.CHECKED
        if (
            declared is None
            or steering is None
            or not checked
            or self.corrections.height_refused(FOUR_WHEELS)
        ):
            return declared, None
        # As the wheels stand.
        half_toe = 0.5 * (values.front_toe_left_to_thrust - values.front_toe_right_to_thrust) - straight.steer
        half_toe_u = self.corrections.half_toe_u(self._half_toe_u(raw))
        value, u = steering_wheel_offset(straight, steering, half_toe, half_toe_u)
        return self._set(declared, value, u, *FOUR_WHEELS), u

    def _half_toe_u(self, raw: VehicleAngles) -> float:
        """Of half the difference of measured front toes against the thrust line."""
        if self.own is not None:
            left, right = (f"front_{side}.toe_to_thrust" for side in SIDES)
            return self.own.u_of({left: 0.5, right: -0.5})
        toes_u = [self.results[f"front_{side}"].measurement for side in SIDES]
        parts = [0.5 * found.toe_u for found in toes_u if found is not None]
        return math.hypot(*parts, raw.thrust_angle_u)

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

    def _raw(self, wheel: str) -> WheelAngles | None:
        found = self.results[wheel].measurement
        if found is None:
            return None
        own = self.own
        if own is None or f"{wheel}.toe" not in own:
            return WheelAngles(found.camber, found.toe, found.camber_u, found.toe_u)
        camber, toe = f"{wheel}.camber", f"{wheel}.toe"
        return WheelAngles(own.value(camber), own.value(toe), own.u(camber), own.u(toe))
