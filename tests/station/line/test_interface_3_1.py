"""Interface 3.1: what is told of the vehicle, its age, guidance, the sweep; 3.0 goes on unchanged."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import InputError, LineError
from station.cycle.words.cycle import (
    SERVED_MODES,
    Abort,
    ErrorCode,
    Outcome,
    Stop,
    Trigger,
    VehicleAnswer,
    WheelAnswer,
)
from station.cycle.words.geometry import QuantityAnswer, QuantityState
from station.cycle.words.guidance import Guidance
from station.cycle.words.steering import (
    AXIS_DIFFERENCES,
    AXIS_LENGTHS,
    AXIS_QUANTITIES,
    AngleCorrection,
    CornerAnswer,
    HeightState,
    SteeringAnswer,
    SteeringWheelAnswer,
    Step,
    StraightAhead,
    SweepProgress,
    SweepState,
)
from station.cycle.words.vehicle import NOTHING_TOLD, RideHeights, SteeringSource, SteeringWheel
from station.guidance.words import AdjusterKind, GuidanceState, OutOfReach, TurnDirection
from station.line.interface import StationLine
from station.line.plc.results import read_results
from station.line.plc.simulator import PlcSimulator
from station.line.plc.teller import VehicleTeller
from station.line.wire.bus import LineBus
from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.messages import Answer, HandshakeState
from station.line.wire.options import LineOptions
from station.line.wire.results import result_frames
from station.line.wire.steering_frames import (
    guidance_frames,
    progress_frame,
    read_guidance,
    read_progress,
    read_steering,
    steering_frames,
)
from tests.station.line.line_bench import DBC, Bench, Clock, FakeCanBus

DATABASE = load_line_database(DBC)
FOUR = tuple(DATABASE.wheels)
NAMES = [*(f"{wheel}.{name}" for wheel in FOUR[:2] for name in AXIS_QUANTITIES), *AXIS_DIFFERENCES]


def dbc_of_interface_3_0() -> str:
    """The shipped DBC without what 3.1 and 3.2 brought."""
    text = today = DBC.read_text(encoding="cp1252")
    new = r"SteeringWheel|RideHeight|Sweep|Guidance|WheelRaw|MasterCheck"
    for number in re.findall(rf"^BO_ (\d+) (?:{new})\w*:", today, re.MULTILINE):
        pattern = rf"^BO_ {number} (?:.*\n(?: SG_.*\n)*)|^(?:CM_|BA_|VAL_)[^\n]* {number} [^\n]*\n"
        text = re.sub(pattern, "", text, flags=re.MULTILINE)
    text = re.sub(r' \d+ "(?:sweeping|turning|step_incomplete|master_check_\w+)"', "", text)
    return text.replace('BA_ "InterfaceMinor" 2;', 'BA_ "InterfaceMinor" 0;')


@pytest.fixture
def old(tmp_path: Path) -> LineDatabase:
    file = tmp_path / "line.dbc"
    file.write_text(dbc_of_interface_3_0(), encoding="cp1252")
    return load_line_database(file)


@pytest.fixture
def sweeping() -> Iterator[Bench]:
    """A station that serves sweeps, ready for a start."""
    fake, clock = FakeCanBus(), Clock()
    with LineBus(lambda: fake) as bus:
        line = StationLine(bus, DATABASE, clock, LineOptions(modes=SERVED_MODES))
        bench = Bench(DATABASE, fake, bus, clock, line)
        bench.idle()
        bench.command("none", 0)
        yield bench
        line.close()


def tell(bench: Bench, teller: VehicleTeller, times: int = 1) -> None:
    for _ in range(times):
        for frame in teller.frames():
            bench.receive(frame)


def teller(**changes: object) -> VehicleTeller:
    made = VehicleTeller(DATABASE)
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def beat(bench: Bench, seconds: float) -> None:
    """Time passes while the controller is heard."""
    for _ in range(max(1, round(seconds / 0.1))):
        bench.clock.now += 0.1
        bench.command("none", 0)
        bench.line.tick()


# --- What the controller tells


def test_what_a_leaving_controller_told_is_not_taken_for_the_next_vehicles(sweeping: Bench) -> None:
    """A vehicle was measured with the steering wheel of the one before: that controller had just ended."""
    leaving = teller(steering=SteeringWheel(740.0), heights=RideHeights({"front_left": 12.0}))
    tell(sweeping, leaving, 2)
    told = sweeping.line.told()
    assert told.steering is not None
    assert told.steering.angle_deg == pytest.approx(740.0)
    leaving.forget()
    leaving.forget()
    assert leaving.telling
    tell(sweeping, leaving)
    told = sweeping.line.told()
    assert told.steering is None or not told.steering.valid
    assert told.heights is None or told.heights.of("front_left") is None
    assert not leaving.telling
    assert list(leaving.frames()) == []


def test_a_simulated_controller_takes_back_what_it_told_when_it_ends(sweeping: Bench) -> None:
    controller = PlcSimulator(sweeping.bus, DATABASE, sweeping.clock)
    controller.teller.steering = SteeringWheel(740.0)
    sweeping.messages()
    controller.tick()
    controller.close()
    controller.close()
    told = [values for name, values in sweeping.messages() if name == "SteeringWheel"]
    assert [values["Source"] for values in told] == ["vehicle", "none"]


def test_nothing_is_known_before_it_was_told(bench: Bench) -> None:
    assert bench.line.told() == NOTHING_TOLD


def test_the_first_frame_of_an_angle_only_sets_its_counter(bench: Bench) -> None:
    told = teller(steering=SteeringWheel(12.34))
    tell(bench, told)
    assert bench.line.told() == NOTHING_TOLD
    tell(bench, told)
    steering = bench.line.told().steering
    assert steering is not None
    assert steering.angle_deg == pytest.approx(12.3)
    assert steering.source is SteeringSource.VEHICLE


@pytest.mark.parametrize("angle", [-900.0, -0.1, 0.0, 0.1, 900.0])
def test_an_angle_comes_as_it_was_told(bench: Bench, angle: float) -> None:
    tell(bench, teller(steering=SteeringWheel(angle, 0.25, SteeringSource.LEVEL)), 2)
    steering = bench.line.told().steering
    assert steering is not None
    assert steering.angle_deg == pytest.approx(angle)
    assert steering.age_s == pytest.approx(0.25)
    assert steering.source is SteeringSource.LEVEL


def test_an_angle_that_is_not_valid_is_none_and_not_zero(bench: Bench) -> None:
    tell(bench, teller(steering=SteeringWheel(None)), 2)
    steering = bench.line.told().steering
    assert steering is not None
    assert not steering.valid


def test_an_age_grows_from_that_of_the_frame(bench: Bench) -> None:
    tell(bench, teller(steering=SteeringWheel(1.0, 0.2)), 2)
    bench.clock.now += 0.3
    steering = bench.line.told().steering
    assert steering is not None
    assert steering.age_s == pytest.approx(0.5)


def test_without_a_frame_for_half_a_second_nothing_is_known(bench: Bench) -> None:
    """500 ms, as the page says."""
    heights = RideHeights(dict.fromkeys(FOUR, 380.0))
    tell(bench, teller(steering=SteeringWheel(1.0), heights=heights), 2)
    bench.clock.now += 0.499
    assert bench.line.told().steering is not None
    assert bench.line.told().heights is not None
    bench.clock.now += 0.002
    assert bench.line.told() == NOTHING_TOLD


def test_a_sensor_whose_sample_stands_grows_old_however_often_it_is_sent(bench: Bench) -> None:
    told = teller(steering=SteeringWheel(1.0))
    tell(bench, told, 2)
    told.stands = True
    for _ in range(20):
        bench.clock.now += 0.1
        tell(bench, told)
    steering = bench.line.told().steering
    assert steering is not None
    assert steering.age_s == pytest.approx(2.0)
    told.stands = False
    tell(bench, told)
    steering = bench.line.told().steering
    assert steering is not None
    assert steering.age_s == 0.0


def test_lost_communication_forgets_what_was_told(bench: Bench) -> None:
    told = teller(steering=SteeringWheel(1.0), heights=RideHeights({"front_left": 380.0}))
    tell(bench, told, 2)
    for _ in range(6):
        # The angle is still sent, but who sends it is not heard any more.
        bench.clock.now += 0.1
        tell(bench, told)
        bench.line.tick()
    assert bench.line.told() == NOTHING_TOLD


def test_heights_come_by_corner_and_what_is_not_known_is_missing(bench: Bench) -> None:
    known = {"front_left": 381.2, "rear_left": 372.5, "rear_right": 371.0}
    tell(bench, teller(heights=RideHeights(known)), 2)
    heights = bench.line.told().heights
    assert heights is not None
    assert dict(heights.heights_mm) == pytest.approx(known)
    assert heights.of("front_right") is None


@pytest.mark.parametrize("height", [0.0, 5.0, 1999.9, 2000.0])
def test_an_absurd_height_comes_as_it_is_for_the_vehicle_type_to_judge(bench: Bench, height: float) -> None:
    tell(bench, teller(heights=RideHeights({"front_left": height})), 2)
    heights = bench.line.told().heights
    assert heights is not None
    assert heights.of("front_left") == pytest.approx(height)


@given(st.lists(st.sampled_from(["tell", "stand", "wait", "pause", "spoil"]), max_size=25))
def test_no_history_makes_an_angle_younger_than_its_measurement(history: list[str]) -> None:
    fake, clock = FakeCanBus(), Clock()
    with LineBus(lambda: fake) as bus:
        line = StationLine(bus, DATABASE, clock)
        bench = Bench(DATABASE, fake, bus, clock, line)
        told = teller(steering=SteeringWheel(7.0))
        measured_s = clock.now
        tell(bench, told, 2)
        for step in history:
            told.stands = step == "stand"
            if step == "wait":
                clock.now += 0.2
            elif step == "pause":
                clock.now += 0.7
            elif step == "spoil":
                told.stands = True
                for frame in told.frames():
                    frame.data[3] ^= 0xFF
                    line.receive(frame)
            else:
                if step == "tell":
                    measured_s = clock.now
                tell(bench, told)
            steering = line.told().steering
            if steering is not None and steering.valid:
                assert steering.angle_deg == pytest.approx(7.0)
                assert steering.age_s >= clock.now - measured_s - 1e-9
        line.close()


# --- The sweep


def start_sweep(bench: Bench, sequence: int = 5) -> None:
    bench.start(sequence, mode="sweep")
    assert bench.status.handshake is HandshakeState.SWEEPING
    [trigger] = bench.commands()
    assert isinstance(trigger, Trigger)
    bench.command("none", sequence)


def want(bench: Bench, position: int) -> None:
    bench.line.publish_sweep(SweepProgress(SweepState.TURN, position, 3, 10.0 * position))


def step(bench: Bench, told: VehicleTeller, position: int, sequence: int = 5) -> None:
    told.step = Step(sequence, position, 10.0 * position)
    tell(bench, told)
    bench.command("step", sequence)


def test_steps_are_told_to_the_cycle_with_the_angle_that_was_reached(sweeping: Bench) -> None:
    told = teller(sweeping=True)
    tell(sweeping, told)
    start_sweep(sweeping)
    for position in (1, 2, 3):
        want(sweeping, position)
        assert sweeping.status.handshake is HandshakeState.TURNING
        step(sweeping, told, position)
        assert sweeping.status.handshake is HandshakeState.SWEEPING
        assert sweeping.commands() == [Step(5, position, 10.0 * position)]
        sweeping.command("none", 5)
    sweeping.line.publish_sweep(SweepProgress(SweepState.DONE, 3, 3))
    assert sweeping.status.handshake is HandshakeState.BUSY


def test_a_step_without_its_frame_waits_for_it_and_not_for_an_old_one(sweeping: Bench) -> None:
    """Two seconds, as the page says."""
    told = teller(sweeping=True)
    tell(sweeping, told)
    start_sweep(sweeping)
    want(sweeping, 1)
    sweeping.command("step", 5)
    assert sweeping.answer.error_code is ErrorCode.STEP_INCOMPLETE
    told.step = Step(5, 1, 10.0)
    tell(sweeping, told)
    for _ in range(5):
        sweeping.clock.now += 0.41
        sweeping.command("none", 5)
    sweeping.command("step", 5)
    assert sweeping.answer.error_code is ErrorCode.STEP_INCOMPLETE
    assert sweeping.commands() == []
    tell(sweeping, told)
    sweeping.command("step", 5)
    assert sweeping.commands() == [Step(5, 1, 10.0)]


def test_a_frame_of_another_start_is_no_position_of_this_one(sweeping: Bench) -> None:
    told = teller(sweeping=True)
    tell(sweeping, told)
    start_sweep(sweeping)
    want(sweeping, 1)
    told.step = Step(4, 1, 10.0)
    tell(sweeping, told)
    sweeping.command("step", 5)
    assert sweeping.answer.error_code is ErrorCode.STEP_INCOMPLETE


def test_the_progress_is_repeated_while_the_sweep_goes_on_and_then_no_more(sweeping: Bench) -> None:
    start_sweep(sweeping)
    want(sweeping, 1)
    sweeping.messages()
    beat(sweeping, 0.3)
    shown = [values for name, values in sweeping.messages() if name == "SweepProgress"]
    assert len(shown) == 3
    assert {(v["State"], v["Sequence"], v["Position"], v["Wanted"]) for v in shown} == {("turn", 5, 1, 10.0)}
    sweeping.command("abort", 5)
    assert sweeping.commands() == [Abort(5)]
    sweeping.line.send_results(5, [WheelAnswer(wheel, Outcome.ABORTED) for wheel in FOUR])
    sweeping.messages()
    beat(sweeping, 0.3)
    assert "SweepProgress" not in {name for name, _ in sweeping.messages()}


def test_lost_communication_ends_a_sweep(sweeping: Bench) -> None:
    start_sweep(sweeping)
    want(sweeping, 1)
    sweeping.clock.now += 0.6
    sweeping.line.tick()
    assert sweeping.commands() == [Abort(5, ErrorCode.COMMUNICATION_LOST)]
    assert sweeping.status.handshake is HandshakeState.ENDING


def test_stop_ends_a_sweep_for_the_cycle_to_answer(sweeping: Bench) -> None:
    start_sweep(sweeping)
    want(sweeping, 1)
    sweeping.command("stop", 5)
    assert sweeping.commands() == [Stop(5)]
    sweeping.line.publish_sweep(SweepProgress(SweepState.FAILED, 0, 3))
    assert sweeping.status.handshake is HandshakeState.BUSY


def test_a_step_that_nobody_waits_for_is_refused_where_there_are_sweeps(sweeping: Bench) -> None:
    told = teller(sweeping=True, step=Step(4, 1))
    tell(sweeping, told, 2)
    sweeping.command("step", 4)
    assert (sweeping.answer.answer, sweeping.answer.error_code) == (Answer.REFUSED, ErrorCode.WRONG_SEQUENCE)
    assert sweeping.commands() == []


# --- Guidance


def guidance(**changes: object) -> Guidance:
    values: dict[str, object] = {
        "wheel": "rear_left",
        "state": GuidanceState.TURN,
        "shot": 17,
        "adjuster": AdjusterKind.TIE_ROD,
        "turns_to_go": -1.25,
        "target_camber_deg": -0.75,
        "target_toe_deg": 0.125,
        "drift_deg": -0.07,
    }
    return Guidance(**(values | changes))  # type: ignore[arg-type]


def decoded(frames: tuple[object, ...]) -> list[dict[str, object]]:
    return [DATABASE.decode(frame) for frame in frames]  # type: ignore[arg-type, misc]


STATES = st.sampled_from([s for s in GuidanceState if s not in (GuidanceState.TURN, GuidanceState.HOLD)])


@given(
    st.sampled_from(FOUR),
    st.integers(0, 255),
    st.sampled_from([AdjusterKind.TIE_ROD, AdjusterKind.CAMBER_BOLT]),
    st.integers(-32000, 32000),
    st.sampled_from([GuidanceState.TURN, GuidanceState.HOLD]),
    st.none() | st.integers(0, 60_000),
)
def test_guidance_that_is_read_is_what_was_said(
    wheel: str, shot: int, adjuster: AdjusterKind, turns: int, state: GuidanceState, age: int | None
) -> None:
    said = guidance(wheel=wheel, shot=shot, adjuster=adjuster, turns_to_go=turns * 0.005, state=state)
    target, values = decoded(guidance_frames(DATABASE, said, None if age is None else age / 1000.0))
    found, age_s = read_guidance(wheel, values, target)  # type: ignore[arg-type]
    assert found.turns_to_go == pytest.approx(said.turns_to_go)
    assert replace(found, turns_to_go=said.turns_to_go, drift_deg=said.drift_deg) == said
    assert found.drift_deg == pytest.approx(-0.07)
    assert found.direction is said.direction
    assert values["Direction"] == str(said.direction)
    assert age_s == (None if age is None else pytest.approx(age / 1000.0))


@pytest.mark.parametrize(
    ("adjuster", "turns", "direction"),
    [
        (AdjusterKind.TIE_ROD, 0.5, TurnDirection.LENGTHEN),
        (AdjusterKind.TIE_ROD, -0.5, TurnDirection.SHORTEN),
        (AdjusterKind.CAMBER_BOLT, 0.5, TurnDirection.OUT),
        (AdjusterKind.CAMBER_BOLT, -0.5, TurnDirection.IN),
    ],
)
def test_the_direction_on_the_bus_is_that_of_the_turns(
    adjuster: AdjusterKind, turns: float, direction: TurnDirection
) -> None:
    _, values = decoded(guidance_frames(DATABASE, guidance(adjuster=adjuster, turns_to_go=turns), 0.1))
    assert (values["Direction"], values["Turns"]) == (str(direction), turns)


def test_turns_beyond_the_range_are_at_its_end_and_keep_their_way() -> None:
    for turns, end in ((1e6, 160.0), (-1e6, -160.0)):
        target, values = decoded(guidance_frames(DATABASE, guidance(turns_to_go=turns, drift_deg=turns), 1e9))
        found, age_s = read_guidance("rear_left", values, target)  # type: ignore[arg-type]
        assert found.turns_to_go == end
        assert abs(found.drift_deg or 0.0) == pytest.approx(0.635)
        assert age_s == 60.0


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"Shot": 16}, "of shot 16"),
        ({"Direction": "lengthen"}, "says lengthen"),
        ({"Turns": "invalid"}, "contradicts itself"),
        ({"State": "done"}, "contradicts itself"),
        ({"Adjuster": "none"}, "contradicts itself"),
    ],
)
def test_guidance_that_contradicts_itself_turns_nothing(changes: dict[str, object], what: str) -> None:
    target, values = decoded(guidance_frames(DATABASE, guidance(), 0.1))
    with pytest.raises(LineError, match=what):
        read_guidance("rear_left", values | changes, target)  # type: ignore[arg-type]


def test_guidance_is_shown_while_adjusting_grows_old_and_ends_with_none(bench: Bench) -> None:
    bench.start(1, mode="adjust")
    bench.line.publish_guidance(guidance(), bench.clock.now)
    bench.messages()
    beat(bench, 0.3)
    shown = dict(bench.messages())
    assert shown["GuidanceRearLeft"]["State"] == "turn"
    assert shown["GuidanceRearLeft"]["Age"] == pytest.approx(300, abs=1)
    assert "GuidanceFrontLeft" not in shown
    # One second, as live angles.
    beat(bench, 0.9)
    old = dict(bench.messages())
    assert (old["GuidanceRearLeft"]["State"], old["GuidanceRearLeft"]["Turns"]) == ("lost", "invalid")
    assert old["GuidanceTargetRearLeft"]["Camber"] == "invalid"
    bench.command("abort", 1)
    bench.line.send_results(1, [WheelAnswer(wheel, Outcome.ABORTED) for wheel in FOUR])
    last = [values["State"] for name, values in bench.messages() if name == "GuidanceRearLeft"][-1]
    assert last == "none"
    beat(bench, 0.3)
    assert "GuidanceRearLeft" not in dict(bench.messages())


def test_a_reset_tells_a_nutrunner_to_stop(bench: Bench) -> None:
    bench.start(1, mode="adjust")
    bench.line.publish_guidance(guidance(), bench.clock.now)
    bench.messages()
    bench.command("reset", 2)
    assert [v["State"] for name, v in bench.messages() if name == "GuidanceRearLeft"] == ["none"]


def test_what_cannot_be_reached_says_why() -> None:
    said = Guidance("front_left", GuidanceState.UNREACHABLE, 3, reason=OutOfReach.RANGE)
    target, values = decoded(guidance_frames(DATABASE, said, 0.1))
    assert read_guidance("front_left", values, target)[0] == said  # type: ignore[arg-type]


# --- Results


def quantity(name: str, state: QuantityState, k: int) -> QuantityAnswer:
    scale = 1.0 if name.rpartition(".")[2] in AXIS_LENGTHS else 0.5
    numbers = (scale * k, 0.01 * k) if state.measured else (None, None)
    return QuantityAnswer(name, state, *numbers)


def whole(state: QuantityState = QuantityState.OK) -> SteeringAnswer:
    return SteeringAnswer(
        tuple(quantity(name, state, k) for k, name in enumerate(NAMES, 1)),
        SteeringWheelAnswer(StraightAhead.CHECKED, QuantityState.OK, -1.25, 12.5),
        (
            CornerAnswer("front_left", HeightState.USED, 381.2, AngleCorrection.BOTH, -0.5, 0.25),
            CornerAnswer("front_right", HeightState.ABSURD),
            CornerAnswer("rear_left", HeightState.MISSING),
            CornerAnswer("rear_right", HeightState.NONE, None, AngleCorrection.STEERING, 0.125, -0.25),
        ),
    )


def through(steering: SteeringAnswer, sequence: int = 5) -> SteeringAnswer:
    frames = steering_frames(DATABASE, sequence, steering)
    return read_steering(DATABASE, {DATABASE.name_of(f) or "?": DATABASE.decode(f) for f in frames})


@pytest.mark.parametrize("state", QuantityState)
def test_steering_that_is_read_is_what_was_answered(state: QuantityState) -> None:
    said = whole(state)
    found = through(said)
    assert found.wheel == said.wheel
    heights = [None if c.height_mm is None else pytest.approx(c.height_mm) for c in said.corners]
    assert [c.height_mm for c in found.corners] == heights
    assert [replace(c, height_mm=said.corner(c.wheel).height_mm) for c in found.corners] == [*said.corners]
    for name in NAMES:
        one, other = found.of(name), said.of(name)
        assert one.state is other.state
        assert one.value == (None if other.value is None else pytest.approx(other.value))
        assert one.u95 == (None if other.u95 is None else pytest.approx(other.u95))


@pytest.mark.parametrize("state", [QuantityState.NOK, QuantityState.NOT_MEASURED])
@pytest.mark.parametrize("name", NAMES)
def test_a_vehicle_is_never_ok_with_an_axis_that_is_not(name: str, state: QuantityState) -> None:
    steering = SteeringAnswer((quantity(name, state, 1),))
    wheels = [WheelAnswer(wheel, Outcome.OK, -0.5, 0.1, 0.001, 0.002) for wheel in FOUR]
    vehicle = VehicleAnswer(Outcome.OK, 0.0, 0.001, steering=steering)
    overall, frames = result_frames(DATABASE, 5, FOUR, wheels, [], vehicle)
    assert overall is (Outcome.NOK if state is QuantityState.NOK else Outcome.FAULT)
    results = {DATABASE.name_of(frame) or "?": DATABASE.decode(frame) for frame in frames}
    assert read_results(DATABASE, results, 5)[0].outcome is overall
    with pytest.raises(LineError, match="shown as ok"):
        read_results(DATABASE, results | {"VehicleResult": results["VehicleResult"] | {"Outcome": "ok"}}, 5)


def test_a_result_that_does_not_count_tells_no_number() -> None:
    lost = through(whole().withdrawn())
    assert all(axis.state is QuantityState.NOT_MEASURED and axis.value is None for axis in lost.axes)
    assert lost.wheel == SteeringWheelAnswer(StraightAhead.NONE, QuantityState.NOT_MEASURED)
    assert {c.height for c in lost.corners} == {HeightState.MISSING, HeightState.ABSURD}
    assert all(c.raw_camber_deg is None and c.height_mm is None for c in lost.corners)


def test_results_come_in_one_order_with_the_verdict_last() -> None:
    wheels = [WheelAnswer(wheel, Outcome.OK, -0.5, 0.1, 0.001, 0.002) for wheel in FOUR]
    vehicle = VehicleAnswer(Outcome.OK, 0.0, 0.001, steering=whole())
    _, frames = result_frames(DATABASE, 5, FOUR, wheels, [], vehicle)
    assert tuple(DATABASE.name_of(frame) for frame in frames) == DATABASE.result_messages
    assert DATABASE.result_messages[-1] == "VehicleResult"


@pytest.mark.parametrize(
    "made",
    [
        lambda: SweepProgress(SweepState.TURN, 1, 3),
        lambda: SweepProgress(SweepState.TURN, 0, 3, 1.0),
        lambda: SweepProgress(SweepState.DONE, 3, 3, 1.0),
        lambda: SweepProgress(SweepState.TURN, 4, 3, 1.0),
        lambda: SweepProgress(SweepState.HOLD, 1, 256, 1.0),
        lambda: SweepProgress(SweepState.TURN, 1, 3, math.nan),
        lambda: SteeringWheelAnswer(StraightAhead.CHECKED),
        lambda: SteeringWheelAnswer(StraightAhead.NOT_CHECKED, used_deg=1.0),
        lambda: SteeringWheelAnswer(StraightAhead.NOT_CHECKED, QuantityState.OK, 1.0),
        lambda: SteeringWheelAnswer(StraightAhead.CHECKED, QuantityState.OK, None, 1.0),
        lambda: CornerAnswer("front_left", HeightState.MISSING, 380.0),
        lambda: CornerAnswer("front_left", HeightState.USED),
        lambda: CornerAnswer("front_left", correction=AngleCorrection.STEERING),
        lambda: CornerAnswer("front_left", raw_toe_deg=1.0),
        lambda: SteeringAnswer((quantity("front_left.caster", QuantityState.OK, 1),) * 2),
        lambda: SteeringAnswer((quantity("front_left.camber", QuantityState.OK, 1),)),
        lambda: SteeringAnswer(corners=(CornerAnswer("front_left"),) * 2),
    ],
)
def test_what_contradicts_itself_cannot_be_said(made: Callable[[], object]) -> None:
    with pytest.raises(InputError):
        made()


@given(st.integers(1, 255), st.integers(-30000, 30000), st.sampled_from([SweepState.TURN, SweepState.HOLD]))
def test_progress_that_is_read_is_what_was_shown(position: int, wanted: int, state: SweepState) -> None:
    said = SweepProgress(state, position, 255, wanted / 10.0)
    sequence, found = read_progress(DATABASE.decode(progress_frame(DATABASE, 9, said)))
    assert sequence == 9
    assert replace(found, wanted_deg=said.wanted_deg) == said
    assert found.wanted_deg == pytest.approx(said.wanted_deg)


def test_progress_without_an_angle_is_not_understood() -> None:
    values = DATABASE.decode(progress_frame(DATABASE, 9, SweepProgress(SweepState.TURN, 1, 3, 1.0)))
    with pytest.raises(LineError, match="contradicts itself"):
        read_progress(values | {"Wanted": "invalid"})


# --- Interface 3.0


def test_a_station_with_a_dbc_of_3_0_speaks_3_0(old: LineDatabase) -> None:
    assert old.interface_version == (3, 0)
    assert not old.has_steering
    assert set(DATABASE.result_messages) - set(old.result_messages) == set(old_ids_missing(old))
    fake, clock = FakeCanBus(), Clock()
    with LineBus(lambda: fake) as bus:
        line = StationLine(bus, old, clock, LineOptions(modes=SERVED_MODES))
        bench = Bench(old, fake, bus, clock, line)
        bench.idle()
        bench.command("none", 0)
        bench.start(1, mode="sweep")
        assert bench.answer.error_code is ErrorCode.MODE_NOT_AVAILABLE
        bench.command("none", 1)
        bench.command("step", 2)
        assert bench.status.error_code is ErrorCode.UNKNOWN_COMMAND
        bench.command("none", 2)
        bench.start(3, mode="adjust")
        line.publish_guidance(guidance(), clock.now)
        assert line.told() == NOTHING_TOLD
        vehicle = VehicleAnswer(Outcome.NOT_REQUESTED, steering=whole())
        line.send_results(3, [WheelAnswer(w, Outcome.FAULT) for w in FOUR], [], vehicle)
        assert {name for name, _ in bench.messages()} <= set(old.protected)
        line.close()


def old_ids_missing(old: LineDatabase) -> list[str]:
    return [name for name in DATABASE.result_messages if name not in old.protected]


def test_what_3_0_had_has_kept_its_bits(old: LineDatabase) -> None:
    for name in old.protected:
        one, other = (d.definition.get_message_by_name(name) for d in (old, DATABASE))
        assert (one.frame_id, one.length, one.senders) == (other.frame_id, other.length, other.senders)
        assert old.protected[name] == DATABASE.protected[name]
        for before, today in zip(one.signals, other.signals, strict=True):
            for what in ("name", "start", "length", "scale", "offset", "is_signed", "unit"):
                assert getattr(before, what) == getattr(today, what)
            words = {int(n): str(w) for n, w in (before.choices or {}).items()}
            assert words.items() <= {int(n): str(w) for n, w in (today.choices or {}).items()}.items()


def test_a_controller_of_3_0_sees_no_word_that_it_does_not_know(old: LineDatabase) -> None:
    """It starts, adjusts, aborts and acknowledges, and reads all that it knows by its own DBC."""
    fake, clock = FakeCanBus(), Clock()
    with LineBus(lambda: fake) as bus:
        line = StationLine(bus, DATABASE, clock, LineOptions(modes=SERVED_MODES))
        bench = Bench(DATABASE, fake, bus, clock, line)
        bench.idle()
        bench.command("none", 0)
        for sequence, mode in itertools.product((1, 2), ("automatic", "adjust", "master_check")):
            number = 10 * sequence + len(mode)
            bench.start(number, mode=mode)
            bench.command("none", number)
            line.publish_guidance(guidance(), clock.now)
            bench.command("abort", number)
            line.send_results(number, [WheelAnswer(wheel, Outcome.ABORTED) for wheel in FOUR])
            bench.command("acknowledge", number)
            bench.idle()
            bench.command("none", number)
        known = [frame for frame in fake.sent if old.name_of(frame) is not None]
        assert len(known) > 100
        for frame in known:
            assert old.decode(frame) == DATABASE.decode(frame)
        line.close()
