"""Times and limits that `docs/line-interface.md` promises, as numbers of the page and not of the program."""

from __future__ import annotations

import threading
from collections import Counter

import can
import pytest

from alignment.errors import ConfigurationError, LineConnectionError
from station.configuration.settings import read_station
from station.cycle.recording.store_thread import StoreThread
from station.cycle.words.cycle import ErrorCode, Mode, Outcome, WheelAnswer
from station.line.wire.bus import LineBus
from station.running.composition import cycle_bounds
from station.threads.supervised import SupervisedThread
from tests.station.bench import Bench as CycleBench
from tests.station.bench import open_bench
from tests.station.line.line_bench import DBC, WAIT_S, Bench, Clock, FakeCanBus
from tests.station.line.page import TEXT

PAGE = " ".join(TEXT.split())
FOUR = ("front_left", "front_right", "rear_left", "rear_right")


class Waits(threading.Event):
    """An event that does not wait: it keeps for how long it was to, and is set after some waits."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.asked: list[float | None] = []
        self.done = threading.Event()
        self._most = most

    def wait(self, timeout: float | None = None) -> bool:
        self.asked.append(timeout)
        if len(self.asked) >= self._most:
            self.set()
            self.done.set()
        return self.is_set()


def says(text: str) -> None:
    assert text in PAGE, f"the page does not say {text!r} any more; this test holds its numbers"


def test_vin_frames_count_for_two_seconds(bench: Bench) -> None:
    """The test imported the constant that it should judge: a lifetime of 2,000 s passed."""
    says("A frame older than two seconds does not count")
    bench.vin(1)
    bench.clock.now += 2.001
    bench.command("start", 1)
    assert bench.status.error_code is ErrorCode.VIN_INCOMPLETE
    bench.vin(2)
    for _ in range(3):
        bench.clock.now += 0.45
        bench.command("none", 0)
    bench.clock.now += 0.6
    bench.command("start", 2)
    assert bench.status.error_code is ErrorCode.NONE
    assert bench.status.busy


def test_controller_is_lost_after_500_ms(bench: Bench) -> None:
    says("no good `Command` for 500 ms means that the communication is lost")
    bench.clock.now += 0.499
    bench.line.tick()
    assert bench.status.ready
    bench.clock.now += 0.002
    bench.line.tick()
    assert not bench.status.ready
    assert bench.status.error_code is ErrorCode.COMMUNICATION_LOST


def test_preparation_is_forgotten_after_300_s(bench: Bench) -> None:
    says("as it is after 300 s in any case")

    def pass_time(seconds: float) -> None:
        bench.clock.now += seconds - 0.2
        bench.command("none", 0)
        bench.command("none", 0)
        bench.clock.now += 0.2
        bench.line.tick()

    bench.command("prepare", 3)
    pass_time(299.9)
    assert bench.status.handshake == "prepared"
    pass_time(0.3)
    assert bench.status.handshake == "ready"


def test_how_often_everything_comes(bench: Bench) -> None:
    """Status and answer every 100 ms, information and blank results every second, held ones as Status."""

    def second() -> Counter[str]:
        bench.messages()
        for _ in range(10):
            bench.clock.now += 0.1001
            bench.command("none", 0)
            bench.line.tick()
        return Counter(name for name, _ in bench.messages())

    bench.line.tick()
    idle = second()
    assert (idle["Status"], idle["CommandAnswer"]) == (10, 10)
    assert idle["StationInfo"] == idle["ErrorDetail"] == idle["VehicleResult"] == 1
    assert idle["WheelResultFrontLeft"] == idle["AxleUncertaintyRear"] == 1
    bench.start(1)
    bench.line.send_results(1, [WheelAnswer(wheel, Outcome.FAULT) for wheel in FOUR])
    held = second()
    assert held["VehicleResult"] == held["WheelUncertaintyRearRight"] == held["AxleResultFront"] == 10


def test_status_goes_out_every_100_ms_by_itself(bench: Bench) -> None:
    says("Command every 100 ms, Status and CommandAnswer every 100 ms")
    waits = bench.line._cyclic.stopping = Waits(4)
    bench.line.start()
    assert waits.done.wait(WAIT_S)
    bench.line.close()
    assert waits.asked == [0.1] * 4


def refusing_bus(clock: Clock) -> tuple[LineBus, FakeCanBus, threading.Semaphore, threading.Event]:
    """A bus whose adapter takes no frame: bus, adapter, a pass of its receiving thread, opened again."""
    fake, passes, again = FakeCanBus(), threading.Semaphore(0), threading.Event()
    buses = iter([fake])

    def opened() -> can.BusABC:
        found = next(buses, None)
        if found is None:
            again.set()
            return FakeCanBus()
        return found

    fake.send_error = can.CanOperationError("transmit queue full")
    fake.receive = passes.release
    return LineBus(opened, clock=clock), fake, passes, again


def passed(passes: threading.Semaphore) -> None:
    """The receiving thread has looked at the adapter, wholly after now."""
    while passes.acquire(blocking=False):
        pass
    for _ in range(3):
        assert passes.acquire(timeout=WAIT_S)


def test_adapter_that_takes_no_frame_for_two_seconds_is_opened_again_however_often_it_refuses() -> None:
    """Patience that starts anew at each refusal never ends, as a Status is refused every 100 ms."""
    says("takes no frame for 2 s is opened again")
    clock = Clock()
    bus, _, passes, again = refusing_bus(clock)
    with bus:
        for _ in range(20):
            with pytest.raises(LineConnectionError):
                bus.send(command_frame_of_nothing())
            clock.now += 0.0999
            passed(passes)
        assert bus.health.losses == 0
        clock.now += 0.01
        assert again.wait(WAIT_S)
        assert bus.health.losses == 1
        assert "no frame was taken for 2 s" in str(bus.health.last_error)


def test_one_frame_that_is_taken_renews_the_patience() -> None:
    clock = Clock()
    bus, fake, passes, again = refusing_bus(clock)
    with bus:
        refusal = fake.send_error
        with pytest.raises(LineConnectionError):
            bus.send(command_frame_of_nothing())
        clock.now += 1.9
        fake.send_error = None
        bus.send(command_frame_of_nothing())
        fake.send_error = refusal
        with pytest.raises(LineConnectionError):
            bus.send(command_frame_of_nothing())
        clock.now += 1.9
        passed(passes)
        assert bus.health.losses == 0
        clock.now += 0.2
        assert again.wait(WAIT_S)


def command_frame_of_nothing() -> can.Message:
    return can.Message(arbitration_id=0x7F0, is_extended_id=False)


def test_pauses_of_an_adapter_that_is_away_grow_from_a_tenth_to_five_seconds() -> None:
    says("after pauses that grow from 0.1 s to 5 s")
    away = [True]

    def opened() -> can.BusABC:
        if away[0]:
            raise ConfigurationError(field="line.channel", expected="an adapter", seen="none")
        return FakeCanBus()

    away[0] = False
    with LineBus(opened) as bus:
        bus._receiver.stop()
        away[0] = True
        waits = Waits(100)
        for _ in range(8):
            bus._reopen(waits)
        assert waits.asked == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0])
        away[0] = False
        bus._reopen(waits)
        bus._lose("again")
        bus._reopen(waits)
        assert waits.asked[-1] == pytest.approx(0.1)


def test_failed_step_of_a_thread_rests_before_the_next() -> None:
    """A lasting failure would take a whole processor."""

    def fail(stopping: threading.Event) -> None:
        raise ZeroDivisionError

    for pause_s, thread in (
        (0.1, SupervisedThread("line a", fail)),
        (7.0, SupervisedThread("line b", fail, 7.0)),
    ):
        waits = thread.stopping = Waits(5)
        thread.start()
        assert waits.done.wait(WAIT_S)
        thread.stop()
        assert waits.asked == [pause_s] * 5
        assert thread.failures == 5


def test_step_that_goes_well_is_repeated_without_a_rest_and_a_rest_ends_at_the_stop() -> None:
    steps, failed = iter(range(3)), threading.Event()

    def step(stopping: threading.Event) -> None:
        if next(steps, None) is None:
            failed.set()
            raise ZeroDivisionError

    thread = SupervisedThread("line c", step, pause_s=1000.0)
    thread.start()
    assert failed.wait(WAIT_S)
    thread.stop(timeout_s=WAIT_S)
    assert (thread.alive, thread.failures) == (False, 1)


@pytest.mark.parametrize(("mode", "calls"), [(Mode.AUTOMATIC, 6), (Mode.MASTER_CHECK, 14)])
def test_cycle_ends_within_the_page_s_longest_time(
    mode: Mode, calls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wheels that never come and a database that takes its whole bound for each call."""
    says(f"| `cycle.measure_timeout_s` + {calls} × `database.timeout_s` | {30 + calls * 5} s |")
    settings = read_station(DBC.parent / "station.toml")
    assert settings.database.timeout_s == 5.0
    store_s = cycle_bounds(settings).store_s
    call = StoreThread.call
    with open_bench(measure_s=0.4, store_s=store_s) as bench:

        def slow(self: StoreThread, *arguments: object) -> object:
            bench.clock.now += store_s
            return call(self, *arguments)  # type: ignore[arg-type]

        ended = times_of(bench, monkeypatch)
        monkeypatch.setattr(StoreThread, "call", slow)
        for rig in bench.rigs.values():
            rig.gate = threading.Event()
        started = bench.clock.now
        bench.trigger(mode=mode)
        assert bench.line.sent
        assert ended[0] - started <= 0.4 + calls * 5.0 + 0.1


def times_of(bench: CycleBench, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """When results were sent; the clock goes on while the cycle looks for commands."""
    ended: list[float] = []
    send, look = bench.line.send_results, bench.line.next_command

    def send_results(*arguments: object) -> Outcome:
        ended.append(bench.clock.now)
        return send(*arguments)  # type: ignore[arg-type]

    def next_command(timeout_s: float) -> object:
        bench.clock.now += 0.02 if timeout_s == 0 else 0.0
        return look(timeout_s)

    monkeypatch.setattr(bench.line, "send_results", send_results)
    monkeypatch.setattr(bench.line, "next_command", next_command)
    return ended
