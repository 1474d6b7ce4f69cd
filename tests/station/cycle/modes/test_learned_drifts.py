"""What locking adds is known from vehicle to vehicle, over a restart of the program too."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from alignment.errors import StoreUnavailableError
from alignment.units import ARCMIN
from db.records import AdjustingRecord, VehicleRecord
from db.store import ResultStore
from db.upkeep.check import check_database
from station.cycle.judging.evaluation import evaluate
from station.cycle.modes.guiding import stated_drifts
from station.cycle.modes.learned_drifts import LearnedDrifts, learned_from
from station.cycle.under_way import CycleUnderWay
from station.cycle.wheels.positions import WheelResult
from station.cycle.words.cycle import Mode, Stop, Trigger
from station.guidance.words import AdjusterKind, GuidanceState
from tests.db.example_records import adjusting, cycle
from tests.station.bench import TODAY, VIN, measurement, open_bench
from tests.station.cycle.modes.test_guiding import GUIDED

ROD = ("front", AdjusterKind.TIE_ROD)
STATED = stated_drifts(GUIDED)
WHEEL = "front_left"


class Vehicle:
    """A vehicle with one wheel, guided by a program."""

    def __init__(self, program: LearnedDrifts) -> None:
        trigger = Trigger(1, (WHEEL,), GUIDED.number, VIN, 0.0, Mode.ADJUST)
        self.cycle = CycleUnderWay(trigger, TODAY, (), GUIDED)
        self.program, self.time_s = program, 0.0
        guiding = program.guiding(self.cycle)
        assert guiding is not None
        self.guiding = guiding

    def at(self, toe: float, results: int) -> float | None:
        """The drift that its target leaves room for, degrees."""
        for _ in range(results):
            self.time_s += 0.25
            seen = evaluate(
                GUIDED, [WheelResult(WHEEL, "c", True, measurement(camber=0.0, toe=toe), None)], 2.0
            )
            told = self.guiding.take(seen, WHEEL, self.time_s, 0)
        self.state = told.state
        return told.drift_deg

    def adjust(self, drift: float) -> tuple[AdjustingRecord, ...]:
        """Turn and lock it once; what is stored of it."""
        left_room = self.at(0.02, 5)
        assert left_room is not None
        self.at(-math.radians(left_room), 6)
        self.at(drift - math.radians(left_room), 12)
        assert self.state is GuidanceState.DONE
        self.program.learn(self.cycle, self.guiding)
        return self.cycle.adjusted


@pytest.fixture(autouse=True)
def wheels_that_are_seldom_seen_are_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads get unequal turns on a busy machine, and the clock goes on with each."""
    monkeypatch.setattr("station.cycle.modes.guiding.FRESH_S", 1e6)


def test_a_program_that_starts_again_knows_what_locking_adds() -> None:
    """After each restart the first vehicles were adjusted by what the vehicle type states."""
    stored: list[AdjustingRecord] = []
    before = LearnedDrifts(lambda name, n: ())
    for drift in (4.0, 5.0, 3.5, 4.5):
        stored[:0] = Vehicle(before).adjust(drift * ARCMIN)
    assert [turned.nuts_locked for turned in stored] == [1] * 4
    asked: list[str] = []

    def ask(name: str, n: int) -> list[AdjustingRecord]:
        asked.append(name)
        return stored[:n]

    again = LearnedDrifts(ask)
    known = Vehicle(before).at(0.02, 5)
    assert known == pytest.approx(17.0 / 4.25 / 60.0)
    assert Vehicle(again).at(0.02, 5) == pytest.approx(known, rel=1e-9)
    assert Vehicle(again).at(0.02, 5) == pytest.approx(known, rel=1e-9)
    # Once for a program, however many vehicles come.
    assert asked == ["Guided"]


def test_a_database_that_does_not_answer_leaves_what_the_type_states() -> None:
    def ask(name: str, n: int) -> list[AdjustingRecord]:
        raise StoreUnavailableError("the database did not answer")

    assert Vehicle(LearnedDrifts(ask)).at(0.02, 5) == 0.0


def test_nuts_count_each_and_what_the_type_does_not_name_teaches_nothing() -> None:
    drift = 2.0 * ARCMIN
    twice = learned_from(STATED, [adjusting(corrections=2, nuts_locked=2, drift=drift)])[ROD]
    assert twice.weight == pytest.approx(2.25)
    assert twice.mean == pytest.approx(2.0 * drift / 2.25)
    others = [
        adjusting(adjuster="camber_bolt"),
        adjusting("rear_left"),
        adjusting(nuts_locked=0, drift=None),
        # No locking does that: it was turned.
        adjusting(drift=0.02),
    ]
    assert learned_from(STATED, others) == STATED


def test_the_station_leaves_room_by_what_it_stored_of_this_type() -> None:
    with open_bench(types={GUIDED.number: GUIDED}) as bench:
        mine = VehicleRecord(VIN, GUIDED.name)
        for station, drift in (("station_1", 4.0), ("station_2", 9.0)):
            turned = adjusting(corrections=2, nuts_locked=2, drift=drift * ARCMIN)
            bench.store.cycles.append(cycle(station=station, vehicle=mine, adjustings=(turned,)))
        bench.found[WHEEL] = measurement(toe=0.02)

        # How often each wheel is seen is up to the machine: until it says what to turn, or patience ends.
        def stop_when_told() -> None:
            bench.line.clock.now += 0.1
            if any(guidance.state is GuidanceState.TURN for guidance, _ in bench.line.guided):
                bench.line.queue.append(Stop(1))

        bench.line.on_live = stop_when_told
        bench.trigger(vehicle_type=GUIDED.number, mode=Mode.ADJUST)
        told = [guidance for guidance, _ in bench.line.guided if guidance.state is GuidanceState.TURN]
        assert told[0].drift_deg == pytest.approx(8.0 / 2.25 / 60.0)


def test_an_adjusted_vehicle_is_in_the_database_and_in_its_chain(tmp_path: Path) -> None:
    """A row that the database refuses would take the whole cycle with it."""
    url = f"sqlite:///{tmp_path / 'results.db'}"
    toes = {GuidanceState.TURN: 0.0, GuidanceState.LOCK_NUT: 4.0 * ARCMIN}
    with ResultStore(url, create=True) as store:
        with open_bench(types={GUIDED.number: GUIDED}, store=store) as bench:
            bench.found[WHEEL] = measurement(toe=0.02)

            # By what was told of the wheel: how often it is seen before is up to the machine.
            def turn() -> None:
                bench.line.clock.now += 0.1
                told = [guidance.state for guidance, _ in bench.line.guided if guidance.wheel == WHEEL]
                bench.found[WHEEL] = measurement(toe=toes.get((told or [None])[-1], bench.found[WHEEL].toe))
                if told and told[-1] is GuidanceState.DONE and not bench.line.queue:
                    bench.line.queue.append(Stop(1))

            bench.line.on_live = turn
            report = bench.trigger(vehicle_type=GUIDED.number, mode=Mode.ADJUST)
        assert report is not None
        assert report.record is not None
        stored = store.cycle(report.record.uuid)
        assert stored is not None
        assert stored.record == report.record
        [turned] = stored.record.adjustings
        assert (turned.outcome, turned.corrections, turned.nuts_locked) == ("done", 1, 1)
        assert turned.drift == pytest.approx(4.0 * ARCMIN)
        assert turned.left_toe == pytest.approx(4.0 * ARCMIN)
        assert store.recent_adjustings("station_1", GUIDED.name, 9) == (turned,)
    assert check_database(url, days=None).findings == ()
