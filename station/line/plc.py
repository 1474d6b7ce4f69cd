"""A simulated line controller: sends VIN and start, waits for the results, takes them over.

It behaves as a careful PLC program would: every wait is bounded, a silent station is noticed, results count
only when done is shown with the right sequence, and they must be complete and free of contradiction.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from os import PathLike
from types import TracebackType
from typing import Self

import can

from alignment.errors import InputError, LineError, LineTimeoutError
from station.line.bus import BusSettings, LineBus, open_bus
from station.line.dbc import VIN_LENGTH, LineDatabase, Value, load_line_database
from station.line.messages import (
    AxleAnswer,
    LineErrorCode,
    LineStatus,
    Outcome,
    VehicleReport,
    WheelAnswer,
    overall_outcome,
)
from station.line.results import read_axle, read_status, read_vehicle, read_wheel


@dataclass(frozen=True)
class PlcOrder:
    """One vehicle to measure: its VIN, the number of its type, and the wheels; None means all of the line."""

    vin: str
    vehicle_type: int = 1
    wheels: tuple[str, ...] | None = None


@dataclass(frozen=True)
class PlcTimeouts:
    """How long the controller waits, seconds.

    Attributes
    ----------
    ready_s, busy_s, done_s, acknowledged_s
        For ready (also after a reset), for busy after start, for done after busy, for the end of done after
        the acknowledgement.
    silence_s
        Without any Status for so long, a station once heard counts as lost.
    """

    ready_s: float = 5.0
    busy_s: float = 1.0
    done_s: float = 60.0
    acknowledged_s: float = 2.0
    silence_s: float = 1.0


@dataclass(frozen=True)
class ReceivedMessage:
    """One message from the station: when (seconds of the controller's clock), its name, its signals."""

    time_s: float
    name: str
    values: dict[str, Value]


@dataclass(frozen=True)
class PlcResult:
    """Everything one vehicle brought.

    Attributes
    ----------
    order, sequence
        What was asked.
    vehicle
        Verdict of the vehicle and thrust angle.
    wheels, axles
        Of all wheels and axles of the line, also those not requested.
    started_s, busy_s, done_s, acknowledged_s
        When start was sent, busy and done were seen, and the end of done was seen after acknowledge.
    received
        All messages of the station from start to the end of done, in order.
    """

    order: PlcOrder
    sequence: int
    vehicle: VehicleReport
    wheels: tuple[WheelAnswer, ...]
    axles: tuple[AxleAnswer, ...]
    started_s: float
    busy_s: float
    done_s: float
    acknowledged_s: float
    received: tuple[ReceivedMessage, ...]


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
    """

    def __init__(
        self,
        bus: LineBus,
        database: LineDatabase,
        clock: Callable[[], float] = time.monotonic,
        timeouts: PlcTimeouts = PlcTimeouts(),
        sequence: int = 0,
    ) -> None:
        self._bus = bus
        self._database = database
        self._clock = clock
        self._timeouts = timeouts
        self._sequence = sequence
        self._changed = threading.Condition()
        self._status: LineStatus | None = None
        self._heard_s = clock()
        self._received: list[ReceivedMessage] = []
        self._recording = False
        self._results: dict[str, dict[str, Value]] = {}
        bus.listen(self._receive)

    def close(self) -> None:
        """Stop listening; harmless when closed."""
        self._bus.unlisten(self._receive)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def status(self) -> LineStatus | None:
        """The last Status received."""
        with self._changed:
            return self._status

    def reset(self) -> LineStatus:
        """Send reset and wait until the station is ready; a controller that starts does this first.

        Raises
        ------
        LineTimeoutError
            When the station is silent or does not become ready in time.
        """
        sequence = self._next_sequence()
        self._send_command("reset", sequence)
        ready = self._wait(
            f"ready after reset {sequence}",
            self._timeouts.ready_s,
            lambda status: status.ready and status.sequence == sequence,
        )
        return ready[0]

    def run(self, order: PlcOrder) -> PlcResult:
        """Measure one vehicle: wait for ready, start, wait for done, read the results, acknowledge.

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
        self._wait("ready", self._timeouts.ready_s, lambda status: status.ready)
        sequence = self._next_sequence()
        with self._changed:
            self._received.clear()
            self._recording = True
            self._results.clear()
        started_s = self._clock()
        self.send_vin(order.vin, sequence)
        self.send_start(order, sequence)
        self._wait_in_cycle("busy", self._timeouts.busy_s, sequence, lambda s: s.busy or s.done)
        self._wait_in_cycle("done", self._timeouts.done_s, sequence, lambda s: s.done)
        with self._changed:
            results = dict(self._results)
        vehicle, wheels, axles = self._read(results, sequence)
        self.acknowledge(sequence)
        _, acknowledged_s = self._wait(
            f"the end of done after acknowledge {sequence}",
            self._timeouts.acknowledged_s,
            lambda status: not status.done,
        )
        with self._changed:
            self._recording = False
            received = tuple(self._received)
        return PlcResult(
            order=order,
            sequence=sequence,
            vehicle=vehicle,
            wheels=wheels,
            axles=axles,
            started_s=started_s,
            busy_s=_first_shown(received, sequence, ("Busy", "Done")),
            done_s=_first_shown(received, sequence, ("Done",)),
            acknowledged_s=acknowledged_s,
            received=received,
        )

    def send_vin(self, vin: str, sequence: int) -> None:
        """Send the three VIN frames."""
        if len(vin) != VIN_LENGTH or not vin.isascii():
            raise InputError(field="vin", expected=f"{VIN_LENGTH} characters of ASCII", seen=repr(vin))
        for message, signals in self._database.vin_messages.items():
            characters: dict[str, Value] = {name: ord(vin[int(name[3:]) - 1]) for name in signals}
            self._bus.send(self._database.encode(message, {"SequenceLow": sequence % 16, **characters}))

    def send_start(self, order: PlcOrder, sequence: int) -> None:
        """Send the start command."""
        wheels = tuple(self._database.wheels) if order.wheels is None else order.wheels
        if unknown := set(wheels) - set(self._database.wheels):
            raise InputError(
                field="wheels",
                expected=f"wheels of {', '.join(self._database.wheels)}",
                seen=", ".join(sorted(unknown)),
            )
        self._send_command("start", sequence, wheels, order.vehicle_type)

    def abort(self, sequence: int | None = None) -> None:
        """Send abort of a cycle; of the last one started when no sequence is given."""
        self._send_command("abort", self._sequence if sequence is None else sequence)

    def acknowledge(self, sequence: int) -> None:
        """Send that the results were taken over."""
        self._send_command("acknowledge", sequence)

    def _next_sequence(self) -> int:
        self._sequence = (self._sequence + 1) % 256
        return self._sequence

    def _send_command(
        self, code: str, sequence: int, wheels: tuple[str, ...] = (), vehicle_type: int = 0
    ) -> None:
        bits = {f"Wheel{ending}": int(name in wheels) for name, ending in self._database.wheels.items()}
        values: dict[str, Value] = {"Code": code, "Sequence": sequence, "VehicleType": vehicle_type, **bits}
        self._bus.send(self._database.encode("Command", values))

    def _receive(self, frame: can.Message) -> None:
        name = self._database.name_of(frame)
        if name is None:
            return
        values = self._database.decode(frame)
        now = self._clock()
        with self._changed:
            if self._recording:
                self._received.append(ReceivedMessage(now, name, values))
            if name == "Status":
                self._status, self._heard_s = read_status(values), now
            else:
                self._results[name] = values
            self._changed.notify_all()

    def _wait(
        self, what: str, timeout_s: float, reached: Callable[[LineStatus], bool]
    ) -> tuple[LineStatus, float]:
        deadline = self._clock() + timeout_s
        with self._changed:
            while self._status is None or not reached(self._status):
                silent = deadline if self._status is None else self._heard_s + self._timeouts.silence_s
                remaining = min(deadline, silent) - self._clock()
                if remaining <= 0:
                    problem = "the station is silent" if silent < deadline else "time is over"
                    raise LineTimeoutError(
                        f"expected {what} within {timeout_s:g} s, but {problem}; "
                        f"last status: {self._status or 'none'}"
                    )
                self._changed.wait(remaining)
            return self._status, self._heard_s

    def _wait_in_cycle(
        self, what: str, timeout_s: float, sequence: int, reached: Callable[[LineStatus], bool]
    ) -> None:
        def reached_or_failed(status: LineStatus) -> bool:
            return (status.sequence == sequence and reached(status)) or failed(status)

        def failed(status: LineStatus) -> bool:
            refused = status.error_sequence == sequence and status.error_code is not LineErrorCode.NONE
            return status.fault or (refused and not status.busy and not status.done)

        status, _ = self._wait(f"{what} of sequence {sequence}", timeout_s, reached_or_failed)
        if failed(status):
            problem = "reports a fault" if status.fault else "refused"
            raise LineError(f"the station {problem} at sequence {sequence}: {status.error_code} ({status})")

    def _read(
        self, results: dict[str, dict[str, Value]], sequence: int
    ) -> tuple[VehicleReport, tuple[WheelAnswer, ...], tuple[AxleAnswer, ...]]:
        wheels, axles = self._database.wheels, self._database.axles
        names = [f"Wheel{part}{ending}" for ending in wheels.values() for part in ("Uncertainty", "Result")]
        names += [f"Axle{part}{ending}" for ending in axles.values() for part in ("Uncertainty", "Result")]
        names.append("VehicleResult")
        missing = [n for n in names if n not in results or results[n]["Sequence"] != sequence]
        if missing:
            raise LineError(
                f"done was shown, but these results of {sequence} are missing: {', '.join(missing)}"
            )
        wheel_answers = tuple(
            read_wheel(name, results[f"WheelResult{ending}"], results[f"WheelUncertainty{ending}"])
            for name, ending in wheels.items()
        )
        axle_answers = tuple(
            read_axle(name, results[f"AxleResult{ending}"], results[f"AxleUncertainty{ending}"])
            for name, ending in axles.items()
        )
        vehicle = read_vehicle(results["VehicleResult"])
        answers: tuple[WheelAnswer | AxleAnswer, ...] = wheel_answers + axle_answers
        parts = overall_outcome(answer.outcome for answer in answers)
        if vehicle.outcome is Outcome.OK and parts is not Outcome.OK:
            raise LineError(f"the vehicle of sequence {sequence} is shown as ok, but its parts are {parts}")
        return vehicle, wheel_answers, axle_answers


def _first_shown(received: Iterable[ReceivedMessage], sequence: int, flags: tuple[str, ...]) -> float:
    """When a Status of this sequence first showed one of the flags."""
    return next(
        message.time_s
        for message in received
        if message.name == "Status"
        and message.values["Sequence"] == sequence
        and any(message.values[flag] for flag in flags)
    )


def run_plc(
    settings: BusSettings,
    dbc: str | PathLike[str],
    orders: Iterable[PlcOrder],
    timeouts: PlcTimeouts = PlcTimeouts(),
) -> Iterator[PlcResult]:
    """Open a bus, reset the station, and measure vehicle after vehicle; the bus closes with the iterator.

    Raises
    ------
    ConfigurationError
        When the DBC is not usable or the log cannot be written.
    LineError
        When the bus does not open or a vehicle fails, see `PlcSimulator.run`.
    """
    database = load_line_database(dbc)
    with open_bus(settings) as bus, PlcSimulator(bus, database, timeouts=timeouts) as plc:
        plc.reset()
        for order in orders:
            yield plc.run(order)
