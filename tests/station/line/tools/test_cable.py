"""Serial devices back to back, an adapter that is pulled out and comes back, a channel that is in use."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import can
import pytest
from can_remote import RemoteServer

from alignment.errors import ConfigurationError
from station.cycle.words.cycle import StationState, StationStatus
from station.line.interface import StationLine
from station.line.plc.orders import PlcTimeouts
from station.line.plc.simulator import PlcSimulator
from station.line.tools.cable import Cable
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.channel import BusSettings, Channel
from station.line.wire.dbc import LineDatabase
from tests.station.line.line_bench import WAIT_S, FakeCanBus

PATIENT = PlcTimeouts(connect_s=20.0, ready_s=WAIT_S, silence_s=2.0)


@pytest.fixture
def cable() -> Iterator[Cable]:
    with Cable() as cable:
        yield cable


def frame(number: int) -> can.Message:
    return can.Message(arbitration_id=0x123, is_extended_id=False, data=[number])


def wait_until(reached: Callable[[], bool]) -> None:
    wait = threading.Event()
    for _ in range(int(20 / 0.01)):
        if reached():
            return
        wait.wait(0.01)
    pytest.fail("it did not come in time")


def test_frames_pass_both_ways(cable: Cable) -> None:
    heard: list[queue.SimpleQueue[can.Message]] = [queue.SimpleQueue(), queue.SimpleQueue()]
    with open_bus(cable.settings(0)) as first, open_bus(cable.settings(1)) as second:
        first.listen(heard[0].put)
        second.listen(heard[1].put)
        for number in range(20):
            first.send(frame(number))
            second.send(frame(100 + number))
        assert [heard[1].get(timeout=WAIT_S).data[0] for _ in range(20)] == list(range(20))
        assert [heard[0].get(timeout=WAIT_S).data[0] for _ in range(20)] == list(range(100, 120))


def test_one_program_has_a_relative_name_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only absolute names were claimed: two programs on one device each took half of the bytes."""
    monkeypatch.chdir(tmp_path)
    with Cable() as cable:
        Path("plc").symlink_to(cable.ends[1])
        named = replace(cable.settings(1), channel="plc")
        with open_bus(named), pytest.raises(ConfigurationError, match="another program has it open"):
            open_bus(named)


def test_what_is_sent_to_nobody_is_lost(cable: Cable) -> None:
    heard: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
    with open_bus(cable.settings(0)) as first:
        for _ in range(10):
            first.send(frame(1))
        wait_until(lambda: cable.lost_bytes >= 80)
        with open_bus(cable.settings(1)) as second:
            second.listen(heard.put)
            for _ in range(50):
                first.send(frame(2))
            assert heard.get(timeout=WAIT_S).data[0] == 2


def test_end_that_nobody_reads_keeps_the_newest_frames(cable: Cable) -> None:
    device = os.open(cable.ends[1], os.O_RDWR | os.O_NOCTTY)
    try:
        with open_bus(cable.settings(0)) as first:
            for number in range(30_000):
                first.send(frame(number % 256))
            assert first.health.send_failures == 0
            wait_until(lambda: cable.lost_bytes > 0)
    finally:
        os.close(device)


def test_channel_in_use_is_said_so(cable: Cable) -> None:
    with open_bus(cable.settings(0)), pytest.raises(ConfigurationError, match="another program has it open"):
        open_bus(cable.settings(0))
    with open_bus(cable.settings(0)) as again:
        assert again.health.connected


def test_device_is_free_again_after_an_open_that_failed(cable: Cable) -> None:
    """Whoever corrects a bit rate that the adapter does not have must not find the device locked."""
    settings = cable.settings(0)
    wrong = Channel(replace(settings, bitrate=123))
    for _ in range(2):
        with pytest.raises(ConfigurationError, match="bitrate"):
            wrong()
    with open_bus(settings) as bus:
        assert bus.health.connected


def test_adapter_that_is_pulled_out_comes_back_without_a_restart(
    database: LineDatabase, request: pytest.FixtureRequest
) -> None:
    cables = [Cable()]

    def unplug_all() -> None:
        for cable in cables:
            cable.close()

    request.addfinalizer(unplug_all)

    def opened(end: int) -> can.BusABC:
        return Channel(cables[-1].settings(end))()

    with (
        LineBus(lambda: opened(0)) as station_bus,
        LineBus(lambda: opened(1)) as plc_bus,
        StationLine(station_bus, database) as line,
        PlcSimulator(plc_bus, database, timeouts=PATIENT) as plc,
    ):
        line.publish(StationStatus(StationState.IDLE))
        assert plc.connect().ready
        cables[0].close()
        wait_until(lambda: station_bus.health.losses > 0 and plc_bus.health.losses > 0)
        wait_until(lambda: not line.health.link_up)
        assert not line.status.ready
        wait_until(lambda: plc.status is None)
        cables.append(Cable())
        assert plc.connect().ready
        assert line.health.link_up
        assert station_bus.health.receiving
        assert station_bus.health.losses == 1


class Server:
    """A python-can-remote server on the loopback address."""

    def __init__(self) -> None:
        self.server = RemoteServer("127.0.0.1", 0, interface="virtual", channel="remote-line")
        self.address = f"ws://127.0.0.1:{self.server.server_address[1]}/"
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.thread.start()


@pytest.mark.parametrize("problem", ["bus off", "queue"])
def test_bus_off_and_a_full_queue_open_the_adapter_again(problem: str) -> None:
    opened: list[FakeCanBus] = []
    reopened = threading.Event()

    class OffBus(FakeCanBus):
        @property
        def state(self) -> can.BusState:
            off = problem == "bus off" and self is opened[0]
            return can.BusState.ERROR if off else can.BusState.ACTIVE

    def make() -> OffBus:
        opened.append(OffBus())
        if problem == "queue" and len(opened) == 1:
            opened[0].send_error = can.CanOperationError("transmit queue full")
        if len(opened) == 2:
            reopened.set()
        return opened[-1]  # type: ignore[return-value]

    ticks = iter(range(1_000_000))
    with LineBus(make, clock=lambda: float(next(ticks))) as bus:
        if problem == "queue":
            for _ in range(2):
                with pytest.raises(ConnectionError, match=r"queue full|away"):
                    bus.send(frame(1))
        assert reopened.wait(WAIT_S)
        wait_until(lambda: bus.health.connected)
        bus.send(frame(2))
        assert bus.health.losses == 1
        assert "bus off" in str(bus.health.last_error) or "queue full" in str(bus.health.last_error)


def test_bus_off_of_socketcan_is_an_error_frame() -> None:
    opened: list[FakeCanBus] = []
    off = iter([can.Message(arbitration_id=0x40, is_error_frame=True, dlc=8, data=bytes(8))])

    def make() -> FakeCanBus:
        opened.append(FakeCanBus())
        opened[-1].receive = lambda: next(off, None)
        return opened[-1]

    with LineBus(make) as bus:
        wait_until(lambda: len(opened) == 2 and bus.health.connected)
        assert bus.health.losses == 1
        assert bus.health.error_frames == 1


@pytest.mark.parametrize("kind", [0x01, 0x02, 0x04, 0x20, 0x80, 0x100, 0x200])
def test_error_frame_that_is_no_bus_off_does_not_lose_the_bus(kind: int) -> None:
    """Of socketcan: lost arbitration, a full queue, a bus error, a controller that restarted: all pass."""
    heard: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
    frames = iter([can.Message(arbitration_id=kind, is_error_frame=True, dlc=8, data=bytes(8)), frame(7)])
    fake = FakeCanBus()
    with LineBus(lambda: fake) as bus:
        bus.listen(heard.put)
        fake.receive = lambda: next(frames, None)
        assert heard.get(timeout=WAIT_S).is_error_frame
        assert heard.get(timeout=WAIT_S).data[0] == 7
        assert (bus.health.error_frames, bus.health.losses) == (1, 0)
        assert bus.health.connected


def test_adapter_that_stays_away_is_tried_again_and_again() -> None:
    tries: list[int] = []
    enough = threading.Event()

    def make() -> FakeCanBus:
        tries.append(1)
        if len(tries) > 1:
            enough.set()
            raise ConfigurationError(expected="an adapter", seen="none")
        fake = FakeCanBus()
        fake.receive = broken
        return fake

    def broken() -> can.Message | None:
        raise OSError("no such device")

    with LineBus(make) as bus:
        assert enough.wait(WAIT_S)
        assert not bus.health.connected
        with pytest.raises(ConnectionError, match="away"):
            bus.send(frame(1))


def test_two_programs_over_python_can_remote(database: LineDatabase) -> None:
    server = Server()
    settings = BusSettings("remote", server.address)
    heard: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
    try:
        with open_bus(settings) as first, open_bus(settings) as second:
            second.listen(heard.put)
            first.send(frame(7))
            assert heard.get(timeout=WAIT_S).data[0] == 7
    finally:
        server.server.shutdown()
        server.server.server_close()


def test_log_of_the_other_kind_of_device(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="channel"):
        open_bus(BusSettings("slcan", str(tmp_path / "no_device")))
