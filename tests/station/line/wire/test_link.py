"""What the station's side does with bad frames, a lost controller, live angles, and results from before."""

from __future__ import annotations

import can
import pytest

from alignment.errors import LineError
from station.cycle.words.cycle import (
    Abort,
    Acknowledge,
    ErrorCode,
    LiveAngles,
    LiveState,
    Mode,
    Outcome,
    Prepare,
    Reset,
    StationState,
    StationStatus,
    Stop,
    Trigger,
    WheelAnswer,
)
from station.line.plc.station_view import StationView
from station.line.tools.monitor import decode_frame
from station.line.wire.bus import LineBus
from station.line.wire.dbc import LineDatabase
from station.line.wire.link import ProtectedLink
from station.line.wire.messages import Answer, LineStatus, StationInfo
from station.line.wire.messages import HandshakeState as State
from station.line.wire.protection import Check, Guard, Protector
from station.line.wire.status import detail_frame, info_frame, status_frame
from tests.station.line.line_bench import VIN, Bench, Clock, FakeCanBus, command_frame

IDLE = LineStatus(
    StationState.IDLE,
    sequence=0,
    ready=True,
    busy=False,
    done=False,
    fault=False,
    alive_counter=0,
    error_code=ErrorCode.NONE,
    error_sequence=0,
)
FOUR = ("front_left", "front_right", "rear_left", "rear_right")


def ok(wheel: str) -> WheelAnswer:
    return WheelAnswer(wheel, Outcome.OK, -0.5, 0.1, 0.001, 0.002)


def lose(bench: Bench) -> None:
    bench.clock.now += 0.6
    bench.line.tick()


def sent(bench: Bench, name: str) -> dict[str, object]:
    """The last message of a name that was sent since the last look."""
    return dict(dict(bench.messages())[name])


def test_command_with_a_wrong_crc_or_counter_did_not_happen(bench: Bench) -> None:
    bench.vin(1)
    frame = command_frame(bench.database, "start", 1)
    bench.protector.protect("Command", frame.data)
    frame.data[3] ^= 1
    bench.line.receive(frame)
    frame = command_frame(bench.database, "start", 1)
    bench.protector.protect("Command", frame.data, jump=7)
    bench.line.receive(frame)
    assert bench.commands() == []
    health = bench.line.health.link
    assert (health.wrong_crc, health.wrong_counter) == (1, 1)


def test_before_the_controller_is_heard_the_station_is_not_ready(bench: Bench) -> None:
    assert bench.line.status.ready
    lose(bench)
    status = bench.status
    assert not status.ready
    assert status.error_code is ErrorCode.COMMUNICATION_LOST
    assert not bench.answer.link_up
    assert not status.fault, "the station itself is sound"


def test_controller_that_comes_back_must_give_its_start_anew(bench: Bench) -> None:
    lose(bench)
    for _ in range(3):
        bench.vin(5)
        bench.command("start", 5)
    assert bench.answer.error_code is ErrorCode.START_STALE
    assert bench.commands() == []
    bench.command("none", 5)
    bench.start(5)
    assert [type(command) for command in bench.commands()] == [Trigger]


def test_cycle_goes_on_when_the_controller_is_lost_and_its_results_wait(bench: Bench) -> None:
    bench.start(1)
    lose(bench)
    assert bench.status.busy
    assert [type(command) for command in bench.commands()] == [Trigger]
    bench.line.send_results(1, [ok(wheel) for wheel in FOUR])
    assert bench.status.done
    bench.link_up()
    bench.command("acknowledge", 1)
    assert bench.commands() == [Acknowledge(1)]


def test_adjusting_ends_when_the_controller_is_lost(bench: Bench) -> None:
    bench.start(1, mode="adjust")
    (trigger,) = bench.commands()
    assert isinstance(trigger, Trigger)
    assert trigger.mode is Mode.ADJUST
    lose(bench)
    assert bench.commands() == [Abort(1, ErrorCode.COMMUNICATION_LOST)]
    assert bench.status.handshake is State.ENDING


def test_live_angles_go_out_at_once_and_turn_stale(bench: Bench) -> None:
    bench.start(1, mode="adjust")
    bench.messages()
    live = LiveAngles("front_left", LiveState.INSIDE, 7, -0.5, 0.25)
    bench.line.publish_live(live, bench.clock.now)
    found = sent(bench, "LiveAnglesFrontLeft")
    assert (found["State"], found["Shot"]) == ("inside", 7)
    assert found["Toe"] == pytest.approx(0.25)
    bench.clock.now += 0.4
    bench.command("none", 0)
    bench.line.tick()
    assert sent(bench, "LiveAnglesFrontLeft")["State"] == "inside"
    bench.clock.now += 0.61
    bench.line.tick()
    found = sent(bench, "LiveAnglesFrontLeft")
    assert (found["State"], found["Camber"], found["Toe"]) == ("stale", "invalid", "invalid")
    bench.command("none", 0)
    bench.command("none", 0)
    bench.line.send_results(1, [ok(wheel) for wheel in FOUR])
    bench.messages()
    bench.line.tick()
    assert "LiveAnglesFrontLeft" not in dict(bench.messages())


def test_stop_reaches_the_cycle(bench: Bench) -> None:
    bench.start(1, mode="adjust")
    bench.command("stop", 1)
    assert bench.commands()[-1] == Stop(1)
    assert bench.status.handshake is State.BUSY


def test_preparation_is_forgotten_after_a_while(bench: Bench) -> None:
    bench.command("prepare", 3, wheels=0b0011)
    assert bench.commands() == [Prepare(3, ("front_left", "front_right"), 7)]
    assert bench.status.handshake is State.PREPARED
    assert bench.answer.answer is Answer.ACCEPTED
    bench.clock.now += 301.0
    bench.line.tick()
    assert bench.status.handshake is State.READY


def test_preparation_that_the_cycle_declines(bench: Bench) -> None:
    bench.command("prepare", 3)
    bench.commands()
    bench.line.refuse(3, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    assert bench.answer.error_code is ErrorCode.UNKNOWN_VEHICLE_TYPE
    assert bench.status.ready


def test_mode_that_no_value_table_has(bench: Bench) -> None:
    bench.vin(1)
    frame = command_frame(bench.database, "start", 1)
    frame.data[7] |= 0x0F
    bench.receive(frame)
    assert bench.answer.error_code is ErrorCode.MODE_NOT_AVAILABLE
    assert bench.commands() == []


def test_results_of_an_earlier_run_are_offered_until_they_are_taken(bench: Bench) -> None:
    bench.line._handshake.__init__()  # type: ignore[misc]
    outcome = bench.line.restore_results(77, [ok(wheel) for wheel in FOUR])
    assert outcome is Outcome.OK
    assert (bench.line.status.done, bench.line.status.fault) == (True, False)
    bench.line.publish(StationStatus(StationState.REPORTING))
    assert (bench.status.done, bench.status.sequence) == (True, 77)
    bench.messages()
    bench.line.tick()
    assert sent(bench, "VehicleResult")["Sequence"] == 77
    bench.command("acknowledge", 77)
    assert bench.commands() == [Acknowledge(77)]


def test_information_and_error_detail_come_every_second_and_when_they_change(bench: Bench) -> None:
    bench.messages()
    bench.line.publish(StationStatus(StationState.FAULT, ErrorCode.CAMERA_FAULT, "rear_left"))
    detail = sent(bench, "ErrorDetail")
    assert (detail["Part"], detail["ErrorCode"], detail["Wheel"], detail["Count"]) == (
        "cameras",
        "camera_fault",
        "rear_left",
        1,
    )
    bench.line.publish(StationStatus(StationState.FAULT, ErrorCode.CAMERA_FAULT, "rear_left"))
    assert "ErrorDetail" not in dict(bench.messages())
    names: list[str] = []
    for _ in range(21):
        bench.clock.now += 0.1
        bench.line.tick()
        names += [name for name, _ in bench.messages()]
    assert names.count("Status") == 21
    assert 2 <= names.count("StationInfo") <= 3
    assert 2 <= names.count("ErrorDetail") <= 4
    assert bench.line.health.faults == 1


def test_refusal_that_comes_after_a_reset_is_harmless(bench: Bench) -> None:
    bench.start(1)
    bench.command("reset", 2)
    bench.line.refuse(1, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    assert bench.status.handshake is State.RESETTING


def test_trigger_carries_the_vin(bench: Bench) -> None:
    bench.start(1)
    assert bench.commands() == [Trigger(1, FOUR, 7, VIN)]


def test_first_frame_after_a_lost_communication_only_sets_the_counter(bench: Bench) -> None:
    """It may have waited in an adapter: that its counter is in step proves nothing."""
    lose(bench)
    bench.command("none", 0)
    bench.line.tick()
    assert not bench.answer.link_up
    assert not bench.status.ready
    bench.command("none", 0)
    assert bench.line.status.ready


def test_vin_from_before_a_lost_communication_is_not_that_of_the_vehicle_after_it(bench: Bench) -> None:
    bench.vin(5)
    lose(bench)
    for _ in range(2):
        bench.command("none", 0)
    bench.command("start", 5)
    assert bench.answer.error_code is ErrorCode.VIN_INCOMPLETE
    assert bench.commands() == []


def test_reset_forgets_the_vin_of_the_vehicle_before_it(bench: Bench) -> None:
    bench.vin(5)
    bench.command("reset", 6)
    bench.commands()
    bench.idle()
    bench.command("none", 6)
    bench.command("start", 5)
    assert bench.answer.error_code is ErrorCode.VIN_INCOMPLETE
    assert bench.commands() == []


def test_alive_counter_counts_the_frames_that_went_out(bench: Bench) -> None:
    """A controller that watches it would take a frame that the adapter refused for one that it missed."""
    bench.line.tick()
    before = bench.status.alive_counter
    bench.fake.send_error = can.CanOperationError("transmit queue full")
    for _ in range(3):
        bench.line.tick()
    bench.fake.send_error = None
    bench.line.tick()
    assert bench.status.alive_counter == (before + 1) % 256


def test_reset_supersedes_everything_that_waits(bench: Bench) -> None:
    bench.command("prepare", 3)
    bench.start(4)
    bench.command("abort", 4)
    bench.command("reset", 5)
    assert bench.commands() == [Reset(5)]


def test_controller_that_is_heard_again_gets_a_frame_of_each_result_at_once(bench: Bench) -> None:
    """Its counters are in step before the first result that counts."""
    lose(bench)
    bench.messages()
    bench.command("none", 0)
    assert "VehicleResult" not in dict(bench.messages())
    bench.command("none", 0)
    assert set(bench.database.result_messages) <= set(dict(bench.messages()))


def test_results_are_given_once_also_when_the_bus_did_not_take_them_yet(bench: Bench) -> None:
    bench.start(1)
    bench.fake.send_error = can.CanOperationError("transmit queue full")
    bench.line.send_results(1, [ok(wheel) for wheel in FOUR])
    with pytest.raises(LineError, match="not awaited"):
        bench.line.send_results(1, [WheelAnswer(wheel, Outcome.FAULT) for wheel in FOUR])
    bench.fake.send_error = None
    bench.line.tick()
    results = [values["Outcome"] for name, values in bench.messages() if name == "VehicleResult"]
    assert results[-1] == "ok"


def test_numbers_beyond_their_signal_stay_at_its_end(bench: Bench) -> None:
    """ErrorDetail.Count stays at 65535, as the page says; it does not begin anew."""
    frame = detail_frame(bench.database, ErrorCode.CAMERA_FAULT, 1, "front_left", 70_000)
    assert bench.database.decode(frame)["Count"] == 65535
    info = info_frame(bench.database, StationInfo((2, 0), (300, 256, 255), 9))
    values = bench.database.decode(info)
    assert [values[f"Software{part}"] for part in ("Major", "Minor", "Patch")] == [255, 255, 255]


def test_frame_that_is_spoilt_on_purpose_does_not_count(database: LineDatabase) -> None:
    """What the check of a station sends to see bad frames dropped must be bad."""
    fake = FakeCanBus()
    with LineBus(lambda: fake) as bus:
        link = ProtectedLink(bus, database, Clock())
        guard = Guard(database.protected)
        found = []
        for spoil in (None, None, "crc", None, "counter", None, None):
            link.send(command_frame(database, "none", 0), spoil)  # type: ignore[arg-type]
            found.append(guard.check("Command", fake.sent[-1].data))
    assert found == [
        Check.INITIAL,
        Check.OK,
        Check.WRONG_CRC,
        Check.SOME_LOST,
        Check.WRONG_SEQUENCE,
        Check.SYNC,
        Check.OK,
    ]


def test_health_counts_each_kind_of_frame_that_did_not_count(database: LineDatabase) -> None:
    with LineBus(FakeCanBus) as bus:
        link, protector = ProtectedLink(bus, database, Clock()), Protector(database.protected)
        frame = command_frame(database, "none", 0)
        for jump in (1, 1, 0, 7, 1, 1):  # first, good, repeated, jump, in step again, good
            protector.protect("Command", frame.data, jump)
            link.read(frame)
        health = link.health
        assert (health.good, health.wrong_counter, health.unsettled) == (2, 2, 2)
        assert (health.wrong_crc, health.malformed) == (0, 0)


def test_what_was_heard_is_forgotten_with_a_lost_communication(database: LineDatabase) -> None:
    """A controller's program looks more often than frames come. It would lose the station at each look,
    and never hear the second frame of it, which counts."""
    clock, protector = Clock(), Protector(database.protected)
    frame = status_frame(database, IDLE)
    with LineBus(FakeCanBus) as bus:
        link = ProtectedLink(bus, database, clock)
        view = StationView(link, clock)

        def receive() -> None:
            protector.protect("Status", frame.data)
            view.receive(frame)

        receive()
        receive()
        assert view.status is not None
        assert link.heard_s("Status") == clock.now
        clock.now += 1.0
        assert view.lose_when_silent(0.5)
        assert view.status is None
        assert link.heard_s("Status") is None
        for _ in range(2):
            assert not view.lose_when_silent(0.5)
            receive()
        assert view.status is not None


def test_traffic_that_is_shown_has_its_wrong_crc_and_counter_marked(database: LineDatabase) -> None:
    frame = command_frame(database, "none", 0)
    protector, guard = Protector(database.protected), Guard(database.protected)
    marks = []
    for jump, flip in ((1, 0), (1, 0), (7, 0), (1, 0), (1, 1)):
        protector.protect("Command", frame.data, jump)
        frame.data[0] ^= flip
        marks.append(decode_frame(frame, database, guard).error)
    assert marks[:2] == [None, None]
    assert marks[2] == "end-to-end protection: wrong_sequence"
    assert marks[4] == "end-to-end protection: wrong_crc"
