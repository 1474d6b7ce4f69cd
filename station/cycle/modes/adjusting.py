"""Live angles while an operator turns the tie rods: every rig measures again and again in its thread."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from types import TracebackType
from typing import Protocol, Self

from alignment.errors import TruewheelError
from alignment.wheel import LiveSpin
from station.cycle.judging import Evaluation, Status, combined, evaluate
from station.cycle.modes.guiding import Guiding
from station.cycle.under_way import CycleUnderWay
from station.cycle.wheel_runs import run_wheels
from station.cycle.wheels import CommonFrame, WheelPosition, WheelResult, WheelThreads
from station.cycle.words import (
    AxisKind,
    Command,
    ErrorCode,
    Guidance,
    GuidanceLine,
    LiveAngles,
    LiveState,
    Stop,
    ToldOfVehicle,
    fault,
)
from station.guidance import GuidanceState

_LOG = logging.getLogger("truewheel.station")
_REST_S = 0.2
"""Before a wheel whose cameras failed is tried again: its driver may fail at once, for minutes."""
_NO_RUN_OUT = "the series before the adjusting told no run-out of this wheel"
_STATES = {Status.OK: LiveState.INSIDE, Status.NOK: LiveState.OUTSIDE}


class LiveLine(GuidanceLine, Protocol):
    """What is needed of the line."""

    def next_command(self, timeout_s: float) -> Command | None:
        """Take the next command."""
        ...

    def publish_live(self, angles: LiveAngles, measured_s: float) -> None:
        """Show angles of a wheel."""
        ...

    def told(self) -> ToldOfVehicle:
        """What was told last of the vehicle's steering wheel and ride heights."""
        ...


class RunOutBefore:
    """What a series before the adjusting says of the run-out of each wheel, which is then taken off.

    Parameters
    ----------
    cycle
        Of the adjusting.
    line
        Tells when to stop; is shown that nothing is measured yet.

    Attributes
    ----------
    lives
        What follows the spin axis of each wheel; of a wheel whose series failed there is none.
    late
        Names of wheels whose series did not end in time; their cameras are still in use.
    stopped
        Whether a stop came meanwhile: then there is nothing to adjust any more.
    """

    def __init__(self, cycle: CycleUnderWay, line: LiveLine) -> None:
        self._cycle, self._line = cycle, line
        self.lives: dict[str, LiveSpin] = {}
        self.late: set[str] = set()
        self.stopped = False

    @property
    def wanted(self) -> bool:
        """Whether the spin axis is shown, so that a wheel without its run-out shows nothing."""
        return self._cycle.plan is not None

    def find(
        self,
        threads: WheelThreads,
        positions: Sequence[WheelPosition],
        bound_s: float,
        clock: Callable[[], float],
    ) -> None:
        """Take a series of each wheel; a stop that comes meanwhile is kept, an abort ends it."""
        for position in positions:
            self._line.publish_live(LiveAngles(position.name, LiveState.NOT_MEASURED), clock())
        run_wheels(threads, self._cycle, positions, bound_s, clock, self._given_up, self._done, kept=False)

    def _done(self, result: WheelResult) -> None:
        if result.live is not None:
            self.lives[result.wheel] = result.live
        elif result.failure is not None and result.failure.error_code is ErrorCode.CYCLE_TIMEOUT:
            self.late.add(result.wheel)

    def _given_up(self) -> bool:
        command = self._line.next_command(0.0)
        if isinstance(command, Stop) and command.sequence == self._cycle.sequence:
            self.stopped = True
            return False
        return self._cycle.heed(command)


class Adjusting:
    """Measures the wheels of some positions continuously; use it in a `with`, which waits for the last shots.

    What a shot shows after the end of the `with` is shown to nobody; a shot that does not end is left behind.

    Parameters
    ----------
    threads
        Of the positions.
    cycle
        Its zero measurements correct, and the limits of its vehicle type say inside or outside.
    positions
        Those of the cycle that are armed.
    coverage_factor
        k of the expanded uncertainty.
    line
        Is told every result.
    clock
        Monotonic seconds, the line's.
    last_s
        Longest wait for the last shots.
    frame
        Common frame of the rigs. Where toes refer to the vehicle, a wheel is shown as soon as all four were
        seen: the others as they were last tell where its centreline is.
    before
        The run-out of each wheel, where the spin axis is shown.
    guiding
        Says what to turn; None where the vehicle type names no adjuster.

    Attributes
    ----------
    late
        Positions whose last shot did not end in time; empty before the end.
    armed
        Names of those whose cameras are still armed by the series before and have failed in nothing since:
        they look at the wheel whose run-out is known, and are not armed for another one.
    """

    def __init__(
        self,
        threads: WheelThreads,
        cycle: CycleUnderWay,
        positions: Sequence[WheelPosition],
        coverage_factor: float,
        line: LiveLine,
        clock: Callable[[], float],
        last_s: float,
        frame: CommonFrame | None,
        before: RunOutBefore,
        guiding: Guiding | None = None,
    ) -> None:
        self._threads = threads
        self._frame = frame
        self._seen: dict[str, WheelResult] = {}
        self._before = before
        self._guiding = guiding
        assert cycle.kind is not None
        self._zeros, self._kind = cycle.zeros, cycle.kind
        self._coverage_factor = coverage_factor
        self._line = line
        self._clock = clock
        self._last_s = last_s
        self.late: tuple[WheelPosition, ...] = ()
        self.armed = set(before.lives)
        self._ending = threading.Event()
        self._dark: set[str] = set()
        self._shots = {position.name: 0 for position in positions}
        self._followers = {position.name: position.follower() for position in positions}
        self._running = {self._begin(position): position for position in positions}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending.set()
        # The cameras are needed for the measurement that counts.
        _, late = wait(self._running, self._last_s)
        self._threads.leave(late)
        self.late = tuple(self._running[future] for future in late)

    def step(self, timeout_s: float) -> None:
        """Wait for the next results at most this long, show them, and measure those wheels again."""
        done, _ = wait(self._running, timeout_s, FIRST_COMPLETED)
        for future in done:
            position = self._running.pop(future)
            result, started_s = self._result(future, position)
            self._remember(result)
            self._shots[position.name] = (self._shots[position.name] + 1) % 256
            evaluation = self._judge(result)
            self._line.publish_live(self._live(result, evaluation), started_s)
            if self._guiding is not None:
                self._line.publish_guidance(
                    self._guide(self._guiding, result, evaluation, started_s), started_s
                )
            self._running[self._begin(position)] = position

    def _remember(self, result: WheelResult) -> None:
        failure = result.failure
        if failure is not None and failure.error_code is ErrorCode.CAMERA_FAULT:
            self._dark.add(result.wheel)
        else:
            self._dark.discard(result.wheel)

    def _begin(self, position: WheelPosition) -> Future[tuple[WheelResult, float]]:
        return self._threads.submit(position.name, self._measure, position)

    def _result(
        self, future: Future[tuple[WheelResult, float]], position: WheelPosition
    ) -> tuple[WheelResult, float]:
        try:
            return future.result()
        except Exception as error:  # noqa: BLE001
            # A mistake in the program must not end the adjusting, nor the station.
            text = f"{position.name}: {type(error).__name__}: {error}"
            return position.failed(fault(ErrorCode.INTERNAL_FAULT, text)), self._clock()

    def _measure(self, position: WheelPosition) -> tuple[WheelResult, float]:
        if position.name in self._dark:
            self._ending.wait(_REST_S)
        # The angles are as old as the moment before the exposure, at most.
        started_s = self._clock()
        try:
            if position.name not in self.armed:
                position.arm()
            live = self._before.lives.get(position.name)
            follower = self._followers[position.name]
            result = position.run(self._zeros, live, follower)
            if result.shot is None:
                self.armed.discard(position.name)
                if follower is not None:
                    follower.forget()
            if live is None and self._before.wanted and result.measurement is not None:
                # A tyre plane is not shown as if it were the axis.
                return position.failed(fault(ErrorCode.MEASUREMENT_REFUSED, _NO_RUN_OUT)), started_s
            return result, started_s
        except TruewheelError as error:
            return position.failed(fault(ErrorCode.CAMERA_FAULT, str(error))), started_s

    def _judge(self, result: WheelResult) -> Evaluation:
        if result.measurement is not None:
            self._seen[result.wheel] = result.without_images()
        # Lengths and other wheels say nothing of whether this one is good.
        results = [*(self._seen | {result.wheel: result}).values()]
        return evaluate(self._kind, results, self._coverage_factor, self._frame, [self._line.told()])

    def _guide(
        self, guiding: Guiding, result: WheelResult, evaluation: Evaluation, started_s: float
    ) -> Guidance:
        shot = self._shots[result.wheel]
        try:
            return guiding.take(evaluation, result.wheel, started_s, shot)
        except Exception:  # noqa: BLE001
            # Live angles go on without guidance, which says no more than that.
            _LOG.exception("guidance of %s failed", result.wheel)
            return Guidance(result.wheel, GuidanceState.NONE, shot)

    def _live(self, result: WheelResult, evaluation: Evaluation) -> LiveAngles:
        shot, found = self._shots[result.wheel], result.measurement
        judged = next(wheel for wheel in evaluation.wheels if wheel.result is result)
        state = _STATES.get(combined(judged.angles))
        if judged.values is None or state is None:
            return LiveAngles(result.wheel, LiveState.NOT_MEASURED, shot)
        camber, toe = math.degrees(judged.values.camber), math.degrees(judged.values.toe)
        kind = AxisKind.of_method(None if found is None else found.method)
        return LiveAngles(result.wheel, state, shot, camber, toe, kind)
