"""Guidance beside live angles: it follows the verdict, tells fresh things alone, and ends nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from alignment.units import ARCMIN
from db.records import CycleOutcome
from station.configuration.vehicle_types import VehicleType
from station.cycle.judging.evaluation import evaluate
from station.cycle.measuring import MeasuringCycle
from station.cycle.modes.adjusting_record import adjusting_records, as_left
from station.cycle.modes.guiding import Guiding, stated_drifts
from station.cycle.wheels.positions import WheelResult
from station.cycle.words.cycle import Abort, Mode, Outcome, Stop
from station.guidance.words import AdjusterKind, GuidanceState, TurnDirection
from tests.station.bench import KIND, WHEELS, Bench, measurement, open_bench

ROD = {"toe_deg_per_turn": 0.7, "range_turns": 4.0}
GUIDED = VehicleType.model_validate(
    KIND.model_dump() | {"number": 8, "name": "Guided", "adjusting": {"front": {"tie_rod": ROD}, "rear": {}}}
)
S = GuidanceState


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """A bench whose vehicle types include one that names adjusters."""
    begin = MeasuringCycle.__init__

    def with_guided(self: MeasuringCycle, *arguments: object, **named: object) -> None:
        given = list(arguments)
        given[2] = {**given[2], GUIDED.number: GUIDED}  # type: ignore[dict-item]
        begin(self, *given, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(MeasuringCycle, "__init__", with_guided)
    # Threads get unequal turns on a busy machine, and the clock goes on with each.
    monkeypatch.setattr("station.cycle.modes.guiding.FRESH_S", 1e6)
    with open_bench() as bench:
        yield bench


def adjust(bench: Bench, results: int, kind: int = GUIDED.number, told: GuidanceState | None = None) -> None:
    """Until there are so many results of each wheel, and this was told of the front left one twice."""

    def stop_after() -> None:
        bench.line.clock.now += 0.1
        wheels = [angles.wheel for angles, _ in bench.line.live]
        said = [guidance.state for guidance, _ in bench.line.guided if guidance.wheel == "front_left"]
        enough = min(wheels.count(wheel) for wheel in WHEELS) >= results
        enough = enough and (told is None or said.count(told) >= 2)
        if enough and not bench.line.queue:
            bench.line.queue.append(Stop(1))

    bench.line.on_live = stop_after
    report = bench.trigger(vehicle_type=kind, mode=Mode.ADJUST)
    assert report is not None


def test_every_live_result_has_its_guidance(bench: Bench) -> None:
    adjust(bench, 3)
    shown = [(angles.wheel, angles.shot, at) for angles, at in bench.line.live]
    guided = [(guidance.wheel, guidance.shot, at) for guidance, at in bench.line.guided]
    assert guided == shown


def test_a_type_that_names_no_adjuster_is_not_guided(bench: Bench) -> None:
    adjust(bench, 2, KIND.number)
    assert bench.line.guided == []


def test_guidance_that_fails_leaves_live_angles_and_the_verdict(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(self: Guiding, *arguments: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(Guiding, "take", broken)
    adjust(bench, 2)
    assert {guidance.state for guidance, _ in bench.line.guided} == {S.NONE}
    assert set(bench.line.outcomes.values()) == {Outcome.OK}


def test_what_was_turned_is_recorded_with_the_cycle(bench: Bench) -> None:
    bench.found["front_left"] = measurement(toe=0.02)
    adjust(bench, 1, told=S.TURN)
    told = [guidance for guidance, _ in bench.line.guided if guidance.wheel == "front_left"]
    assert told[-1].state is S.TURN
    [event] = [event for event in bench.store.events if event.code == "adjusted"]
    assert event.cycle_uuid == bench.store.cycles[-1].uuid
    assert event.text == ("front_left: found at camber +0.0573°, toe +1.1459°; tie_rod +0.00 turns; turn")


def test_what_was_turned_is_stored_with_the_results_as_found_and_as_left(bench: Bench) -> None:
    bench.found["front_left"] = measurement(toe=0.02)
    adjust(bench, 1, told=S.TURN)
    record = bench.store.cycles[-1]
    [turned] = record.adjustings
    assert (turned.wheel, turned.adjuster) == ("front_left", "tie_rod")
    assert (turned.outcome, turned.reason, turned.corrections) == ("unfinished", None, 1)
    assert turned.found_toe == pytest.approx(0.02)
    [wheel] = [wheel for wheel in record.wheels if wheel.wheel == "front_left"]
    assert (turned.left_camber, turned.left_toe) == (wheel.camber, wheel.toe)
    assert (turned.nuts_locked, turned.drift, turned.operator) == (0, None, None)
    assert record.received_monotonic_s is not None
    shown = [at for told, at in bench.line.guided if told.wheel == "front_left"]
    assert turned.ended_s == pytest.approx(shown[-1] - record.received_monotonic_s)
    assert 0.0 < turned.begun_s < turned.ended_s


def test_a_wheel_that_failed_in_the_end_was_left_nobody_knows_how(bench: Bench) -> None:
    bench.found["front_left"] = measurement(toe=0.02)

    def fail_at_the_end() -> None:
        bench.line.clock.now += 0.1
        if any(told.state is S.TURN for told, _ in bench.line.guided):
            bench.line.queue.append(Abort(1))

    bench.line.on_live = fail_at_the_end
    bench.trigger(vehicle_type=GUIDED.number, mode=Mode.ADJUST)
    record = bench.store.cycles[-1]
    assert record.outcome is CycleOutcome.ABORTED
    [turned] = record.adjustings
    assert turned.found_toe == pytest.approx(0.02)
    assert (turned.left_camber, turned.left_toe) == (None, None)


def test_nothing_is_stored_of_wheels_that_nobody_had_to_turn(bench: Bench) -> None:
    adjust(bench, 1, told=S.DONE)
    assert bench.line.guided[-1][0].state in (S.CHECK, S.DONE)
    assert bench.store.cycles[-1].adjustings == ()


def test_the_next_vehicle_has_nothing_of_what_was_turned_on_the_one_before(bench: Bench) -> None:
    bench.found["front_left"] = measurement(toe=0.02)
    adjust(bench, 1, told=S.TURN)
    bench.trigger(sequence=2, vehicle_type=GUIDED.number)
    before, after = bench.store.cycles
    assert (len(before.adjustings), after.trigger_sequence, after.adjustings) == (1, 2, ())


def test_an_adjuster_is_stored_with_its_turns_its_times_and_what_locking_added() -> None:
    wheels = Wheels("front_left")
    time_s, begun_s = 100.0, None
    for toe, results in ((0.02, 5), (0.0, 6), (0.0015, 9)):
        for _ in range(results):
            time_s += 0.25
            state = wheels.tell("front_left", time_s, toe=toe)
            begun_s = time_s if begun_s is None and state is S.TURN else begun_s
    done_s = time_s
    assert state is S.DONE
    assert begun_s is not None
    # Nobody works on it any more, however long it is looked at.
    for _ in range(20):
        time_s += 0.25
        wheels.tell("front_left", time_s, toe=0.0015)
    [turned] = adjusting_records(wheels.guiding, 98.0)
    assert (turned.outcome, turned.corrections, turned.nuts_locked) == ("done", 1, 1)
    assert turned.drift == pytest.approx(0.0015)
    assert turned.turns == pytest.approx(-1.64, abs=0.01)
    assert turned.turns_made == -turned.turns
    assert turned.found_toe == pytest.approx(0.02)
    assert turned.begun_s == pytest.approx(begun_s - 98.0)
    assert turned.begun_s < turned.ended_s <= done_s - 98.0
    # A clock that came later than the images is no reason to lose the record.
    [late] = adjusting_records(wheels.guiding, 1000.0)
    assert (late.begun_s, late.ended_s) == (0.0, 0.0)


def test_a_rod_at_its_end_is_stored_with_the_reason() -> None:
    wheels = Wheels("front_left")
    # It moves nearly as far as it goes, and then no farther, for as long as it takes to be believed.
    for step in range(80):
        state = wheels.tell("front_left", 0.25 * step, toe=200.0 * ARCMIN if step < 5 else 60.0 * ARCMIN)
    assert state is S.UNREACHABLE
    [turned] = adjusting_records(wheels.guiding, 0.0)
    assert (turned.outcome, turned.reason) == ("unreachable", "range")
    assert as_left([turned], evaluate(GUIDED, [], 2.0)) == (turned,)


def test_the_account_says_how_a_wheel_was_found_and_where_its_nut_locked() -> None:
    wheels = Wheels("front_left")
    time_s = 0.0
    for toe, results in ((0.02, 5), (0.0, 6), (0.0015, 9)):
        for _ in range(results):
            time_s += 0.25
            state = wheels.tell("front_left", time_s, toe=toe)
    assert state is S.DONE
    assert list(wheels.guiding.account()) == [
        "front_left: found at camber +0.0000°, toe +1.1459°; tie_rod -1.64 turns, taken at +0.0000°, "
        "locked at +0.0859°; done"
    ]
    learned = wheels.guiding.learned(stated_drifts(GUIDED))["front", AdjusterKind.TIE_ROD]
    assert learned.mean == pytest.approx(0.0015 / 1.25)


def test_the_answer_is_the_measurements_whatever_was_guided(bench: Bench) -> None:
    bench.found["front_left"] = measurement(toe=0.02)
    adjust(bench, 2)
    assert bench.line.outcomes["front_left"] is Outcome.NOK


class Wheels:
    """Four wheels whose angles are told one after the other."""

    def __init__(self, *wheels: str) -> None:
        self.guiding = Guiding(GUIDED, wheels, stated_drifts(GUIDED))
        self.results: dict[str, WheelResult] = {}

    def tell(self, wheel: str, time_s: float, toe: float = 0.0, camber: float = 0.0) -> GuidanceState:
        found = measurement(toe=toe, camber=camber)
        self.results[wheel] = WheelResult(wheel, "c", True, found, None)
        evaluation = evaluate(GUIDED, [*self.results.values()], 2.0)
        return self.guiding.take(evaluation, wheel, time_s, 0).state


def test_toe_that_is_outside_says_which_way_to_turn() -> None:
    wheels = Wheels("front_left")
    for step in range(5):
        wheels.tell("front_left", 0.25 * step, toe=0.02)
    evaluation = evaluate(GUIDED, [*wheels.results.values()], 2.0)
    told = wheels.guiding.take(evaluation, "front_left", 2.0, 7)
    assert (told.state, told.adjuster, told.shot) == (S.TURN, AdjusterKind.TIE_ROD, 7)
    assert told.direction is TurnDirection.SHORTEN
    assert told.turns_to_go == pytest.approx(-math.degrees(0.02) / 0.7)
    assert told.target_toe_deg == pytest.approx(0.0)
    assert not told.done


def test_a_wheel_is_done_only_with_its_axle() -> None:
    wheels = Wheels("front_left", "front_right")
    for step in range(6):
        assert wheels.tell("front_left", 0.25 * step) is not S.DONE
    for step in range(6, 12):
        state = wheels.tell("front_left", 0.25 * step)
        wheels.tell("front_right", 0.25 * step)
    assert state is S.DONE


def test_what_the_other_wheel_was_is_no_reason_to_be_done() -> None:
    """The last result of a wheel whose cameras failed is kept for the centreline; it judges no axle."""
    wheels = Wheels("front_left", "front_right")
    for step in range(6):
        wheels.tell("front_left", 0.25 * step)
        wheels.tell("front_right", 0.25 * step)
    assert wheels.tell("front_left", 1.5) is S.DONE
    assert wheels.tell("front_left", 60.0) is S.CHECK


def test_a_wheel_that_was_not_measured_is_lost() -> None:
    wheels = Wheels("front_left")
    for step in range(5):
        wheels.tell("front_left", 0.25 * step)
    assert wheels.guiding.take(None, "front_left", 2.0, 0).state is S.LOST


def test_drifts_are_those_that_the_type_states_until_a_nut_was_locked() -> None:
    rod = ROD | {"drift_deg": 0.05, "drift_bound_deg": 0.1, "aim_before_drift": False}
    kind = VehicleType.model_validate(GUIDED.model_dump() | {"adjusting": {"front": {"tie_rod": rod}}})
    (drift,) = stated_drifts(kind).values()
    assert drift.mean == pytest.approx(3.0 * ARCMIN)
    assert drift.bound == pytest.approx(6.0 * ARCMIN)
    assert not drift.used
    guiding = Guiding(kind, ("front_left",), stated_drifts(kind))
    assert guiding.learned(stated_drifts(kind)) == stated_drifts(kind)
