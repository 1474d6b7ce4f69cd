"""Points about the steering: sweeps and how they end, and guidance. A station need not offer sweeps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from station.cycle import ErrorCode, Mode, Outcome, SteeringWheel, Step
from station.guidance import GuidanceState
from station.line.plc import PlcResult, say_step, turn_steering
from station.line.tools.trial import Trial
from station.line.wire import Answer, CommandCode, HandshakeState, LineStatus

C, E = CommandCode, ErrorCode
_SWEEPING = (HandshakeState.SWEEPING, HandshakeState.TURNING)
Odd = Callable[[Trial, int], None]
"""What a controller does instead of turning the steering to a position, of the start with this number."""


def step_without_a_sweep(trial: Trial) -> None:
    """A step that nobody waits for is refused: a station without sweeps knows no such command."""
    sequence = trial.plc.number()
    trial.plc.command(C.STEP, sequence)

    def refused() -> bool:
        answer, status = trial.plc.view.answer, trial.plc.status
        known = answer is not None and (answer.code, answer.sequence) == (C.STEP, sequence)
        unknown = status is not None and status.error_code is E.UNKNOWN_COMMAND
        return unknown or (known and answer is not None and answer.answer is Answer.REFUSED)

    came = trial.plc.view.wait_until(2.0, refused)
    trial.plc.withdraw()
    trial.expect("a refusal of step while no sweep is under way", came)
    trial.status("ready after it", lambda s: s.ready)


def swept_to_the_end(trial: Trial) -> None:
    """Each position is wanted, stepped to and taken; then there are results, of the steering axes too."""
    begun = _begun(trial)
    if begun is None:
        return
    wanted: list[int] = []

    def turned(position: int, wanted_deg: float) -> float:
        wanted.append(position)
        return wanted_deg

    turn_steering(trial.plc, begun, turned)
    result = trial.end(begun)
    trial.expect(
        f"positions one by one from 1, found {', '.join(map(str, wanted)) or 'none'}",
        sorted(set(wanted)) == list(range(1, max(wanted, default=0) + 1)) and len(wanted) > 1,
    )
    trial.expect(
        f"a verdict after the sweep, found {result.vehicle.outcome}",
        result.vehicle.outcome in (Outcome.OK, Outcome.NOK, Outcome.FAULT),
    )
    steering = result.vehicle.steering
    trial.expect(
        "no vehicle that is ok without what the sweep was asked for: "
        f"{', '.join(steering.missed) or 'no steering axis'}",
        result.vehicle.outcome is not Outcome.OK or (bool(steering.axes) and not steering.missed),
    )


def ended_by(code: ErrorCode, odd: Odd, position: int = 2) -> Callable[[Trial], None]:
    """A point: what the controller does at a position ends the sweep with this code, and never with ok."""

    def run(trial: Trial) -> None:
        result = _ended(trial, odd, position)
        if result is None:
            return
        told = [m.values["ErrorCode"] for m in result.received if m.name == "Status"]
        trial.expect(
            f"no verdict on a vehicle whose sweep has failed, found {result.vehicle.outcome}",
            not result.vehicle.outcome.judged,
        )
        trial.expect(f"{code} in Status, found {', '.join(sorted({*map(str, told)}))}", code in told)
        trial.status("ready after it", lambda s: s.ready)

    return run


def aborted(trial: Trial) -> None:
    """An abort while a step is awaited aborts all wheels."""
    result = _ended(trial, lambda t, sequence: t.plc.abort(sequence), 2)
    if result is not None:
        trial.expect(f"aborted, found {result.vehicle.outcome}", result.vehicle.outcome is Outcome.ABORTED)


def lost_heartbeat(trial: Trial) -> None:
    """Without Command frames a sweep ends: nobody knows who turns the steering."""

    def pause(trial: Trial, sequence: int) -> None:
        trial.plc.paused = True
        try:
            trial.status("the end of the sweep", lambda s: s.done and s.sequence == sequence)
        finally:
            trial.plc.paused = False

    result = _ended(trial, pause, 2)
    if result is not None:
        # With the heartbeat the angle is lost too; which of both is seen first is no matter.
        ended = result.vehicle.outcome in (Outcome.ABORTED, Outcome.FAULT)
        trial.expect(f"aborted or a fault, found {result.vehicle.outcome}", ended)


def guidance(trial: Trial) -> None:
    """What is told of guidance while adjusting is whole, with its age, and over when adjusting is."""
    sequence, _ = trial.plc.begin(trial.order(Mode.ADJUST))
    view = trial.plc.view
    view.wait_until(min(2.0, trial.vehicles.patience_s), lambda: bool(view.guidance))
    shown = view.guidance
    for wheel, (told, age_s) in shown.items():
        trial.expect(f"an age of the guidance of {wheel}, found none", age_s is not None)
        trial.expect(
            f"turns to go of {wheel} beside a direction, found {told.turns_to_go} and {told.direction}",
            told.state is not GuidanceState.TURN or told.turns_to_go is not None,
        )
    trial.plc.abort(sequence)
    trial.status("the end of adjusting", lambda s: s.done and s.sequence == sequence)
    over = view.wait_until(
        2.0, lambda: all(told.state is GuidanceState.NONE for told, _ in view.guidance.values())
    )
    trial.end(sequence)
    trial.expect("guidance of state none when adjusting is over", over)


def stop(trial: Trial, sequence: int) -> None:
    """Send stop."""
    trial.plc.stop(sequence)


def lose_the_angle(trial: Trial, sequence: int) -> None:
    """Tell no angle any more."""
    del sequence
    trial.plc.teller.sensor = lambda steering: None


def call_the_angle_invalid(trial: Trial, sequence: int) -> None:
    """Tell that the angle is not valid."""
    del sequence
    trial.plc.teller.sensor = lambda steering: SteeringWheel(None)


def freeze_the_sensor(trial: Trial, sequence: int) -> None:
    """Claim steps while the angle that is told stays what it was."""
    stood = trial.plc.teller.steering
    assert stood is not None
    trial.plc.teller.sensor = lambda steering: stood
    told = trial.plc.view.progress
    assert told is not None
    assert told[1].wanted_deg is not None
    say_step(trial.plc, Step(sequence, told[1].position, told[1].wanted_deg))


def let_the_angle_jump(trial: Trial, sequence: int) -> None:
    """Tell an angle far from the one just told."""
    del sequence
    trial.plc.teller.sensor = lambda steering: replace(
        steering, angle_deg=(steering.angle_deg or 0.0) + 900.0
    )


def _ended(trial: Trial, odd: Odd, position: int) -> PlcResult | None:
    """Begin a sweep, do something odd at a position, and take the results over; None without sweeps."""
    begun = _begun(trial)
    if begun is None:
        return None
    try:
        turn_steering(trial.plc, begun, lambda at, wanted_deg: None if at == position else wanted_deg)
        odd(trial, begun)
        trial.status("the end of the sweep", lambda s: s.done and s.sequence == begun)
    finally:
        trial.plc.teller.forget()
    return trial.end(begun)


def _begun(trial: Trial) -> int | None:
    """Start a sweep; its number, None where the station offers none."""
    order = trial.order(Mode.SWEEP)
    trial.plc.teller.steering = SteeringWheel(0.0)
    trial.plc.view.record()
    sequence = trial.plc.number()
    trial.plc.give(C.START, order, sequence)

    def decided(status: LineStatus) -> bool:
        answer = trial.plc.view.answer_to(C.START, sequence)
        refused = answer is not None and answer.answer is Answer.REFUSED
        refused = refused and answer is not None and answer.error_code is not E.VIN_INCOMPLETE
        return refused or (status.sequence == sequence and status.handshake in _SWEEPING)

    trial.status("a sweep under way, or a refusal", decided)
    # A start that was accepted may still be declined by the cycle.
    trial.plc.view.wait_until(0.2, lambda: False)
    answer = trial.plc.view.answer_to(C.START, sequence)
    trial.plc.withdraw(C.START, sequence)
    if answer is None or answer.answer is not Answer.REFUSED:
        return sequence
    trial.plc.teller.forget()
    trial.expect(
        f"mode_not_available where there are no sweeps, found {answer.error_code}",
        answer.error_code is E.MODE_NOT_AVAILABLE,
    )
    return None
