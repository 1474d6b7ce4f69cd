"""The station's side of the line: commands in, status, answers and results out.

The handshake of one vehicle::

    PLC      Vin1 Vin2 Vin3  Command start(n) ................................. acknowledge(n)  none
    station                  Status busy(n) CommandAnswer ... results(n)  Status ResultValid(n) ... Ready

What a command does is decided by `station.line.handshake`; this module reads and sends frames, watches that
the controller is alive, and holds results until they are acknowledged. Busy is on the bus from the moment a
start is accepted, ResultValid only after all results went out.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import secrets
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from types import TracebackType
from typing import Self

import can

from alignment.errors import LineConnectionError, LineError
from station.cycle import (
    AxleAnswer,
    Command,
    ErrorCode,
    Guidance,
    LiveAngles,
    MasterShown,
    Mode,
    Outcome,
    Reset,
    StationState,
    StationStatus,
    SweepProgress,
    SweepState,
    ToldOfVehicle,
    Trigger,
    VehicleAnswer,
    WheelAnswer,
)
from station.line.asking import heard_in_words, interface_of, known_code, read_asked, refusal_in_words
from station.line.handshake import Event, Handshake
from station.line.live import LiveShown, SweepShown
from station.line.master import MasterOnLine
from station.line.said import Said, shown_status
from station.line.told import ToldByController
from station.line.wire import (
    DEFAULT_OPTIONS,
    CommandAnswer,
    CommandCode,
    LineBus,
    LineDatabase,
    LineHealth,
    LineOptions,
    LineStatus,
    ProtectedLink,
    StationInfo,
    Value,
    VinAssembly,
    answer_frame,
    blank_frames,
    detail_frame,
    info_frame,
    result_frames,
    status_frame,
)
from station.threads import SupervisedThread

STATUS_PERIOD_S = 0.1
COMMUNICATION_TIMEOUT_S = 0.5
PREPARE_LIFETIME_S = 300.0


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
    options
        What a station may set.

    Frames are read in the bus's receiving thread; the other methods are called by the cycle, from any one
    thread. `start` begins the cyclic messages (Status at the DBC's cycle time) in a supervised thread;
    without it call `tick`.
    """

    def __init__(
        self,
        bus: LineBus,
        database: LineDatabase,
        clock: Callable[[], float] = time.monotonic,
        options: LineOptions = DEFAULT_OPTIONS,
    ) -> None:
        self._bus = bus
        self._database = database
        self._clock = clock
        # A controller of a line before 3.1 has no way to tell of a step.
        self._modes = options.modes if database.has_steering else options.modes - {Mode.SWEEP}
        self._link = ProtectedLink(bus, database, clock)
        # One lock over state and sending: what a Status says is what held when it went out.
        self._lock = threading.RLock()
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._vin = VinAssembly(database.vin_messages)
        self._handshake = Handshake()
        self._status = StationStatus(StationState.STARTING, ErrorCode.STARTING)
        self._trigger: Trigger | None = None
        self._reset_pending = False
        self._results: list[can.Message] = []
        self._blank = blank_frames(database)
        self._live = LiveShown(database, clock, options.live_age_s, self._send)
        self._sweep = SweepShown(database, self._send)
        self._master = MasterOnLine(database, clock, self._send)
        self._told = ToldByController(database, clock)
        self._said = Said(clock)
        self._link_up = False
        self._heartbeat = self._alive_counter = self._faults = 0
        self._prepared_s = 0.0
        self._detailed: tuple[ErrorCode, int, str | None, int] | None = None
        self._due: dict[str, float] = {}
        self._info = StationInfo(database.interface_version, options.software, secrets.randbelow(256))
        self._timeout_s = (
            options.communication_timeout_s or database.timeout_s("Command") or COMMUNICATION_TIMEOUT_S
        )
        period_s = database.cycle_time_s("Status") or STATUS_PERIOD_S
        self._cyclic = SupervisedThread("line status", lambda stopping: self._cyclic_step(stopping, period_s))
        bus.listen(self.receive)

    def start(self) -> Self:
        """Begin the cyclic messages; the first ones go out at once."""
        self.tick()
        self._cyclic.start()
        return self

    def close(self) -> None:
        """End the cyclic messages and stop listening; harmless when closed."""
        self._bus.unlisten(self.receive)
        self._cyclic.stop()
        with self._lock:
            self._said.flush()

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
    def health(self) -> LineHealth:
        """State of bus, frames and threads."""
        with self._lock:
            bus, link, cyclic = self._bus.health, self._link.health, self._cyclic
            return LineHealth(bus, link, self._link_up, cyclic.alive, cyclic.failures, self._faults)

    @property
    def threads(self) -> tuple[SupervisedThread, ...]:
        """Its threads, for who looks after them: of the cyclic messages, and of the bus."""
        return self._cyclic, self._bus.thread

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
        return command

    def publish(self, status: StationStatus) -> None:
        """Say what the cycle does; sent at once and then cyclically.

        A bus that does not take the frame is no error here: the cyclic Status tries again, and the health of
        the bus counts it.
        """
        with self._lock:
            if status.state is StationState.FAULT and self._status.state is not StationState.FAULT:
                self._faults += 1
            self._status = status
            # Until the cycle has taken a reset, it speaks of what was before.
            if not self._reset_pending:
                if status.state is StationState.FAULT:
                    self._happened(Event.CYCLE_FAULT)
                elif status.state is StationState.IDLE:
                    self._happened(Event.CYCLE_READY)
            self._send_status()
            if self._detailed != self._detail():
                self._send_detail()

    def publish_live(self, angles: LiveAngles, measured_s: float) -> None:
        """Show angles of a wheel that is adjusted, of images taken at this time of the monotonic clock."""
        with self._lock:
            self._live.show(angles, measured_s)

    def publish_guidance(self, guidance: Guidance, measured_s: float) -> None:
        """Show what to do at a wheel that is adjusted, of images taken at this time of the clock."""
        with self._lock:
            self._live.guide(guidance, measured_s)

    def publish_sweep(self, progress: SweepProgress) -> None:
        """Show how the sweep goes; a position that is wanted is awaited from then on."""
        with self._lock:
            self._sweep.show(self._handshake.sequence, progress)
            if progress.state is SweepState.TURN:
                self._handshake.want(progress.position)
            elif progress.state in (SweepState.DONE, SweepState.FAILED):
                self._happened(Event.SWEEP_OVER)
            self._send_status()

    def publish_master(self, master: MasterShown) -> None:
        """Show where the station stands with its master checks."""
        with self._lock:
            self._master.show(master)
            self._send_status()

    def told(self) -> ToldOfVehicle:
        """What the controller last told of the vehicle."""
        with self._lock:
            return self._told.of_vehicle

    def send_results(
        self,
        sequence: int,
        wheel_answers: Sequence[WheelAnswer],
        axle_answers: Sequence[AxleAnswer] = (),
        vehicle_answer: VehicleAnswer | None = None,
    ) -> Outcome:
        """Send all results of the accepted start, then Status with ResultValid. Call it after the commit.

        Wheels and axles without an answer are sent as not requested. Nothing is sent unless all can be. The
        results are held, and sent again with the cyclic Status, until the controller acknowledges them; a bus
        that does not take them now takes them then.

        Returns
        -------
        The outcome of the vehicle, as sent: see `vehicle_outcome`.

        Raises
        ------
        InputError
            When a requested wheel has no answer, another wheel has one, a name is unknown or given twice, or
            an angle does not fit its signal.
        LineError
            When no start of this sequence waits for results.
        """
        with self._lock:
            if not self._handshake.awaits(sequence) or self._trigger is None or self._results:
                raise LineError(
                    f"results of sequence {sequence} are not awaited: expected an accepted start without "
                    f"results, found the state '{self._handshake.state}' of sequence "
                    f"{self._handshake.sequence}"
                )
            overall, self._results = result_frames(
                self._database,
                sequence,
                self._trigger.wheels,
                wheel_answers,
                axle_answers,
                vehicle_answer or VehicleAnswer(Outcome.NOT_REQUESTED),
            )
            self._repeat_results()
            return overall

    def restore_results(
        self,
        sequence: int,
        wheel_answers: Sequence[WheelAnswer],
        axle_answers: Sequence[AxleAnswer] = (),
        vehicle_answer: VehicleAnswer | None = None,
    ) -> Outcome:
        """Offer results of an earlier run of the program that nobody acknowledged; before anything else.

        Raises
        ------
        InputError
            As `send_results`.
        """
        with self._lock:
            wheels = tuple(a.wheel for a in wheel_answers if a.outcome is not Outcome.NOT_REQUESTED)
            overall, self._results = result_frames(
                self._database,
                sequence,
                wheels,
                wheel_answers,
                axle_answers,
                vehicle_answer or VehicleAnswer(Outcome.NOT_REQUESTED),
            )
            self._handshake.restore(sequence)
            # Not 'starting' any more: a fault beside valid results would be taken for theirs.
            self._status = StationStatus(StationState.REPORTING)
            self._repeat_results()
            return overall

    def refuse(self, sequence: int, code: ErrorCode) -> None:
        """Decline an accepted start or preparation, such as one of an unknown vehicle type.

        The sequence may be used again. Harmless when it is no longer in hand.
        """
        with self._lock:
            if self._reset_pending:
                return
            self._handshake.refuse(sequence, code)
            trigger, self._trigger = self._trigger, None
            command = CommandCode.PREPARE if trigger is None else CommandCode.START
            self._said.refused(sequence, code, refusal_in_words(command, sequence, code, trigger))
            self._send_status()
            self._send_answer()

    def tick(self) -> None:
        """Send the cyclic messages once, and look whether the controller is alive."""
        with self._lock:
            self._watch()
            self._send_status()
            self._send_answer()
            if self._results:
                self._repeat_results()
            else:
                self._send_slow("VehicleResult", lambda: self._sent(self._blank))
            self._live.repeat()
            self._sweep.repeat()
            self._send_slow("MasterCheck", self._master.repeat)
            self._send_slow("StationInfo", lambda: self._send(info_frame(self._database, self._info)))
            self._send_slow("ErrorDetail", self._send_detail)

    def receive(self, frame: can.Message) -> None:
        """Take one frame; the bus's receiving thread calls this. Nothing a frame holds makes it raise."""
        with self._lock:
            read = self._link.read(frame)
            if read is None:
                return
            name, values = read
            if name == "Command":
                self._receive_command(values)
            elif name in self._database.vin_messages:
                self._vin.add(name, values, self._clock())
            else:
                self._told.take(name, values)

    def _cyclic_step(self, stopping: threading.Event, period_s: float) -> None:
        if not stopping.wait(period_s):
            self.tick()

    def _watch(self) -> None:
        self._said.flush_due()
        now = self._clock()
        heard = self._link.heard_s("Command")
        if self._link_up and (heard is None or now - heard > self._timeout_s):
            self._link_up = False
            self._said.say(
                logging.WARNING, "lost", f"controller lost: no good Command for {self._timeout_s:g} s"
            )
            self._link.forget()
            self._vin.clear()
            self._told.clear()
            self._happened(Event.LINK_LOST)
        if now - self._prepared_s > PREPARE_LIFETIME_S:
            self._happened(Event.PREPARE_EXPIRED)

    def _happened(self, event: Event) -> None:
        command = self._handshake.happened(event)
        if event in (Event.CYCLE_READY, Event.CYCLE_FAULT):
            self._end_start()
        if command is not None:
            self._commands.put(command)

    def _end_start(self) -> None:
        if not self._handshake.busy and not self._handshake.held:
            self._trigger = None
            self._results = []
        if not self._handshake.busy:
            self._clear_shown()

    def _clear_shown(self) -> None:
        self._live.clear()
        self._sweep.clear()

    def _line_status(self) -> LineStatus:
        why, up, alive = self._master.why_not_ready, self._link_up, self._alive_counter
        return shown_status(self._handshake, self._status, self._said, why, link_up=up, alive=alive)

    def _send(self, frame: can.Message) -> bool:
        """Send a frame that comes again; a failure is counted in the health of the bus."""
        with contextlib.suppress(LineConnectionError):
            self._link.send(frame)
            return True
        return False

    def _send_status(self) -> None:
        if self._send(status_frame(self._database, self._line_status())):
            self._alive_counter = (self._alive_counter + 1) % 256

    def _send_answer(self) -> None:
        reply = self._handshake.reply
        answer = CommandAnswer(
            reply.code, reply.sequence, reply.answer, reply.refusal, self._link_up, self._heartbeat
        )
        self._send(answer_frame(self._database, answer))

    def _detail(self) -> tuple[ErrorCode, int, str | None, int]:
        status = self._line_status()
        return status.error_code, status.error_sequence, self._status.wheel, self._faults

    def _send_detail(self) -> None:
        self._detailed = self._detail()
        self._send(detail_frame(self._database, *self._detailed))

    def _send_slow(self, name: str, send: Callable[[], object]) -> None:
        now = self._clock()
        if name in self._database.protected and now >= self._due.get(name, now):
            send()
            self._due[name] = now + (self._database.cycle_time_s(name) or 0.0)

    def _repeat_results(self) -> None:
        """Send the held results; ResultValid is shown from the first time that all of them went out."""
        if not self._sent(self._results):
            return
        if self._handshake.busy:
            self._handshake.happened(Event.RESULTS_SENT)
            self._clear_shown()
            self._send_status()

    def _sent(self, frames: Iterable[can.Message]) -> bool:
        return all(self._send(frame) for frame in frames)

    def _receive_command(self, values: dict[str, Value]) -> None:
        if not self._link_up:
            self._link_up = True
            self._said.say(*heard_in_words(interface_of(values)))
            # With the next cyclic ones its counters of all messages are in step.
            self._due.pop("VehicleResult", None)
            self._sent(self._results or self._blank)
        self._heartbeat = int(values["Heartbeat"])
        sequence = int(values["Sequence"])
        code = known_code(values, self._modes)
        if code is None:
            why = ErrorCode.UNKNOWN_COMMAND
            self._said.refused(sequence, why, refusal_in_words(f"command {values['Code']},", sequence, why))
            self._send_status()
            return
        before = self._handshake.state, self._handshake.reply
        now, modes = self._clock(), self._modes
        wheels = self._database.wheels
        asked = read_asked(code, sequence, values, wheels, self._vin, self._told, modes, now)
        command = self._handshake.asked(asked)
        if command is not None:
            self._accepted(command)
        reply = self._handshake.reply
        if before == (self._handshake.state, reply) and command is None:
            return
        start = asked if code is CommandCode.START else None
        text = refusal_in_words(code, reply.sequence, reply.refusal, start)
        self._said.refused(reply.sequence, reply.refusal, text)
        self._send_status()
        self._send_answer()

    def _accepted(self, command: Command) -> None:
        if isinstance(command, Trigger):
            self._trigger, self._results = command, []
            self._vin.clear()
        elif isinstance(command, Reset):
            with contextlib.suppress(queue.Empty):
                while True:
                    self._commands.get_nowait()
            self._trigger, self._results = None, []
            self._clear_shown()
            self._vin.clear()
            self._reset_pending = True
        self._prepared_s = self._clock()
        if not self._handshake.held and not self._handshake.busy:
            self._results = []
        self._commands.put(command)
