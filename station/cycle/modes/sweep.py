"""A sweep of the steering: from position to position, as the controller's steps say, images at each.

The station tells the angle that is wanted, the controller (or the operator) turns the steering and says step,
the front wheels are measured, and so on; the last position is straight ahead, where the measurement that
counts follows. How it can end without results is in `station.cycle.sweep_ends`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Protocol

from alignment.errors import TruewheelError
from station.configuration import SweepPlan
from station.cycle.judging import STEERED
from station.cycle.modes.steering_watch import Ended, SteeringWatch
from station.cycle.modes.sweep_ends import SweepEnd, sweep_failure
from station.cycle.under_way import CycleUnderWay
from station.cycle.wheel_runs import POLL_S
from station.cycle.wheels import WheelPosition, WheelResult, WheelThreads, result_of
from station.cycle.words import (
    Abort,
    Command,
    ErrorCode,
    Failure,
    Step,
    Stop,
    SweepProgress,
    SweepState,
    ToldOfVehicle,
    fault,
)

_LEFT_OUT_SHARE = 0.2
"""Of all positions: those at which a wheel may be refused."""
_ATTEMPTS = 2
"""At images of a position that are refused."""


class SweepLine(Protocol):
    """What is needed of the line."""

    def next_command(self, timeout_s: float) -> Command | None:
        """Take the next command."""
        ...

    def publish_sweep(self, progress: SweepProgress) -> None:
        """Show how the sweep goes."""
        ...

    def told(self) -> ToldOfVehicle:
        """What the controller told of the vehicle."""
        ...


class Sweep:
    """One sweep; `run` takes it.

    Parameters
    ----------
    threads
        Of the positions.
    cycle
        Its zero measurements correct.
    positions
        Of the steered wheels that are armed.
    plan
        How to sweep.
    straight_deg
        What the line tells of a steering wheel that stands straight, degrees.
    line
        Tells commands and angles, is told the progress.
    clock
        Monotonic seconds, the line's.
    bound_s
        Longest time for the images of one position and their measurement.
    stopping
        Set when the station is told to stop: the cycle is then aborted.

    Attributes
    ----------
    taken
        What came of each wheel, by the number of the position, without images; those at which it was refused
        are left out.
    late
        Positions whose shot did not end in time; their cameras are still in use.
    """

    def __init__(
        self,
        threads: WheelThreads,
        cycle: CycleUnderWay,
        positions: Sequence[WheelPosition],
        plan: SweepPlan,
        straight_deg: float,
        line: SweepLine,
        clock: Callable[[], float],
        bound_s: float,
        stopping: threading.Event,
    ) -> None:
        self._threads = threads
        self._cycle = cycle
        self._positions = positions
        self._plan = plan
        self._wanted = plan.wanted_deg(straight_deg)
        self._line = line
        self._clock = clock
        self._bound_s = bound_s
        self._stopping = stopping
        self._watch = SteeringWatch(plan, clock())
        self._left_out: dict[str, list[str]] = {position.name: [] for position in positions}
        self._series: dict[str, dict[int, WheelResult]] = {position.name: {} for position in positions}
        self.late: tuple[WheelPosition, ...] = ()

    @property
    def taken(self) -> Mapping[str, Mapping[int, WheelResult]]:
        """What came of each wheel."""
        return self._series

    def run(self) -> Failure | None:
        """Go through all positions; why there are no results, None where there are or the cycle was ended."""
        failure = self._positions_one_by_one()
        over = failure is not None or self._cycle.interrupted
        state = SweepState.FAILED if over else SweepState.DONE
        self._line.publish_sweep(SweepProgress(state, 0 if over else len(self._wanted), len(self._wanted)))
        return failure

    def _positions_one_by_one(self) -> Failure | None:
        for number, wanted_deg in enumerate(self._wanted, 1):
            ended: Ended | Failure | None = self._turned(number, wanted_deg)
            if ended is None and not self._cycle.interrupted and number < len(self._wanted):
                ended = self._exposed(number)
            if self._cycle.interrupted:
                return None
            if isinstance(ended, Failure):
                return ended
            if ended is not None:
                return sweep_failure(ended[0], f"at position {number} of {len(self._wanted)}: {ended[1]}")
        return None

    def _show(self, state: SweepState, number: int, wanted_deg: float) -> None:
        self._line.publish_sweep(SweepProgress(state, number, len(self._wanted), wanted_deg))

    def _turned(self, number: int, wanted_deg: float) -> Ended | None:
        """Wait until the steering stands where it is wanted."""
        for left in reversed(range(self._plan.attempts)):
            self._show(SweepState.TURN, number, wanted_deg)
            step = self._awaited(number)
            if not isinstance(step, Step):
                return step
            told = self._line.told().steering
            reached = self._watch.look(told, self._clock()) or self._watch.reached(told, step, wanted_deg)
            if reached is True:
                self._show(SweepState.HOLD, number, wanted_deg)
                return None
            if reached is not False:
                return reached
            if not left:
                return self._watch.never_reached(told, step, wanted_deg)
        return None

    def _awaited(self, number: int) -> Step | Ended | None:
        """The step to this position; None where the cycle was ended."""
        deadline = self._clock() + self._plan.step_timeout_s
        while not self._cycle.interrupted:
            command = self._line.next_command(POLL_S)
            if isinstance(command, Step) and command.sequence == self._cycle.sequence:
                if command.position == number:
                    return command
            elif (ended := self._looked(command)) is not None:
                return ended
            if self._clock() >= deadline:
                return SweepEnd.LATE, f"none within {self._plan.step_timeout_s:g} s"
        return None

    def _looked(self, command: Command | None) -> Ended | None:
        """Heed a command, and look at the steering wheel; why the sweep ends, if it does."""
        if isinstance(command, Stop) and command.sequence == self._cycle.sequence:
            return SweepEnd.STOPPED, "the controller sent stop"
        if self._stopping.is_set():
            self._cycle.heed(Abort(self._cycle.sequence))
        if self._cycle.heed(command):
            return None
        return self._watch.look(self._line.told().steering, self._clock())

    def _exposed(self, number: int) -> Ended | Failure | None:
        """Take and measure images of each wheel; those that are refused are taken once more."""
        due: Sequence[WheelPosition] = self._positions
        refused: dict[str, str] = {}
        for _ in range(_ATTEMPTS):
            results = self._shot(due)
            if not isinstance(results, Mapping):
                return results
            for wheel, result in results.items():
                failure = result.failure
                if failure is None:
                    self._series[wheel][number] = result.without_images()
                elif failure.needs_reset:
                    return failure
            refused = {w: r.failure.text for w, r in results.items() if r.failure is not None}
            due = [position for position in due if position.name in refused]
            if not due:
                break
        self._watch.released()
        for wheel, why in refused.items():
            self._left_out[wheel].append(why)
            if len(self._left_out[wheel]) > _LEFT_OUT_SHARE * self._plan.positions:
                seen = f"{wheel} at {len(self._left_out[wheel])} of {number}, the last time: {why}"
                return SweepEnd.NOT_MEASURED, seen
        return None

    def _shot(self, positions: Sequence[WheelPosition]) -> Mapping[str, WheelResult] | Ended | Failure | None:
        """One exposure of some wheels; None where the cycle was ended."""
        running = {self._threads.submit(p.name, self._measure, p): p for p in positions}
        results: dict[str, WheelResult] = {}
        deadline = self._clock() + self._bound_s
        ended: Ended | Failure | None = None
        while running and not self._cycle.interrupted and ended is None:
            done, _ = wait(running, POLL_S, FIRST_COMPLETED)
            for future in done:
                position = running.pop(future)
                results[position.name] = result_of(future, position)
            ended = self._looked(self._line.next_command(0.0))
            if running and ended is None and self._clock() >= deadline:
                ended = next(iter(running.values())).late(self._bound_s).failure
        if running:
            self._give_up(running)
        return ended if ended is not None or self._cycle.interrupted else results

    def _give_up(self, running: Mapping[Future[WheelResult], WheelPosition]) -> None:
        self._threads.leave(running)
        self.late = tuple(position for future, position in running.items() if not future.done())

    def _measure(self, position: WheelPosition) -> WheelResult:
        try:
            position.arm()
        except TruewheelError as error:
            return position.failed(fault(ErrorCode.CAMERA_FAULT, str(error)))
        return position.run(self._cycle.zeros, steered=True)


def sweep_steering(
    threads: WheelThreads,
    cycle: CycleUnderWay,
    armed: Sequence[WheelPosition],
    line: SweepLine,
    clock: Callable[[], float],
    bound_s: float,
    stopping: threading.Event,
) -> list[WheelPosition]:
    """Take the sweep of a cycle; what came of it is in `cycle.swept`.

    Parameters as of `Sweep`, and

    Parameters
    ----------
    armed
        Positions of the cycle whose cameras are armed.

    Returns
    -------
    Those that are to be measured straight ahead, armed anew; none where the sweep ended without results: all
    have a result that says why then.
    """
    assert cycle.kind is not None
    assert cycle.kind.sweep is not None
    steered = [position for position in armed if position.name in STEERED]
    if {position.name for position in steered} != STEERED.keys() & set(cycle.trigger.wheels):
        # One whose cameras failed has its result; the others alone are no sweep.
        line.publish_sweep(SweepProgress(SweepState.FAILED))
        return list(armed)
    straight_deg = 0.0 if cycle.kind.steering is None else cycle.kind.steering.offset_deg
    sweep = Sweep(
        threads, cycle, steered, cycle.kind.sweep, straight_deg, line, clock, bound_s, stopping
    )  # fmt: skip
    failure = sweep.run()
    cycle.swept = sweep.taken
    if failure is not None:
        late = {position.name for position in sweep.late}
        cycle.take({p.name: p.late(bound_s) if p.name in late else p.failed(failure) for p in armed})
    if failure is not None or cycle.interrupted:
        return []
    threads.each({position.name: position.arm for position in armed}, bound_s)
    return list(armed)
