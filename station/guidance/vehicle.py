"""The guidance of a vehicle: the rear axle before the front one, and what an axle asks of its two wheels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from station.guidance.drift import Drift
from station.guidance.plan import GuidanceSettings, WheelPlan, WheelReading
from station.guidance.stillness import Rest
from station.guidance.wheel import Advice, WheelGuide
from station.guidance.words import AdjusterKind, GuidanceState

_ANGLE_OF = {"total_toe": "toe", "thrust_angle": "toe", "camber_difference": "camber"}
"""Which angle of its wheels changes an angle of an axle or the vehicle."""


class VehicleGuide:
    """Guides whoever adjusts the wheels of one vehicle.

    Parameters
    ----------
    plans
        Of the wheels that are adjusted.
    drifts
        By axle and adjuster; of each adjuster of a plan there is one.
    settings
        When a wheel rests.

    Attributes
    ----------
    wheels
        The guide of each wheel, by name.
    """

    def __init__(
        self,
        plans: Sequence[WheelPlan],
        drifts: Mapping[tuple[str, AdjusterKind], Drift],
        settings: GuidanceSettings | None = None,
    ) -> None:
        self.wheels: dict[str, WheelGuide] = {}
        for plan in plans:
            own = {kind: drift for (axle, kind), drift in drifts.items() if axle == _axle(plan.wheel)}
            self.wheels[plan.wheel] = WheelGuide(plan, own, settings)
        self._seen: dict[str, Rest] = {}

    def take(self, reading: WheelReading) -> Advice:
        """Return what to do at a wheel after a result of it; of a wheel without a plan: nothing."""
        guide = self.wheels.get(reading.wheel)
        if guide is None:
            return Advice(GuidanceState.NONE)
        if reading.camber is not None and reading.toe is not None:
            self._seen[reading.wheel] = Rest(reading.camber, reading.toe)
        return guide.take(reading, allowed=self._allowed(reading.wheel), asked=self._asked(reading))

    def _allowed(self, wheel: str) -> bool:
        """Whether a correction of this wheel may begin: the front axle is the last one."""
        before = [guide for name, guide in self.wheels.items() if _axle(name) != "front"]
        return _axle(wheel) != "front" or all(guide.finished for guide in before)

    def _asked(self, reading: WheelReading) -> frozenset[str]:
        """Return which angle of this wheel is to be turned for an angle of its axle that is outside.

        The wheel that is farther from its own target is asked.
        """
        asked = set()
        for name, inside in reading.verdicts.items():
            angle = _ANGLE_OF.get(name.rpartition(".")[2])
            if angle is not None and not inside and self._farther(reading.wheel, angle):
                asked.add(angle)
        return frozenset(asked)

    def _farther(self, wheel: str, angle: str) -> bool:
        away = self._away(wheel, angle)
        others = [name for name in self.wheels if _axle(name) == _axle(wheel) and name != wheel]
        return all(away >= self._away(name, angle) for name in others)

    def _away(self, wheel: str, angle: str) -> float:
        seen, plan = self._seen.get(wheel), self.wheels[wheel].plan
        if seen is None:
            return 0.0
        limits = plan.toe if angle == "toe" else plan.camber
        value = seen.toe if angle == "toe" else seen.camber
        return abs(value - 0.5 * (limits.low + limits.high))


def _axle(wheel: str) -> str:
    return wheel.rpartition("_")[0]
