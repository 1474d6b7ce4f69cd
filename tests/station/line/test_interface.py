"""The station's side of the line, frame by frame."""

from __future__ import annotations

import itertools
import math
import threading
from copy import deepcopy
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import InputError, LineError
from station.cycle.words.cycle import (
    Abort,
    Acknowledge,
    AxleAnswer,
    ErrorCode,
    Outcome,
    Reset,
    StationState,
    StationStatus,
    Trigger,
    VehicleAnswer,
    WheelAnswer,
)
from station.line.interface import StationLine
from station.line.wire.bus import LineBus
from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.protection import Protector
from station.line.wire.status import status_frame
from station.line.wire.vin import is_vin
from tests.station.line.line_bench import DBC, VIN, WAIT_S, Bench, Clock, FakeCanBus, command_frame, vin_frame

FOUR = ("front_left", "front_right", "rear_left", "rear_right")


def ok(wheel: str) -> WheelAnswer:
    return WheelAnswer(wheel, Outcome.OK, -0.5, 0.1, 0.001, 0.002)


def nok(wheel: str) -> WheelAnswer:
    return WheelAnswer(wheel, Outcome.NOK, -2.5, 0.9, 0.001, 0.002)


def test_start_with_its_vin_is_one_trigger_and_busy_is_on_the_bus_at_once(bench: Bench) -> None:
    bench.start(5, wheels=0b0101)
    assert bench.status.busy
    assert bench.status.sequence == 5
    assert not bench.status.ready
    trigger = bench.line.next_command(0.0)
    assert trigger == Trigger(5, ("front_left", "rear_left"), 7, VIN)
    assert isinstance(trigger, Trigger)
    assert trigger.received_s == bench.clock.now
    assert bench.line.next_command(0.0) is None


def test_vin_frames_may_come_in_any_order_and_twice(bench: Bench) -> None:
    bench.vin(3, messages=("Vin3", "Vin1", "Vin2", "Vin1"))
    bench.command("start", 3)
    assert bench.commands() == [Trigger(3, FOUR, 7, VIN)]


def test_repeated_start_is_no_second_trigger(bench: Bench) -> None:
    for _ in range(3):
        bench.start(9)
    assert len(bench.commands()) == 1
    assert bench.status.error_code is ErrorCode.NONE
    bench.line.send_results(9, [ok(wheel) for wheel in FOUR])
    bench.start(9)
    assert bench.status.done
    assert bench.commands() == []


def test_repeated_start_after_the_acknowledgement_is_refused(bench: Bench) -> None:
    bench.start(9)
    bench.line.send_results(9, [ok(wheel) for wheel in FOUR])
    bench.command("acknowledge", 9)
    bench.idle()
    bench.start(9)
    assert [type(command) for command in bench.commands()] == [Trigger, Acknowledge]
    assert bench.status.error_code is ErrorCode.SEQUENCE_USED
    assert bench.status.ready


def test_incomplete_vin_is_answered_with_its_error_code(bench: Bench) -> None:
    bench.vin(4, messages=("Vin1", "Vin3"))
    bench.command("start", 4)
    assert bench.commands() == []
    assert bench.status.error_code is ErrorCode.VIN_INCOMPLETE
    assert bench.status.error_sequence == 4
    assert not bench.status.busy
    bench.vin(4, messages=("Vin2",))
    bench.command("start", 4)
    assert bench.commands() == [Trigger(4, FOUR, 7, VIN)]
    assert bench.status.error_code is ErrorCode.NONE


def test_start_without_any_vin_frame(bench: Bench) -> None:
    bench.command("start", 1)
    assert bench.status.error_code is ErrorCode.VIN_INCOMPLETE
    assert bench.commands() == []


def test_end_of_an_earlier_vin_never_completes_the_next(bench: Bench) -> None:
    bench.vin(1)
    bench.vin(1, vin="WVWZZZ9KZAW999999", messages=("Vin1", "Vin2"))
    bench.command("start", 1)
    assert bench.status.error_code is ErrorCode.VIN_INCOMPLETE
    bench.vin(1, messages=("Vin1", "Vin2", "Vin3"))
    bench.vin(2, messages=("Vin1", "Vin2"))
    bench.command("start", 2)
    assert bench.status.error_code is ErrorCode.VIN_INCOMPLETE
    assert bench.commands() == []


def test_vin_of_an_accepted_start_is_used_up(bench: Bench) -> None:
    bench.start(1)
    bench.command("reset", 2)
    bench.commands()
    bench.idle()
    bench.command("start", 1)
    assert bench.status.error_code is ErrorCode.VIN_INCOMPLETE


def test_vin_of_another_sequence_does_not_count(bench: Bench) -> None:
    bench.vin(1)
    bench.command("start", 2)
    assert bench.status.error_code is ErrorCode.VIN_INCOMPLETE


def test_vin_with_a_character_that_no_vin_has(bench: Bench) -> None:
    bench.vin(1, vin="WVWZZZ1KZAO123456")
    bench.command("start", 1)
    assert bench.status.error_code is ErrorCode.VIN_INVALID
    assert bench.commands() == []


def test_start_without_wheels(bench: Bench) -> None:
    bench.start(1, wheels=0)
    assert bench.status.error_code is ErrorCode.NO_WHEELS
    assert bench.commands() == []


def test_other_start_while_busy_and_while_done_is_refused_and_changes_nothing(bench: Bench) -> None:
    bench.start(1)
    bench.start(2)
    assert (bench.status.error_code, bench.status.error_sequence) == (ErrorCode.BUSY, 2)
    assert (bench.status.sequence, bench.status.busy) == (1, True)
    bench.line.send_results(1, [ok(wheel) for wheel in FOUR])
    bench.start(3)
    assert (bench.status.error_code, bench.status.error_sequence) == (ErrorCode.NOT_ACKNOWLEDGED, 3)
    assert (bench.status.sequence, bench.status.done) == (1, True)
    assert bench.commands() == [Trigger(1, FOUR, 7, VIN)]


def test_start_while_the_station_is_at_fault_needs_a_reset(bench: Bench) -> None:
    bench.line.publish(StationStatus(StationState.FAULT, ErrorCode.CAMERA_FAULT))
    bench.start(1)
    assert bench.commands() == []
    assert bench.status.fault
    assert bench.status.error_code is ErrorCode.CAMERA_FAULT
    bench.command("reset", 2)
    assert bench.commands() == [Reset(2)]
    bench.idle()
    bench.start(1)
    assert bench.commands() == [Trigger(1, FOUR, 7, VIN)]


def test_fault_during_a_cycle_ends_busy_until_the_reset(bench: Bench) -> None:
    bench.start(1)
    bench.line.publish(StationStatus(StationState.FAULT, ErrorCode.STORE_FAULT))
    status = bench.status
    assert (status.busy, status.done, status.ready, status.fault) == (False, False, False, True)
    assert (status.error_code, status.error_sequence) == (ErrorCode.STORE_FAULT, 1)


def test_before_the_cycle_says_anything_the_station_is_not_ready(database: LineDatabase) -> None:
    fake = FakeCanBus()
    with LineBus(lambda: fake) as bus:
        line = StationLine(bus, database, Clock())
        assert line.status.state is StationState.STARTING
        assert not line.status.fault
        assert line.status.error_code is ErrorCode.STARTING
        assert not line.status.ready
        line.close()


def test_reset_supersedes_what_was_queued_and_blocks_starts_until_the_cycle_took_it(bench: Bench) -> None:
    bench.start(1)
    bench.command("reset", 2)
    assert not bench.status.ready
    bench.start(1)
    assert bench.status.error_code is ErrorCode.RESETTING
    bench.idle()
    assert not bench.status.ready, "the cycle speaks of what was before it took the reset"
    assert bench.commands() == [Reset(2)]
    bench.idle()
    assert bench.status.ready
    assert bench.status.sequence == 2
    bench.command("none", 1)
    bench.start(1)
    assert bench.commands() == [Trigger(1, FOUR, 7, VIN)]


def test_results_of_a_cycle_that_was_reset_cannot_go_out(bench: Bench) -> None:
    bench.start(1)
    bench.commands()
    bench.command("reset", 2)
    with pytest.raises(LineError, match="not awaited"):
        bench.line.send_results(1, [ok(wheel) for wheel in FOUR])
    assert not bench.status.done


def test_abort_reaches_the_cycle_once(bench: Bench) -> None:
    bench.start(1)
    for _ in range(3):
        bench.command("abort", 1)
    assert bench.commands() == [Trigger(1, FOUR, 7, VIN), Abort(1)]
    outcome = bench.line.send_results(1, [WheelAnswer(wheel, Outcome.ABORTED) for wheel in FOUR])
    assert outcome is Outcome.ABORTED
    bench.command("abort", 1)
    bench.command("acknowledge", 1)
    bench.command("abort", 1)
    bench.idle()
    bench.command("abort", 1)
    assert bench.commands() == [Acknowledge(1)]
    assert bench.status.error_code is ErrorCode.NONE


@pytest.mark.parametrize("code", ["abort", "acknowledge"])
def test_abort_and_acknowledge_of_another_sequence_are_harmless(bench: Bench, code: str) -> None:
    bench.command(code, 77)
    assert bench.status.error_code is ErrorCode.WRONG_SEQUENCE
    bench.start(1)
    bench.command(code, 77)
    assert (bench.status.error_code, bench.status.error_sequence) == (ErrorCode.WRONG_SEQUENCE, 77)
    assert bench.status.busy
    assert bench.commands() == [Trigger(1, FOUR, 7, VIN)]


def test_acknowledge_before_done_and_twice_after(bench: Bench) -> None:
    bench.start(1)
    bench.command("acknowledge", 1)
    assert bench.status.error_code is ErrorCode.NOTHING_TO_ACKNOWLEDGE
    assert bench.status.busy
    bench.line.send_results(1, [ok(wheel) for wheel in FOUR])
    bench.command("acknowledge", 1)
    assert bench.status.done, "an acknowledgement that stood before the results does not mean them"
    bench.command("none", 1)
    bench.command("acknowledge", 1)
    bench.command("acknowledge", 1)
    assert bench.commands() == [Trigger(1, FOUR, 7, VIN), Acknowledge(1)]
    assert not bench.status.ready, "the cycle has not stored the acknowledgement yet"
    bench.idle()
    assert bench.status.ready
    assert not bench.status.done


def test_unknown_command_code_and_none(bench: Bench) -> None:
    frame = command_frame(bench.database, "none", 8)
    bench.receive(frame)
    assert bench.status.error_code is ErrorCode.NONE
    frame.data[1] |= 0xF0
    bench.receive(frame)
    assert (bench.status.error_code, bench.status.error_sequence) == (ErrorCode.UNKNOWN_COMMAND, 8)
    assert bench.commands() == []


def test_refused_trigger_frees_its_sequence(bench: Bench) -> None:
    bench.start(1)
    bench.commands()
    bench.line.refuse(1, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    assert (bench.status.error_code, bench.status.error_sequence) == (ErrorCode.UNKNOWN_VEHICLE_TYPE, 1)
    assert bench.status.ready
    assert bench.answer.error_code is ErrorCode.UNKNOWN_VEHICLE_TYPE
    bench.start(1)
    assert bench.commands() == [], "it stands as it was refused"
    bench.command("none", 0)
    bench.start(1)
    assert bench.commands() == [Trigger(1, FOUR, 7, VIN)]


def test_results_go_out_before_done_and_done_once(bench: Bench) -> None:
    bench.start(1, wheels=0b0011)
    bench.messages()
    axle = AxleAnswer("front", Outcome.OK, 0.2, 0.0, 0.002, 0.002)
    outcome = bench.line.send_results(
        1, [ok("front_left"), nok("front_right")], [axle], VehicleAnswer(Outcome.OK, 0.01, 0.001)
    )
    assert outcome is Outcome.NOK
    sent = bench.messages()
    assert sent[-1][0] == "Status"
    assert sent[-1][1]["ResultValid"] == 1
    assert all(values["Sequence"] == 1 for _, values in sent)
    by_name = dict(sent)
    assert [name for name, _ in sent].count("Status") == 1
    assert by_name["WheelResultFrontRight"]["Outcome"] == "nok"
    assert by_name["WheelResultFrontRight"]["Camber"] == pytest.approx(-2.5, abs=5e-5)
    idle_wheel = by_name["WheelResultRearLeft"]
    assert (idle_wheel["Outcome"], idle_wheel["Camber"], idle_wheel["Toe"]) == (
        "not_requested",
        "invalid",
        "invalid",
    )
    assert by_name["AxleResultRear"]["Outcome"] == "not_requested"
    assert by_name["VehicleResult"]["Outcome"] == "nok"
    with pytest.raises(LineError, match="not awaited"):
        bench.line.send_results(1, [ok("front_left"), nok("front_right")])


def test_results_without_a_start_are_refused(bench: Bench) -> None:
    with pytest.raises(LineError, match="not awaited"):
        bench.line.send_results(1, [ok("front_left")])
    bench.start(2)
    with pytest.raises(LineError, match="sequence 1"):
        bench.line.send_results(1, [ok("front_left")])


@pytest.mark.parametrize(
    "wheels",
    [(), ("front_left",), (*FOUR[:2], "rear_left"), ("front_left", "front_left"), ("front_left", "middle")],
)
def test_answers_must_be_those_of_the_requested_wheels(bench: Bench, wheels: tuple[str, ...]) -> None:
    bench.start(1, wheels=0b0011)
    bench.messages()
    with pytest.raises(InputError):
        bench.line.send_results(1, [ok(wheel) for wheel in wheels])
    assert bench.messages() == []
    assert bench.status.busy


def test_unknown_axle(bench: Bench) -> None:
    bench.start(1, wheels=0b0001)
    with pytest.raises(InputError, match="axle_answers"):
        bench.line.send_results(1, [ok("front_left")], [AxleAnswer("third", Outcome.FAULT)])


def test_requested_wheel_answered_as_not_requested(bench: Bench) -> None:
    bench.start(1, wheels=0b0001)
    with pytest.raises(InputError, match="wheel_answers"):
        bench.line.send_results(1, [WheelAnswer("front_left", Outcome.NOT_REQUESTED)])


def test_angle_out_of_range_sends_nothing_at_all(bench: Bench) -> None:
    bench.start(1, wheels=0b0011)
    bench.messages()
    for camber in (15.1, -52.4288, 1e9):
        too_far = WheelAnswer("front_right", Outcome.NOK, camber, 0.0, 0.001, 0.001)
        with pytest.raises(InputError, match=r"WheelResultFrontRight\.Camber"):
            bench.line.send_results(1, [ok("front_left"), too_far])
    assert bench.messages() == []


def test_bus_that_fails_amid_the_results_shows_them_valid_when_all_went_out(bench: Bench) -> None:
    bench.start(1)
    bench.fake.send_error = can.CanOperationError("transmit queue full")
    assert bench.line.send_results(1, [ok(wheel) for wheel in FOUR]) is Outcome.OK
    assert not bench.line.status.done
    bench.line.tick()
    assert not bench.line.status.done
    bench.fake.send_error = None
    bench.messages()
    bench.line.tick()
    assert bench.status.done
    assert {"WheelResultFrontLeft", "VehicleResult"} <= {name for name, _ in bench.messages()}


def test_results_are_sent_again_until_they_are_acknowledged(bench: Bench) -> None:
    bench.start(1)
    bench.line.send_results(1, [ok(wheel) for wheel in FOUR])
    for _ in range(2):
        bench.messages()
        bench.line.tick()
        assert dict(bench.messages())["VehicleResult"]["Outcome"] == "ok"
    bench.command("acknowledge", 1)
    bench.messages()
    bench.line.tick()
    blank = dict(bench.messages())["VehicleResult"]
    assert (blank["Outcome"], blank["Sequence"], blank["ThrustAngle"]) == ("none", 0, "invalid")


def test_status_that_the_bus_does_not_take_is_counted_and_sent_later(bench: Bench) -> None:
    bench.fake.send_error = can.CanOperationError("bus off")
    bench.line.publish(StationStatus(StationState.ARMED))
    assert bench.bus.health.send_failures >= 1
    assert "bus off" in str(bench.bus.health.last_error)
    bench.fake.send_error = None
    bench.line.tick()
    assert bench.status.state is StationState.ARMED


def test_alive_counter_counts_every_status_and_wraps(bench: Bench) -> None:
    bench.messages()
    for _ in range(300):
        bench.line.tick()
    counters = [int(v["AliveCounter"]) for name, v in bench.messages() if name == "Status"]
    assert len(counters) == 300
    assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(counters))


def test_status_is_sent_cyclically_without_anybody_asking(database: LineDatabase) -> None:
    fake, three = FakeCanBus(), threading.Event()
    with LineBus(lambda: fake) as bus, StationLine(bus, database) as line:
        send = fake.send

        def counted(msg: can.Message, timeout: float | None = None) -> None:
            send(msg, timeout)
            if len(fake.sent) >= 3:
                three.set()

        fake.send = counted  # type: ignore[method-assign]
        assert three.wait(WAIT_S)
        assert line.health.cyclic_failures == 0
    line.close()


def test_cyclic_thread_survives_what_it_does_not_expect(
    database: LineDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    twice = threading.Event()
    failures = iter([ZeroDivisionError("first")])

    def broken(*given: Any) -> can.Message:
        for failure in failures:
            raise failure
        twice.set()
        return status_frame(*given)

    with LineBus(FakeCanBus) as bus, StationLine(bus, database) as line:
        monkeypatch.setattr("station.line.interface.status_frame", broken)
        assert twice.wait(WAIT_S)
        assert line.health.cyclic_failures == 1


@pytest.mark.parametrize("length", [0, 3, 7])
@pytest.mark.parametrize("name", ["Command", "Vin1"])
def test_wrong_length_is_counted_and_ignored(bench: Bench, name: str, length: int) -> None:
    bench.vin(1)
    identifier = {"Command": 0x110, "Vin1": 0x100}[name]
    bench.receive(can.Message(arbitration_id=identifier, is_extended_id=False, data=bytes([0x20] * length)))
    assert bench.line.health.link.malformed == 1
    assert bench.commands() == []


def test_frames_of_others_are_not_ours(bench: Bench) -> None:
    bench.receive(can.Message(arbitration_id=0x7FF, is_extended_id=False, data=bytes(8)))
    bench.receive(can.Message(arbitration_id=0x110, is_extended_id=True, data=bytes([0, 0x20] + [1] * 6)))
    bench.receive(can.Message(arbitration_id=0x120, is_extended_id=False, data=bytes(8)))
    assert bench.line.health.link.malformed == 0
    assert bench.commands() == []


def test_remote_and_error_frames(bench: Bench) -> None:
    bench.receive(can.Message(arbitration_id=0x110, is_extended_id=False, is_remote_frame=True, dlc=8))
    bench.receive(can.Message(arbitration_id=0x110, is_extended_id=False, is_error_frame=True, dlc=8))
    assert bench.line.health.link.malformed == 1
    assert bench.commands() == []


def test_wheels_of_the_line(bench: Bench) -> None:
    assert bench.line.wheels == FOUR


def test_waiting_for_a_command_is_bounded_and_ends_when_one_comes(bench: Bench) -> None:
    assert bench.line.next_command(0.01) is None
    bench.start(1)
    assert bench.line.next_command(WAIT_S) == Trigger(1, FOUR, 7, VIN)


DATABASE = load_line_database(DBC)
PAYLOADS = st.binary(max_size=8) | st.binary(min_size=8, max_size=8)
IDENTIFIERS = [0x100, 0x101, 0x102, 0x110, 0x110, 0x120, 0x131, 0x7FF]
RANDOM = st.builds(
    lambda identifier, data: can.Message(arbitration_id=identifier, is_extended_id=False, data=data),
    st.sampled_from(IDENTIFIERS),
    PAYLOADS,
)
VINS = st.sampled_from([VIN, "1FTFW1ET5DFC10312", "1FTFW1ET5DFC10313"])
COMMAND = st.builds(
    lambda code, sequence, wheels: command_frame(DATABASE, code, sequence, wheels),
    st.sampled_from(["start", "abort", "acknowledge", "reset", "none"]),
    st.integers(1, 2),
    st.integers(0, 15),
)


@st.composite
def start_sequences(draw: st.DrawFn) -> list[can.Message]:
    """VIN frames and a start; at times one is lost, belongs to another sequence, or to another vehicle."""
    sequence = draw(st.integers(1, 3))
    names = draw(st.permutations(["Vin1", "Vin2", "Vin3"]))
    vins = [draw(VINS)] * 3 if draw(st.booleans()) else draw(st.lists(VINS, min_size=3, max_size=3))
    parts = [vin_frame(DATABASE, name, sequence, vin) for name, vin in zip(names, vins, strict=True)]
    if draw(st.booleans()):
        parts.pop(draw(st.integers(0, 2)))
    return [*parts, command_frame(DATABASE, "start", draw(st.sampled_from([sequence, sequence, 9])))]


TRAFFIC = st.lists(start_sequences() | st.lists(RANDOM | COMMAND, min_size=1, max_size=3), max_size=15)


def test_random_frames_never_crash_nor_make_a_trigger_without_a_whole_vin() -> None:
    triggers = 0

    @given(TRAFFIC)
    def check(traffic: list[list[can.Message]]) -> None:
        nonlocal triggers
        triggers += check_traffic(list(itertools.chain.from_iterable(traffic)))

    check()
    assert triggers > 10, "the random traffic must also hold good starts, or nothing was tested"


def check_traffic(received: list[can.Message]) -> int:
    """Hand all frames over; every trigger's VIN must be whole and sent since the last trigger or reset."""
    triggers = 0
    with LineBus(FakeCanBus) as bus:
        line = StationLine(bus, DATABASE, Clock())
        line.publish(StationStatus(StationState.IDLE))
        protector = Protector(DATABASE.protected)
        opening = [vin_frame(DATABASE, name, 15) for name in ("Vin1", "Vin2", "Vin3")]
        received = [*opening, *[command_frame(DATABASE, "none", 0)] * 2, *received]
        vin_frames: dict[int, list[bytes]] = {0x100: [], 0x101: [], 0x102: []}
        for given_frame in received:
            frame = deepcopy(given_frame)
            name = DATABASE.name_of(frame)
            if name is not None and len(frame.data) == 8:
                protector.protect(name, frame.data)
            if frame.arbitration_id in vin_frames:
                vin_frames[frame.arbitration_id].append(bytes(frame.data))
            line.receive(frame)
            command = line.next_command(0.0)
            if isinstance(command, Trigger):
                triggers += 1
                assert is_vin(command.vin)
                assert command.wheels
                for k, seen in enumerate(vin_frames.values()):
                    part = command.vin[6 * k : 6 * k + 6].encode()
                    last = [data for data in seen if len(data) == 8][-1]
                    assert last[2 : 2 + len(part)] == part
                    assert last[1] >> 4 == command.sequence % 16
            if isinstance(command, Reset):
                line.publish(StationStatus(StationState.IDLE))
            elif isinstance(command, Trigger):
                line.refuse(command.sequence, ErrorCode.UNKNOWN_VEHICLE_TYPE)
            if isinstance(command, Trigger | Reset):
                vin_frames = {identifier: [] for identifier in vin_frames}
            assert not line.status.done
        line.close()
    return triggers


@given(
    outcome=st.sampled_from(list(Outcome)),
    values=st.tuples(*[st.none() | st.floats(allow_nan=True, allow_infinity=True)] * 4),
)
def test_no_answer_is_judged_without_its_values(outcome: Outcome, values: tuple[float | None, ...]) -> None:
    try:
        answer = WheelAnswer("front_left", outcome, *values)
    except InputError:
        return
    judged = outcome in (Outcome.OK, Outcome.NOK)
    for value in (answer.camber_deg, answer.toe_deg, answer.camber_u95_deg, answer.toe_u95_deg):
        assert (value is not None and math.isfinite(value)) == judged
