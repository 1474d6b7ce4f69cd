"""Adapters whose driver is missing, strange or broken: one sentence with what to install, no traceback."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from typing import Any

import can
import pytest

from alignment.errors import ConfigurationError, LineConnectionError
from station.cli import main
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.channel import BusSettings, Channel
from tests.station.line.line_bench import WAIT_S

FOREIGN = sorted(can.VALID_INTERFACES - {"virtual"})


class OwnError(Exception):
    """An error of a driver that descends from nothing common."""


RAISED: list[Callable[[], BaseException]] = [
    lambda: NameError("name 'canGetNumberOfChannels' is not defined"),
    lambda: AttributeError("module 'ctypes' has no attribute 'windll'"),
    lambda: ImportError("No module named 'ics'"),
    lambda: OSError("libpcanbasic.so: cannot open shared object file"),
    lambda: can.CanInitializationError("no such channel"),
    lambda: can.CanInterfaceNotImplementedError("cannot import"),
    NotImplementedError,
    lambda: TypeError("__init__() missing 2 required positional arguments: 'host' and 'port'"),
    lambda: ValueError("bad channel"),
    lambda: KeyError("handle"),
    lambda: IndexError("list index out of range"),
    lambda: RuntimeError("driver"),
    AssertionError,
    lambda: ctypes.ArgumentError("argument 1"),
    MemoryError,
    lambda: OwnError("0x80040111"),
    lambda: SystemExit(3),
]


@pytest.mark.parametrize("interface", FOREIGN)
def test_an_adapter_that_is_not_there_ends_in_one_sentence(
    interface: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A missing library of Kvaser's ended in a NameError, exit 1: "a goal was missed"."""
    # Only what these would reach beyond this program is held back; all else is the adapter's own code.
    beyond = {"socketcan", "udp_multicast", "socketcand", "remote"}
    if interface in beyond:
        monkeypatch.setattr(can, "Bus", failing(lambda: OSError(19, "No such device")))
    with pytest.raises(SystemExit) as ended:
        main(["line", "monitor", "--seconds", "0.1", "--interface", interface, "--channel", "0"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said
    (line,) = [line for line in said.splitlines() if line.startswith("truewheel:")]
    assert f"expected a channel of the interface '{interface}' that opens, found '0': " in line
    assert interface in beyond or "This interface needs " in line


@pytest.mark.parametrize("raised", RAISED, ids=lambda raised: type(raised()).__name__)
@pytest.mark.parametrize("interface", ["kvaser", "vector", "remote"])
def test_whatever_an_adapter_raises_when_it_opens_is_told(
    interface: str, raised: Callable[[], BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can, "Bus", failing(raised))
    with pytest.raises(ConfigurationError) as caught:
        open_bus(BusSettings(interface, "0"))
    text = str(raised())
    assert text in str(caught.value) or type(raised()).__name__ in str(caught.value)
    assert caught.value.cure
    assert interface != "kvaser" or "Kvaser's canlib driver" in str(caught.value)


def test_a_persons_wish_to_end_the_program_is_no_fault_of_the_adapter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(can, "Bus", failing(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        Channel(BusSettings("kvaser", "0"))()


def failing(raised: Callable[[], BaseException]) -> Callable[..., Any]:
    def fail(*arguments: object, **options: object) -> Any:
        raise raised()

    return fail


class Broken(can.BusABC):
    """An adapter that opens and then raises."""

    channel_info = "broken"

    def __init__(self, raised: Callable[[], BaseException], when: str) -> None:
        self.raised, self.when = raised, when
        super().__init__(channel="0")

    def _fail(self, now: str) -> None:
        if self.when == now:
            raise self.raised()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self._fail("receive")
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._fail("send")

    @property
    def state(self) -> can.BusState:
        self._fail("state")
        return can.BusState.ACTIVE

    def shutdown(self) -> None:
        super().shutdown()
        self._fail("close")


@pytest.mark.parametrize("raised", RAISED, ids=lambda raised: type(raised()).__name__)
def test_whatever_an_open_adapter_raises_is_survived(raised: Callable[[], BaseException]) -> None:
    bus = LineBus(lambda: Broken(raised, "send"))
    with bus:
        with pytest.raises(LineConnectionError, match="did not take frame"):
            bus.send(can.Message(arbitration_id=1))
        assert bus.health.receiving
    # An adapter need not know a state: that it says so is no failure.
    second = "receive" if isinstance(raised(), NotImplementedError) else "state"
    lost = iter([Broken(raised, "receive"), Broken(raised, second)])
    third = threading.Event()

    def opened() -> can.BusABC:
        again = next(lost, None)
        if again is None:
            third.set()
        return again or Broken(raised, "never")

    with LineBus(opened) as bus:
        assert third.wait(WAIT_S)
        assert bus.health.receiving
        assert bus.health.receive_failures == 2
        assert "receive: " in str(bus.health.last_error)
    with LineBus(lambda: Broken(raised, "close")) as closing:
        pass
    assert "close: " in str(closing.health.last_error)
