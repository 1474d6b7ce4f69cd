"""The simulated controller against a small station on the virtual bus: the contract of the line."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import can
import pytest

from alignment.errors import ConfigurationError, InputError, LineError, LineTimeoutError
from station.cycle.words.cycle import (
    Abort,
    Acknowledge,
    AxleAnswer,
    ErrorCode,
    Mode,
    Outcome,
    Reset,
    StationState,
    StationStatus,
    Trigger,
    VehicleAnswer,
    WheelAnswer,
)
from station.cycle.words.master import MasterShown
from station.duty.words import MasterState
from station.line.interface import StationLine
from station.line.plc.orders import PlcOrder, PlcTimeouts
from station.line.plc.simulator import PlcSimulator, run_plc
from station.line.tools.monitor import decode_log, trace_cycles
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.channel import BusSettings
from station.line.wire.dbc import LineDatabase
from station.line.wire.messages import Answer, CommandCode, LineMaster
from station.line.wire.protection import protect
from tests.station.line.line_bench import DBC, VIN, WAIT_S

PATIENT = PlcTimeouts(ready_s=WAIT_S, busy_s=WAIT_S, done_s=WAIT_S, acknowledged_s=WAIT_S, silence_s=WAIT_S)


class SmallStation:
    """Answers triggers with prepared outcomes; what it does with a trigger can be replaced."""

    def __init__(self, line: StationLine) -> None:
        self.line = line
        self.triggers: list[Trigger] = []
        self.on_trigger: Callable[[Trigger], None] = self.measure
        self.on_acknowledge: Callable[[], None] = self.idle
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="line small station")

    def __enter__(self) -> SmallStation:
        self.line.start()
        self.idle()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopping.set()
        self._thread.join(WAIT_S)
        self.line.close()

    def idle(self) -> None:
        self.line.publish(StationStatus(StationState.IDLE))

    def measure(self, trigger: Trigger) -> None:
        for state in (StationState.MEASURING, StationState.EVALUATING, StationState.STORING):
            self.line.publish(StationStatus(state))
        self.line.publish(StationStatus(StationState.REPORTING))
        wheels = [WheelAnswer(w, Outcome.OK, -0.5, 0.1, 0.0008, 0.0009) for w in trigger.wheels]
        axles = [AxleAnswer("front", Outcome.OK, 0.2, 0.0, 0.0012, 0.0012)]
        self.line.send_results(trigger.sequence, wheels, axles, VehicleAnswer(Outcome.OK, 0.02, 0.001))

    def wait_for_abort(self, trigger: Trigger) -> None:
        self.line.publish(StationStatus(StationState.MEASURING))
        if self.line.next_command(WAIT_S) == Abort(trigger.sequence):
            aborted = [WheelAnswer(wheel, Outcome.ABORTED) for wheel in trigger.wheels]
            self.line.send_results(trigger.sequence, aborted)

    def _serve(self) -> None:
        while not self._stopping.is_set():
            match self.line.next_command(0.02):
                case Trigger() as trigger:
                    self.triggers.append(trigger)
                    self.on_trigger(trigger)
                case Acknowledge():
                    self.on_acknowledge()
                case Reset():
                    self.idle()


@pytest.fixture
def station(station_bus: LineBus, database: LineDatabase) -> Iterator[SmallStation]:
    with SmallStation(StationLine(station_bus, database)) as station:
        yield station


@pytest.fixture
def plc(plc_bus: LineBus, database: LineDatabase) -> Iterator[PlcSimulator]:
    with PlcSimulator(plc_bus, database, timeouts=PATIENT) as plc:
        yield plc


def test_vehicles_one_after_the_other(station: SmallStation, plc: PlcSimulator, station_bus: LineBus) -> None:
    station_bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False))  # another device on the bus
    assert plc.reset().ready
    orders = [PlcOrder(VIN, 7), PlcOrder("1FTFW1ET5DFC10312", 8, ("front_left", "rear_right"))]
    results = [plc.run(order) for order in orders]
    assert [t.vin for t in station.triggers] == [order.vin for order in orders]
    assert [t.vehicle_type for t in station.triggers] == [7, 8]
    assert station.triggers[1].wheels == ("front_left", "rear_right")
    first, second = results
    assert first.vehicle.outcome is Outcome.OK
    assert first.vehicle.thrust_angle_deg == pytest.approx(0.02)
    assert [wheel.outcome for wheel in first.wheels] == [Outcome.OK] * 4
    assert first.wheels[0].camber_deg == pytest.approx(-0.5)
    assert first.axles[0].total_toe_deg == pytest.approx(0.2)
    assert first.axles[1] == AxleAnswer("rear", Outcome.NOT_REQUESTED)
    assert [w.wheel for w in second.wheels if w.outcome is Outcome.OK] == ["front_left", "rear_right"]
    assert first.sequence + 1 == second.sequence
    for result in results:
        assert result.started_s <= result.busy_s <= result.done_s <= result.acknowledged_s
        names = [message.name for message in result.received]
        flags = [
            (message.values["Busy"], message.values["ResultValid"])
            for message in result.received
            if message.name == "Status" and message.values["Sequence"] == result.sequence
        ]
        assert flags[0] == (1, 0)
        assert (0, 1) in flags
        assert names.count("WheelResultFrontLeft") == 1


def test_sequence_numbers_wrap(station: SmallStation, plc_bus: LineBus, database: LineDatabase) -> None:
    with PlcSimulator(plc_bus, database, timeouts=PATIENT, sequence=253) as plc:
        plc.reset()
        assert [plc.run(PlcOrder(VIN)).sequence for _ in range(3)] == [255, 1, 2]


def test_log_shows_trigger_busy_results_done_in_order(
    tmp_path: Path, channel: str, database: LineDatabase
) -> None:
    file = tmp_path / "traffic.log"
    with (
        open_bus(BusSettings(channel=channel, log=file)) as bus,
        SmallStation(StationLine(bus, database)),
    ):
        orders = [PlcOrder(VIN), PlcOrder(VIN)]
        assert len(list(run_plc(BusSettings(channel=channel), DBC, orders))) == 2
    frames = list(decode_log(file, database))
    assert [f for f in frames if f.error] == []
    cycles = trace_cycles(frames)
    assert [cycle.in_order for cycle in cycles] == [True, True]
    assert all(cycle.acknowledged_s is not None for cycle in cycles)


def test_abort_amid_a_measurement(station: SmallStation, plc: PlcSimulator) -> None:
    station.on_trigger = station.wait_for_abort
    plc.reset()
    results = []
    thread = threading.Thread(target=lambda: results.append(plc.run(PlcOrder(VIN))))
    measuring = threading.Event()
    answer = station.on_trigger
    station.on_trigger = lambda trigger: (measuring.set(), answer(trigger))[1]
    thread.start()
    assert measuring.wait(WAIT_S)
    plc.abort()
    thread.join(WAIT_S)
    assert results[0].vehicle.outcome is Outcome.ABORTED
    assert {wheel.outcome for wheel in results[0].wheels} == {Outcome.ABORTED}


def test_the_end_of_a_start_leaves_an_abort_standing_that_came_meanwhile(
    plc_bus: LineBus, database: LineDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[can.Message] = []
    monkeypatch.setattr(plc_bus, "send", sent.append)
    plc = PlcSimulator(plc_bus, database)

    def standing() -> tuple[object, object]:
        plc.tick()
        values = database.decode(next(f for f in reversed(sent) if database.name_of(f) == "Command"))
        return values["Code"], values["Sequence"]

    plc.command(CommandCode.START, 3)
    plc.command(CommandCode.ABORT, 3)
    plc.withdraw(CommandCode.START, 3)
    assert standing() == (str(CommandCode.ABORT), 3)
    plc.withdraw(CommandCode.ABORT, 3)
    assert standing() == (str(CommandCode.NONE), 3)
    plc.close()


def test_an_answer_is_found_though_another_command_was_answered_since(
    station: SmallStation, plc: PlcSimulator
) -> None:
    plc.reset()
    for code, sequence in ((CommandCode.STOP, 7), (CommandCode.ABORT, 9)):
        plc.command(code, sequence)
        assert plc.view.wait_until(WAIT_S, lambda c=code, s=sequence: plc.view.answer_to(c, s) is not None)
    assert plc.answer_to(CommandCode.STOP, 7).answer is Answer.REFUSED
    # Before the same command is given again, its old answer goes.
    plc.view.forget_answer(CommandCode.STOP, 7)
    assert plc.view.answer_to(CommandCode.STOP, 7) is None


def test_silent_station(plc_bus: LineBus, database: LineDatabase) -> None:
    plc = PlcSimulator(plc_bus, database, timeouts=replace(PATIENT, ready_s=0.05))
    with pytest.raises(LineTimeoutError, match=r"expected ready.*last status: none"):
        plc.run(PlcOrder(VIN))


def test_station_that_stops_sending_counts_as_lost(
    station: SmallStation, plc_bus: LineBus, database: LineDatabase
) -> None:
    timeouts = replace(PATIENT, silence_s=1.0)
    with PlcSimulator(plc_bus, database, timeouts=timeouts) as plc:
        plc.reset()
        station.on_trigger = lambda trigger: station.line.close()
        with pytest.raises(LineTimeoutError, match="silent; last status: busy"):
            plc.run(PlcOrder(VIN))


def test_results_that_never_come(station: SmallStation, plc_bus: LineBus, database: LineDatabase) -> None:
    station.on_trigger = lambda trigger: None
    with PlcSimulator(plc_bus, database, timeouts=replace(PATIENT, done_s=0.1)) as plc:
        plc.reset()
        with pytest.raises(LineTimeoutError, match=r"expected results of sequence 2 .*busy, busy"):
            plc.run(PlcOrder(VIN))
        assert plc.status is not None
        assert plc.status.busy


def test_done_that_does_not_end(station: SmallStation, plc_bus: LineBus, database: LineDatabase) -> None:
    with PlcSimulator(plc_bus, database, timeouts=replace(PATIENT, acknowledged_s=0.3)) as plc:
        plc.reset()
        plc.acknowledge = lambda sequence: None  # type: ignore[method-assign]
        with pytest.raises(LineTimeoutError, match="end of ResultValid"):
            plc.run(PlcOrder(VIN))


def test_refused_vehicle_type(station: SmallStation, plc: PlcSimulator) -> None:
    station.on_trigger = lambda t: station.line.refuse(t.sequence, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    plc.reset()
    with pytest.raises(LineError, match="refused at sequence 2: unknown_vehicle_type"):
        plc.run(PlcOrder(VIN, 999))


def test_a_master_check_is_started_although_the_station_is_not_ready(
    station: SmallStation, plc_bus: LineBus, database: LineDatabase
) -> None:
    """A controller that waited for Ready could never have made it ready."""
    station.line.publish_master(MasterShown(MasterState.OVERDUE, 0, None, 2))
    with PlcSimulator(plc_bus, database, timeouts=PATIENT) as plc:
        assert plc.start_up() is None
        assert not plc.reset().ready
        plc.timeouts = replace(PATIENT, ready_s=0.3)
        with pytest.raises(LineTimeoutError, match="master_check_overdue"):
            plc.run(PlcOrder(VIN))
        plc.timeouts = PATIENT
        assert station.triggers == []
        assert plc.run(PlcOrder(VIN, mode=Mode.MASTER_CHECK)).vehicle.outcome is Outcome.OK
        said = LineMaster(MasterState.OVERDUE, 0, None, 2)
        # It comes every second.
        assert plc.view.wait_until(WAIT_S, lambda: plc.view.master == said)
        station.line.publish_master(MasterShown(MasterState.GOOD, 5))
        plc.view.wait("ready", WAIT_S, lambda status: status.ready)


def test_refused_vin(station: SmallStation, plc: PlcSimulator) -> None:
    plc.reset()
    with pytest.raises(LineError, match="vin_invalid"):
        plc.run(PlcOrder("wvwzzz1kzaw123456"))
    assert station.triggers == []


def test_fault_is_a_fault_and_a_reset_cures_it(station: SmallStation, plc: PlcSimulator) -> None:
    fault = StationStatus(StationState.FAULT, ErrorCode.CAMERA_FAULT)
    station.on_trigger = lambda trigger: station.line.publish(fault)
    plc.reset()
    with pytest.raises(LineError, match="reports a fault at sequence 2: camera_fault"):
        plc.run(PlcOrder(VIN))
    station.on_trigger = station.measure
    plc.reset()
    assert plc.run(PlcOrder(VIN)).vehicle.outcome is Outcome.OK


def test_lost_result_is_not_overlooked(
    station: SmallStation, plc: PlcSimulator, station_bus: LineBus, database: LineDatabase
) -> None:
    send = station_bus.send

    def losing(frame):  # type: ignore[no-untyped-def]
        if database.name_of(frame) != "WheelResultRearLeft":
            send(frame)

    station_bus.send = losing  # type: ignore[method-assign]
    plc.timeouts = replace(PATIENT, acknowledged_s=0.3)
    plc.reset()
    with pytest.raises(LineError, match="missing: WheelResultRearLeft"):
        plc.run(PlcOrder(VIN))


def test_ok_of_a_vehicle_whose_wheel_failed_is_not_believed(
    station: SmallStation, plc: PlcSimulator, station_bus: LineBus, database: LineDatabase
) -> None:
    send = station_bus.send

    def forging(frame):  # type: ignore[no-untyped-def]
        if database.name_of(frame) == "VehicleResult":
            frame.data[1] = 0x10 | frame.data[1] & 0x0F
            protect(frame.data, database.protected["VehicleResult"].data_id, frame.data[1] & 0x0F)
        send(frame)

    station_bus.send = forging  # type: ignore[method-assign]
    station.on_trigger = lambda trigger: station.line.send_results(
        trigger.sequence, [WheelAnswer(wheel, Outcome.FAULT) for wheel in trigger.wheels]
    )
    plc.reset()
    with pytest.raises(LineError, match="shown as ok, but its parts are fault"):
        plc.run(PlcOrder(VIN))


def test_orders_that_cannot_be_sent(station: SmallStation, plc: PlcSimulator) -> None:
    plc.reset()
    for vin in ("SHORT", VIN + "1", "WVWZZZ1KZAÄ123456"):
        with pytest.raises(InputError, match="17 characters"):
            plc.run(PlcOrder(vin))
    with pytest.raises(InputError, match="sixth_wheel"):
        plc.run(PlcOrder(VIN, wheels=("sixth_wheel",)))


def test_controller_without_a_dbc(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"absent\.dbc"):
        next(run_plc(BusSettings(), tmp_path / "absent.dbc", []))
