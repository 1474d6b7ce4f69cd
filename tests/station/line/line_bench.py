"""What the line's tests share: a clock that the test moves, a bus without a bus, a station on it."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import can

from station.cycle.words.cycle import Command, StationState, StationStatus
from station.line.interface import StationLine
from station.line.wire.bus import LineBus
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.messages import CommandAnswer, LineStatus
from station.line.wire.protection import Protector
from station.line.wire.status import read_answer, read_status

DBC = Path(__file__).resolve().parents[3] / "configs" / "line.dbc"
VIN = "WVWZZZ1KZAW123456"
WAIT_S = 5.0


def vin_frame(database: LineDatabase, name: str, sequence: int, vin: str = VIN) -> can.Message:
    characters: dict[str, Value] = {s: ord(vin[int(s[3:]) - 1]) for s in database.vin_messages[name]}
    return database.encode(name, {"SequenceLow": sequence % 16, **characters})


def command_frame(
    database: LineDatabase,
    code: str,
    sequence: int,
    wheels: int = 0b1111,
    mode: str = "automatic",
    interface: int = 3,
) -> can.Message:
    bits = {f"Wheel{ending}": wheels >> k & 1 for k, ending in enumerate(database.wheels.values())}
    values: dict[str, Value] = {
        "Code": code,
        "Sequence": sequence,
        "Mode": mode,
        "VehicleType": 7,
        "Heartbeat": sequence,
        "InterfaceMajor": interface,
    }
    return database.encode("Command", {**values, **bits})


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class FakeCanBus(can.BusABC):
    """A bus without a bus: keeps what is sent, and lets the test fail it."""

    channel_info = "fake bus"

    def __init__(self) -> None:
        super().__init__(channel=None)
        self.sent: list[can.Message] = []
        self.send_error: Exception | None = None
        self.receive: Callable[[], can.Message | None] = lambda: None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        assert timeout is not None
        if self.send_error is not None:
            raise self.send_error
        self.sent.append(msg)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        assert timeout is not None
        frame = self.receive()
        if frame is None:
            threading.Event().wait(0.001)
        return frame


@dataclass
class Bench:
    """A `StationLine` to which the test hands frames, in its own thread, and whose answers it reads.

    Frames are protected on their way, and the link is up from the beginning.
    """

    database: LineDatabase
    fake: FakeCanBus
    bus: LineBus
    clock: Clock
    line: StationLine
    seen: int = field(default=0)
    protector: Protector = field(init=False)

    def __post_init__(self) -> None:
        self.protector = Protector(self.database.protected)
        self.link_up()

    def link_up(self) -> None:
        """The first frame of a message sets the counter; from the second on they count."""
        for _ in range(2):
            self.vin(0)
            self.command("none", 0)

    def receive(self, frame: can.Message) -> None:
        name = self.database.name_of(frame)
        if name in self.database.protected and len(frame.data) == 8:
            self.protector.protect(name, frame.data)
        self.line.receive(frame)

    def vin(
        self, sequence: int, vin: str = VIN, messages: tuple[str, ...] = ("Vin1", "Vin2", "Vin3")
    ) -> None:
        for name in messages:
            self.receive(vin_frame(self.database, name, sequence, vin))

    def command(
        self, code: str, sequence: int, wheels: int = 0b1111, mode: str = "automatic", interface: int = 3
    ) -> None:
        self.receive(command_frame(self.database, code, sequence, wheels, mode, interface))

    def start(self, sequence: int, wheels: int = 0b1111, mode: str = "automatic") -> None:
        self.vin(sequence)
        self.command("start", sequence, wheels, mode)

    def commands(self) -> list[Command]:
        return list(iter(lambda: self.line.next_command(0.0), None))

    def messages(self) -> list[tuple[str, dict[str, Value]]]:
        """What was sent since the last call."""
        new, self.seen = self.fake.sent[self.seen :], len(self.fake.sent)
        return [(self.database.name_of(frame) or "?", self.database.decode(frame)) for frame in new]

    @property
    def answer(self) -> CommandAnswer:
        """The last CommandAnswer that was sent."""
        frames = [f for f in self.fake.sent if self.database.name_of(f) == "CommandAnswer"]
        return read_answer(self.database.decode(frames[-1]))

    @property
    def status(self) -> LineStatus:
        """The last Status that was sent."""
        frames = [f for f in self.fake.sent if self.database.name_of(f) == "Status"]
        return read_status(self.database.decode(frames[-1]))

    def idle(self) -> None:
        self.line.publish(StationStatus(StationState.IDLE))


def dbc_of_interface_2() -> str:
    """The shipped DBC without what interface 3 brought."""
    text = today = DBC.read_text(encoding="cp1252")
    for name in re.findall(
        r"^BO_ \d+ ((?:Geometry|WheelAxis|LiveAge|VehicleReference)\w*):", today, re.MULTILINE
    ):
        number = re.search(rf"^BO_ (\d+) {name}:", text, re.MULTILINE)
        assert number is not None
        pattern = rf"^BO_ {number[1]} (?:.*\n(?: SG_.*\n)*)|^(?:CM_|BA_|VAL_)[^\n]* {number[1]} [^\n]*\n"
        text = re.sub(pattern, "", text, flags=re.MULTILINE)
    text = re.sub(r"^.*\b272 InterfaceMajor.*\n|^ SG_ InterfaceMajor : 60.*\n", "", text, flags=re.MULTILINE)
    text = re.sub(r' (?:4|5|6|7) "(?:sweep|guidance|steering|locate|step)"', "", text)
    text = re.sub(
        r' \d+ "(?:wrong_interface|nothing_to_step|\w+(?<=sweep|uidan|teeri|locat)\w*_fault)"', "", text
    )
    return text.replace('BA_ "InterfaceMajor" 3;', 'BA_ "InterfaceMajor" 2;')
