"""Wheels that turn, in the cycle: a series of each, measured while it is taken, judged by its spin axis."""

from __future__ import annotations

import gc
import math
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from alignment.units import ARCMIN
from alignment.values import Refusal, RefusalCode, WheelMeasurement
from db.records import CycleOutcome, Severity, Verdict, WheelKind, WheelOutcome
from sensors.shot import HeadFrames, WheelShot
from station.configuration.vehicle_types import VehicleType
from station.cycle.judging.evaluation import missed_limits
from station.cycle.wheels.image_memory import ImageMemory
from station.cycle.wheels.series import MOST_WAITING, SeriesChoice
from station.cycle.words.cycle import Abort, AxisKind, ErrorCode, LiveState, Mode, Outcome, StationState, Stop
from tests.alignment.wheel.test_series import exposures, mean_axis
from tests.sensors.samples import shot as sample_shot
from tests.station.bench import AXLE, GATE_S, WHEELS, Bench, FakeRig, assert_set, camera_error, open_bench

WIDE = {"nominal_deg": 0.0, "tolerance_deg": 1.0}
SPUN = {**AXLE, "camber": {"nominal_deg": -0.8, "tolerance_deg": 0.3}, "toe": WIDE, "run_out_mm": 2.5}
TURNING = VehicleType.model_validate(
    {"number": 3, "name": "On rollers", "measure": "spin_axis", "axles": {"front": SPUN, "rear": SPUN}}
)
PLANES = VehicleType.model_validate({"number": 4, "name": "Standing", "axles": {"front": SPUN, "rear": SPUN}})
CHOICE = SeriesChoice(interval_s=0.0)


class TurningRig(FakeRig):
    """Every shot is the next exposure since arming; `change` may drop, double or fail one."""

    def __init__(self, name: str, log: list[str]) -> None:
        super().__init__(name, log)
        self.taken = 0
        self.change: Callable[[int], int] = lambda number: number
        self.at_shot: Callable[[int], None] = lambda number: None
        self.still = False

    def arm(self) -> None:
        super().arm()
        self.taken = 0

    def shoot(self, timeout_s: float) -> WheelShot:
        self.taken += 1
        super().shoot(timeout_s)
        self.at_shot(self.taken)
        taken = sample_shot(rig=self.name, trigger=self.change(self.taken))
        return _quiet(taken) if self.still else taken


def _quiet(taken: WheelShot) -> WheelShot:
    """The same, of a wheel that looks alike in every exposure, but for one grey value."""

    def alike(frame: Any) -> Any:
        image = np.full_like(frame.image, 90)
        image[0, 0] = 90 + frame.trigger_counter
        return replace(frame, image=image)

    heads = tuple(HeadFrames(h.name, alike(h.left), alike(h.right)) for h in taken.heads)
    return replace(taken, heads=heads)


class TurningBench(Bench):
    """A bench whose rigs have rollers; planes of each wheel come in the order of its exposures."""

    def __init__(self, **options: Any) -> None:
        options = {"series": CHOICE, "types": {3: TURNING, 4: PLANES}} | options
        super().__init__(**options)
        self.planes: dict[str, deque[WheelMeasurement | Refusal]] = {}
        self.axes: dict[str, np.ndarray] = {}
        for k, name in enumerate(WHEELS):
            self.put_rig(TurningRig(name, self.log))
            planes, self.axes[name] = exposures(np.random.default_rng([21, k]), side=_side(name))
            self.planes[name] = deque(planes)
        self.hold: Callable[[str], None] = lambda wheel: None

    def _measure(self, rig: str) -> WheelMeasurement | Refusal:
        self.hold(rig)
        return self.planes[rig].popleft() if self.planes[rig] else super()._measure(rig)

    def rig(self, name: str) -> TurningRig:
        found = self.rigs[name]
        assert isinstance(found, TurningRig)
        return found


def _side(wheel: str) -> Any:
    return wheel.rpartition("_")[2]


@contextmanager
def opened(**options: Any) -> Iterator[TurningBench]:
    bench = TurningBench(**options)
    bench.cycle.start()
    try:
        yield bench
    finally:
        bench.cycle.close()


@pytest.fixture
def bench() -> Iterator[TurningBench]:
    with opened() as bench:
        yield bench


def test_the_verdict_is_on_the_mean_spin_axis_of_sixteen_exposures(bench: TurningBench) -> None:
    report = bench.trigger(vehicle_type=3)
    assert report is not None
    assert report.told is Outcome.OK
    for wheel in report.record.wheels:
        camber, toe = mean_axis(bench.axes[wheel.wheel], _side(wheel.wheel))
        assert wheel.method == "spin_axis"
        assert wheel.camber == pytest.approx(camber, abs=0.1 * ARCMIN)
        assert wheel.toe == pytest.approx(toe, abs=0.1 * ARCMIN)
        assert wheel.points_used == 16 * 9000
    assert {rig.taken for rig in map(bench.rig, WHEELS)} == {16}


def test_a_vehicle_type_that_does_not_say_is_measured_as_the_station_says() -> None:
    with opened() as bench:
        assert bench.trigger(vehicle_type=4) is not None
        assert {rig.taken for rig in map(bench.rig, WHEELS)} == {1}
    with opened(series=replace(CHOICE, measure="spin_axis", exposures=14)) as bench:
        assert bench.trigger(vehicle_type=4) is not None
        assert {rig.taken for rig in map(bench.rig, WHEELS)} == {14}


def test_run_out_without_a_limit_is_stored_and_not_judged() -> None:
    axle = {name: value for name, value in SPUN.items() if name != "run_out_mm"}
    kind = VehicleType.model_validate(
        TURNING.model_dump(exclude_none=True) | {"axles": {"front": axle, "rear": axle}}
    )
    with opened(types={3: kind}) as bench:
        report = bench.trigger(vehicle_type=3)
    assert report is not None
    assert report.told is Outcome.OK
    for stored in report.record.wheels:
        assert stored.run_out == pytest.approx(2.0, abs=0.06)
        assert stored.run_out_high is None


@pytest.mark.parametrize("k", [2.0, 1.96, 1.7])
def test_run_out_at_the_edge_of_its_limit_is_judged_alike_in_record_and_cycle(k: float) -> None:
    """Judged as a tilt and stored in millimetres, the two could fall on both sides of the limit."""
    with opened(coverage_factor=k) as bench:
        report = bench.trigger(wheels=["front_left"], vehicle_type=3)
        assert report is not None
        (found,) = report.record.wheels
        assert found.run_out is not None
        assert found.run_out_u is not None
        edge = found.run_out + k * found.run_out_u
    told = set()
    for most_mm in (math.nextafter(edge, 9.0), edge, math.nextafter(edge, 0.0), edge - 1e-9):
        axle = SPUN | {"run_out_mm": most_mm}
        kind = VehicleType.model_validate(
            TURNING.model_dump(exclude_none=True) | {"axles": {"front": axle, "rear": axle}}
        )
        with opened(coverage_factor=k, types={3: kind}) as bench:
            report = bench.trigger(wheels=["front_left"], vehicle_type=3)
            (answer,) = bench.line.sent[-1][1]
        assert report is not None
        assert report.record.outcome == str(report.told) == str(answer.run_out_state)
        told.add(report.told)
    assert told == {Outcome.OK, Outcome.NOK}


def test_run_out_of_a_part_of_a_vehicle_fails_it_too() -> None:
    """Two wheels of an axle have no verdict of a whole vehicle's angles, and run-outs all the same."""
    axle = SPUN | {"run_out_mm": 1.9}
    kind = VehicleType.model_validate(
        TURNING.model_dump(exclude_none=True) | {"axles": {"front": axle, "rear": axle}}
    )
    with opened(types={3: kind}) as bench:
        report = bench.trigger(wheels=["front_left"], vehicle_type=3)
    assert report is not None
    assert (report.told, report.record.outcome) == (Outcome.NOK, CycleOutcome.NOK)


@pytest.mark.parametrize(
    ("most_mm", "severity", "told"),
    [(2.5, Severity.INFO, Outcome.OK), (1.9, Severity.WARNING, Outcome.NOK)],
)
def test_run_out_beyond_its_limit_fails_the_vehicle_and_not_the_angles_of_its_wheels(
    most_mm: float, severity: Severity, told: Outcome
) -> None:
    """The vehicle was told OK, whatever its tyres ran out by."""
    axle = SPUN | {"run_out_mm": most_mm}
    kind = VehicleType.model_validate(
        TURNING.model_dump(exclude_none=True) | {"axles": {"front": axle, "rear": axle}}
    )
    with opened(types={3: kind}) as bench:
        report = bench.trigger(vehicle_type=3)
    assert report is not None
    assert report.told is told
    assert report.record.outcome == str(told)
    assert {wheel.verdict for wheel in report.record.wheels} == {Verdict.OK}
    assert set(bench.line.outcomes.values()) == {Outcome.OK}
    said = missed_limits(report.evaluation)
    assert len(said) == (len(WHEELS) if told is Outcome.NOK else 0)
    assert all(f"limit {most_mm:g} mm" in one for one in said)
    events = [event for event in bench.store.events if event.code == "run_out"]
    assert len(events) == len(WHEELS)
    for event in events:
        assert event.severity is severity
        assert event.value == pytest.approx(2.0, abs=0.06)
        assert event.cycle_uuid == report.record.uuid
        assert "high spot at" in event.text
    for stored in report.record.wheels:
        assert stored.kind is WheelKind.SPIN_AXIS
        assert stored.run_out == pytest.approx(2.0, abs=0.06)
        assert stored.run_out_high == pytest.approx(most_mm, rel=1e-6)
        assert 0.0 < stored.run_out_u < 0.1  # type: ignore[operator]
        assert stored.run_out_phase is not None
        assert stored.run_out_phase_u is not None
    # The answer did not wait for it.
    assert bench.log.index("results") > bench.log.index("commit")


def test_exposures_are_measured_while_the_next_are_taken_and_few_wait(bench: TurningBench) -> None:
    """Sixteen exposures of four wheels are gigabytes; they must not wait for a slow measurement."""
    gate, most = threading.Event(), []
    rig = bench.rig("front_left")
    measured = threading.Semaphore(0)

    def hold(wheel: str) -> None:
        assert gate.wait(GATE_S)
        measured.release()

    def look(number: int) -> None:
        done = 0
        while measured.acquire(blocking=False):
            done += 1
        most.append(done)
        if number == MOST_WAITING:
            # Taken while the first is still being measured.
            assert not gate.is_set()
            threading.Timer(0.2, gate.set).start()

    bench.hold, rig.at_shot = hold, look
    assert bench.trigger(wheels=["front_left"], vehicle_type=3) is not None
    finished = np.cumsum(most)
    assert (np.arange(1, 17) - finished).max() <= MOST_WAITING
    assert bench.line.outcomes == {"front_left": Outcome.OK}


def wheel_of(bench: TurningBench, name: str = "front_left") -> Any:
    (record,) = bench.store.cycles
    return next(wheel for wheel in record.wheels if wheel.wheel == name)


@pytest.mark.parametrize(
    ("change", "code", "text"),
    [
        (lambda n: n + (n > 6), "exposure_missing", "exposure 7 is missing"),
        (lambda n: 6 if n == 7 else n, "exposure_doubled", "exposure 6 came twice"),
    ],
)
def test_an_exposure_that_is_missing_or_came_twice_refuses_its_wheel_alone(
    bench: TurningBench, change: Callable[[int], int], code: str, text: str
) -> None:
    bench.rig("front_left").change = change
    assert bench.trigger(vehicle_type=3) is not None
    wheel = wheel_of(bench)
    assert (wheel.outcome, wheel.reason_code) == (WheelOutcome.REFUSED, code)
    assert text in wheel.reason_text
    assert bench.line.outcomes["rear_left"] is Outcome.OK
    assert bench.line.status.error_code is ErrorCode.NONE or bench.cycle.state is StationState.IDLE


def another(planes: list[Any]) -> None:
    planes[9] = replace(planes[9], centre=planes[9].centre + np.array([5.0, 0.0, 0.0]))


def turned_steering(planes: list[Any]) -> None:
    planes[8:] = [replace(m, toe=m.toe + 8.0 * ARCMIN) for m in planes[8:]]


def dark(planes: list[Any]) -> None:
    planes[4] = Refusal(RefusalCode.HEAD_DARK, "no light lines", "head_2")


@pytest.mark.parametrize(
    ("spoil", "code", "text"),
    [
        (another, "another_wheel", "exposure 10"),
        (turned_steering, "not_slow", "not slow"),
        (dark, "head_dark", "exposure 5: no light lines"),
    ],
)
def test_a_series_that_is_none_of_one_slow_wheel_ends_with_its_reason(
    bench: TurningBench, spoil: Callable[[list[Any]], None], code: str, text: str
) -> None:
    planes = list(bench.planes["front_left"])
    spoil(planes)
    bench.planes["front_left"] = deque(planes)
    assert bench.trigger(wheels=["front_left"], vehicle_type=3) is not None
    wheel = wheel_of(bench)
    assert (wheel.outcome, wheel.reason_code) == (WheelOutcome.REFUSED, code)
    assert text in wheel.reason_text
    assert bench.cycle.state is StationState.IDLE


def test_a_wheel_that_the_rollers_do_not_turn_is_refused(bench: TurningBench) -> None:
    """All its planes agree, and all are off the axis by the run-out."""
    planes, _ = exposures(np.random.default_rng(22), step=0.0)
    bench.planes["front_left"] = deque(planes)
    bench.rig("front_left").still = True
    assert bench.trigger(wheels=["front_left"], vehicle_type=3) is not None
    assert wheel_of(bench).reason_code == "turn_too_short"
    assert "check that the rollers turn it" in wheel_of(bench).reason_text


def test_a_wheel_that_turns_less_than_asked_is_refused(bench: TurningBench) -> None:
    planes, _ = exposures(np.random.default_rng(23), step=math.radians(12.0), wander=0.0, uneven=0.0)
    bench.planes["front_left"] = deque(planes)
    assert bench.trigger(wheels=["front_left"], vehicle_type=3) is not None
    assert wheel_of(bench).reason_code == "turn_too_short"
    assert "turned by 180°" in wheel_of(bench).reason_text


def test_a_camera_that_fails_amid_a_series_is_a_fault(bench: TurningBench) -> None:
    rig = bench.rig("front_left")

    def fail(number: int) -> None:
        if number == 9:
            raise camera_error()

    rig.at_shot = fail
    assert bench.trigger(vehicle_type=3) is not None
    assert bench.line.outcomes["front_left"] is Outcome.FAULT
    assert bench.line.outcomes["rear_left"] is Outcome.OK
    assert rig.taken == 9
    assert bench.cycle.state is StationState.FAULT


def test_an_abort_ends_a_series_before_its_next_exposure(bench: TurningBench) -> None:
    """A series takes seconds, and its cameras are in use until it ends."""
    rig, begun, gate = bench.rig("front_left"), threading.Event(), threading.Event()

    def wait(number: int) -> None:
        if number == 5:
            begun.set()
            assert gate.wait(GATE_S)

    rig.at_shot = wait

    def abort() -> None:
        if bench.cycle.state is StationState.MEASURING:
            assert_set(begun)
            bench.line.at[StationState.MEASURING] = Abort(1)

    bench.line.on_poll = abort
    bench.line.on_delivery = lambda: threading.Timer(0.1, gate.set).start() or None
    report = bench.trigger(wheels=["front_left"], vehicle_type=3)
    assert report is not None
    assert report.told is Outcome.ABORTED
    assert rig.taken == 5
    assert bench.wheels_at_rest(GATE_S)


def test_a_measurement_that_hangs_ends_the_cycle_in_its_bound(bench: TurningBench) -> None:
    gate, held = threading.Event(), threading.Event()

    def hang(wheel: str) -> None:
        held.set()
        assert gate.wait(GATE_S)

    bench.hold = hang

    def pass_time() -> None:
        if bench.cycle.state is StationState.MEASURING:
            assert_set(held)
            bench.clock.now += 1000.0

    bench.line.on_poll = pass_time
    report = bench.trigger(wheels=["front_left"], vehicle_type=3)
    gate.set()
    assert report is not None
    assert report.told is Outcome.FAULT
    assert wheel_of(bench).reason_code == "cycle_timeout"


def test_of_a_series_the_last_exposure_is_kept_and_no_other_image(bench: TurningBench) -> None:
    report = bench.trigger(wheels=["front_left"], vehicle_type=3)
    assert report is not None
    (wheel,) = report.evaluation.wheels
    assert wheel.result.shot is not None
    assert wheel.result.shot.frames[0].trigger_counter == 16
    kept = wheel.result.without_images()
    assert kept.shot is None
    assert kept.spin is not None


def test_adjusting_shows_the_axis_of_single_exposures_and_not_their_planes(bench: TurningBench) -> None:
    """A plane is eleven minutes off an axis; the series before the adjusting tells where it leans to."""
    bench.planes["front_left"].extend([bench.planes["front_left"][-1]] * 3)
    series, _ = exposures(np.random.default_rng(24))
    bench.planes["front_left"].extend(series)
    last = bench.axes["front_left"][-1]

    def stop() -> None:
        shown = sum(angles.state is not LiveState.NOT_MEASURED for angles, _ in bench.line.live)
        if shown == 3 or len(bench.line.live) == 8:
            bench.line.queue.append(Stop(1))

    bench.line.on_live = stop
    rig = bench.rig("front_left")
    # Nothing is measured beyond the three before the stop is heard.
    bench.hold = lambda wheel: None
    report = bench.trigger(wheels=["front_left"], vehicle_type=3, mode=Mode.ADJUST)
    assert report is not None
    shown = [angles for angles, _ in bench.line.live]
    assert shown[0].state is LiveState.NOT_MEASURED
    for angles in shown[1:4]:
        assert angles.camber_deg == pytest.approx(math.degrees(last[0]), abs=1.5 / 60.0)
        assert angles.toe_deg == pytest.approx(math.degrees(last[1]), abs=1.5 / 60.0)
        assert angles.kind is AxisKind.SPIN_AXIS
    # One series, single exposures, one series, all of the wheel that stood there when it was armed.
    assert rig.taken >= 16 + 3 + 16


def test_a_wheel_whose_series_is_refused_shows_no_live_angles(bench: TurningBench) -> None:
    planes = list(bench.planes["front_left"])
    another(planes)
    bench.planes["front_left"] = deque(planes)

    def stop() -> None:
        if len(bench.line.live) == 4:
            bench.line.queue.append(Stop(1))

    bench.line.on_live = stop
    bench.trigger(wheels=["front_left"], vehicle_type=3, mode=Mode.ADJUST)
    assert {angles.state for angles, _ in bench.line.live[:4]} == {LiveState.NOT_MEASURED}


def test_a_stop_that_comes_amid_the_series_before_the_adjusting_is_heard(bench: TurningBench) -> None:
    bench.planes["front_left"].extend(bench.planes["front_left"].copy())
    told, heard = threading.Event(), threading.Event()
    bench.line.on_poll = lambda: heard.set() if told.is_set() and not bench.line.queue else None

    def stop(number: int) -> None:
        if number == 3 and not told.is_set():
            told.set()
            bench.line.queue.append(Stop(1))
            # The series goes on when the stop has been taken from the line: amid it, not after.
            assert heard.wait(10.0)

    bench.rig("front_left").at_shot = stop
    report = bench.trigger(wheels=["front_left"], vehicle_type=3, mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.OK
    assert len(bench.line.live) == 1


def test_the_bench_of_standing_wheels_takes_no_second_thread() -> None:
    with open_bench() as bench:
        assert not any(thread.name.startswith("series") for thread in bench.cycle.threads)


def test_exposures_are_kept_for_the_archive_and_let_go_with_their_result() -> None:
    memory = ImageMemory(10**9)
    with opened(series=SeriesChoice(interval_s=0.0, memory=memory)) as bench:
        report = bench.trigger(vehicle_type=3)
        assert report is not None
        for wheel in report.evaluation.wheels:
            kept = wheel.result.exposures
            assert kept is not None
            assert [shot.series and shot.series.number for shot in kept] == list(range(1, 17))
        assert memory.bytes > 0
        del report, wheel, kept
        gc.collect()
        assert memory.bytes == 0


def test_a_series_that_finds_no_room_is_measured_and_not_kept() -> None:
    memory = ImageMemory(1000)
    with opened(series=SeriesChoice(interval_s=0.0, memory=memory)) as bench:
        report = bench.trigger(vehicle_type=3)
        assert report is not None
        assert report.told is Outcome.OK
        assert [wheel.result.exposures for wheel in report.evaluation.wheels] == [None] * 4
        assert memory.bytes == 0
