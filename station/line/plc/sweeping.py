"""The controller's part in a sweep: it turns the steering to where the station wants it, and says step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from alignment.errors import LineTimeoutError
from station.cycle import ErrorCode, SteeringSource, SteeringWheel, Step, SweepProgress, SweepState
from station.line.plc.orders import PlcTimeouts
from station.line.plc.station_view import StationView
from station.line.plc.teller import VehicleTeller
from station.line.wire import Answer, CommandCode, HandshakeState, LineStatus

SWEEPING = (HandshakeState.SWEEPING, HandshakeState.TURNING)
_TURN_DEG_S, _TURN_S = 200.0, 0.01
_PASSING = frozenset({ErrorCode.BUSY, ErrorCode.STEP_INCOMPLETE})


TurnedTo = Callable[[int, float], float | None]


class Controller(Protocol):
    """What is needed of the controller; `station.line.plc.simulator.PlcSimulator` is one."""

    view: StationView
    teller: VehicleTeller
    timeouts: PlcTimeouts
    clock: Callable[[], float]

    @property
    def status(self) -> LineStatus | None:
        """The last good Status."""
        ...

    def tick(self) -> None:
        """Send what stands once."""
        ...

    def command(self, code: CommandCode, sequence: int) -> None:
        """Put a command on the bus."""
        ...

    def withdraw(self, code: CommandCode | None = None, sequence: int = 0) -> None:
        """Go back to none."""
        ...


def turn_steering(
    plc: Controller, sequence: int, turned: TurnedTo = lambda position, wanted_deg: wanted_deg
) -> SweepProgress | None:
    """Go through a sweep that has begun, to its end.

    Parameters
    ----------
    plc
        The controller.
    sequence
        Number of the start.
    turned
        To what angle the steering is turned, degrees, of a position and the angle that is wanted; None leaves
        the sweep there.

    Returns
    -------
    The progress that was shown last; None before the first.

    Raises
    ------
    LineTimeoutError
        When the station is silent, or the next position is not wanted in time.
    """
    seen = 0
    while True:
        progress = _next(plc, sequence, seen)
        if progress is None or progress.wanted_deg is None or progress.state is not SweepState.TURN:
            return progress
        seen = plc.view.turnings
        angle_deg = turned(progress.position, progress.wanted_deg)
        if angle_deg is None:
            return progress
        _turn(plc, angle_deg)
        say_step(plc, Step(sequence, progress.position, angle_deg))


def say_step(plc: Controller, step: Step) -> None:
    """Put a step on the bus, its position before it, until the station took or refused it, or ended.

    All steps of a sweep have one number, so that an answer may be that of the step before: what counts is
    that the station does not wait for this one any more.
    """
    seen = plc.view.turnings
    plc.teller.step = step
    plc.command(CommandCode.STEP, step.sequence)
    try:
        plc.view.wait(f"an end of {step}", plc.timeouts.done_s, lambda status: _is_taken(plc, step, seen))
    finally:
        plc.withdraw(CommandCode.STEP, step.sequence)
        plc.teller.step = None


def _turn(plc: Controller, angle_deg: float) -> None:
    """Turn the steering wheel, no faster than a robot would, and tell its angle all the while."""
    told = plc.teller.steering
    now_deg = angle_deg if told is None or told.angle_deg is None else told.angle_deg
    before_s = plc.clock()
    while now_deg != angle_deg:
        plc.view.wait_until(_TURN_S, lambda: False)
        now_s = plc.clock()
        most_deg, before_s = _TURN_DEG_S * (now_s - before_s), now_s
        now_deg += min(max(angle_deg - now_deg, -most_deg), most_deg)
        plc.teller.steering = SteeringWheel(now_deg, 0.0, SteeringSource.VEHICLE)
    plc.teller.steering = SteeringWheel(angle_deg, 0.0, SteeringSource.VEHICLE)
    # The station must have heard of the angle before it hears of the step.
    plc.tick()


def _is_taken(plc: Controller, step: Step, seen: int) -> bool:
    status, answer = plc.status, plc.view.answer_to(CommandCode.STEP, step.sequence)
    waits = status is not None and status.handshake is HandshakeState.TURNING
    if not waits or plc.view.turnings > seen:
        return True
    refused = answer is not None and answer.answer is Answer.REFUSED
    return refused and answer is not None and answer.error_code not in _PASSING


def _next(plc: Controller, sequence: int, seen: int) -> SweepProgress | None:
    """The progress when a position is wanted once more than `seen` times, or the sweep is over."""

    def over() -> bool:
        status = plc.status
        return status is None or status.sequence != sequence or status.handshake not in SWEEPING

    def wanted() -> bool:
        status, told = plc.status, plc.view.progress
        turning = status is not None and status.handshake is HandshakeState.TURNING
        # The first frame of the progress only sets its counter.
        known = told is not None and told[0] == sequence and told[1].state is SweepState.TURN
        return turning and known and plc.view.turnings > seen

    if not plc.view.wait_until(plc.timeouts.done_s, lambda: over() or wanted()):
        raise LineTimeoutError(f"expected another position of sweep {sequence}; last status: {plc.status}")
    told = plc.view.progress
    return None if told is None or told[0] != sequence else told[1]
