"""No thread of the station dies unseen, and none keeps the station from ending."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from alignment.errors import CameraError, StoreError, StoreUnavailableError
from station.cycle.recording.store_thread import StoreThread
from station.cycle.words.cycle import ErrorCode, Mode, Outcome, Reset, StationState, Stop
from station.threads.health import ThreadWatch
from station.threads.supervised import SupervisedThread, described
from station.threads.worker import Worker, WorkerError
from tests.station.bench import GATE_S, WHEELS, Bench, assert_set, open_bench

UNFORESEEN = [
    MemoryError("no room"),
    KeyError("x"),
    UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"),
    RecursionError("too deep"),
    TimeoutError("of the call itself"),
]


def raising(error: BaseException) -> Any:
    def call(*args: Any, **kwargs: Any) -> Any:
        raise error

    return call


@pytest.fixture
def worker() -> Iterator[Worker]:
    worker = Worker("test", most_waiting=2)
    yield worker
    worker.close()


@pytest.mark.parametrize("error", UNFORESEEN[:-1])
def test_worker_survives_what_a_call_raises_and_counts_it(worker: Worker, error: Exception) -> None:
    with pytest.raises(type(error)):
        worker.submit(raising(error)).result(GATE_S)
    assert worker.submit(lambda: 5).result(GATE_S) == 5
    assert (worker.alive, worker.failures, worker.last_error) == (True, 1, described(error))


def test_error_of_the_product_is_the_callers_and_no_defect(worker: Worker) -> None:
    with pytest.raises(CameraError):
        worker.submit(raising(CameraError("c", "it burns"))).result(GATE_S)
    assert worker.failures == 0


def test_worker_that_is_busy_refuses_with_the_cause_and_ends_within_its_bound() -> None:
    worker = Worker("slow", most_waiting=1)
    gate, going = threading.Event(), threading.Event()

    def hang() -> None:
        going.set()
        gate.wait(GATE_S)

    worker.submit(hang)
    assert_set(going)
    waiting = worker.submit(lambda: 1)
    with pytest.raises(WorkerError, match=r"'slow' is too slow: 1 calls wait, for one of \d"):
        worker.submit(lambda: 2)
    assert not worker.close(0.1)
    assert waiting.cancelled()
    with pytest.raises(WorkerError, match="'slow' has ended"):
        worker.submit(lambda: 3)
    gate.set()


def test_worker_finishes_what_was_submitted_before_it_ends() -> None:
    worker = Worker("prompt")
    done: list[int] = []
    for k in range(20):
        worker.submit(done.append, k)
    assert worker.close(GATE_S)
    assert done == list(range(20))


def test_worker_that_waits_for_work_ends_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """It looked only every 50 ms whether it should end, and a station waited for each of its own in turn."""
    monkeypatch.setattr("station.threads.worker._LOOK_S", 2 * GATE_S)
    worker = Worker("waiting")
    assert worker.submit(lambda: 5).result(GATE_S) == 5
    started = time.monotonic()
    assert worker.close(GATE_S)
    assert time.monotonic() - started < GATE_S
    assert not worker.alive


@pytest.mark.parametrize("error", UNFORESEEN)
def test_whatever_the_database_raises_becomes_a_store_error(error: Exception) -> None:
    thread = StoreThread(GATE_S)
    with pytest.raises(StoreError, match=type(error).__name__) as caught:
        thread.call(raising(error))
    assert not isinstance(caught.value, StoreUnavailableError)
    assert thread.call(lambda: 5) == 5
    assert thread.close()


def test_call_that_did_not_begin_within_its_bound_is_never_made() -> None:
    thread = StoreThread(0.1)
    gate = threading.Event()
    made: list[int] = []
    with pytest.raises(StoreUnavailableError, match=r"within 0\.1 s"):
        thread.call(lambda: gate.wait(GATE_S))
    with pytest.raises(StoreUnavailableError):
        thread.call(made.append, 1)
    gate.set()
    assert thread.call(lambda: list(made)) == []
    assert thread.close()


def test_watch_tells_once_a_minute_of_a_thread_that_fails_on_and_of_its_end() -> None:
    failing = threading.Event()

    def step(stopping: threading.Event) -> None:
        failing.set()
        raise KeyError("x")

    def fail_again() -> None:
        # When the second step begins, the first one is counted.
        for _ in range(2):
            failing.clear()
            assert_set(failing)

    thread = SupervisedThread("bad", step, pause_s=0.001)
    watch = ThreadWatch([thread])
    thread.start()
    fail_again()
    (text,) = watch.news(0.0)
    assert text.startswith("the thread 'bad' runs on; ")
    assert text.endswith("the last: KeyError: 'x'")
    fail_again()
    assert watch.news(59.0) == []
    assert len(watch.news(60.0)) == 1
    thread.stop()
    assert [health.alive for health in watch.health] == [False]
    (text,) = watch.news(200.0)
    assert "has ended" in text
    assert watch.news(300.0) == []


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


def health_of(bench: Bench, name: str) -> tuple[bool, int]:
    (found,) = (health for health in bench.cycle.threads if health.name == name)
    return found.alive, found.failures


@pytest.mark.parametrize("error", UNFORESEEN)
def test_defect_in_a_wheels_thread_is_told_counted_and_survived(bench: Bench, error: Exception) -> None:
    bench.raises = error
    report = bench.trigger(wheels=["front_left"])
    assert report is not None
    assert report.told is Outcome.FAULT
    assert bench.line.status.error_code is ErrorCode.INTERNAL_FAULT
    assert type(error).__name__ in (report.record.reason_text or "")
    bench.raises = None
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    report = bench.trigger(3)
    assert report is not None
    assert report.told is Outcome.OK
    if not isinstance(error, OSError):
        assert health_of(bench, "wheel front_left") == (True, 1)
        (event,) = (event for event in bench.store.events if event.code == "thread_failed")
        assert type(error).__name__ in event.text


@pytest.mark.parametrize("error", UNFORESEEN)
def test_defect_in_the_stores_thread_is_told_counted_and_survived(bench: Bench, error: Exception) -> None:
    bench.store.hold = raising(error)
    report = bench.trigger()
    assert report is not None
    assert report.told is Outcome.FAULT
    assert bench.line.status.error_code is ErrorCode.STORE_FAULT
    bench.store.hold = lambda record: None
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    report = bench.trigger(3)
    assert report is not None
    assert report.told is Outcome.OK
    if not isinstance(error, OSError):
        assert health_of(bench, "store")[0]
        assert health_of(bench, "store")[1] >= 1
        assert "thread_failed" in bench.store.event_codes


def test_defect_amid_adjusting_is_shown_and_does_not_end_it(bench: Bench) -> None:
    """It ended the station's serving loop."""
    bench.raises = KeyError("x")

    def mend() -> None:
        bench.raises = None
        bench.line.queue.append(Stop(1))

    bench.line.on_live = mend
    report = bench.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.OK


@pytest.mark.parametrize("moment", ["arm", "connect"])
def test_defect_in_a_cameras_driver_is_told_and_survived(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    """It ended the station's serving loop."""
    rig = bench.rigs["rear_left"]
    with monkeypatch.context() as patched:
        patched.setattr(rig, moment, raising(KeyError("x")))
        if moment == "connect":
            rig.shoot_error = CameraError("rear_left", "it burns")
        report = bench.trigger()
        assert report is not None
        assert bench.line.outcomes["rear_left"] is Outcome.FAULT
        assert bench.line.outcomes["front_left"] is Outcome.OK
        bench.line.queue.append(Reset(2))
        bench.cycle.step(0.1)
        if moment == "connect":
            assert bench.cycle.state is StationState.FAULT
            assert any("KeyError: 'x'" in event.text for event in bench.store.events)
        else:
            assert report.record.reason_code == "internal_fault"
    rig.shoot_error = None
    bench.line.queue.append(Reset(3))
    bench.cycle.step(0.1)
    report = bench.trigger(4)
    assert report is not None
    assert report.told is Outcome.OK


def test_cameras_that_do_not_take_their_settings_in_time_are_a_fault_and_left_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whoever waited for them waited for ever."""
    with open_bench(measure_s=0.1) as bench:
        gate = threading.Event()
        monkeypatch.setattr(bench.rigs["rear_left"], "arm", lambda: gate.wait(GATE_S))
        report = bench.trigger()
        assert report is not None
        assert report.record.reason_code == "camera_fault"
        assert "rear_left: its cameras did not answer within 0.1 s" in (report.record.reason_text or "")
        bench.line.queue.append(Reset(2))
        bench.cycle.step(0.1)
        assert bench.line.status.error_code is ErrorCode.CYCLE_TIMEOUT
        gate.set()
        assert bench.wheels_at_rest(GATE_S)
        bench.line.queue.append(Reset(3))
        bench.cycle.step(0.1)
        assert bench.cycle.state is StationState.IDLE


def test_thread_that_has_ended_refuses_its_wheel_with_the_cause(bench: Bench) -> None:
    bench.end_thread_of("rear_left")
    report = bench.trigger()
    assert report is not None
    assert "the thread 'wheel rear_left' has ended" in (report.record.reason_text or "")
    assert bench.line.outcomes["rear_left"] is Outcome.FAULT
    assert bench.line.outcomes["front_left"] is Outcome.OK
    bench.line.queue.append(Reset(2))
    bench.cycle.step(0.1)
    assert any("wheel rear_left" in e.text for e in bench.store.events if e.code == "thread_failed")


def test_rig_that_hangs_amid_adjusting_neither_keeps_the_others_nor_the_station() -> None:
    """The end of adjusting waited for the last shot, for ever, with the cameras' next start lost to it."""
    with open_bench(measure_s=0.2) as bench:
        hanging = bench.rigs["rear_right"]

        def hang_then_stop() -> None:
            if hanging.gate is None:
                hanging.shooting.clear()
                hanging.gate = threading.Event()
            elif hanging.shooting.is_set() and not bench.line.queue:
                bench.line.queue.append(Stop(1))

        bench.line.on_live = hang_then_stop
        report = bench.trigger(mode=Mode.ADJUST)
        assert report is not None
        assert {w: o for w, o in bench.line.outcomes.items() if o is not Outcome.OK} == {
            "rear_right": Outcome.FAULT
        }
        assert report.record.reason_code == "cycle_timeout"
        assert bench.cycle.state is StationState.FAULT
        bench.line.queue.append(Reset(2))
        bench.cycle.step(0.1)
        assert bench.cycle.state is StationState.FAULT
        assert bench.line.status.error_code is ErrorCode.CYCLE_TIMEOUT
        assert "connected rear_right" not in bench.log


def test_measurement_that_comes_after_its_start_was_given_up_is_nobodys() -> None:
    with open_bench(measure_s=1.0) as bench:
        gate = threading.Event()
        for rig in bench.rigs.values():
            rig.gate = gate
        bench.line.on_poll = bench.let_the_rigs_shoot_too_long
        bench.trigger()
        bench.line.on_poll = lambda: None
        gate.set()
        assert bench.wheels_at_rest(GATE_S)
        bench.line.queue.append(Reset(2))
        bench.cycle.step(0.1)
        for name in WHEELS:
            bench.rigs[name].shot = None
        bench.raises = CameraError("front_left", "no images of this start")
        report = bench.trigger(3)
        assert report is not None
        assert report.told is Outcome.FAULT
        assert len(bench.line.sent) == 2


def test_images_that_come_after_a_calibration_start_was_told_a_fault_are_not_kept(tmp_path: Any) -> None:
    """They were written into its folder, while the station could be reset and use the cameras."""
    with open_bench(measure_s=0.2, image_folder=tmp_path / "images") as bench:
        gate = bench.rigs["rear_right"].gate = threading.Event()
        bench.trigger(mode=Mode.CALIBRATE)
        assert bench.line.outcomes["rear_right"] is Outcome.FAULT
        assert bench.line.outcomes["front_left"] is Outcome.RECORDED
        bench.line.queue.append(Reset(2))
        bench.cycle.step(0.1)
        assert bench.cycle.state is StationState.FAULT
        gate.set()
        assert bench.wheels_at_rest(GATE_S)
        (folder,) = (tmp_path / "images").iterdir()
        assert sorted(path.name for path in folder.iterdir()) == sorted(set(WHEELS) - {"rear_right"})
        bench.line.queue.append(Reset(3))
        bench.cycle.step(0.1)
        assert bench.cycle.state is StationState.IDLE


def test_rig_that_hangs_for_ever_does_not_hang_the_end_of_the_station(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("station.cycle.wheels.threads._CLOSING_S", 0.2)
    bench = Bench(measure_s=1.0)
    bench.cycle.start()
    gate = bench.rigs["front_left"].gate = threading.Event()
    bench.line.on_poll = lambda: setattr(bench.clock, "now", bench.clock.now + 1.0)
    bench.trigger(wheels=["front_left"])
    ended = threading.Thread(target=bench.cycle.close)
    ended.start()
    ended.join(GATE_S / 2)
    assert not ended.is_alive()
    gate.set()
