"""The steering axes of a vehicle from the positions of a sweep: found, and judged by its type's limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from alignment.errors import DegenerateInputError
from alignment.measure_steering import steered_wheels
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import Refusal, WheelMeasurement
from alignment.vehicle import (
    SIGN,
    RunOut,
    SteeredPair,
    SteeredWheel,
    SteeringAxis,
    SteeringRules,
    SteeringStand,
    steered_pair,
    steering_axis,
    straight_toe,
)
from station.configuration import VehicleType
from station.cycle.judging.straight_ahead import STEERED
from station.cycle.judging.verdict import Angle, Status, combined
from station.cycle.wheels import CommonFrame, WheelResult
from station.cycle.words import AXIS_DIFFERENCES, AXIS_QUANTITIES

_EXPECTED_LEAN = 4.0 * ARCMIN
"""Lean of a tyre plane from its spin axis that is expected, each way, one standard deviation."""
_REAR = ("rear_left", "rear_right")
Swept = Mapping[str, Mapping[int, WheelResult]]
"""What came of each steered wheel, by the number of the position."""


@dataclass(frozen=True, eq=False)
class JudgedAxis:
    """The steering axis of one wheel.

    Attributes
    ----------
    wheel
        Its name.
    found
        The axis, or why there is none, in words.
    positions
        Of the steering that it rests on.
    angles
        What it tells, by name of the quantity, with its limits; without a value what is not known.
    """

    wheel: str
    found: SteeringAxis | str
    positions: int
    angles: Mapping[str, Angle]

    @property
    def status(self) -> Status:
        """The verdict on all that has limits."""
        return combined(angle for angle in self.angles.values() if angle.limits is not None)


@dataclass(frozen=True, eq=False)
class SweepFound:
    """What a sweep brought: the axis of each steered wheel that was asked for, and their differences."""

    axes: tuple[JudgedAxis, ...]
    differences: Mapping[str, Angle]

    @property
    def judged(self) -> Iterator[Angle]:
        """All that decides of the vehicle."""
        for angles in (*(axis.angles for axis in self.axes), self.differences):
            yield from (angle for angle in angles.values() if angle.limits is not None)

    @property
    def refusals(self) -> tuple[str, ...]:
        """Why wheels have no steering axis."""
        return tuple(f"{axis.wheel}: {axis.found}" for axis in self.axes if isinstance(axis.found, str))


NO_AXES = SweepFound((), {})
"""Of a cycle without a sweep."""


def sweep_found(
    kind: VehicleType,
    results: Mapping[str, WheelResult],
    swept: Swept,
    rigs: Mapping[str, PreparedRig],
    frame: CommonFrame | None,
    coverage_factor: float,
) -> SweepFound:
    """Return the steering axes of a sweep.

    Parameters
    ----------
    kind
        The vehicle type, with a plan of the sweep.
    results
        Of each wheel straight ahead; one that failed there has no axis either.
    swept
        Positions of the steering.
    rigs
        Of the steered wheels, as prepared for wheels that are steered.
    frame
        Common frame of the rigs; its road is what trail and scrub radius refer to.
    coverage_factor
        k of the expanded uncertainty.
    """
    wheels = [wheel for wheel in STEERED if wheel in results]
    found: dict[str, SteeringAxis | str] = {}
    series = _series(wheels, results, swept, rigs)
    known = {wheel: one for wheel, one in series.items() if not isinstance(one, str)}
    heading, heading_u = _heading(results)
    toe = _straight_toe(known, heading)
    for wheel, one in series.items():
        if isinstance(one, str):
            found[wheel] = one
        else:
            found[wheel] = _axis(kind, one, frame, (heading, heading_u, toe), coverage_factor)
    pair = _pair(found)
    judge = _Judge(kind, results, coverage_factor)
    return SweepFound(
        tuple(judge.axis(wheel, found[wheel], pair, len(known.get(wheel, ()))) for wheel in wheels),
        judge.differences(pair) if set(STEERED) <= set(wheels) else {},
    )


def _series(
    wheels: list[str], results: Mapping[str, WheelResult], swept: Swept, rigs: Mapping[str, PreparedRig]
) -> dict[str, list[SteeredWheel] | str]:
    """Positions at which all of the wheels were measured, as those of one sweep; or why there are none."""
    failed = {w: f.text for w in wheels if (f := results[w].failure) is not None}
    taken = [set(swept.get(wheel, {})) for wheel in wheels]
    numbers = sorted(set.intersection(*taken)) if taken else []
    out: dict[str, list[SteeredWheel] | str] = {}
    for wheel in wheels:
        planes = [m for n in numbers if (m := swept[wheel][n].measurement) is not None]
        if wheel in failed:
            out[wheel] = failed[wheel]
        elif not planes:
            out[wheel] = "it was measured at no position of the steering"
        elif any(plane.reference is None for plane in planes):
            out[wheel] = (
                "the place of the wheel is not known: the outermost ring of the sidewall was not seen; check "
                "that the heads see the widest part of the tyre"
            )
        else:
            out[wheel] = steered_wheels(planes, rigs[wheel])
    return out


def _heading(results: Mapping[str, WheelResult]) -> tuple[float, float]:
    """Direction of the thrust line on the stand and its uncertainty, radians; its X without rear wheels."""
    rear: list[WheelMeasurement] = []
    for wheel in _REAR:
        found = results[wheel].measurement if wheel in results else None
        if found is None:
            return 0.0, 0.0
        rear.append(found)
    left, right = rear
    heading = -0.5 * (SIGN["left"] * left.toe + SIGN["right"] * right.toe)
    return heading, 0.5 * math.hypot(left.toe_u, right.toe_u)


def _straight_toe(series: Mapping[str, list[SteeredWheel]], heading: float) -> float:
    """Toe of both wheels straight ahead; 0 where a sweep never passes there, which is refused afterwards."""
    if set(series) != set(STEERED):
        return 0.0
    left, right = (series[wheel] for wheel in STEERED)
    try:
        return straight_toe(left, right, heading)
    except DegenerateInputError:
        return 0.0


def _axis(
    kind: VehicleType,
    series: list[SteeredWheel],
    frame: CommonFrame | None,
    straight: tuple[float, float, float],
    coverage_factor: float,
) -> SteeringAxis | str:
    assert kind.sweep is not None
    heading, heading_u, toe = straight
    rolls = not kind.sweep.brakes_held
    tyres, road_z_mm = kind.tyre_widths(), None if frame is None else frame.stand.road_z_mm
    if rolls and (road_z_mm is None or tyres.front_mm is None):
        return (
            "the run-out of a wheel that rolls while it is steered needs the height of the wheel supports "
            "and the width of the tyres, which are not stated; state them, or hold the brakes and say so"
        )
    stand = SteeringStand(
        heading, heading_u, road_z_mm, tyres.front_mm, tyres.sigma_mm, toe, 1.0 if rolls else 0.0
    )
    lean = RunOut(0.0, 0.0, np.eye(2) * _EXPECTED_LEAN**2) if rolls else None
    try:
        found = steering_axis(series, stand, SteeringRules(coverage_factor=coverage_factor), lean)
    except DegenerateInputError as error:
        return str(error)
    return found.reason if isinstance(found, Refusal) else found


def _pair(found: Mapping[str, SteeringAxis | str]) -> SteeredPair | None:
    left, right = (found.get(wheel) for wheel in STEERED)
    if not isinstance(left, SteeringAxis) or not isinstance(right, SteeringAxis):
        return None
    try:
        return steered_pair(left, right)
    except DegenerateInputError:
        # Steered too little for toe-out on turns; then there is none.
        return None


@dataclass(frozen=True, eq=False)
class _Judge:
    kind: VehicleType
    results: Mapping[str, WheelResult]
    k: float

    def axis(
        self, wheel: str, found: SteeringAxis | str, pair: SteeredPair | None, positions: int
    ) -> JudgedAxis:
        values: dict[str, tuple[float, float]] = {}
        if isinstance(found, SteeringAxis):
            values = {name: (found.value(name), found.u(name)) for name in AXIS_QUANTITIES if name in found}
            if pair is not None:
                out = pair.toe_out_left if wheel == "front_left" else pair.toe_out_right
                values["toe_out"] = out, self._toe_out_u()
        valid = self.results[wheel].calibration_valid
        angles = {
            name: self._angle(f"{wheel}.{name}", name, values.get(name), valid) for name in AXIS_QUANTITIES
        }
        return JudgedAxis(wheel, found, positions, angles)

    def differences(self, pair: SteeredPair | None) -> dict[str, Angle]:
        valid = all(self.results[wheel].calibration_valid for wheel in STEERED)
        out = {}
        for name in AXIS_DIFFERENCES:
            of = name.removesuffix("_difference")
            known = pair is not None and of in pair.differences
            value = (pair.differences[of], pair.differences_u[of]) if pair is not None and known else None
            out[name] = self._angle(name, name, value, valid)
        return out

    def _angle(self, name: str, quantity: str, value: tuple[float, float] | None, valid: bool) -> Angle:
        tolerance = self.kind.steering_axis.stated.get(quantity)
        limits = None if tolerance is None else tolerance.limits()
        angle = Angle(name, limits, self.kind.guard_band)
        return (
            angle if value is None else angle.measured(value[0], self.k * value[1], calibration_valid=valid)
        )

    def _toe_out_u(self) -> float:
        """Of the difference of two steered angles, each a difference of two toes of one wheel."""
        toes = [found.toe_u for w in STEERED if (found := self.results[w].measurement) is not None]
        return math.sqrt(2.0) * math.hypot(*toes)
