"""The steps of a controller as `docs/line-interface.md` shows them, run as they stand against a station.

The controller is built from the page alone (`page.PagePlc`); the station is the real `StationLine`. Time is a
clock that the test moves, so a restart can be tried at every moment of a cycle.
"""

from __future__ import annotations

import contextlib
import queue
import random
import re
import time
from collections import deque
from collections.abc import Iterator

import can
import pytest

from station.cycle.words.cycle import (
    SERVED_MODES,
    Abort,
    Acknowledge,
    ErrorCode,
    Mode,
    Outcome,
    Reset,
    StationState,
    StationStatus,
    Trigger,
    WheelAnswer,
)
from station.cycle.words.vehicle import SteeringWheel
from station.line.handshake import Asked, Event, Handshake
from station.line.interface import StationLine
from station.line.plc.orders import PlcOrder
from station.line.plc.simulator import PlcSimulator
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.dbc import LineDatabase, Value, load_line_database
from station.line.wire.messages import CommandCode, HandshakeState
from station.line.wire.options import LineOptions
from station.rehearsal.simulated import simulated_station
from tests.documents import snippets
from tests.station.line.line_bench import DBC, VIN, WAIT_S, Clock, FakeCanBus
from tests.station.line.page import PAGE, TEXT, Kept, PageCode, PagePlc, rows
from tests.station.line.plc.test_simulator import SmallStation
from tests.structured_text import names_of, translated

DATABASE = load_line_database(DBC)
SCAN_S, STATUS_S = 0.02, 0.1
CYCLE_S = 0.5
VINS = (VIN, "1FTFW1ET5DFC10312", "TWDEMX00000000001")


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> PageCode:
    return PageCode(tmp_path_factory.mktemp("page"))


class World:
    """A station and the page's controller on one clock. What the station stores outlasts its restart."""

    def __init__(self, code: PageCode, database: LineDatabase = DATABASE) -> None:
        self.code, self.database, self.clock = code, database, Clock()
        self.kept = Kept()
        self.triggers: list[str] = []
        self.stored: list[tuple[str, Outcome]] = []
        self.starts: list[tuple[int, ErrorCode | None]] = []
        self.held: tuple[int, Outcome] | None = None
        self.plan: dict[str, str] = {}
        self.broken = False
        self.lost = lambda: False
        self.deaf = False
        self.log: list[tuple[str, can.Message]] = []
        self._way: deque[list[can.Message]] = deque([[], []])
        self.plc: PagePlc | None = None
        self.line: StationLine | None = None
        self._bus: LineBus | None = None
        self._cycle: tuple[Trigger, float] | None = None
        self._due_s = self.clock.now
        self.power_station()
        self.power_plc()

    def power_station(self) -> None:
        self.off_station()
        self._fake = FakeCanBus()
        self._bus = LineBus(lambda: self._fake)
        self.line = StationLine(self._bus, self.database, self.clock)
        self._cycle = None
        if self.held is None:
            self.idle()
        else:
            sequence, outcome = self.held
            self.line.restore_results(sequence, self.answers(outcome))

    def off_station(self) -> None:
        if self.line is not None and self._bus is not None:
            self.line.close()
            self._bus.close()
        self.line = None

    def power_plc(self) -> None:
        waiting = list(VINS[: 0 if self.plc is None else len(VINS)])
        waiting = [vin for vin in waiting if vin not in self.kept.vehicles.values()]
        self.plc = PagePlc(self.code, self.to_station, self.kept, self.clock.now)
        self.plc.waiting = waiting

    def answers(self, outcome: Outcome) -> list[WheelAnswer]:
        values = (-0.5, 0.1, 0.001, 0.002) if outcome.judged else (None,) * 4
        return [WheelAnswer(wheel, outcome, *values) for wheel in self.database.wheels]

    def idle(self) -> None:
        assert self.line is not None
        self.line.publish(StationStatus(StationState.IDLE))

    def to_station(self, identifier: int, data: bytes) -> None:
        frame = can.Message(arbitration_id=identifier, is_extended_id=False, data=data)
        self.log.append(("P->>S", frame))
        if self.line is not None and not self.deaf and not self.lost():
            self.line.receive(frame)

    def step(self) -> None:
        """One scan of both sides."""
        self.clock.now += SCAN_S
        if self.line is not None:
            self._serve(self.line)
            if self.clock.now >= self._due_s:
                self.line.tick()
                self._due_s = self.clock.now + STATUS_S - SCAN_S / 2
            # Frames take two scans, as a controller reads them once in each.
            self.log += [("S->>P", frame) for frame in self._fake.sent]
            self._way.append(self._fake.sent)
            self._fake.sent = []
            for frame in self._way.popleft():
                if self.plc is not None and not self.lost():
                    self.plc.receive(frame.arbitration_id, bytes(frame.data))
        if self.plc is not None:
            self.plc.scan(self.clock.now)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / SCAN_S)):
            self.step()

    def _serve(self, line: StationLine) -> None:
        """The measuring cycle, of which nothing but its timing and its answers is played."""
        if self._cycle is not None and self.clock.now >= self._cycle[1]:
            self._end(line, self._cycle[0], Outcome.OK)
        match line.next_command(0.0):
            case Trigger() as trigger:
                self.triggers.append(trigger.vin)
                self._start(line, trigger)
            case Abort() as abort if self._cycle is not None and abort.sequence == self._cycle[0].sequence:
                self._end(line, self._cycle[0], Outcome.ABORTED)
            case Acknowledge() as acknowledge:
                assert self.held is not None
                assert acknowledge.sequence == self.held[0]
                self.held = None
                self.idle()
            case Reset():
                self._cycle = self.held = None
                if self.broken:
                    line.publish(StationStatus(StationState.FAULT, ErrorCode.CAMERA_FAULT))
                else:
                    self.idle()

    def _start(self, line: StationLine, trigger: Trigger) -> None:
        plan = self.plan.pop(trigger.vin, "measure")
        self.starts.append((trigger.sequence, None))
        if plan == "unknown type":
            line.refuse(trigger.sequence, ErrorCode.UNKNOWN_VEHICLE_TYPE)
        elif plan == "fault":
            line.publish(StationStatus(StationState.FAULT, ErrorCode.CAMERA_FAULT))
        else:
            lasts_s = CYCLE_S if plan == "measure" else 1e9
            self._cycle = trigger, self.clock.now + lasts_s
            line.publish(StationStatus(StationState.MEASURING))

    def _end(self, line: StationLine, trigger: Trigger, outcome: Outcome) -> None:
        self._cycle = None
        self.stored.append((trigger.vin, outcome))
        self.held = trigger.sequence, outcome
        line.publish(StationStatus(StationState.REPORTING))
        line.send_results(trigger.sequence, self.answers(outcome))

    def judge(self) -> None:
        """Whatever happened: no verdict that the station did not store, none lost, and all at rest."""
        assert self.plc is not None
        assert self.plc.plc.Step == "ready"
        assert self.held is None
        told = [(vin, outcome) for vin, _, outcome in self.kept.results]
        assert set(told) == {(vin, str(outcome)) for vin, outcome in self.stored}
        for vin in self.kept.vehicles.values():
            named = [kept[0] for kept in (*self.kept.results, *self.kept.not_measured)]
            assert vin in named, f"{vin} was started, and nobody said what became of it"


@pytest.fixture
def world(code: PageCode) -> Iterator[World]:
    world = World(code)
    yield world
    world.off_station()


def test_vehicle_after_vehicle_from_power_up(world: World) -> None:
    assert world.plc is not None
    world.plc.waiting += VINS
    world.run(5.0)
    assert [(vin, outcome) for vin, _, outcome in world.kept.results] == [(vin, "ok") for vin in VINS]
    assert world.kept.not_measured == []
    assert list(world.kept.vehicles) == [1, 2, 3]
    world.judge()


def test_numbers_go_from_255_to_1(world: World) -> None:
    assert world.plc is not None
    world.run(1.0)
    world.plc.plc.Number = 254
    world.plc.waiting += VINS[:2]
    world.run(4.0)
    assert list(world.kept.vehicles) == [255, 1]
    world.judge()


def test_powered_up_before_the_station(world: World) -> None:
    assert world.plc is not None
    world.off_station()
    world.plc.waiting.append(VIN)
    world.run(2.0)
    assert world.plc.plc.Step == "power_up"
    world.power_station()
    world.run(3.0)
    world.judge()
    assert len(world.kept.results) == 1


def test_station_that_is_still_starting_gets_no_start_and_no_reset(world: World) -> None:
    assert world.plc is not None
    world.off_station()
    world.power_station()
    assert world.line is not None
    world.line._handshake.__init__()  # type: ignore[misc]
    world.line.publish(StationStatus(StationState.FAULT, ErrorCode.STARTING))
    world.line._handshake.__init__()  # type: ignore[misc]
    world.plc.waiting.append(VIN)
    world.run(30.0)
    assert world.plc.plc.Step == "power_up"
    assert world.line.status.handshake == "starting"
    world.idle()
    world.run(3.0)
    assert [outcome for _, _, outcome in world.kept.results] == ["ok"]


@pytest.mark.parametrize("vin", ["WVWZZZ1KZAO123456", VIN])
def test_refused_start_is_reported_once_and_the_next_vehicle_is_measured(world: World, vin: str) -> None:
    """Of an invalid VIN at once, by the cycle after it was accepted; and the number is not used again."""
    assert world.plc is not None
    world.plan[VIN] = "unknown type"
    world.plc.waiting += [vin, VINS[1]]
    world.run(5.0)
    [(refused, number, why)] = world.kept.not_measured
    assert (refused, why) == (vin, "unknown_vehicle_type" if vin == VIN else "vin_invalid")
    assert [(v, outcome) for v, _, outcome in world.kept.results] == [(VINS[1], "ok")]
    assert number not in [kept for _, kept, _ in world.kept.results]
    assert world.triggers.count(VIN) <= 1
    world.judge()


def test_restart_after_a_refused_start_does_not_take_the_old_refusal_for_an_answer(world: World) -> None:
    """`Status.Sequence` stays at the number before, and `CommandAnswer` shows the refused one."""
    assert world.plc is not None
    world.plc.waiting.append("WVWZZZ1KZAO123456")
    world.run(2.0)
    assert len(world.kept.not_measured) == 1
    world.power_plc()
    world.plc.waiting[:] = [VINS[1]]
    world.run(3.0)
    assert len(world.kept.not_measured) == 1
    assert [(vin, outcome) for vin, _, outcome in world.kept.results] == [(VINS[1], "ok")]


def test_number_after_a_restart_is_neither_the_last_start_s_nor_the_last_answer_s(world: World) -> None:
    assert world.plc is not None
    world.plc.waiting += [VIN, "WVWZZZ1KZAO123456"]
    world.run(4.0)
    assert (list(world.kept.vehicles), world.line and world.line.status.sequence) == ([1, 2], 1)
    world.power_plc()
    world.plc.waiting[:] = [VINS[1]]
    world.run(3.0)
    assert world.kept.results[-1] == (VINS[1], 3, "ok")


def test_controller_of_interface_2_is_told_why_no_vehicle_is_measured(world: World) -> None:
    """Its bits of the interface are 0. It got results of which it read only those that it knew."""
    assert world.plc is not None
    assert world.plc.interface == 3
    world.plc.interface = 0
    world.plc.waiting += VINS[:2]
    world.run(5.0)
    assert [why for _, _, why in world.kept.not_measured] == ["wrong_interface"] * 2
    assert world.kept.results == []
    assert world.triggers == []


def test_start_that_the_station_does_not_hear(world: World) -> None:
    assert world.plc is not None
    world.run(1.0)
    world.deaf = True
    world.plc.waiting += VINS[:2]
    world.run(3.0)
    assert world.kept.not_measured == [(VIN, 1, "communication_lost")]
    assert world.plc.plc.Step == "power_up"
    world.deaf = False
    world.run(3.0)
    assert [(vin, outcome) for vin, _, outcome in world.kept.results] == [(VINS[1], "ok")]
    world.judge()


def test_station_restarts_amid_a_cycle_before_its_silence_is_noticed(world: World) -> None:
    assert world.plc is not None
    world.plan[VIN] = "hang"
    world.plc.waiting += VINS[:2]
    world.run(3.0)
    assert world.plc.plc.Step == "waiting"
    world.power_station()
    world.run(6.0)
    assert [kept[0] for kept in world.kept.not_measured] == [VIN]
    assert [(vin, outcome) for vin, _, outcome in world.kept.results] == [(VINS[1], "ok")]
    world.judge()


def test_controller_restarts_amid_a_cycle_that_does_not_end(world: World) -> None:
    assert world.plc is not None
    world.plan[VIN] = "hang"
    world.plc.waiting.append(VIN)
    world.run(3.0)
    world.power_plc()
    world.plc.waiting.clear()
    world.run(53.0)
    assert [(vin, outcome) for vin, _, outcome in world.kept.results] == [(VIN, "aborted")]
    world.judge()


def test_fault_is_not_measured_and_a_reset_goes_on(world: World) -> None:
    assert world.plc is not None
    world.plan[VIN] = "fault"
    world.broken = True
    world.plc.waiting += VINS[:2]
    world.run(8.0)
    assert [kept[0::2] for kept in world.kept.not_measured] == [(VIN, "camera_fault")]
    assert world.plc.plc.Step == "power_up"
    world.run(25.0)
    assert world.plc.plc.Step in ("power_up", "resetting"), "a fault that stays does not become ready"
    world.broken = False
    world.plc.plc.ResetAsked = True
    world.run(5.0)
    assert [(vin, outcome) for vin, _, outcome in world.kept.results] == [(VINS[1], "ok")]
    world.judge()


def test_cycle_that_does_not_end_is_aborted_after_the_page_s_time(world: World) -> None:
    assert world.plc is not None
    world.plan[VIN] = "hang"
    world.plc.waiting += VINS[:2]
    world.run(48.0)
    assert world.kept.not_measured == []
    world.run(8.0)
    assert [kept[0] for kept in world.kept.not_measured] == [VIN]
    told = [(vin, outcome) for vin, _, outcome in world.kept.results]
    assert told == [(VIN, "aborted"), (VINS[1], "ok")]
    world.judge()


@pytest.mark.parametrize("away_s", [0.04, 1.0])
def test_controller_restarts_at_any_moment_of_a_cycle(code: PageCode, away_s: float) -> None:
    for moment in range(4, 80, 5 if away_s < 1 else 7):
        world = World(code)
        assert world.plc is not None
        world.run(0.4)
        world.plc.waiting.append(VIN)
        world.run(moment * SCAN_S)
        world.plc = None
        world.run(away_s)
        world.power_plc()
        assert world.plc is not None
        world.plc.waiting[:] = [vin for vin in (VIN, VINS[1]) if vin not in world.kept.vehicles.values()]
        world.run(4.0)
        missing = set(world.kept.vehicles.values()) - {kept[0] for kept in world.kept.results}
        # A start that the restart cut short before the station took it: the page says not measured.
        assert missing <= {VIN} - set(world.triggers), moment
        assert world.triggers.count(VIN) <= 1, moment
        assert (VINS[1], "ok") in [(vin, outcome) for vin, _, outcome in world.kept.results], moment
        world.kept.not_measured += [(vin, 0, "restart") for vin in missing]
        world.judge()
        world.off_station()


def test_station_restarts_at_any_moment_of_a_cycle(code: PageCode) -> None:
    """What was stored is offered again and taken over; what was not is not measured."""
    for moment in range(2, 80, 7):
        world = World(code)
        assert world.plc is not None
        world.run(0.4)
        world.plc.waiting += VINS[:2]
        world.run(moment * SCAN_S)
        world.off_station()
        world.run(1.0)
        world.power_station()
        world.run(6.0)
        assert world.triggers.count(VIN) <= 1, moment
        world.judge()
        world.off_station()


@pytest.mark.parametrize("seed", range(3))
def test_frames_that_get_lost_lose_no_vehicle(code: PageCode, seed: int) -> None:
    world = World(code)
    assert world.plc is not None
    lottery = random.Random(seed)
    world.lost = lambda: lottery.random() < 0.15
    world.plc.waiting += VINS
    world.run(12.0)
    world.lost = lambda: False
    world.run(3.0)
    measured = [vin for vin, _, _ in world.kept.results]
    assert set(measured) | {vin for vin, _, _ in world.kept.not_measured} == set(VINS)
    assert all(world.triggers.count(vin) <= 1 for vin in VINS)
    world.judge()
    world.off_station()


def test_controller_of_the_page_on_a_bus_beside_a_station_with_its_threads(
    code: PageCode, station_bus: LineBus, plc_bus: LineBus
) -> None:
    frames: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
    kept = Kept()

    def send(identifier: int, data: bytes) -> None:
        plc_bus.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data))

    plc_bus.listen(frames.put)
    with SmallStation(StationLine(station_bus, DATABASE)):
        plc = PagePlc(code, send, kept, time.monotonic())
        plc.waiting += VINS[:2]
        deadline = time.monotonic() + 2 * WAIT_S
        while time.monotonic() < deadline and not (len(kept.results) == 2 and plc.plc.Step == "ready"):
            with contextlib.suppress(queue.Empty):
                frame = frames.get(timeout=0.01)
                plc.receive(frame.arbitration_id, bytes(frame.data))
            plc.scan(time.monotonic())
    assert [(vin, outcome) for vin, _, outcome in kept.results] == [(vin, "ok") for vin in VINS[:2]]
    assert kept.not_measured == []


def test_every_name_of_the_steps_is_explained() -> None:
    explained = {name for cells in rows("name | what") for name in re.findall(r"`(\w+)`", cells[0])}
    used = names_of("\n".join(snippets(PAGE, "iecst")))
    assert used - {"NextNumber", "LongestCycle"} == explained


def shows(frame: can.Message, part: str) -> bool:
    """Whether a frame is what a part of an arrow's text says, such as ``Status Busy (n)``."""
    name, *words = part.replace("(n)", "").replace("…", "").split()
    values = DATABASE.decode(frame)
    if not (DATABASE.name_of(frame) or "").startswith(name) or ("(n)" in part and not values_number(values)):
        return False
    for word in set(words) - {"each", "wheel", "axle", "gone)"}:
        if word.startswith("("):
            if values[word[1:]] != 0:
                return False
        elif word in values:
            if values[word] != 1:
                return False
        elif word not in (values.get("Code"), values.get("Answer")):
            return False
    return True


def values_number(values: dict[str, Value]) -> bool:
    return values.get("Sequence", values.get("SequenceLow")) == 1


def test_drawn_cycle_is_what_goes_over_the_bus(world: World) -> None:
    """Every arrow of the drawing is a frame, and they come in the order of the drawing."""
    assert world.plc is not None
    drawing = next(text for text in snippets(PAGE, "mermaid") if text.startswith("sequenceDiagram"))
    arrows = re.findall(r"^ +(\S->>\S): (.*)$", drawing, re.MULTILINE)
    assert len(arrows) == 16
    world.run(1.0)
    world.plc.waiting.append(VIN)
    world.run(2.0)
    frames = iter(world.log)
    for way, text in arrows:
        for part in re.sub(r", each \w+", "", text).split(", "):
            full = part if "(" in part or "(n)" not in text else f"{part} (n)"
            found = any(way == direction and shows(frame, full) for direction, frame in frames)
            assert found, f"no {full} ({way}) after what is drawn before it"


def test_drawn_sweep_is_what_goes_over_the_bus() -> None:
    """What the station sends comes in the order of the drawing; the controller's messages exist."""
    drawing = snippets(PAGE, "mermaid")[-1]
    arrows = re.findall(r"^ +(\S)->>\S: (.*)$", drawing, re.MULTILINE)
    assert len(arrows) == 8
    options = LineOptions(communication_timeout_s=1.5, modes=SERVED_MODES)
    with (
        simulated_station(DATABASE, 0.02, options) as settings,
        open_bus(settings) as bus,
        PlcSimulator(bus, DATABASE) as plc,
    ):
        plc.connect()
        plc.teller.steering = SteeringWheel(0.0)
        received = iter(plc.run(PlcOrder(VIN, mode=Mode.SWEEP)).received)
    for sender, text in arrows:
        for part in text.split(", "):
            name, *words = part.replace("(n)", "").split()
            if name == "results":
                continue
            message = next(m for m in DATABASE.definition.messages if m.name == name)
            assert message.senders == [{"P": "PLC", "S": "STATION"}[sender]]
            if sender == "S" and (wanted := [w for w in words if w.isalpha() and w in SHOWN]):
                found = any(
                    m.name == name and set(wanted) <= {*map(str, m.values.values())} for m in received
                )
                assert found, f"no {part} after what is drawn before it"


SHOWN = {"accepted", "sweeping", "turning", "hold", "turn", "done", "busy"}


def cells_of_the_handshake() -> list[tuple[str, str, str]]:
    head = re.search(r"^\| state \| (prepare.*) \|$", TEXT, re.MULTILINE)
    assert head is not None
    columns = head[1].split(" | ")
    table = rows("state | prepare")
    return [(r[0].strip("*"), c, cell) for r in table for c, cell in zip(columns, r[1:], strict=True)]


@pytest.mark.parametrize(("state", "request_", "cell"), cells_of_the_handshake())
def test_command_does_in_a_state_what_the_page_says(state: str, request_: str, cell: str) -> None:
    handshake = Handshake()
    handshake.asked(Asked(CommandCode.NONE, 0))
    handshake.state, handshake.sequence, handshake._start, handshake._next = HandshakeState(state), 5, 5, 3
    code, _, number = request_.partition(", ")
    position = {"next position": 3, "position taken before": 2}.get(number, 0)
    own = number == "same number" or position > 0
    wheels = ("front_left",)
    handshake.asked(Asked(CommandCode(code), 5 if own else 6, wheels, vin=VIN, position=position))
    refusal = handshake.reply.refusal
    if cell.startswith("→"):
        assert (handshake.state, refusal) == (cell[2:], ErrorCode.NONE)
    else:
        assert handshake.state == state
        assert cell == ("*harmless*" if refusal is ErrorCode.NONE else f"`{refusal}`")


def test_drawn_states_are_left_as_drawn() -> None:
    drawing = next(text for text in snippets(PAGE, "mermaid") if text.startswith("stateDiagram"))
    edges = re.findall(r"^ +(\w+) --> (\w+): (.*)$", drawing, re.MULTILINE)
    commands = {
        (s, c.partition(",")[0]): cell[2:] for s, c, cell in cells_of_the_handshake() if cell[0] == "→"
    }
    drawn = set()
    for source, target, words in edges:
        for word in words.split(", "):
            drawn.add((source, word))
            if word in set(Event):
                handshake = Handshake()
                handshake.state = HandshakeState(source)
                handshake.happened(Event(word))
                assert handshake.state == target, (source, word)
            elif word in ("start to adjust", "start to sweep"):
                assert target == {"adjust": "adjusting", "sweep": "sweeping"}[word.rpartition(" ")[2]]
                assert (source, "start") in commands
            else:
                assert commands.get((source, word)) == target, (source, word)
    assert {(s, c) for (s, c), target in commands.items() if target != s} <= drawn


@pytest.mark.parametrize(
    "text", ["IF a THEN b := 1;", "a := 1", "CASE a OF END_IF;", "a b;", "a := ?;", "END_IF;", "IF a b := 1;"]
)
def test_structured_text_with_a_mistake_is_not_run(text: str) -> None:
    with pytest.raises(SyntaxError):
        translated(text)
