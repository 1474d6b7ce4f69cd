"""The sweep of the steering: position by position, and every way in which it ends, never with OK."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from pydantic import ValidationError

from alignment.values import Refusal, RefusalCode
from db.records import CycleOutcome
from station.configuration.sweeps import SweepPlan
from station.cycle.modes.sweep_ends import SWEEP_ENDS, SweepEnd
from station.cycle.ports import CycleReport
from station.cycle.words.cycle import Abort, ErrorCode, Mode, Outcome, Reset, StationState, Stop
from station.cycle.words.steering import Step, SweepProgress, SweepState
from station.cycle.words.vehicle import SteeringSource, SteeringWheel, ToldOfVehicle
from tests.station.bench import KIND, MASTER, WHEELS, Bench, camera_error, open_bench

PLAN = SweepPlan(largest_deg=40.0, positions=5)
SWEPT = KIND.model_copy(update={"sweep": PLAN})
WANTED = (-40.0, -20.0, 0.0, 20.0, 40.0, 0.0)
FRONT = WHEELS[:2]


@dataclass
class Driver:
    """Turns the steering as the sweep wants it, and says step; what is odd is set by the test.

    `angle` is the steering wheel's, `told` makes what the line tells of it, and `odd` may do something else
    at a position than turn there and step.
    """

    bench: Bench
    angle: float = 0.0
    claims: bool = True
    told: Callable[[float], SteeringWheel | None] = SteeringWheel
    odd: dict[int, Callable[[], None]] = field(default_factory=dict)
    samples: Iterator[int] = field(default_factory=itertools.count)

    def __post_init__(self) -> None:
        self.bench.line.on_sweep = self.progress
        self.bench.line.vehicle = self.of_vehicle

    def of_vehicle(self) -> ToldOfVehicle:
        steering = self.told(self.angle)
        if steering is not None:
            steering = replace(steering, sample=next(self.samples) % 256)
        return ToldOfVehicle(steering)

    def progress(self, progress: SweepProgress) -> None:
        if progress.state is not SweepState.TURN:
            return
        odd = self.odd.get(progress.position)
        if odd is not None:
            odd()
            return
        assert progress.wanted_deg is not None
        self.turn(progress.wanted_deg)
        self.step(progress.position)

    def turn(self, angle: float) -> None:
        # It takes its time.
        self.bench.clock.now += 1.0
        self.angle = angle

    def step(self, position: int, claimed: float | None = None) -> None:
        if claimed is None and self.claims:
            claimed = self.angle
        self.bench.line.queue.append(Step(1, position, claimed))


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench(types={1: SWEPT}) as bench:
        yield bench


def unrequired(bench: Bench) -> None:
    """The vehicle type asks for no sensor."""
    bench.types[1] = KIND.model_copy(update={"sweep": PLAN.model_copy(update={"require_angle": False})})


def swept(bench: Bench, **changes: object) -> CycleReport:
    report = bench.trigger(mode=Mode.SWEEP, **changes)
    assert report is not None
    return report


def assert_ended(bench: Bench, report: CycleReport, end: SweepEnd, seen: str = "") -> None:
    """The cycle has ended as the table says: a fault of all wheels, with its reason, and ready again."""
    code = SWEEP_ENDS[end].code
    assert report.told is Outcome.FAULT
    assert set(bench.line.outcomes.values()) == {Outcome.FAULT}
    assert report.record.outcome is CycleOutcome.FAULT
    assert {wheel.reason_code for wheel in report.record.wheels} == {str(end)}
    assert report.record.reason_text is not None
    assert SWEEP_ENDS[end].when in report.record.reason_text
    assert seen in report.record.reason_text
    assert bench.line.swept[-1].state is SweepState.FAILED
    reporting = [s for s in bench.line.statuses if s.state is StationState.REPORTING]
    assert reporting[-1].error_code is code
    assert bench.cycle.state is StationState.IDLE
    assert StationState.MEASURING not in bench.states


def test_a_sweep_goes_through_all_positions_and_measures_straight_ahead(bench: Bench) -> None:
    driver = Driver(bench)
    report = swept(bench)
    turned = [p for p in bench.line.swept if p.state is SweepState.TURN]
    assert [p.wanted_deg for p in turned] == list(WANTED)
    assert [p.position for p in turned] == [1, 2, 3, 4, 5, 6]
    assert [p.state for p in bench.line.swept] == [SweepState.TURN, SweepState.HOLD] * 6 + [SweepState.DONE]
    assert bench.states[1:4] == [StationState.ARMED, StationState.SWEEPING, StationState.MEASURING]
    assert driver.angle == 0.0
    assert {wheel.wheel for wheel in report.record.wheels} == set(WHEELS)


def test_rear_wheels_are_measured_once_and_front_wheels_at_each_position(bench: Bench) -> None:
    Driver(bench)
    swept(bench)
    armed = [entry.removeprefix("armed ") for entry in bench.log if entry.startswith("armed ")]
    assert {wheel: armed.count(wheel) for wheel in WHEELS} == {
        **dict.fromkeys(FRONT, 1 + PLAN.positions + 1),
        **dict.fromkeys(WHEELS[2:], 2),
    }


@pytest.mark.parametrize("position", range(1, 7))
@pytest.mark.parametrize("valid", [None, False])
def test_an_angle_that_is_lost_ends_the_sweep(bench: Bench, position: int, valid: bool | None) -> None:
    driver = Driver(bench)
    lost = SteeringWheel(None) if valid is False else None

    def lose() -> None:
        driver.told = lambda angle: lost

    driver.odd[position] = lose
    assert_ended(bench, swept(bench), SweepEnd.LOST, f"at position {position} of 6")


@pytest.mark.parametrize("position", [1, 4])
def test_an_angle_that_is_too_old_is_lost(bench: Bench, position: int) -> None:
    driver = Driver(bench)

    def age() -> None:
        driver.told = lambda angle: SteeringWheel(angle, 0.501)

    driver.odd[position] = age
    assert_ended(bench, swept(bench), SweepEnd.LOST, "it is 0.50 s old")


def test_an_angle_of_which_only_the_source_is_known_is_none(bench: Bench) -> None:
    driver = Driver(bench)
    driver.told = lambda angle: SteeringWheel(None, 0.0, SteeringSource.LEVEL)
    assert_ended(bench, swept(bench), SweepEnd.LOST, "not valid")


@pytest.mark.parametrize("position", range(2, 6))
def test_a_sensor_that_stands_while_steps_are_claimed_ends_the_sweep(bench: Bench, position: int) -> None:
    """Its counter runs, its value stays: every step tells another angle than it does."""
    driver = Driver(bench)

    def freeze() -> None:
        stood = driver.angle
        driver.told = lambda angle: SteeringWheel(stood)
        del driver.odd[position]
        driver.turn(WANTED[position - 1])
        driver.step(position)

    driver.odd[position] = freeze
    assert_ended(bench, swept(bench), SweepEnd.FROZEN, f"at position {position} of 6")


def test_a_sensor_that_stands_is_found_when_steps_tell_no_angle_too(bench: Bench) -> None:
    driver = Driver(bench, claims=False)

    def freeze() -> None:
        stood = WANTED[1]
        driver.told = lambda angle: SteeringWheel(stood)
        driver.turn(WANTED[2])
        driver.step(3)

    driver.odd[3] = freeze
    report = swept(bench)
    assert_ended(bench, report, SweepEnd.FROZEN, "0° was wanted, -20° was told")
    assert [p.position for p in bench.line.swept].count(3) == PLAN.attempts


def test_an_angle_that_jumps_ends_the_sweep(bench: Bench) -> None:
    driver = Driver(bench)

    def jump() -> None:
        driver.angle += 60.0

    driver.odd[4] = jump
    assert_ended(bench, swept(bench), SweepEnd.JUMPED, "from 0° to 60°")


def test_a_jump_while_images_are_taken_ends_the_sweep(bench: Bench) -> None:
    driver = Driver(bench)

    def told(angle: float) -> SteeringWheel:
        held = bench.line.swept[-1].state is SweepState.HOLD and bench.line.swept[-1].position == 2
        return SteeringWheel(angle + (1.0 if held else 0.0))

    driver.told = told
    assert_ended(bench, swept(bench), SweepEnd.MOVED, "at position 2 of 6: from -20° to -19°")


def test_a_step_that_says_another_angle_than_the_line_ends_the_sweep(bench: Bench) -> None:
    driver = Driver(bench)

    def contradict() -> None:
        driver.turn(-20.0)
        driver.step(2, claimed=-17.9)

    driver.odd[2] = contradict
    assert_ended(bench, swept(bench), SweepEnd.CONTRADICTED, "the step says -17.9°, the line -20°")


def test_a_step_elsewhere_is_wanted_again_and_then_counts(bench: Bench) -> None:
    driver = Driver(bench)

    def miss() -> None:
        del driver.odd[3]
        driver.turn(-2.1)
        driver.step(3)

    driver.odd[3] = miss
    report = swept(bench)
    assert bench.line.swept[-1].state is SweepState.DONE
    assert [p.position for p in bench.line.swept if p.state is SweepState.TURN] == [1, 2, 3, 3, 4, 5, 6]
    assert report.record.wheels


def test_steps_that_never_reach_the_angle_end_the_sweep(bench: Bench) -> None:
    driver = Driver(bench)
    attempts = itertools.count(1)

    def miss() -> None:
        driver.turn(-10.0 + next(attempts))
        driver.step(3)

    driver.odd[3] = miss
    assert_ended(bench, swept(bench), SweepEnd.ELSEWHERE, "0° was wanted, -7° was told")


def test_a_step_that_does_not_come_ends_the_sweep(bench: Bench) -> None:
    driver = Driver(bench)
    driver.odd[4] = lambda: None
    before = bench.clock.now
    assert_ended(bench, swept(bench), SweepEnd.LATE, "none within 60 s")
    assert bench.clock.now - before == pytest.approx(PLAN.step_timeout_s, abs=10.0)


@pytest.mark.parametrize("position", range(1, 7))
def test_stop_at_any_position_ends_the_sweep_without_results(bench: Bench, position: int) -> None:
    driver = Driver(bench)
    driver.odd[position] = lambda: bench.line.queue.append(Stop(1))
    assert_ended(bench, swept(bench), SweepEnd.STOPPED, f"at position {position} of 6")


@pytest.mark.parametrize("position", range(1, 6))
@pytest.mark.parametrize("state", [SweepState.TURN, SweepState.HOLD])
def test_abort_at_any_position_ends_the_cycle(bench: Bench, position: int, state: SweepState) -> None:
    driver = Driver(bench)

    def progress(progress: SweepProgress) -> None:
        if (progress.state, progress.position) == (state, position):
            bench.line.queue.append(Abort(1))
        else:
            driver.progress(progress)

    bench.line.on_sweep = progress
    report = swept(bench)
    assert report.told is Outcome.ABORTED
    assert set(bench.line.outcomes.values()) == {Outcome.ABORTED}
    assert report.record.outcome is CycleOutcome.ABORTED
    assert bench.line.swept[-1].state is SweepState.FAILED
    assert StationState.MEASURING not in bench.states


def test_stop_while_images_are_taken_ends_the_sweep(bench: Bench) -> None:
    driver = Driver(bench)

    def progress(progress: SweepProgress) -> None:
        driver.progress(progress)
        if (progress.state, progress.position) == (SweepState.HOLD, 2):
            bench.line.queue.append(Stop(1))

    bench.line.on_sweep = progress
    assert_ended(bench, swept(bench), SweepEnd.STOPPED, "at position 2 of 6")


def test_reset_amid_a_sweep_forgets_the_vehicle(bench: Bench) -> None:
    driver = Driver(bench)
    driver.odd[3] = lambda: bench.line.queue.append(Reset(9))
    report = swept(bench)
    assert report.told is None
    assert bench.line.sent == []
    assert report.record.outcome is CycleOutcome.ABORTED


def test_lost_communication_aborts_a_sweep(bench: Bench) -> None:
    driver = Driver(bench)
    driver.odd[3] = lambda: bench.line.queue.append(Abort(1, ErrorCode.COMMUNICATION_LOST))
    report = swept(bench)
    assert report.told is Outcome.ABORTED
    assert report.record.reason_text == "the cycle was ended: communication_lost"


def test_steps_and_stops_of_other_starts_are_nothing(bench: Bench) -> None:
    driver = Driver(bench)

    def others() -> None:
        del driver.odd[2]
        bench.line.queue += [Stop(2), Abort(2), Step(2, 2, -20.0), Step(1, 7, -20.0), Step(1, 1, -40.0)]
        driver.turn(-20.0)
        driver.step(2)

    driver.odd[2] = others
    swept(bench)
    assert bench.line.swept[-1].state is SweepState.DONE


def test_a_camera_that_fails_amid_a_sweep_is_a_fault_of_the_station(bench: Bench) -> None:
    driver = Driver(bench)

    def lose() -> None:
        bench.rigs["front_left"].shoot_error = camera_error()
        driver.turn(WANTED[2])
        driver.step(3)

    driver.odd[3] = lose
    report = swept(bench)
    assert report.told is Outcome.FAULT
    assert bench.cycle.state is StationState.FAULT
    assert bench.line.status.error_code is ErrorCode.CAMERA_FAULT


def test_a_front_camera_that_cannot_be_armed_leaves_no_sweep_and_no_ok(bench: Bench) -> None:
    Driver(bench)
    bench.rigs["front_right"].arm_error = camera_error()
    report = swept(bench)
    assert report.told is Outcome.FAULT
    assert [p.state for p in bench.line.swept] == [SweepState.FAILED]


def test_a_wheel_that_is_refused_once_at_a_position_is_taken_again(bench: Bench) -> None:
    driver = Driver(bench)

    class Once(dict[str, Any]):
        def get(self, wheel: str, default: Any = None) -> Any:
            return self.pop(wheel, default)

    def refuse_once() -> None:
        bench.found = Once(front_left=refusal())
        driver.turn(WANTED[2])
        driver.step(3)

    driver.odd[3] = refuse_once
    swept(bench)
    assert bench.found == {}
    assert bench.line.swept[-1].state is SweepState.DONE


def refusal() -> Refusal:
    return Refusal(RefusalCode.INCONSISTENT_SHOTS, "something hides the tyre")


def test_a_wheel_that_is_refused_at_too_many_positions_ends_the_sweep(bench: Bench) -> None:
    driver = Driver(bench)

    def refuse(position: int) -> Callable[[], None]:
        def odd() -> None:
            bench.found["front_left"] = refusal()
            driver.turn(WANTED[position - 1])
            driver.step(position)

        return odd

    driver.odd = {position: refuse(position) for position in (3, 4)}
    assert_ended(bench, swept(bench), SweepEnd.NOT_MEASURED, "something hides the tyre")


def test_a_sweep_without_a_sensor_counts_where_the_vehicle_type_allows_it(bench: Bench) -> None:
    unrequired(bench)
    driver = Driver(bench)
    driver.told = lambda angle: None
    swept(bench)
    assert bench.line.swept[-1].state is SweepState.DONE


def test_an_angle_that_was_there_once_must_stay(bench: Bench) -> None:
    unrequired(bench)
    driver = Driver(bench)

    def lose() -> None:
        driver.told = lambda angle: None

    driver.odd[3] = lose
    assert_ended(bench, swept(bench), SweepEnd.LOST)


def test_a_step_that_nobody_knows_the_angle_of_is_none(bench: Bench) -> None:
    unrequired(bench)
    driver = Driver(bench, claims=False)
    driver.told = lambda angle: None
    assert_ended(bench, swept(bench), SweepEnd.LOST, "neither the line nor the step told an angle")


def test_a_type_without_a_plan_and_a_start_without_front_wheels_are_declined(bench: Bench) -> None:
    assert bench.trigger(vehicle_type=MASTER.number, mode=Mode.SWEEP) is None
    assert bench.line.refused == [(1, ErrorCode.MODE_NOT_AVAILABLE)]
    assert bench.trigger(2, wheels=WHEELS[2:], mode=Mode.SWEEP) is None
    assert bench.line.refused[-1] == (2, ErrorCode.WHEEL_NOT_AVAILABLE)
    assert bench.cycle.state is StationState.IDLE


def test_positions_that_a_tolerance_cannot_tell_apart_are_no_plan() -> None:
    with pytest.raises(ValidationError, match="less than half of the 4°"):
        SweepPlan(largest_deg=80.0, positions=41, tolerance_deg=2.0)


def test_wanted_angles_are_those_that_the_line_tells() -> None:
    assert PLAN.wanted_deg() == WANTED
    assert PLAN.wanted_deg(3.5) == tuple(angle + 3.5 for angle in WANTED)
    assert len(SweepPlan(largest_deg=160.0).wanted_deg()) == 42


def test_every_end_has_its_row() -> None:
    assert set(SWEEP_ENDS) == set(SweepEnd)
    assert {ending.code for ending in SWEEP_ENDS.values()} == {
        ErrorCode.SWEEP_FAULT,
        ErrorCode.STEERING_FAULT,
    }
