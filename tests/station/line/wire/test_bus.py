"""One end of the bus: opening, sending, the receiving thread, the log."""

from __future__ import annotations

import queue
import struct
import threading
from pathlib import Path

import can
import pytest

from alignment.errors import ConfigurationError, LineConnectionError, LineError
from station.line.tools.monitor import decode_log
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.channel import BusSettings
from station.line.wire.dbc import LineDatabase
from station.line.wire.protection import Protector
from station.threads.supervised import SupervisedThread
from tests.station.line.line_bench import WAIT_S, FakeCanBus, command_frame


def frame(number: int = 1) -> can.Message:
    return can.Message(arbitration_id=0x123, is_extended_id=False, data=[number])


def test_unknown_interface_is_named_with_those_that_exist() -> None:
    with pytest.raises(ConfigurationError, match=r"socketcan.*'nosuchbus'"):
        open_bus(BusSettings(interface="nosuchbus"))


def test_channel_that_does_not_open() -> None:
    with pytest.raises(ConfigurationError, match=r"'slcan'.*'/dev/no_such_adapter'.*adapter"):
        open_bus(BusSettings(interface="slcan", channel="/dev/no_such_adapter"))


def test_log_is_closed_when_the_bus_does_not_open(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError):
        open_bus(BusSettings(interface="nosuchbus", log=tmp_path / "traffic.log"))


def test_log_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="log"):
        open_bus(BusSettings(log=tmp_path / "no_such_folder" / "traffic.log"))
    with pytest.raises(ConfigurationError, match=r"\.blf"):
        open_bus(BusSettings(log=tmp_path / "traffic.xlsx"))


def test_frames_reach_every_listener_until_it_ends(station_bus: LineBus, plc_bus: LineBus) -> None:
    first: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
    second: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
    station_bus.listen(first.put)
    station_bus.listen(second.put)
    plc_bus.send(frame(1))
    assert first.get(timeout=WAIT_S).data == second.get(timeout=WAIT_S).data == bytearray([1])
    station_bus.unlisten(first.put)
    plc_bus.send(frame(2))
    assert second.get(timeout=WAIT_S).data == bytearray([2])
    assert first.empty()
    assert plc_bus.health.sent == 2
    assert station_bus.health.received == 2


def test_listener_that_raises_is_seen_and_keeps_nobody_else_from_the_frame(
    station_bus: LineBus, plc_bus: LineBus
) -> None:
    seen: queue.SimpleQueue[can.Message] = queue.SimpleQueue()

    def broken(received: can.Message) -> None:
        raise ZeroDivisionError("in a listener")

    station_bus.listen(broken)
    station_bus.listen(seen.put)
    for number in (1, 2):
        plc_bus.send(frame(number))
        assert seen.get(timeout=WAIT_S).data == bytearray([number])
    health = station_bus.health
    assert health.receiving
    assert health.receive_failures >= 1
    assert "in a listener" in str(health.last_error)


def test_adapter_that_fails_while_receiving_is_tried_again() -> None:
    fake, received = FakeCanBus(), threading.Event()
    script = iter([can.CanOperationError("bus off"), OSError("unplugged"), frame()])

    def receive() -> can.Message | None:
        step = next(script, None)
        if isinstance(step, Exception):
            raise step
        return step

    with LineBus(lambda: fake) as bus:
        bus.listen(lambda _: received.set())
        fake.receive = receive
        assert received.wait(WAIT_S)
        assert bus.health.receive_failures == bus.health.losses == 2
        assert "unplugged" in str(bus.health.last_error)
    assert not bus.health.receiving


def test_sending_on_a_closed_bus(station_bus: LineBus) -> None:
    station_bus.close()
    with pytest.raises(LineConnectionError, match="closed"):
        station_bus.send(frame())
    station_bus.close()


@pytest.mark.parametrize("error", [can.CanOperationError("transmit queue full"), OSError("unplugged")])
def test_frame_that_the_adapter_does_not_take(error: Exception) -> None:
    fake = FakeCanBus()
    fake.send_error = error
    with LineBus(lambda: fake) as bus:
        with pytest.raises(LineConnectionError, match=f"0x123.*{error}"):
            bus.send(frame())
        assert bus.health.send_failures == 1
        assert bus.health.sent == 0


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf"])
def test_log_of_both_directions_is_decoded_again(
    tmp_path: Path, channel: str, plc_bus: LineBus, database: LineDatabase, ending: str
) -> None:
    file = tmp_path / f"traffic{ending}"
    arrived = threading.Event()
    with open_bus(BusSettings(channel=channel, log=file)) as bus:
        bus.listen(lambda _: arrived.set())
        protector = Protector(database.protected)
        reset, start = command_frame(database, "reset", 3), command_frame(database, "start", 4)
        for each in (reset, start):
            protector.protect("Command", each.data)
        plc_bus.send(reset)
        assert arrived.wait(WAIT_S)
        bus.send(start)
    frames = list(decode_log(file, database))
    assert [(f.name, f.values["Code"], f.values["Sequence"]) for f in frames] == [
        ("Command", "reset", 3),
        ("Command", "start", 4),
    ]
    assert all(f.error is None for f in frames)


class FullDisk:
    def __init__(self, stop_fails: bool, error: Exception) -> None:
        self.stop_fails = stop_fails
        self.stopped = 0
        self.error = error

    def on_message_received(self, msg: can.Message) -> None:
        raise self.error

    def stop(self) -> None:
        self.stopped += 1
        if self.stop_fails:
            raise self.error


# A time or a number that python-can's writers cannot put into their formats ends in errors of their own.
@pytest.mark.parametrize(
    "error", [OSError("no space left on device"), OverflowError("infinity"), struct.error("range")]
)
@pytest.mark.parametrize(("stop_fails", "failures"), [(False, 1), (True, 2)])
def test_full_disk_stops_the_log_not_the_line(stop_fails: bool, failures: int, error: Exception) -> None:
    fake, disk = FakeCanBus(), FullDisk(stop_fails, error)
    with LineBus(lambda: fake, disk) as bus:  # type: ignore[arg-type]
        bus.send(frame(1))
        bus.send(frame(2))
        assert bus.health.log_failures == failures
        assert str(error) in str(bus.health.last_error)
    assert len(fake.sent) == 2
    assert disk.stopped == 1


def test_thread_that_does_not_end_is_reported() -> None:
    release, running = threading.Event(), threading.Event()

    def stubborn(stopping: threading.Event) -> None:
        running.set()
        release.wait(WAIT_S)

    thread = SupervisedThread("line stubborn", stubborn)
    thread.start()
    assert running.wait(WAIT_S)
    with pytest.raises(LineError, match="stubborn"):
        thread.stop(timeout_s=0.01)
    release.set()
    thread.stop()
    assert not thread.alive


def test_thread_that_never_began_can_be_stopped() -> None:
    thread = SupervisedThread("line idle", lambda stopping: None)
    thread.stop()
    assert (thread.alive, thread.failures, thread.last_error) == (False, 0, None)
