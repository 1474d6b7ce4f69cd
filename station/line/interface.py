"""The station's side of the line: commands in, status and results out.

The handshake of one vehicle::

    PLC      Vin1 Vin2 Vin3  Command start(n) ........................................ acknowledge(n)
    station                            Status busy(n) ... results(n)  Status done(n) ...       Status ready

`StationLine` keeps sequence, busy and done, so that they are right whatever the measuring cycle says: busy
from the moment a start is accepted, done only after all results went out, until they are acknowledged.
Every accepted start ends in one of three ways: `send_results` and the acknowledgement, `refuse`, or a fault
that the cycle publishes and the controller resets.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

import can

from alignment.errors import InputError, LineConnectionError, LineError
from station.line.bus import LineBus
from station.line.dbc import LineDatabase, Value
from station.line.messages import (
    Abort,
    Acknowledge,
    AxleAnswer,
    Command,
    LineErrorCode,
    LineStatus,
    Outcome,
    Reset,
    StationState,
    StationStatus,
    Trigger,
    VehicleAnswer,
    WheelAnswer,
    overall_outcome,
)
from station.line.results import axle_frames, status_frame, vehicle_frame, wheel_frames
from station.line.supervised import SupervisedThread
from station.line.vin import VinAssembly, VinState

STATUS_PERIOD_S = 0.1


class StationLine:
    """What the measuring cycle sees of the controller.

    Parameters
    ----------
    bus
        Open bus; it stays open when this object closes.
    database
        The checked DBC.
    clock
        Monotonic seconds.

    Frames are read in the bus's receiving thread; `next_command`, `publish`, `send_results` and `refuse` are
    called by the cycle, from any one thread. `start` begins the cyclic Status (the DBC's cycle time) in a
    supervised thread; without it call `tick`.

    Attributes
    ----------
    ignored_frames
        Frames of the line that were malformed; frames of other senders on the bus do not count.
    """

    def __init__(
        self, bus: LineBus, database: LineDatabase, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._bus = bus
        self._database = database
        self._clock = clock
        # One lock over state and sending: what a Status says is what held when it went out.
        self._lock = threading.RLock()
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._vin = VinAssembly(database.vin_messages)
        self._status = StationStatus(StationState.FAULT, LineErrorCode.STARTING)
        self._trigger: Trigger | None = None
        self._sent = self._aborted = self._reset_pending = False
        self._last_sequence: int | None = None
        self._shown_sequence = 0
        self._refusal = LineErrorCode.NONE
        self._refused_sequence = 0
        self._alive_counter = 0
        self.ignored_frames = 0
        period_s = database.cycle_time_s("Status") or STATUS_PERIOD_S
        self._cyclic = SupervisedThread("line status", lambda stopping: self._cyclic_step(stopping, period_s))
        bus.listen(self.receive)

    def start(self) -> Self:
        """Begin the cyclic Status; the first one goes out at once."""
        self.tick()
        self._cyclic.start()
        return self

    def close(self) -> None:
        """End the cyclic Status and stop listening; harmless when closed."""
        self._bus.unlisten(self.receive)
        self._cyclic.stop()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def wheels(self) -> tuple[str, ...]:
        """Names of the wheels the line knows."""
        return tuple(self._database.wheels)

    @property
    def status(self) -> LineStatus:
        """What the next Status message would say."""
        with self._lock:
            return self._line_status()

    @property
    def cyclic_failures(self) -> int:
        """How many cyclic steps raised; a bus that takes no frames counts in the health of the bus."""
        return self._cyclic.failures

    def next_command(self, timeout_s: float) -> Command | None:
        """Take the next command; None when there is none within the bounded time.

        A `Trigger` comes once per sequence, complete with its VIN, and busy is already on the bus. A `Reset`
        supersedes all commands before it.
        """
        try:
            command = self._commands.get(block=timeout_s > 0, timeout=timeout_s if timeout_s > 0 else None)
        except queue.Empty:
            return None
        if isinstance(command, Reset):
            with self._lock:
                self._reset_pending = False
                self._send_status()
        return command

    def publish(self, status: StationStatus) -> None:
        """Say what the cycle does; sent at once and then cyclically.

        A bus that does not take the frame is no error here: the cyclic Status tries again, and the health of
        the bus counts it.
        """
        with self._lock:
            self._status = status
            self._send_status()

    def tick(self) -> None:
        """Send the cyclic Status once."""
        with self._lock:
            self._send_status()

    def send_results(
        self,
        sequence: int,
        wheel_answers: Sequence[WheelAnswer],
        axle_answers: Sequence[AxleAnswer] = (),
        vehicle_answer: VehicleAnswer | None = None,
    ) -> Outcome:
        """Send all results of the accepted start, then Status with done. Call it after the commit only.

        Wheels and axles without an answer are sent as not requested. Nothing is sent unless all can be.
        After a LineConnectionError the same call may be made again.

        Returns
        -------
        The outcome of the vehicle, as sent: see `overall_outcome`.

        Raises
        ------
        InputError
            When a requested wheel has no answer, another wheel has one, a name is unknown or given twice, or
            an angle does not fit its signal.
        LineError
            When no start of this sequence waits for results.
        LineConnectionError
            When the bus does not take a frame; done is then not shown.
        """
        with self._lock:
            if self._trigger is None or self._trigger.sequence != sequence or self._sent:
                raise LineError(
                    f"results of sequence {sequence} are not awaited: expected an accepted start without "
                    f"results, found {'none' if self._trigger is None else self._trigger}"
                )
            wheels = {answer.wheel: answer for answer in wheel_answers}
            axles = {answer.axle: answer for answer in axle_answers}
            answered = {name for name, a in wheels.items() if a.outcome is not Outcome.NOT_REQUESTED}
            _require_names("wheel", [answer.wheel for answer in wheel_answers], self._database.wheels)
            _require_names("axle", [answer.axle for answer in axle_answers], self._database.axles)
            if answered != set(self._trigger.wheels):
                raise InputError(
                    field="wheel_answers",
                    expected=f"an outcome for {', '.join(self._trigger.wheels)} and no other wheel",
                    seen=", ".join(sorted(answered)) or "none",
                )
            vehicle = vehicle_answer or VehicleAnswer(Outcome.NOT_REQUESTED)
            answers: list[WheelAnswer | AxleAnswer | VehicleAnswer] = [
                *wheels.values(),
                *axles.values(),
                vehicle,
            ]
            overall = overall_outcome(answer.outcome for answer in answers)
            frames: list[can.Message] = []
            for name in self._database.wheels:
                wheel = wheels.get(name) or WheelAnswer(name, Outcome.NOT_REQUESTED)
                frames += wheel_frames(self._database, sequence, wheel)
            for name in self._database.axles:
                axle = axles.get(name) or AxleAnswer(name, Outcome.NOT_REQUESTED)
                frames += axle_frames(self._database, sequence, axle)
            frames.append(vehicle_frame(self._database, sequence, overall, vehicle))
            for frame in frames:
                self._bus.send(frame)
            self._sent = True
            self._send_status()
            return overall

    def refuse(self, sequence: int, code: LineErrorCode) -> None:
        """Decline an accepted start, such as one of an unknown vehicle type; the sequence may be used again.

        Raises
        ------
        LineError
            When no start of this sequence waits for results.
        """
        with self._lock:
            if self._trigger is None or self._trigger.sequence != sequence or self._sent:
                raise LineError(f"sequence {sequence} cannot be refused: it does not wait for results")
            self._trigger = None
            self._last_sequence = None
            self._refuse(sequence, code)

    def receive(self, frame: can.Message) -> None:
        """Take one frame; the bus's receiving thread calls this. Nothing a frame holds makes it raise."""
        name = self._database.name_of(frame)
        if name != "Command" and name not in self._database.vin_messages:
            return
        try:
            values = self._database.decode(frame)
        except InputError:
            self.ignored_frames += 1
            return
        with self._lock:
            if name == "Command":
                self._receive_command(values)
            else:
                self._vin.add(name, values, self._clock())

    def _cyclic_step(self, stopping: threading.Event, period_s: float) -> None:
        if not stopping.wait(period_s):
            self.tick()

    def _line_status(self) -> LineStatus:
        fault = self._status.state == StationState.FAULT
        open_start = self._trigger is not None
        station_error = self._status.error_code != LineErrorCode.NONE
        return LineStatus(
            state=self._status.state,
            sequence=self._shown_sequence,
            ready=not open_start
            and not self._reset_pending
            and self._status.state in (StationState.IDLE, StationState.ARMED),
            busy=open_start and not self._sent and not fault,
            done=open_start and self._sent,
            fault=fault,
            alive_counter=self._alive_counter,
            error_code=self._status.error_code if station_error else self._refusal,
            error_sequence=self._shown_sequence if station_error else self._refused_sequence,
        )

    def _send_status(self) -> None:
        frame = status_frame(self._database, self._line_status())
        # A failure is counted in the health of the bus; the next cyclic Status tries again.
        with contextlib.suppress(LineConnectionError):
            self._bus.send(frame)
            self._alive_counter = (self._alive_counter + 1) % 256

    def _receive_command(self, values: dict[str, Value]) -> None:
        sequence = int(values["Sequence"])
        match values["Code"]:
            case "none":
                pass
            case "start":
                self._receive_start(sequence, values)
            case "abort":
                self._receive_abort(sequence)
            case "acknowledge":
                self._receive_acknowledge(sequence)
            case "reset":
                with contextlib.suppress(queue.Empty):
                    while True:
                        self._commands.get_nowait()
                self._trigger = None
                self._last_sequence = None
                self._shown_sequence = sequence
                self._vin.clear()
                self._reset_pending = True
                self._deliver(Reset(sequence))
            case _:
                self._refuse(sequence, LineErrorCode.UNKNOWN_COMMAND)

    def _receive_start(self, sequence: int, values: dict[str, Value]) -> None:
        ending = self._database.wheels
        wheels = tuple(wheel for wheel in ending if values[f"Wheel{ending[wheel]}"])
        vin = self._vin.read(sequence, self._clock())
        if self._trigger is not None:
            if sequence != self._trigger.sequence:
                self._refuse(sequence, LineErrorCode.NOT_ACKNOWLEDGED if self._sent else LineErrorCode.BUSY)
        elif self._reset_pending:
            # Until the cycle has dropped the old vehicle, its results could go out under a used number.
            self._refuse(sequence, LineErrorCode.BUSY)
        elif self._status.state == StationState.FAULT:
            self._refuse(sequence, LineErrorCode.RESET_REQUIRED)
        elif sequence == self._last_sequence:
            self._refuse(sequence, LineErrorCode.SEQUENCE_USED)
        elif not wheels:
            self._refuse(sequence, LineErrorCode.NO_WHEELS)
        elif vin is VinState.INCOMPLETE:
            self._refuse(sequence, LineErrorCode.VIN_INCOMPLETE)
        elif vin is VinState.INVALID:
            self._refuse(sequence, LineErrorCode.VIN_INVALID)
        else:
            self._trigger = Trigger(sequence, wheels, int(values["VehicleType"]), vin, self._clock())
            self._last_sequence = self._shown_sequence = sequence
            self._sent = self._aborted = False
            self._vin.clear()
            self._deliver(self._trigger)

    def _receive_abort(self, sequence: int) -> None:
        if sequence != self._last_sequence:
            self._refuse(sequence, LineErrorCode.WRONG_SEQUENCE)
        elif self._trigger is not None and not self._sent and not self._aborted:
            self._aborted = True
            self._deliver(Abort(sequence))

    def _receive_acknowledge(self, sequence: int) -> None:
        if sequence != self._last_sequence:
            self._refuse(sequence, LineErrorCode.WRONG_SEQUENCE)
        elif self._trigger is not None and not self._sent:
            self._refuse(sequence, LineErrorCode.NOTHING_TO_ACKNOWLEDGE)
        elif self._trigger is not None:
            self._trigger = None
            self._deliver(Acknowledge(sequence))

    def _deliver(self, command: Command) -> None:
        self._refusal, self._refused_sequence = LineErrorCode.NONE, 0
        self._commands.put(command)
        self._send_status()

    def _refuse(self, sequence: int, code: LineErrorCode) -> None:
        self._refusal, self._refused_sequence = code, sequence
        self._send_status()


def _require_names(what: str, given: Sequence[str], known: Sequence[str] | dict[str, str]) -> None:
    if len(set(given)) != len(given) or not set(given) <= set(known):
        raise InputError(
            field=f"{what}_answers",
            expected=f"each {what} of {', '.join(known)} at most once",
            seen=", ".join(given),
        )
