"""What the controller tells of the vehicle, as far as it is still true: steering wheel, ride heights, a step.

One value of each is kept. An age counts from the measurement, not from the frame: a sensor whose samples
stand grows old, however often its angle is sent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from station.cycle import RideHeights, SteeringSource, SteeringWheel, Step, ToldOfVehicle
from station.line.wire import LineDatabase, Value, read_number

STEP_LIFETIME_S = 2.0
"""Longest time from the frame that says which position was reached to the command that means it."""
SILENCE_S = 0.5
"""Without a good frame for so long, where the DBC names no time, nothing is known of what it told."""
_SIDES = ("Left", "Right")


@dataclass(frozen=True)
class _Told:
    """One message: its values, when it came, and how old its measurement was then, seconds."""

    values: Mapping[str, Value]
    heard_s: float
    age_s: float | None

    def age_at(self, now: float) -> float | None:
        """Age of what it tells; None where the controller does not know it."""
        return None if self.age_s is None else max(now - self.heard_s, 0.0) + self.age_s


class ToldByController:
    """Keeps the last of each message.

    Parameters
    ----------
    database
        The checked DBC.
    clock
        Monotonic seconds.
    """

    def __init__(self, database: LineDatabase, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._axles = (
            {f"RideHeight{e}": axle for axle, e in database.axles.items()} if database.has_steering else {}
        )
        self._last: dict[str, _Told] = {}
        names = ("SteeringWheel", *self._axles) if database.has_steering else ()
        self._silence_s = {name: database.timeout_s(name) or SILENCE_S for name in names}
        self._step: tuple[Step, float] | None = None

    def take(self, name: str, values: Mapping[str, Value]) -> None:
        """Take a frame that counts; of another message it is nothing."""
        now = self._clock()
        if name == "SweepStep":
            position = int(values["Position"])
            step = Step(int(values["Sequence"]), position, read_number(values["Angle"]))
            self._step = (step, now) if position else None
        elif name in self._silence_s:
            self._last[name] = self._taken(name, values, now)

    def clear(self) -> None:
        """The communication was lost: what comes then is of another time, or of another vehicle."""
        self._last.clear()
        self._step = None

    def step(self, sequence: int) -> Step | None:
        """The position that a step of this number means; None where no frame says it."""
        if self._step is None:
            return None
        step, heard_s = self._step
        fresh = self._clock() - heard_s <= STEP_LIFETIME_S
        return step if fresh and step.sequence == sequence else None

    @property
    def of_vehicle(self) -> ToldOfVehicle:
        """All that is known now."""
        now = self._clock()
        return ToldOfVehicle(self._steering(now), self._heights(now))

    def _taken(self, name: str, values: Mapping[str, Value], now: float) -> _Told:
        told_ms = read_number(values["Age"])
        age_s = None if told_ms is None else told_ms / 1000.0
        before = self._last.get(name)
        if before is None or age_s is None or before.values["Sample"] != values["Sample"]:
            return _Told(values, now, age_s)
        # The same measurement again: it does not become younger.
        known = before.age_at(now)
        return _Told(values, now, age_s if known is None else max(age_s, known))

    def _known(self, name: str, now: float) -> _Told | None:
        told = self._last.get(name)
        return told if told is not None and now - told.heard_s <= self._silence_s[name] else None

    def _steering(self, now: float) -> SteeringWheel | None:
        told = self._known("SteeringWheel", now)
        if told is None:
            return None
        source, sample = SteeringSource(str(told.values["Source"])), int(told.values["Sample"])
        angle, age_s = read_number(told.values["Angle"]), told.age_at(now)
        if source is SteeringSource.NONE or age_s is None:
            return SteeringWheel(None, 0.0, source, sample)
        return SteeringWheel(angle, age_s, source, sample)

    def _heights(self, now: float) -> RideHeights | None:
        known = {axle: told for name, axle in self._axles.items() if (told := self._known(name, now))}
        if not known:
            return None
        heights: dict[str, float] = {}
        ages: dict[str, float] = {}
        for axle, told in known.items():
            age_s = told.age_at(now)
            for side in _SIDES:
                height = read_number(told.values[side])
                if height is not None and age_s is not None:
                    wheel = f"{axle}_{side.lower()}"
                    heights[wheel], ages[wheel] = height, age_s
        return RideHeights(heights, ages)
