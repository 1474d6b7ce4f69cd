"""Points that a station at the line must fulfil, each tried out on it and judged by itself.

`truewheel line check` tries all of them, a scenario file of `truewheel line plc` some of them. A point begins
with a ready station and leaves one; it fails with a sentence that says what was expected and what was seen.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

from alignment.counting import listed
from alignment.errors import TruewheelError
from station.cycle import ErrorCode, LiveState, Mode, Outcome
from station.line.tools import conformance_steering as steering
from station.line.tools.conformance_values import (
    geometry_of_the_vehicle,
    kind_of_wheels,
    live_ages,
    masters_agree,
    mode_of_no_station,
    older_controller,
)
from station.line.tools.trial import Point, PointVerdict, Trial
from station.line.wire import INTERFACE_MAJOR, CommandAnswer, CommandCode, HandshakeState, Spoil

C, E = CommandCode, ErrorCode
_STATUS_JITTER = 2.0
_PERIODS = 10


def _status_comes(trial: Trial) -> None:
    period = trial.database.cycle_time_s("Status") or 0.1
    trial.plc.view.record()
    trial.plc.view.wait_until(_PERIODS * period, lambda: False)
    times = [m.time_s for m in trial.plc.view.recorded() if m.name == "Status"]
    longest = max((b - a for a, b in itertools.pairwise(times)), default=float("inf"))
    trial.expect(
        f"Status every {1e3 * period:g} ms, found a gap of {1e3 * longest:.0f} ms",
        longest <= _STATUS_JITTER * period,
    )


def _frames_protected(trial: Trial) -> None:
    trial.plc.run(trial.order())
    health = trial.plc.link_health
    trial.expect(
        f"every frame with good CRC and counter, found {health}",
        health.good > 0 and health.wrong_crc == health.wrong_counter == health.malformed == 0,
    )


def _interface_version(trial: Trial) -> None:
    trial.plc.view.wait_until(3.0, lambda: trial.plc.view.info is not None)
    info, known = trial.plc.view.info, trial.database.interface_version
    trial.expect(f"StationInfo with version {known[0]}.x, found {info or 'none'}", info is not None)
    assert info is not None
    trial.expect(f"version {known[0]}.x, found {info}", info.interface[0] == known[0])


def _heartbeat_comes_back(trial: Trial) -> None:
    seen: set[int] = set()

    def two() -> bool:
        answer = trial.plc.view.answer
        if answer is not None:
            seen.add(answer.heartbeat)
        return len(seen) > 3

    trial.plc.view.wait_until(2.0, two)
    trial.expect(f"another HeartbeatEcho with each Command, found {listed(sorted(seen))}", len(seen) > 3)


def _lost_heartbeat(trial: Trial) -> None:
    trial.plc.paused = True
    try:
        lost = trial.status("not ready without Command frames", lambda s: not s.ready)
        trial.expect(f"communication_lost, found {lost.error_code}", lost.error_code is E.COMMUNICATION_LOST)
    finally:
        trial.plc.paused = False
    trial.status("ready again", lambda s: s.ready)


def _start_after_silence(trial: Trial) -> None:
    trial.plc.paused = True
    try:
        trial.status("not ready without Command frames", lambda s: not s.ready)
        sequence = trial.plc.number()
    finally:
        trial.plc.paused = False
    trial.plc.give(C.START, trial.order(), sequence)
    trial.refused(C.START, sequence, E.START_STALE)


def _bad_frames(spoil: Spoil) -> Callable[[Trial], None]:
    def run(trial: Trial) -> None:
        sequence = trial.plc.number()
        trial.plc.spoil = spoil
        try:
            for _ in range(3):
                trial.plc.give(C.START, trial.order(), sequence)
            moved = trial.plc.view.wait_until(
                0.3, lambda: trial.plc.status is not None and trial.plc.status.busy
            )
            trial.expect("no cycle from bad frames, found busy", not moved)
        finally:
            trial.plc.withdraw()
            trial.plc.spoil = None
        trial.status("ready after bad frames", lambda s: s.ready)

    return run


def _vin_incomplete(trial: Trial) -> None:
    sequence = trial.plc.number()
    trial.plc.command(C.START, sequence)
    found: list[CommandAnswer] = []

    def refused() -> bool:
        answer = trial.plc.view.answer
        if answer is not None and (answer.code, answer.sequence) == (C.START, sequence):
            found.append(answer)
        return bool(found)

    trial.plc.view.wait_until(2.0, refused)
    trial.plc.withdraw()
    # No wheel is marked either; a station may name what it likes first.
    reasons = (E.VIN_INCOMPLETE, E.NO_WHEELS)
    trial.expect(
        f"refused with vin_incomplete, found {listed(found)}", bool(found) and found[0].error_code in reasons
    )


def _vin_invalid(trial: Trial) -> None:
    sequence = trial.plc.number()
    trial.plc.give(C.START, trial.order(vin="TWCHKXOOOOOOOOOO1"), sequence)
    trial.refused(C.START, sequence, E.VIN_INVALID)


def _no_wheels(trial: Trial) -> None:
    sequence = trial.plc.number()
    trial.plc.give(C.START, trial.order(wheels=()), sequence)
    trial.refused(C.START, sequence, E.NO_WHEELS)


def _unknown_type(trial: Trial) -> None:
    sequence = trial.plc.number()
    trial.plc.give(C.START, trial.order(vehicle_type=trial.vehicles.unknown_type), sequence)
    trial.plc.view.wait_until(2.0, lambda: _answered(trial, E.UNKNOWN_VEHICLE_TYPE))
    trial.refused(C.START, sequence, E.UNKNOWN_VEHICLE_TYPE)
    trial.status("ready after the refusal", lambda s: s.ready)


def _answered(trial: Trial, code: ErrorCode) -> bool:
    answer = trial.plc.view.answer
    return answer is not None and answer.error_code is code


def _number_zero(trial: Trial) -> None:
    trial.plc.give(C.START, trial.order(), 0)
    trial.refused(C.START, 0, E.WRONG_SEQUENCE)


def _good_cycle(trial: Trial) -> None:
    result = trial.plc.run(trial.order())
    trial.expect(
        f"busy before the results, found {result.busy_s} and {result.done_s}",
        result.started_s <= result.busy_s <= result.done_s,
    )
    early = [
        m.name
        for m in result.received
        if m.values.get("Sequence") == result.sequence
        and m.time_s < result.busy_s
        and m.name in trial.database.result_messages
    ]
    trial.expect(f"no result before busy, found {listed(early)}", not early)
    trial.expect(
        f"a verdict on the vehicle, found {result.vehicle.outcome}",
        result.vehicle.outcome in (Outcome.OK, Outcome.NOK, Outcome.FAULT),
    )
    trial.status("ready after the acknowledgement", lambda s: s.ready)


def _repeated_start(trial: Trial) -> None:
    order = trial.order()
    sequence, started_s = trial.plc.begin(order)
    for _ in range(3):
        trial.plc.give(C.START, order, sequence)
    trial.status("ResultValid once", lambda s: s.done and s.sequence == sequence)
    trial.plc.give(C.START, order, sequence)
    trial.accepted(C.START, sequence)
    trial.plc.finish(order, sequence, started_s)
    trial.status("ready", lambda s: s.ready)
    trial.plc.give(C.START, order, sequence)
    trial.refused(C.START, sequence, E.SEQUENCE_USED)


def _start_while_held(trial: Trial) -> None:
    sequence = trial.held()
    other = trial.plc.number()
    trial.plc.give(C.START, trial.order(), other)
    trial.refused(C.START, other, E.NOT_ACKNOWLEDGED)
    trial.end(sequence)


def _held_until_acknowledged(trial: Trial) -> None:
    sequence = trial.held()
    trial.plc.view.record()
    repeated = trial.plc.view.wait_until(
        2.0, lambda: trial.plc.view.results.get("VehicleResult", {}).get("Sequence") == sequence
    )
    trial.expect("the results again while they are held", repeated)
    wrong = sequence % 255 + 1
    trial.plc.acknowledge(wrong)
    trial.refused(C.ACKNOWLEDGE, wrong, E.WRONG_SEQUENCE)
    trial.status("ResultValid still", lambda s: s.done and s.sequence == sequence)
    trial.end(sequence)
    trial.plc.acknowledge(sequence)
    trial.accepted(C.ACKNOWLEDGE, sequence)


def _slow_controller(trial: Trial) -> None:
    sequence = trial.held()
    trial.plc.view.wait_until(3.0, lambda: False)
    trial.status("ResultValid after three seconds", lambda s: s.done and s.sequence == sequence)
    trial.end(sequence)


def _abort_while_busy(trial: Trial) -> None:
    sequence, _ = trial.plc.begin(trial.order())
    trial.plc.abort(sequence)
    result = trial.end(sequence)
    # An abort that comes too late changes nothing: the results were on their way.
    trial.expect(
        f"aborted, found {result.vehicle.outcome}",
        result.vehicle.outcome is Outcome.ABORTED or result.vehicle.outcome.judged,
    )
    trial.status("ready", lambda s: s.ready)


def _abort_elsewhere(trial: Trial) -> None:
    stranger = trial.plc.number()
    trial.plc.command(C.ABORT, stranger)
    trial.refused(C.ABORT, stranger, E.WRONG_SEQUENCE)
    trial.plc.prepare(trial.order())
    trial.plc.abort(stranger)
    trial.status("not prepared any more", lambda s: s.handshake is HandshakeState.READY)
    sequence = trial.held()
    trial.plc.command(C.ABORT, sequence)
    trial.accepted(C.ABORT, sequence)
    result = trial.end(sequence)
    trial.expect(
        f"results as they were, found {result.vehicle.outcome}",
        result.vehicle.outcome is not Outcome.ABORTED,
    )


def _acknowledge_too_early(trial: Trial) -> None:
    sequence, _ = trial.plc.begin(trial.order())
    trial.plc.acknowledge(sequence)
    answer = trial.plc.answer_to(C.ACKNOWLEDGE, sequence)
    trial.plc.withdraw()
    status = trial.status("ResultValid or ready", lambda s: s.done or s.ready)
    early = answer.error_code is E.NOTHING_TO_ACKNOWLEDGE
    trial.expect(f"nothing_to_acknowledge or held results, found {answer}", early or status.ready)
    if status.done:
        trial.end(sequence)


def _reset_everywhere(trial: Trial) -> None:
    trial.plc.reset()
    trial.plc.begin(trial.order())
    trial.plc.reset()
    trial.held()
    trial.plc.reset()
    status = trial.status("ready", lambda s: s.ready)
    trial.expect("nothing held after a reset", not status.done)
    trial.plc.run(trial.order())


def _stop_without_adjusting(trial: Trial) -> None:
    number = trial.plc.number()
    trial.plc.command(C.STOP, number)
    trial.refused(C.STOP, number, E.NOTHING_TO_STOP)


def _prepare(trial: Trial) -> None:
    trial.plc.prepare(trial.order())
    trial.status("prepared and ready", lambda s: s.handshake is HandshakeState.PREPARED and s.ready)
    trial.plc.stop(trial.plc.number())
    trial.status("not prepared any more", lambda s: s.handshake is HandshakeState.READY)
    trial.plc.prepare(trial.order())
    trial.plc.run(trial.order())


def _master_check(trial: Trial) -> None:
    result = trial.plc.run(trial.order(Mode.MASTER_CHECK))
    trial.expect(
        f"a verdict, found {result.vehicle.outcome}",
        result.vehicle.outcome in (Outcome.OK, Outcome.NOK, Outcome.FAULT),
    )


def _live(trial: Trial) -> None:
    live = trial.plc.view.live
    found = ", ".join(f"{wheel} {angles.state}" for wheel, angles in live.items())
    trial.expect(
        f"live angles of each wheel, found {found or 'none'}",
        trial.plc.view.wait_until(
            trial.vehicles.patience_s,
            lambda: any(
                angles.state in (LiveState.INSIDE, LiveState.OUTSIDE)
                for angles in trial.plc.view.live.values()
            ),
        ),
    )


def _adjust(trial: Trial) -> None:
    sequence, _ = trial.plc.begin(trial.order(Mode.ADJUST))
    trial.status("adjusting", lambda s: s.handshake is HandshakeState.ADJUSTING)
    _live(trial)
    trial.plc.stop(sequence)
    result = trial.end(sequence)
    trial.expect(
        f"a verdict after stop, found {result.vehicle.outcome}",
        result.vehicle.outcome in (Outcome.OK, Outcome.NOK, Outcome.FAULT),
    )


def _adjust_aborted(trial: Trial) -> None:
    sequence, _ = trial.plc.begin(trial.order(Mode.ADJUST))
    trial.plc.abort(sequence)
    result = trial.end(sequence)
    trial.expect(f"aborted, found {result.vehicle.outcome}", result.vehicle.outcome is Outcome.ABORTED)


def _adjust_lost(trial: Trial) -> None:
    sequence, _ = trial.plc.begin(trial.order(Mode.ADJUST))
    trial.plc.paused = True
    try:
        trial.status("the end of adjusting", lambda s: s.done and s.sequence == sequence)
    finally:
        trial.plc.paused = False
    result = trial.end(sequence)
    trial.expect(f"aborted, found {result.vehicle.outcome}", result.vehicle.outcome is Outcome.ABORTED)


POINTS: tuple[Point, ...] = (
    Point("status-comes", "Status comes at its cycle time", _status_comes),
    Point("frames-protected", "every frame has a good CRC and counter", _frames_protected),
    Point("interface-version", "StationInfo names the interface's version", _interface_version),
    Point("older-controller", "commands of a controller of another interface are refused", older_controller),
    Point("unserved-mode", "a start in a mode that the station has not is refused", mode_of_no_station),
    Point("heartbeat-echo", "the heartbeat comes back", _heartbeat_comes_back),
    Point("lost-heartbeat", "without Command frames the station is not ready", _lost_heartbeat),
    Point(
        "start-after-silence",
        "a start from before the communication came back is refused",
        _start_after_silence,
    ),
    Point("wrong-crc", "a start with a wrong CRC is not carried out", _bad_frames("crc")),
    Point("wrong-counter", "a start with a wrong counter is not carried out", _bad_frames("counter")),
    Point("vin-incomplete", "a start without its VIN is refused", _vin_incomplete),
    Point("vin-invalid", "a VIN with a wrong character is refused", _vin_invalid),
    Point("no-wheels", "a start without a wheel is refused", _no_wheels),
    Point("number-zero", "a start with the number 0 is refused", _number_zero),
    Point("unknown-vehicle-type", "an unknown vehicle type is refused", _unknown_type),
    Point("good-cycle", "start, busy, results, ResultValid, acknowledge, ready, in this order", _good_cycle),
    Point("wheel-axes", "each judged wheel says what its angles are those of", kind_of_wheels),
    Point("geometry", "results say what angles and lengths refer to", geometry_of_the_vehicle),
    Point("repeated-start", "a repeated start counts once", _repeated_start),
    Point("start-while-held", "no other start while results are held", _start_while_held),
    Point("held-results", "results are sent until their number is acknowledged", _held_until_acknowledged),
    Point("slow-controller", "results are held for a controller that takes its time", _slow_controller),
    Point("abort-while-busy", "an abort ends the cycle and its wheels are aborted", _abort_while_busy),
    Point(
        "abort-elsewhere", "an abort when ready, prepared or with results held does no harm", _abort_elsewhere
    ),
    Point("early-acknowledge", "an acknowledgement before the results is harmless", _acknowledge_too_early),
    Point("reset-everywhere", "a reset makes ready: idle, busy, with results held", _reset_everywhere),
    Point("stop-without-adjusting", "stop without adjusting is refused", _stop_without_adjusting),
    Point("prepare", "prepare is accepted, stop takes it back", _prepare),
    Point("master-check", "a master wheel is measured and reported", _master_check, Mode.MASTER_CHECK),
    Point("master-state", "MasterCheck and Ready agree", masters_agree),
    Point("adjust", "live angles until stop, then a result", _adjust, Mode.ADJUST),
    Point("live-ages", "live angles come with their age", live_ages, Mode.ADJUST),
    Point("adjust-aborted", "an abort ends adjusting", _adjust_aborted, Mode.ADJUST),
    Point("adjust-lost-heartbeat", "a lost heartbeat ends adjusting", _adjust_lost, Mode.ADJUST),
    Point("guidance", "guidance has its age and ends with adjusting", steering.guidance, Mode.ADJUST),
    Point("step-nowhere", "a step without a sweep is refused", steering.step_without_a_sweep),
    Point("sweep", "a sweep goes from position to position", steering.swept_to_the_end, Mode.SWEEP),
    Point(
        "sweep-stopped",
        "a stop ends a sweep without a verdict",
        steering.ended_by(E.SWEEP_FAULT, steering.stop),
        Mode.SWEEP,
    ),
    Point("sweep-aborted", "an abort ends a sweep", steering.aborted, Mode.SWEEP),
    Point("sweep-lost-heartbeat", "a lost heartbeat ends a sweep", steering.lost_heartbeat, Mode.SWEEP),
    Point(
        "sweep-angle-lost",
        "a steering wheel's angle that is lost ends a sweep",
        steering.ended_by(E.STEERING_FAULT, steering.lose_the_angle),
        Mode.SWEEP,
    ),
    Point(
        "sweep-angle-invalid",
        "a steering wheel's angle that is not valid ends a sweep",
        steering.ended_by(E.STEERING_FAULT, steering.call_the_angle_invalid, 3),
        Mode.SWEEP,
    ),
    Point(
        "sweep-angle-frozen",
        "a sensor that stands while steps are claimed ends a sweep",
        steering.ended_by(E.STEERING_FAULT, steering.freeze_the_sensor),
        Mode.SWEEP,
    ),
    Point(
        "sweep-angle-jumps",
        "a steering wheel's angle that jumps ends a sweep",
        steering.ended_by(E.STEERING_FAULT, steering.let_the_angle_jump),
        Mode.SWEEP,
    ),
)
"""All points, in the order in which they are tried."""


def point_named(name: str) -> Point | None:
    """The point of a name, or None."""
    return next((point for point in POINTS if point.name == name), None)


def try_point(point: Point, trial: Trial) -> PointVerdict:
    """Try one point out, and leave a ready station behind."""
    failure: str | None = None
    try:
        trial.plc.start_up()
        point.run(trial)
    except TruewheelError as error:
        failure = str(error)
    trial.plc.teller.forget()
    trial.plc.spoil, trial.plc.paused, trial.plc.interface = None, False, INTERFACE_MAJOR
    trial.plc.withdraw()
    return PointVerdict(point.name, point.requirement, failure)


def check_station(trial: Trial, points: tuple[Point, ...] = POINTS) -> Iterator[PointVerdict]:
    """Try points out, one after the other."""
    for point in points:
        yield try_point(point, trial)
