"""Guidance beside live angles: what each result of an adjusting says to whoever turns rods and bolts.

What is right or wrong is the verdict's alone; a wheel is done only while the verdict on it, and on all that
it is part of, is made of results that are fresh.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from alignment.units import in_degrees
from alignment.values import SIDES
from alignment.vehicle import FOUR_WHEELS
from station.configuration import AdjusterOptions, AxleAdjusters, VehicleType
from station.cycle.judging import Angle, Evaluation, JudgedWheel, Status, axle_of
from station.cycle.words import Guidance
from station.guidance import (
    AdjusterKind,
    Advice,
    Drift,
    GuidanceSettings,
    GuidanceState,
    VehicleGuide,
    WheelPlan,
    WheelReading,
)

FRESH_S = 3.0
"""Results of other wheels that are older say nothing of an axle."""
_GOOD = (Status.OK, Status.UNJUDGED)
_ENDED = (GuidanceState.DONE, GuidanceState.UNREACHABLE, GuidanceState.WAITING)
"""Nobody works on such a wheel."""
Drifts = Mapping[tuple[str, AdjusterKind], Drift]
"""What locking usually adds, by axle and adjuster."""


def stated_drifts(kind: VehicleType) -> Drifts:
    """Return what a vehicle type says of its nuts, before any was locked here."""
    found = {}
    for axle, adjusters in kind.adjusting.items():
        for name, options in _options(adjusters).items():
            mean, bound = math.radians(options.drift_deg), math.radians(options.drift_bound_deg)
            found[axle, name] = Drift(mean, bound, options.aim_before_drift)
    return found


def _options(adjusters: AxleAdjusters) -> dict[AdjusterKind, AdjusterOptions]:
    both = {AdjusterKind.TIE_ROD: adjusters.tie_rod, AdjusterKind.CAMBER_BOLT: adjusters.camber_bolt}
    return {name: options for name, options in both.items() if options is not None}


@dataclass(frozen=True)
class _Seen:
    """When a wheel was last looked at, and whether it was measured then."""

    time_s: float
    measured: bool


class Guiding:
    """Guides one adjusting.

    Parameters
    ----------
    kind
        The vehicle type.
    wheels
        All of the cycle; those whose axle has a table `adjusting` are guided.
    drifts
        Of each adjuster of the vehicle type.
    settings
        When a wheel rests.

    Attributes
    ----------
    times
        Of each adjuster that was to be turned, by wheel and kind: when first, and when the wheel was done
        with or last looked at, monotonic seconds.
    """

    def __init__(
        self,
        kind: VehicleType,
        wheels: Sequence[str],
        drifts: Drifts,
        settings: GuidanceSettings | None = None,
    ) -> None:
        plans = [
            WheelPlan.of(
                wheel,
                kind.axles[axle_of(wheel)].camber.limits(),
                kind.axles[axle_of(wheel)].toe.limits(),
                kind.adjusting[axle_of(wheel)],
            )
            for wheel in wheels
            if axle_of(wheel) in kind.adjusting
        ]
        self._wheels = tuple(wheels)
        self._seen: dict[str, _Seen] = {}
        self._turned: dict[str, AdjusterKind] = {}
        self.times: dict[tuple[str, AdjusterKind], tuple[float, float]] = {}
        self.vehicle = VehicleGuide(plans, drifts, settings)

    def take(self, evaluation: Evaluation | None, wheel: str, time_s: float, shot: int) -> Guidance:
        """Return what to do at a wheel after a result of it.

        Parameters
        ----------
        evaluation
            Of this result, and of the last ones of the other wheels; None where nothing could be judged.
        wheel
            Whose result it is.
        time_s
            When its images were taken, monotonic.
        shot
            Number of its live angles.
        """
        judged = None if evaluation is None else _judged(evaluation, wheel)
        self._seen[wheel] = _Seen(time_s, judged is not None)
        if evaluation is None or judged is None:
            return self._advised(WheelReading(wheel, time_s), shot)
        assert judged.values is not None
        known = {angle.name: angle for angle in evaluation.angles}
        expected = self._expected(wheel)
        fresh = {name for name, others in expected.items() if self._fresh(others, time_s)}
        verdicts = {
            name: known[name].status in _GOOD
            for name in fresh & known.keys()
            if known[name].status in (*_GOOD, Status.NOK)
        }
        reading = WheelReading(
            wheel,
            time_s,
            judged.values.camber,
            judged.values.toe,
            _margin(judged.camber),
            _margin(judged.toe),
            verdicts,
            whole=expected.keys() == verdicts.keys(),
        )
        return self._advised(reading, shot)

    def learned(self, drifts: Drifts) -> Drifts:
        """Return what is known of locking after this adjusting."""
        found = dict(drifts)
        for wheel, guide in self.vehicle.wheels.items():
            for done in guide.corrections:
                if done.taken is not None and done.locked is not None:
                    key = axle_of(wheel), done.adjuster
                    found[key] = found[key].after(done.locked - done.taken)
        return found

    def account(self) -> Iterator[str]:
        """Say of each wheel that was turned how it was found, what was turned, and where its nuts locked."""
        for wheel, guide in self.vehicle.wheels.items():
            if guide.found is None or not guide.count:
                continue
            camber, toe = math.degrees(guide.found.camber), math.degrees(guide.found.toe)
            text = f"{wheel}: found at camber {camber:+.4f}°, toe {toe:+.4f}°"
            for done in guide.corrections:
                text += f"; {done.adjuster} {done.turns:+.2f} turns"
                for word, angle in (("taken at", done.taken), ("locked at", done.locked)):
                    text += "" if angle is None else f", {word} {math.degrees(angle):+.4f}°"
            yield f"{text}; {guide.state}"

    def _expected(self, wheel: str) -> dict[str, tuple[str, ...]]:
        """Angles that this wheel is part of, each with the wheels that it needs."""
        axle = axle_of(wheel)
        found: dict[str, tuple[str, ...]] = {f"{wheel}.camber": (wheel,), f"{wheel}.toe": (wheel,)}
        both = tuple(f"{axle}_{side}" for side in SIDES)
        if set(both) <= set(self._wheels):
            found |= {f"{axle}.total_toe": both, f"{axle}.camber_difference": both}
        if axle == "rear" and set(FOUR_WHEELS) <= set(self._wheels):
            found["thrust_angle"] = both
        return found

    def _fresh(self, wheels: Sequence[str], time_s: float) -> bool:
        seen = [self._seen.get(wheel) for wheel in wheels]
        return all(each is not None and each.measured and time_s - each.time_s <= FRESH_S for each in seen)

    def _advised(self, reading: WheelReading, shot: int) -> Guidance:
        advice = self.vehicle.take(reading)
        self._time(reading.wheel, reading.time_s, advice)
        return Guidance(
            reading.wheel,
            advice.state,
            shot,
            advice.adjuster,
            advice.turns,
            in_degrees(advice.camber),
            in_degrees(advice.toe),
            in_degrees(advice.drift),
            advice.reason,
        )

    def _time(self, wheel: str, time_s: float, advice: Advice) -> None:
        """Remember how long an adjuster has been worked on, the check of what it did included."""
        kind = self._turned.get(wheel)
        if kind is not None:
            self.times[wheel, kind] = self.times[wheel, kind][0], time_s
        if advice.adjuster is not AdjusterKind.NONE:
            self._turned[wheel] = advice.adjuster
            self.times.setdefault((wheel, advice.adjuster), (time_s, time_s))
        elif advice.state in _ENDED:
            self._turned.pop(wheel, None)


def _judged(evaluation: Evaluation, wheel: str) -> JudgedWheel | None:
    """Return a wheel whose both angles have a verdict, or need none."""
    found = next((each for each in evaluation.wheels if each.result.wheel == wheel), None)
    known = (*_GOOD, Status.NOK)
    if found is None or found.values is None or any(angle.status not in known for angle in found.angles):
        return None
    return found


def _margin(angle: Angle) -> float:
    return angle.expanded_uncertainty or 0.0 if angle.guard_band else 0.0
