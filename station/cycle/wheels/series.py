"""A series of one wheel in the cycle: exposures are taken while rollers turn it, and measured meanwhile.

The rig's thread takes them at their times; a second thread measures. Between the two wait few exposures: when
the measuring falls behind, the next exposure waits, and memory stays what it was.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, wait
from concurrent.futures import TimeoutError as LateError
from dataclasses import dataclass, field, replace
from typing import Protocol

from alignment.errors import TruewheelError
from alignment.measure_spin import SeriesMeasurement, SeriesUnderWay
from alignment.values import Refusal, Side
from alignment.wheel import LEAST_TURN, LiveSpin, SeriesRules
from sensors.shot import SeriesPlace, WheelShot
from station.configuration import Measured, VehicleType
from station.cycle.wheels.image_memory import ImageMemory
from station.cycle.words import ErrorCode
from station.threads import Worker, WorkerError

MOST_WAITING = 2
"""Exposures of one wheel that may wait to be measured, the one under way included."""


class WheelOnRollers(Protocol):
    """What is needed of a wheel position; `station.cycle.positions.WheelPosition` is one."""

    @property
    def name(self) -> str:
        """Of the wheel."""
        ...

    @property
    def side(self) -> Side:
        """Of the vehicle."""
        ...

    @property
    def clock(self) -> Callable[[], float]:
        """Monotonic seconds."""
        ...

    def shoot(self) -> WheelShot:
        """Take one exposure."""
        ...

    def series(self, rules: SeriesRules) -> SeriesUnderWay:
        """Begin a series."""
        ...


@dataclass(frozen=True)
class SeriesChoice:
    """What the station says of series; a vehicle type may say otherwise.

    Attributes
    ----------
    measure
        ``tyre_plane`` or ``spin_axis``.
    exposures, least_turn
        How many, and the least turn from the first to the last, radians.
    interval_s
        From one exposure to the next, seconds.
    memory
        Where exposures are kept until they are archived; None where they are not.
    """

    measure: Measured = "tyre_plane"
    exposures: int = 16
    least_turn: float = LEAST_TURN
    interval_s: float = 0.25
    memory: ImageMemory | None = field(default=None, compare=False)

    def plan(self, kind: VehicleType | None) -> SeriesPlan | None:
        """Return the series of a vehicle of this type; None where single exposures are measured."""
        if kind is None or (kind.measure or self.measure) != "spin_axis":
            return None
        turn = self.least_turn if kind.least_turn_deg is None else math.radians(kind.least_turn_deg)
        return SeriesPlan(SeriesRules(kind.exposures or self.exposures, turn), self.interval_s, self.memory)


@dataclass(frozen=True)
class SeriesPlan:
    """What a series must be, the time from one exposure to the next, seconds, and where they are kept."""

    rules: SeriesRules
    interval_s: float
    memory: ImageMemory | None = field(default=None, compare=False)


@dataclass(frozen=True, eq=False)
class TakenSeries:
    """What came of the exposures of one wheel.

    Attributes
    ----------
    found
        The spin axis, or why there is none.
    shot
        The last one that was taken: the one that is to blame, where one is.
    duration_s
        From the last exposure to the result.
    live
        Follows the axis from single exposures; None where there is no axis.
    exposures
        All that were taken, in their order; None where they were not kept.
    """

    found: SeriesMeasurement | Refusal
    shot: WheelShot
    duration_s: float
    live: LiveSpin | None
    exposures: tuple[WheelShot, ...] | None = None


class _Kept:
    """The exposures of a series so far: all of them, or none when one found no room."""

    def __init__(self, plan: SeriesPlan) -> None:
        self._exposures, self._memory = plan.rules.exposures, plan.memory
        self._shots: list[WheelShot] = []

    def take(self, number: int, shot: WheelShot) -> None:
        if self._memory is None:
            return
        placed = replace(shot, series=SeriesPlace(number, self._exposures))
        if self._memory.take(placed):
            self._shots.append(placed)
        else:
            self._memory = None
            self._shots.clear()

    @property
    def shots(self) -> tuple[WheelShot, ...] | None:
        return None if self._memory is None else tuple(self._shots)


class SeriesError(TruewheelError):
    """A series that the station could not take: what the line is told, and why; an abort has no code."""

    def __init__(self, code: ErrorCode, text: str) -> None:
        super().__init__(text)
        self.code = code


def take_series(
    position: WheelOnRollers, plan: SeriesPlan, worker: Worker, ended: threading.Event, bound_s: float
) -> TakenSeries:
    """Take and measure the exposures of one wheel; in the rig's thread.

    Parameters
    ----------
    position
        Armed.
    plan
        Of the series.
    worker
        Measures; of this position alone.
    ended
        Set when the cycle is given up.
    bound_s
        Longest wait for a measurement.

    Raises
    ------
    SeriesError
        When the measuring fails or hangs, or the cycle is given up.
    TruewheelError
        When a camera fails.
    """
    series = position.series(plan.rules)
    waiting: deque[Future[Refusal | None]] = deque()
    shots: deque[WheelShot] = deque(maxlen=1)
    kept = _Kept(plan)
    began_s = taken_s = position.clock()
    times: list[float] = []

    def measured(most_left: int) -> TakenSeries | None:
        """Wait until no more than so many are left to be measured; what ends the series, if anything does."""
        while len(waiting) > most_left or (waiting and waiting[0].done()):
            refusal = _measured(waiting.popleft(), position, bound_s)
            if refusal is not None:
                return TakenSeries(refusal, shots[-1], position.clock() - taken_s, None, kept.shots)
        return None

    for number in range(1, plan.rules.exposures + 1):
        pause_s = began_s + (number - 1) * plan.interval_s - position.clock()
        if ended.wait(pause_s) if pause_s > 0.0 else ended.is_set():
            raise SeriesError(ErrorCode.NONE, f"{position.name}: given up before exposure {number}")
        if (refused := measured(MOST_WAITING - 1)) is not None:
            return refused
        try:
            shot = position.shoot()
        except TruewheelError:
            # What waits would stand in the way of another attempt.
            wait(waiting, bound_s)
            raise
        taken_s = position.clock()
        shots.append(shot)
        kept.take(number, shot)
        times.append(shot.frames[0].device_time_s)
        try:
            waiting.append(worker.submit(series.take, shot.number, shot.images))
        except WorkerError as error:
            raise SeriesError(ErrorCode.INTERNAL_FAULT, f"{position.name}: {error}") from error
    if (refused := measured(0)) is not None:
        return refused
    found = series.result()
    live = None
    if isinstance(found, SeriesMeasurement):
        live = LiveSpin(found.spin, series.last, _rate(found, times), position.side)
    return TakenSeries(found, shots[-1], position.clock() - taken_s, live, kept.shots)


def _measured(future: Future[Refusal | None], position: WheelOnRollers, bound_s: float) -> Refusal | None:
    try:
        return future.result(bound_s)
    except LateError as error:
        text = f"{position.name}: an exposure was not measured within {bound_s:g} s"
        raise SeriesError(ErrorCode.CYCLE_TIMEOUT, text) from error


def _rate(found: SeriesMeasurement, times: list[float]) -> float:
    """Turn of the wheel by the cameras' clock, radians per second; 0 where that tells none."""
    turned = found.spin.turned
    passed_s = times[-1] - times[0]
    return 0.0 if turned is None or not passed_s > 0.0 else turned / passed_s
