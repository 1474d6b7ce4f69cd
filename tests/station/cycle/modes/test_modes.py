from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from alignment.values import Refusal, RefusalCode
from db.records import CheckOutcome, ZeroRecord
from sensors.formats import read_shot
from station.cycle.wheels.positions import WheelPosition
from station.cycle.words.cycle import (
    ErrorCode,
    LiveAngles,
    LiveState,
    Mode,
    Outcome,
    Prepare,
    StationState,
    Stop,
)
from tests.station.bench import MASTER, TODAY, WHEELS, Bench, camera_error, measurement, open_bench

SIGN = {"camber": 0.8, "toe": 0.2}


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


def test_master_wheel_is_stored_as_a_check_too(bench: Bench) -> None:
    bench.found["rear_left"] = measurement(toe=0.02)
    bench.trigger(vehicle_type=MASTER.number, mode=Mode.MASTER_CHECK)
    outcomes = {check.calibration_id: check.outcome for check in bench.store.checks}
    assert outcomes == {
        f"cal-{wheel}": CheckOutcome.OUT if wheel == "rear_left" else CheckOutcome.WITHIN for wheel in WHEELS
    }
    assert len(bench.store.cycles) == 1


def test_adjusting_shows_live_angles_until_stop_and_then_measures(bench: Bench) -> None:
    bench.found["rear_left"] = measurement(toe=0.02)
    shown: list[int] = []

    def stop_after_two_of_each() -> None:
        shown.append(1)
        wheels = [angles.wheel for angles, _ in bench.line.live]
        if min(wheels.count(wheel) for wheel in WHEELS) == 2:
            bench.line.queue.append(Stop(1))

    bench.line.on_live = stop_after_two_of_each
    report = bench.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.NOK
    assert bench.states[1:4] == [StationState.ARMED, StationState.ADJUSTING, StationState.MEASURING]
    last = {angles.wheel: angles for angles, _ in bench.line.live}
    assert last["rear_left"].state is LiveState.OUTSIDE
    assert last["front_left"].state is LiveState.INSIDE
    assert last["front_left"].camber_deg == pytest.approx(math.degrees(0.001))
    assert last["front_left"].shot >= 2
    assert len(bench.store.cycles) == 1


def test_camera_that_fails_amid_adjusting_is_shown_and_does_not_end_it(bench: Bench) -> None:
    bench.rigs["front_left"].shoot_error = camera_error()

    def mend() -> None:
        if bench.line.live[-1][0] == LiveAngles("front_left", LiveState.NOT_MEASURED, 1):
            bench.rigs["front_left"].shoot_error = None
            bench.line.queue.append(Stop(1))

    bench.line.on_live = mend
    report = bench.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.OK


def test_prepare_arms_the_cameras_or_is_refused(bench: Bench) -> None:
    bench.rigs["front_left"].arm_error = camera_error()
    bench.line.queue.append(Prepare(3, WHEELS, 1))
    bench.cycle.step(0.1)
    armed = [name for name in bench.log if name.startswith("armed")]
    assert sorted(armed) == [f"armed {wheel}" for wheel in WHEELS[1:]]
    bench.line.queue.append(Prepare(4, WHEELS, 77))
    bench.cycle.step(0.1)
    assert bench.line.refused == [(4, ErrorCode.UNKNOWN_VEHICLE_TYPE)]
    assert bench.cycle.state is StationState.IDLE


def test_calibrate_records_images_and_judges_nothing(bench: Bench, tmp_path: Path) -> None:
    assert bench.trigger(mode=Mode.CALIBRATE) is None
    assert bench.line.refused == [(1, ErrorCode.MODE_NOT_AVAILABLE)]
    with open_bench(image_folder=tmp_path / "images") as able:
        able.rigs["rear_right"].shoot_error = camera_error()
        able.trigger(2, wheels=WHEELS[:3], mode=Mode.CALIBRATE)
        assert set(able.line.outcomes.values()) == {Outcome.RECORDED}
        assert able.store.cycles == []
        assert "images" in able.store.event_codes
        assert able.cycle.state is StationState.IDLE
        (folder,) = (tmp_path / "images").iterdir()
        assert sorted(path.name for path in folder.iterdir()) == sorted(WHEELS[:3])
        assert read_shot(folder / "front_left").rig == "front_left"
        able.trigger(3, mode=Mode.CALIBRATE)
        assert able.line.outcomes["rear_right"] is Outcome.FAULT
        assert able.line.outcomes["front_left"] is Outcome.RECORDED
        assert able.cycle.state is StationState.FAULT
        assert able.line.status.error_code is ErrorCode.CAMERA_FAULT


def test_a_plate_is_recorded_without_the_light_lines_of_the_projector(tmp_path: Path) -> None:
    with open_bench(image_folder=tmp_path / "images") as able:
        rig = able.rigs["front_left"]
        rig.shoot_unlit = lambda timeout_s: rig.log.append("unlit") or rig.shot  # type: ignore[attr-defined, func-returns-value]
        able.trigger(1, wheels=["front_left"], mode=Mode.CALIBRATE)
        assert able.line.outcomes["front_left"] is Outcome.RECORDED
        assert "unlit" in rig.log


def zero(name: str, rig: str, calibration: str, toe: float) -> ZeroRecord:
    return ZeroRecord(
        name, rig, calibration, TODAY, master="m", method="tyre_plane", shots=1, camber=0.0, toe=toe,
        certified_camber=0.0, certified_toe=0.0, camber_u=1e-5, toe_u=1e-5, correlation=0.0,
        software_version="1.0",
    )  # fmt: skip


@pytest.mark.parametrize("mode", [Mode.AUTOMATIC, Mode.ADJUST])
def test_zero_measurement_of_this_rig_and_calibration_alone_corrects(bench: Bench, mode: Mode) -> None:
    bench.store.zeros = (
        zero("other-calibration", "front_left", "cal-of-before", 0.004),
        zero("other-rig", "rear_left", "cal-front_left", 0.003),
        zero("own", "front_left", "cal-front_left", 0.002),
    )
    bench.line.on_live = lambda: bench.line.queue.append(Stop(1))
    report = bench.trigger(wheels=["front_left"], mode=mode)
    assert report is not None
    (wheel,) = report.record.wheels
    assert wheel.zero_measurement_id == "own"
    plain = measurement().toe
    assert abs(wheel.toe - plain) == pytest.approx(0.002, rel=1e-3)  # type: ignore[operator]
    if mode is Mode.ADJUST:
        angles, measured_s = bench.line.live[0]
        assert angles.toe_deg == pytest.approx(math.degrees(wheel.toe))  # type: ignore[arg-type]
        assert 1000.0 <= measured_s <= bench.clock.now


def test_refused_master_is_no_check(bench: Bench) -> None:
    bench.found["rear_left"] = Refusal(RefusalCode.HEAD_DARK, "no light lines")
    bench.trigger(wheels=["rear_left", "front_left"], vehicle_type=MASTER.number, mode=Mode.MASTER_CHECK)
    (check,) = bench.store.checks
    assert (check.calibration_id, check.outcome) == ("cal-front_left", CheckOutcome.WITHIN)
    (wheel,) = (wheel for wheel in bench.store.cycles[0].wheels if wheel.wheel == "front_left")
    assert check.utc == wheel.measured_utc


def test_shots_of_adjusting_are_counted_to_255_and_from_0_again(bench: Bench) -> None:
    def stop_in_the_second_round() -> None:
        if len(bench.line.live) == 258:
            bench.line.queue.append(Stop(1))

    bench.line.on_live = stop_in_the_second_round
    bench.trigger(wheels=["front_left"], mode=Mode.ADJUST)
    assert [angles.shot for angles, _ in bench.line.live[:258]] == [*range(1, 256), 0, 1, 2]


def test_master_without_a_verdict_is_not_within(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    run = WheelPosition.run
    monkeypatch.setattr(
        WheelPosition, "run", lambda self, zeros: replace(run(self, zeros), calibration_valid=False)
    )
    bench.trigger(wheels=["front_left"], vehicle_type=MASTER.number, mode=Mode.MASTER_CHECK)
    (check,) = bench.store.checks
    assert check.outcome is CheckOutcome.OUT


def test_limits_of_an_ordinary_vehicle_check_no_calibration(bench: Bench) -> None:
    """Limits of half a degree made every calibration "within", whatever it was."""
    bench.trigger(mode=Mode.MASTER_CHECK)
    assert bench.store.checks == []
    assert len(bench.store.cycles) == 1
    (event,) = (event for event in bench.store.events if event.code == "no_master")
    assert "front_left" in event.text
    assert "wider than ±10′" in event.text


def test_a_slip_in_a_master_s_limits_is_named(bench: Bench) -> None:
    angles = {"camber": math.radians(-0.8), "toe": math.radians(0.2)}
    certified = {name: {"nominal_deg": degrees, "tolerance_deg": 0.05} for name, degrees in SIGN.items()}
    bench.types[MASTER.number] = MASTER.model_validate(
        MASTER.model_dump(exclude_none=True) | {"axles": {"front": certified, "rear": certified}}
    )
    bench.found["front_left"] = measurement(**angles)
    bench.trigger(wheels=["front_left"], vehicle_type=MASTER.number, mode=Mode.MASTER_CHECK)
    (check,) = bench.store.checks
    assert check.outcome is CheckOutcome.OUT
    assert "they would fit with the opposite sign of the camber" in check.reason
