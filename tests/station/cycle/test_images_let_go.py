"""The images of a vehicle, tens of megabytes for each wheel, are let go when its cycle ends."""

from __future__ import annotations

import gc
import logging
import threading
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest

from alignment.errors import LineError
from alignment.values import Refusal, RefusalCode
from station.cycle.under_way import CycleUnderWay
from station.cycle.words.cycle import Abort, Mode, Outcome, Reset, StationState, Stop
from tests.station.bench import GATE_S, MASTER, WHEELS, Bench, FakeRig, camera_error, open_bench, store_error


class FreshRig(FakeRig):
    """Every shot is a new one; remembers them without keeping them."""

    taken: list[weakref.ref[Any]]

    def shoot(self, timeout_s: float) -> Any:
        super().shoot(timeout_s)
        shot = replace(self.shot)
        self.taken.append(weakref.ref(shot))
        return shot


@pytest.fixture
def unlogged() -> Iterator[None]:
    """What catches log records for the report of a test keeps the errors in them."""
    logging.disable()
    yield
    logging.disable(logging.NOTSET)


@pytest.fixture
def bench(tmp_path: Path, unlogged: None) -> Iterator[Bench]:
    with open_bench(image_folder=tmp_path, adjust_s=50.0) as bench:
        for rig in bench.rigs.values():
            rig.__class__ = FreshRig
            rig.taken = []  # type: ignore[attr-defined]
        yield bench


def taken(bench: Bench) -> list[weakref.ref[Any]]:
    return [one for rig in bench.rigs.values() for one in rig.taken]  # type: ignore[attr-defined]


def kept(bench: Bench) -> int:
    """How many shots are still held, once every thread of a wheel has gone on to something else."""
    for wheel in WHEELS:
        bench.cycle._wheel_threads.submit(wheel, lambda: None).result(GATE_S)
    gc.collect()
    return sum(one() is not None for one in taken(bench))


def under_way() -> set[UUID]:
    """The cycles that anybody holds."""
    return {one.uuid for one in gc.get_objects() if isinstance(one, CycleUnderWay)}


def adjust(bench: Bench) -> None:
    bench.line.on_live = lambda: bench.line.queue.append(Stop(3))
    bench.trigger(3, mode=Mode.ADJUST)


def refuse(bench: Bench) -> None:
    bench.found["rear_left"] = Refusal(RefusalCode.HEAD_DARK, "head_1 left: no light lines")
    bench.trigger()


def raising(error: Callable[[], Exception]) -> Any:
    """A call that raises a new error each time, as a program does."""

    def call(*_: object) -> None:
        raise error()

    return call


def fail(bench: Bench) -> None:
    bench._measure = raising(lambda: KeyError("a defect"))  # type: ignore[method-assign]
    bench.trigger()


def lose_a_camera(bench: Bench) -> None:
    bench.rigs["front_left"].shoot_error = camera_error()
    bench.trigger()


def lose_the_store(bench: Bench) -> None:
    bench.store.hold = raising(store_error)
    bench.trigger()


def find_a_defect_of_the_store(bench: Bench) -> None:
    bench.store.hold = raising(lambda: KeyError("a defect"))
    bench.trigger()


def lose_the_line(bench: Bench) -> None:
    bench.line.send_results = raising(lambda: LineError("bus off"))  # type: ignore[method-assign]
    bench.trigger()


def abort(bench: Bench) -> None:
    bench.line.at[StationState.STORING] = Abort(1)
    bench.trigger()


def forget(bench: Bench) -> None:
    bench.line.at[StationState.EVALUATING] = Reset(9)
    bench.trigger()


def hold(bench: Bench) -> None:
    bench.line.acknowledges = False
    bench.trigger()


def check_a_master(bench: Bench) -> None:
    bench.trigger(vehicle_type=MASTER.number, mode=Mode.MASTER_CHECK)


def record_images(bench: Bench) -> None:
    bench.trigger(mode=Mode.CALIBRATE)


@pytest.mark.parametrize(
    "happens",
    [
        lambda bench: bench.trigger(), adjust, refuse, fail, lose_a_camera, lose_the_store,
        find_a_defect_of_the_store, lose_the_line, abort, forget, hold, check_a_master, record_images,
    ],
    ids=lambda happens: happens.__name__.strip("<>"),
)  # fmt: skip
def test_no_image_outlives_its_cycle(bench: Bench, happens: Callable[[Bench], None]) -> None:
    """Every position kept its last shot for whoever might ask, a failed thread the frames of its defect."""
    before = under_way()
    happens(bench)
    assert len(taken(bench)) >= 3
    assert kept(bench) == 0
    assert under_way() <= before


def test_shot_that_comes_too_late_is_let_go_when_it_ends(bench: Bench) -> None:
    late = bench.rigs["rear_left"]
    late.gate = threading.Event()
    bench.line.on_poll = bench.let_the_rigs_shoot_too_long
    bench.trigger()
    bench.line.on_poll = lambda: None
    assert bench.line.outcomes["rear_left"] is Outcome.FAULT
    late.gate.set()
    assert bench.cycle._wheel_threads.drain(GATE_S)
    bench.cycle.step(0.1)
    assert late.taken  # type: ignore[attr-defined]
    assert kept(bench) == 0


@pytest.mark.slow
def test_images_do_not_add_up_over_many_cycles(bench: Bench) -> None:
    most = 0
    for sequence in range(1, 21):
        bench.trigger(sequence)
        most = max(most, kept(bench))
    assert len(taken(bench)) == 20 * len(WHEELS)
    assert most == 0


def test_result_carries_the_images_that_it_was_measured_in(bench: Bench) -> None:
    report = bench.trigger()
    assert report is not None
    for wheel in report.evaluation.wheels:
        shot = wheel.result.shot
        assert shot is not None
        (one,) = bench.rigs[wheel.result.wheel].taken  # type: ignore[attr-defined]
        assert shot is one()
        assert (wheel.result.measured_utc, wheel.result.device_time_s) == (
            shot.time_utc, shot.frames[0].device_time_s,
        )  # fmt: skip
        del shot, wheel
    later = report.without_images()
    assert later.record == report.record
    assert [wheel.result.measured_utc for wheel in later.evaluation.wheels] == [
        wheel.result.measured_utc for wheel in report.evaluation.wheels
    ]
    del report
    assert kept(bench) == 0


@pytest.mark.parametrize("why", ["not this calibration's", "no shot"])
def test_result_without_usable_images_carries_none_of_an_earlier_vehicle(bench: Bench, why: str) -> None:
    bench.trigger(1)
    rig = bench.rigs["front_left"]
    if why == "no shot":
        rig.shoot_error = camera_error()
    else:
        rig.shot = replace(rig.shot, rig="another")
    report = bench.trigger(2)
    assert report is not None
    (wheel,) = (w.result for w in report.evaluation.wheels if w.result.wheel == "front_left")
    assert wheel.failure is not None
    assert (wheel.shot, wheel.measured_utc, wheel.device_time_s) == (None, None, None)
