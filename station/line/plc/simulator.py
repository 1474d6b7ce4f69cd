"""A simulated line controller: sends VIN and commands, waits for the results, takes them over.

It behaves as a careful PLC program would: its Command goes out cyclically, every wait is bounded, a silent
station is noticed, frames count only with good CRC and counter, results only when ResultValid is shown with
the right sequence, and they must be complete and free of contradiction. A command stands until the station
has answered it; when the station is lost, it is withdrawn.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from os import PathLike
from types import TracebackType
from typing import Self

import can

from alignment.errors import InputError, LineConnectionError, LineError
from station.cycle import ErrorCode, Mode, WheelAnswer
from station.line.plc.orders import (
    DEFAULT_TIMEOUTS,
    PlcOrder,
    PlcResult,
    PlcTimeouts,
    first_shown,
)
from station.line.plc.results import missing_results, read_results
from station.line.plc.station_view import StationView
from station.line.plc.sweeping import turn_steering
from station.line.plc.teller import VehicleTeller
from station.line.wire import (
    INTERFACE_MAJOR,
    VIN_LENGTH,
    Answer,
    BusSettings,
    CommandAnswer,
    CommandCode,
    HandshakeState,
    LineBus,
    LineDatabase,
    LineStatus,
    LinkHealth,
    ProtectedLink,
    Spoil,
    Value,
    VehicleReport,
    checked_vin,
    load_line_database,
    open_bus,
)
from station.threads import SupervisedThread

COMMAND_PERIOD_S = 0.1
KeepResult = Callable[[int, VehicleReport, tuple[WheelAnswer, ...]], None]
# Goes out between vehicles, so that the counters of the VIN's frames stay in step.
_NO_VIN = "\0" * VIN_LENGTH
# Refusals that pass while the command stands.
_PASSING = frozenset({ErrorCode.VIN_INCOMPLETE, ErrorCode.STARTING})


@dataclass(frozen=True)
class _Standing:
    """The command that stands on the bus."""

    code: CommandCode = CommandCode.NONE
    sequence: int = 0
    wheels: tuple[str, ...] = ()
    vehicle_type: int = 0
    mode: Mode = Mode.AUTOMATIC
    vin: str | None = None


class PlcSimulator:
    """The controller's end of the bus.

    Parameters
    ----------
    bus
        Its own open bus; it stays open when this object closes.
    database
        The checked DBC.
    clock
        Monotonic seconds.
    timeouts
        Bounds of all waits.
    sequence
        The number before the first one it will use.
    keep
        Called with every result before it is acknowledged: what it keeps survives the controller's end.

    As a context it sends its Command cyclically in a supervised thread; without it call `tick`.

    Attributes
    ----------
    view
        What it knows of the station.
    teller
        What it tells of the vehicle: nothing, unless somebody lets it.
    spoil
        What is wrong with the frames that it sends; None for good frames. For tests of a station.
    interface
        Major version of the interface that it says it speaks. For tests of a station.
    paused
        True lets the cyclic Command cease, as a controller does that has lost its power.
    """

    def __init__(
        self,
        bus: LineBus,
        database: LineDatabase,
        clock: Callable[[], float] = time.monotonic,
        timeouts: PlcTimeouts = DEFAULT_TIMEOUTS,
        sequence: int = 0,
        keep: KeepResult = lambda sequence, vehicle, wheels: None,
    ) -> None:
        self._keep = keep
        self._bus = bus
        self._database = database
        self.clock = clock
        self.timeouts = timeouts
        self._sequence = sequence
        self._link = ProtectedLink(bus, database, clock)
        self.view = StationView(self._link, clock)
        self.teller = VehicleTeller(database)
        self.spoil: Spoil | None = None
        self.interface = INTERFACE_MAJOR
        self.paused = False
        self._standing = _Standing()
        self._sending = threading.RLock()
        self._heartbeat = 0
        self._vin_due_s = clock()
        period_s = database.cycle_time_s("Command") or COMMAND_PERIOD_S
        self._cyclic = SupervisedThread("line plc", lambda stopping: self._cyclic_step(stopping, period_s))
        bus.listen(self.view.receive)

    def start(self) -> Self:
        """Begin the cyclic Command; the first one goes out at once."""
        self.tick()
        self._cyclic.start()
        return self

    def close(self) -> None:
        """Take back what was told of the vehicle, end the cyclic Command, stop listening; harmless twice."""
        self._bus.unlisten(self.view.receive)
        self._cyclic.stop()
        self.teller.forget()
        if self.teller.telling and not self.paused:
            self._send_standing()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def status(self) -> LineStatus | None:
        """The last good Status."""
        return self.view.status

    @property
    def link_health(self) -> LinkHealth:
        """Frames of the station that counted and that did not."""
        return self._link.health

    @property
    def next_sequence(self) -> int:
        """The number that the next command of its own will have: 1 to 255, and again."""
        return self._sequence % 255 + 1

    def tick(self) -> None:
        """Send the standing command once; withdraw it when the station is lost."""
        if self.paused:
            return
        if self.view.lose_when_silent(self.timeouts.silence_s):
            with self._sending:
                self._standing = _Standing()
        self._send_standing()

    def connect(self) -> LineStatus:
        """Wait until the station is heard, hears this controller and has started.

        Raises
        ------
        LineTimeoutError
            When it does not come in time.
        """

        def heard(status: LineStatus) -> bool:
            answer = self.view.answer
            return answer is not None and answer.link_up

        def started(status: LineStatus) -> bool:
            return heard(status) and status.handshake is not HandshakeState.STARTING

        what = "a station that hears the controller"
        self.view.wait(what, self.timeouts.connect_s, heard, patient=True)
        return self.view.wait("a station that has started", self.timeouts.starting_s, started, patient=True)

    def start_up(self) -> PlcResult | None:
        """What a controller does first: take over results that wait, and reset a station that is not ready.

        Returns
        -------
        The results that the station held from before, or None.

        Raises
        ------
        LineTimeoutError, LineError
            As `run`.
        """
        status = self.connect()
        # Go on where the controller before this one was; an answer to its number would be taken for ours.
        self._sequence = self._sequence or status.sequence
        taken = None
        if status.busy or status.done:
            self.view.record()
            taken = self.finish(None, status.sequence, self.clock())
        status = self.status or status
        if not status.takes_start and not status.busy:
            self.reset()
        return taken

    def reset(self) -> LineStatus:
        """Reset the station and wait until it is ready.

        Raises
        ------
        LineTimeoutError
            When the station is silent or does not become ready in time.
        """
        sequence = self.number()
        self.command(CommandCode.RESET, sequence)
        ready = self.view.wait(
            f"ready after reset {sequence}",
            self.timeouts.ready_s,
            lambda status: status.takes_start and status.sequence == sequence,
            patient=True,
        )
        self.withdraw(CommandCode.RESET, sequence)
        return ready

    def run(self, order: PlcOrder) -> PlcResult:
        """Measure one vehicle: wait for ready, start, wait for the results, read and acknowledge them.

        Raises
        ------
        InputError
            When the VIN has not 17 characters of ASCII or a wheel is unknown.
        LineTimeoutError
            When a wait runs out or the station is silent; names what was awaited and the last status.
        LineError
            When the station refuses the start or reports a fault, or the results are incomplete or
            contradictory.
        """
        sequence, started_s = self.begin(order)
        if order.mode is Mode.SWEEP:
            turn_steering(self, sequence)
        return self.finish(order, sequence, started_s)

    def begin(self, order: PlcOrder) -> tuple[int, float]:
        """Start one vehicle and wait for busy; number of the start and when it was sent. Raises as `run`."""
        checked_vin(order.vin)
        self._wheels(order)
        owed = order.mode is Mode.MASTER_CHECK
        self.view.wait("ready", self.timeouts.ready_s, lambda s: s.takes_start if owed else s.ready)
        sequence = self.number()
        self.view.record()
        started_s = self.clock()
        self.give(CommandCode.START, order, sequence)
        self._wait_in_cycle("busy", self.timeouts.busy_s, sequence, lambda s: s.busy or s.done)
        self.withdraw(CommandCode.START, sequence)
        return sequence, started_s

    def finish(self, order: PlcOrder | None, sequence: int, started_s: float) -> PlcResult:
        """Wait for the results of a start that was begun, read and acknowledge them. Raises as `run`."""
        self._wait_in_cycle("results", self.timeouts.done_s, sequence, lambda s: s.done)
        return self._take_over(order, sequence, started_s)

    def prepare(self, order: PlcOrder) -> None:
        """Announce the next vehicle.

        Raises
        ------
        LineTimeoutError, LineError
            When the station does not answer in time, or refuses.
        """
        sequence = self.number()
        self.give(CommandCode.PREPARE, order, sequence)
        self._answered(CommandCode.PREPARE, sequence)

    def stop(self, sequence: int) -> None:
        """End adjusting. Raises as `prepare`."""
        self.command(CommandCode.STOP, sequence)
        self._answered(CommandCode.STOP, sequence)

    def abort(self, sequence: int | None = None) -> None:
        """Abort a cycle; the last one started when no sequence is given. Raises as `prepare`."""
        sequence = self._sequence if sequence is None else sequence
        self.command(CommandCode.ABORT, sequence)
        self._answered(CommandCode.ABORT, sequence)

    def acknowledge(self, sequence: int) -> None:
        """Put the acknowledgement on the bus; it stands until another command or `withdraw`."""
        self.command(CommandCode.ACKNOWLEDGE, sequence)

    def give(self, code: CommandCode, order: PlcOrder, sequence: int) -> None:
        """Put prepare or start of an order on the bus, its VIN before; it stands until `withdraw`."""
        wheels = self._wheels(order)
        # The counter of these frames is known by the time of the first step.
        self.teller.sweeping |= order.mode is Mode.SWEEP
        self._put(_Standing(code, sequence, wheels, order.vehicle_type, order.mode, checked_vin(order.vin)))

    def command(self, code: CommandCode, sequence: int) -> None:
        """Put another command on the bus; it stands until `withdraw`."""
        self._put(_Standing(code, sequence))

    def withdraw(self, code: CommandCode | None = None, sequence: int = 0) -> None:
        """Go back to none; with a command's code and number only if it is that one that stands.

        Another thread may have put its own on the bus meanwhile, an abort amid a cycle for one.
        """
        with self._sending:
            standing = self._standing
            if code is None or (standing.code, standing.sequence) == (code, sequence):
                self._put(replace(standing, code=CommandCode.NONE, vin=None))

    def number(self) -> int:
        """Take the next number for a command."""
        self._sequence = self.next_sequence
        return self._sequence

    def answer_to(self, code: CommandCode, sequence: int) -> CommandAnswer:
        """Wait for the final answer to a command that stands on the bus.

        Raises
        ------
        LineTimeoutError
            When there is none in time.
        """
        found: list[CommandAnswer] = []

        def answered(status: LineStatus) -> bool:
            answer = self.view.answer_to(code, sequence)
            if answer is None:
                return False
            found.append(answer)
            return answer.answer is Answer.ACCEPTED or answer.error_code not in _PASSING

        self.view.wait(f"an answer to {code} {sequence}", self.timeouts.busy_s, answered)
        return found[-1]

    def _answered(self, code: CommandCode, sequence: int) -> None:
        found = self.answer_to(code, sequence)
        self.withdraw(code, sequence)
        if found.answer is Answer.REFUSED:
            raise LineError(f"the station refused {code} at sequence {sequence}: {found.error_code}")

    def _wheels(self, order: PlcOrder) -> tuple[str, ...]:
        wheels = tuple(self._database.wheels) if order.wheels is None else order.wheels
        if unknown := set(wheels) - set(self._database.wheels):
            raise InputError(
                field="wheels",
                expected=f"wheels of {', '.join(self._database.wheels)}",
                seen=", ".join(sorted(unknown)),
            )
        return wheels

    def _put(self, standing: _Standing) -> None:
        if standing.code is not CommandCode.NONE:
            self.view.forget_answer(standing.code, standing.sequence)
        with self._sending:
            self._standing = standing
            self._send_standing()

    def _send_standing(self) -> None:
        with self._sending:
            standing = self._standing
            now = self.clock()
            if standing.vin is not None or now >= self._vin_due_s:
                for frame in self._vin_frames(standing.vin or _NO_VIN, standing.sequence):
                    self._send(frame)
                self._vin_due_s = now + (self._database.cycle_time_s("Vin1") or 0.0)
            for frame in self.teller.frames():
                self._send(frame)
            bits = {f"Wheel{e}": int(name in standing.wheels) for name, e in self._database.wheels.items()}
            values: dict[str, Value] = {
                "Code": str(standing.code),
                "Sequence": standing.sequence,
                "Mode": str(standing.mode),
                "VehicleType": standing.vehicle_type,
                "Heartbeat": self._heartbeat,
                "InterfaceMajor": self.interface,
                **bits,
            }
            self._send(self._database.encode("Command", values))
            self._heartbeat = (self._heartbeat + 1) % 256

    def _vin_frames(self, vin: str, sequence: int) -> Iterator[can.Message]:
        for message, signals in self._database.vin_messages.items():
            characters: dict[str, Value] = {name: ord(vin[int(name[3:]) - 1]) for name in signals}
            yield self._database.encode(message, {"SequenceLow": sequence % 16, **characters})

    def _send(self, frame: can.Message) -> None:
        # What stands is sent again; the health of the bus counts the failure.
        with contextlib.suppress(LineConnectionError):
            self._link.send(frame, self.spoil)

    def _cyclic_step(self, stopping: threading.Event, period_s: float) -> None:
        if not stopping.wait(period_s):
            self.tick()

    def _wait_in_cycle(
        self, what: str, timeout_s: float, sequence: int, reached: Callable[[LineStatus], bool]
    ) -> None:
        def refusal() -> ErrorCode | None:
            found = self.view.answer_to(CommandCode.START, sequence)
            if found is None or found.answer is not Answer.REFUSED:
                return None
            return None if found.error_code in _PASSING else found.error_code

        def reached_or_failed(status: LineStatus) -> bool:
            return (status.sequence == sequence and reached(status)) or failed(status)

        def failed(status: LineStatus) -> bool:
            ended = status.sequence == sequence and not status.busy and not status.done
            return status.fault or (refusal() is not None and (ended or status.sequence != sequence))

        status = self.view.wait(f"{what} of sequence {sequence}", timeout_s, reached_or_failed)
        if failed(status):
            self.withdraw(CommandCode.START, sequence)
            if status.fault:
                raise LineError(
                    f"the station reports a fault at sequence {sequence}: {status.error_code} ({status})"
                )
            raise LineError(f"the station refused at sequence {sequence}: {refusal()} ({status})")

    def _take_over(self, order: PlcOrder | None, sequence: int, started_s: float) -> PlcResult:
        # Results are sent again while they are held, so one that was lost comes.
        self.view.wait_until(
            self.timeouts.acknowledged_s,
            lambda: not missing_results(self._database, self.view.results, sequence),
        )
        vehicle, wheels, axles = read_results(self._database, self.view.results, sequence)
        # What was taken over is safe before the station may forget it.
        self._keep(sequence, vehicle, wheels)
        self.acknowledge(sequence)
        self.view.wait(
            f"the end of ResultValid after acknowledge {sequence}",
            self.timeouts.acknowledged_s,
            lambda status: not status.done,
        )
        acknowledged_s = self.clock()
        self.withdraw(CommandCode.ACKNOWLEDGE, sequence)
        received = self.view.recorded()
        return PlcResult(
            order=order,
            sequence=sequence,
            vehicle=vehicle,
            wheels=wheels,
            axles=axles,
            started_s=started_s,
            busy_s=first_shown(received, sequence, ("Busy", "ResultValid"), started_s),
            done_s=first_shown(received, sequence, ("ResultValid",), started_s),
            acknowledged_s=acknowledged_s,
            received=received,
        )


def run_plc(
    settings: BusSettings,
    dbc: str | PathLike[str],
    orders: Iterable[PlcOrder],
    timeouts: PlcTimeouts = DEFAULT_TIMEOUTS,
) -> Iterator[PlcResult]:
    """Open a bus, wait for the station, and measure vehicle after vehicle; the bus closes with the iterator.

    Results that the station held from before come first; their order is None.

    Raises
    ------
    ConfigurationError
        When the DBC is not usable, the bus does not open, or the log cannot be written.
    LineError
        When a vehicle fails, see `PlcSimulator.run`.
    """
    database = load_line_database(dbc)
    with open_bus(settings) as bus, PlcSimulator(bus, database, timeouts=timeouts) as plc:
        taken = plc.start_up()
        if taken is not None:
            yield taken
        for order in orders:
            yield plc.run(order)
