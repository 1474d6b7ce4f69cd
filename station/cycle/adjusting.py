"""Live angles while an operator turns the tie rods: every rig measures again and again in its thread."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from types import TracebackType
from typing import Protocol, Self

from alignment.errors import TruewheelError
from station.cycle.frame import CommonFrame
from station.cycle.judging import evaluate
from station.cycle.positions import WheelPosition, WheelResult, fault
from station.cycle.under_way import CycleUnderWay
from station.cycle.verdict import Status, combined
from station.cycle.wheel_threads import WheelThreads
from station.cycle.words import ErrorCode, LiveAngles, LiveState

_STATES = {Status.OK: LiveState.INSIDE, Status.NOK: LiveState.OUTSIDE}


class LiveLine(Protocol):
    """What is needed of the line."""

    def publish_live(self, angles: LiveAngles, measured_s: float) -> None:
        """Show angles of a wheel."""
        ...


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

    Attributes
    ----------
    late
        Positions whose last shot did not end in time; empty before the end.
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
        frame: CommonFrame | None = None,
    ) -> None:
        self._threads = threads
        self._frame = frame
        self._seen: dict[str, WheelResult] = {}
        assert cycle.kind is not None
        self._zeros, self._kind = cycle.zeros, cycle.kind
        self._coverage_factor = coverage_factor
        self._line = line
        self._clock = clock
        self._last_s = last_s
        self.late: tuple[WheelPosition, ...] = ()
        self._shots = {position.name: 0 for position in positions}
        self._running = {self._begin(position): position for position in positions}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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
            self._shots[position.name] = (self._shots[position.name] + 1) % 256
            self._line.publish_live(self._live(result), started_s)
            self._running[self._begin(position)] = position

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
        # The angles are as old as the moment before the exposure, at most.
        started_s = self._clock()
        try:
            position.rig.arm()
            return position.run(self._zeros), started_s
        except TruewheelError as error:
            return position.failed(fault(ErrorCode.CAMERA_FAULT, str(error))), started_s

    def _live(self, result: WheelResult) -> LiveAngles:
        shot = self._shots[result.wheel]
        found = result.measurement
        if found is not None:
            self._seen[result.wheel] = result.without_images()
        # Lengths and other wheels say nothing of whether this one is good.
        results = [*(self._seen | {result.wheel: result}).values()]
        evaluation = evaluate(self._kind, results, self._coverage_factor, self._frame)
        judged = next(wheel for wheel in evaluation.wheels if wheel.result is result)
        state = _STATES.get(combined(judged.angles))
        if judged.values is None or state is None:
            return LiveAngles(result.wheel, LiveState.NOT_MEASURED, shot)
        camber, toe = math.degrees(judged.values.camber), math.degrees(judged.values.toe)
        return LiveAngles(result.wheel, state, shot, camber, toe)
