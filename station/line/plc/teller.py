"""What a simulated controller tells of its vehicle: steering wheel, ride heights, position of a step."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import can

from station.cycle import RideHeights, SteeringSource, SteeringWheel, Step
from station.line.wire import LineDatabase, Value, bounded, milliseconds


class VehicleTeller:
    """Frames of what is told; a controller that tells nothing sends none of them.

    What was told and is not any more is told as not valid, once: without that a station would know it for as
    long as it bears with silence, and take it for the next vehicle's.

    Parameters
    ----------
    database
        The checked DBC; of one before 3.1 there is nothing to tell.

    Attributes
    ----------
    steering, heights
        What is told, None for nothing.
    sensor
        Makes of the steering wheel what its sensor tells of it; for tests of a station. None from it is
        silence.
    stands
        Whether the sensor's sample counter stands. For tests of a station.
    step
        The position that the command step means; None between steps.
    sweeping
        Whether frames of steps are sent at all.
    """

    def __init__(self, database: LineDatabase) -> None:
        self._database = database
        self.steering: SteeringWheel | None = None
        self.heights: RideHeights | None = None
        self.sensor: Callable[[SteeringWheel], SteeringWheel | None] = lambda steering: steering
        self.stands = False
        self.step: Step | None = None
        self.sweeping = False
        self._sample = 0
        self._taken_back = False, False

    @property
    def telling(self) -> bool:
        """Whether anything is told, or has to be taken back."""
        return self.steering is not None or self.heights is not None or any(self._taken_back)

    def forget(self) -> None:
        """Tell nothing any more, as a controller that has no sensor and asks for no sweep."""
        steering, heights = self._taken_back
        self._taken_back = steering or self.steering is not None, heights or self.heights is not None
        fresh = VehicleTeller(self._database)
        self.steering, self.heights, self.sensor = fresh.steering, fresh.heights, fresh.sensor
        self.stands, self.step, self.sweeping = fresh.stands, fresh.step, fresh.sweeping

    def frames(self) -> Iterator[can.Message]:
        """What goes out before a Command."""
        if not self._database.has_steering:
            return
        self._sample += not self.stands
        (steering, heights), self._taken_back = self._taken_back, (False, False)
        told = None if self.steering is None else self.sensor(self.steering)
        if self.steering is None and steering:
            told = SteeringWheel(None)
        if told is not None:
            yield self._steering(told)
        if self.heights is not None or heights:
            yield from self._heights(self.heights or RideHeights({}))
        if self.sweeping or self.step is not None:
            yield self._step(self.step or Step(0, 0))

    def _steering(self, told: SteeringWheel) -> can.Message:
        name = "SteeringWheel"
        return self._database.encode(
            name,
            {
                "Source": str(told.source if told.valid else SteeringSource.NONE),
                "Sample": self._sample % 256,
                "Angle": bounded(self._database, name, "Angle", told.angle_deg),
                "Age": milliseconds(self._database, name, "Age", told.age_s if told.valid else None),
            },
        )

    def _heights(self, told: RideHeights) -> Iterator[can.Message]:
        for axle, ending in self._database.levelled.items():
            name = f"RideHeight{ending}"
            ages = [told.ages_s[w] for w in (f"{axle}_left", f"{axle}_right") if w in told.ages_s]
            values: dict[str, Value] = {
                side: bounded(self._database, name, side, told.of(f"{axle}_{side.lower()}"))
                for side in ("Left", "Right")
            }
            age = milliseconds(self._database, name, "Age", max(ages, default=None))
            yield self._database.encode(name, {**values, "Sample": self._sample % 16, "Age": age})

    def _step(self, step: Step) -> can.Message:
        angle = bounded(self._database, "SweepStep", "Angle", step.angle_deg)
        values: dict[str, Value] = {"Sequence": step.sequence, "Position": step.position, "Angle": angle}
        return self._database.encode("SweepStep", values)
