"""The measuring cycle: from a trigger to a committed result, and only then to the answer.

Whatever fails on the way, the cycle ends in a defined state with a record that says why; the line is told OK
of a wheel only when its record is committed. Every wait is bounded.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from datetime import datetime, timedelta
from pathlib import Path

from alignment.errors import InputError, LineError, StoreError, TruewheelError
from db.records import (
    CycleOutcome,
    CycleRecord,
    EventRecord,
    Severity,
    ZeroRecord,
)
from station.adjusting import Adjusting
from station.calibration_images import CalibrationImages
from station.coalesced import Coalesced
from station.cycle_record import cycle_record
from station.evaluation import Evaluation, axle_of, evaluate
from station.held import Closing, Held, closing_text, unacknowledged
from station.line.messages import (
    Abort,
    Acknowledge,
    Command,
    LineErrorCode,
    Mode,
    Outcome,
    Prepare,
    Reset,
    StationState,
    StationStatus,
    Stop,
    Trigger,
)
from station.master_check import master_checks
from station.ports import Bounds, CycleReport, Identity, Line, Observer, Store
from station.records import Standing, answers_of
from station.states import StateMachine
from station.store_thread import StoreThread
from station.vehicle_types import VehicleType
from station.wheels import (
    ABORTED,
    WheelPosition,
    WheelResult,
    connect_all,
    fault,
    result_of,
    utc_now,
)

POLL_S = 0.02
_LOG = logging.getLogger("truewheel.station")


class MeasuringCycle:
    """Serves triggers, one at a time. All methods are called from one thread.

    Parameters
    ----------
    identity
        For the records.
    positions
        One per wheel; their rigs are connected.
    vehicle_types
        By the number that a trigger carries.
    line, store
        Open.
    bounds
        Of every wait.
    coverage_factor
        k of the expanded uncertainty in verdicts and answers.
    observer
        Watches.
    clock, now
        Monotonic seconds, the same clock as the line's; and aware UTC time.
    image_folder
        Where the mode calibrate records images; without it that mode is refused.
    """

    def __init__(
        self,
        identity: Identity,
        positions: Sequence[WheelPosition],
        vehicle_types: Mapping[int, VehicleType],
        line: Line,
        store: Store,
        bounds: Bounds,
        coverage_factor: float = 2.0,
        observer: Observer | None = None,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], datetime] = utc_now,
        image_folder: Path | None = None,
    ) -> None:
        self._identity = identity
        self._positions = {position.name: position for position in positions}
        self._vehicle_types = vehicle_types
        self._line = line
        self._store = store
        self._bounds = bounds
        self._coverage_factor = coverage_factor
        self._observer = observer or Observer()
        self._clock = clock
        self._now = now
        self._machine = StateMachine(self._entered)
        self._error = LineErrorCode.NONE
        self._fault_wheel: str | None = None
        self._held: Held | None = None
        self._interruption: Command | None = None
        self._running: set[Future[WheelResult]] = set()
        self._measured_s = 0.0
        # Cameras mostly wait, so each rig has a thread; the mathematics releases the interpreter.
        self._wheel_threads = ThreadPoolExecutor(max(1, len(positions)), "wheel")
        self._images = (
            None if image_folder is None else CalibrationImages(image_folder, self._wheel_threads, bounds)
        )
        self._store_thread = StoreThread(bounds.store_s)
        self._provoked = Coalesced[tuple[Severity, str]](lambda kind, text: self._note(*kind, text), clock)

    @property
    def state(self) -> StationState:
        """Where the cycle is."""
        return self._machine.state

    def start(self) -> None:
        """Record the calibrations and the start, and be ready for triggers.

        Results of an earlier run that the line did not acknowledge are offered again first.

        Raises
        ------
        StoreError
            When they cannot be recorded.
        """
        for position in self._positions.values():
            self._store_thread.call(self._store.record_calibration, position.in_force.record())
        version = self._identity.software_version
        self._store_thread.call(
            self._store.record_event, self._event(Severity.INFO, "started", f"version {version} started")
        )
        self._offer_again()
        self._line.publish(StationStatus(self.state))

    def close(self) -> None:
        """End the threads; a wheel or a commit that is under way is waited for."""
        self._wheel_threads.shutdown(cancel_futures=True)
        self._provoked.flush()
        self._store_thread.close()

    def serve(self, stopping: threading.Event) -> None:
        """Serve commands until told to stop; a cycle that has begun is finished.

        Whatever unforeseen error ends it, the line is told of a fault first.
        """
        try:
            while not stopping.is_set():
                self.step(5 * POLL_S)
        except BaseException:
            self._error = LineErrorCode.INTERNAL_FAULT
            if self.state is StationState.FAULT:
                self._entered(StationState.FAULT)
            else:
                self._machine.enter(StationState.FAULT)
            raise

    def step(self, timeout_s: float) -> CycleReport | None:
        """Serve the next command, waiting at most `timeout_s` for it; return the report if it was a cycle."""
        self._provoked.flush_due()
        command = self._line.next_command(timeout_s)
        match command:
            case Trigger():
                return self._serve_trigger(command)
            case Prepare():
                self._prepare(command)
            case Acknowledge() if self._held is not None and command.sequence == self._held.sequence:
                self._close_held(Closing.ACKNOWLEDGED)
            case Reset():
                self._recover()
        # Stop and abort without a cycle, and an acknowledgement of another one, are harmless.
        return None

    def _serve_trigger(self, trigger: Trigger) -> CycleReport | None:
        code = self._refusal(trigger)
        if code is not None:
            self._line.refuse(trigger.sequence, code)
            self._provoked.say((Severity.WARNING, str(code)), f"start {trigger} was refused")
            return None
        self._interruption = None
        self._error, self._fault_wheel = LineErrorCode.NONE, None
        received_utc = self._now() - timedelta(seconds=max(0.0, self._clock() - trigger.received_s))
        self._machine.enter(StationState.ARMED)
        if trigger.mode is Mode.CALIBRATE:
            self._record_images(trigger)
            return None
        kind = self._vehicle_types[trigger.vehicle_type]
        results = self._measured([self._positions[wheel] for wheel in trigger.wheels], trigger)
        self._measured_s = self._clock()
        self._machine.enter(StationState.EVALUATING)
        evaluation = evaluate(kind, results, self._coverage_factor)
        self._poll(trigger)
        record = self._record(trigger, kind, evaluation, received_utc)
        self._machine.enter(StationState.STORING)
        committed_s = self._commit(trigger, record)
        self._poll(trigger)
        self._machine.enter(StationState.REPORTING)
        report = CycleReport(trigger, record, evaluation, committed_s, self._tell(record, committed_s))
        self._observer.cycle_done(report)
        self._drain()
        after = StationState.FAULT if self._needs_reset(report) else StationState.IDLE
        cycle = record.uuid if committed_s is not None else None
        if report.told is not None:
            self._held = Held(trigger.sequence, cycle, after)
            self._await_acknowledgement()
        elif isinstance(self._interruption, Reset):
            if cycle is not None:
                self._note(Severity.WARNING, Closing.DISCARDED, closing_text(record.uuid, trigger.sequence))
            self._machine.enter(after)
            self._recover()
        else:
            self._machine.enter(after)
        return report

    def _record_images(self, trigger: Trigger) -> None:
        """Record images of the calibration plate; nothing is judged, so there is no record of a cycle."""
        assert self._images is not None
        self._machine.enter(StationState.MEASURING)
        positions = [self._positions[wheel] for wheel in trigger.wheels]
        answers, self._error, text = self._images.record(positions, trigger.sequence, self._now())
        self._machine.enter(StationState.EVALUATING)
        self._machine.enter(StationState.STORING)
        self._note(Severity.INFO if self._error is LineErrorCode.NONE else Severity.ERROR, "images", text)
        self._machine.enter(StationState.REPORTING)
        after = StationState.IDLE if self._error is LineErrorCode.NONE else StationState.FAULT
        if self._poll(trigger) and isinstance(self._interruption, Reset):
            self._machine.enter(after)
            self._recover()
            return
        self._line.send_results(trigger.sequence, answers)
        self._held = Held(trigger.sequence, None, after)
        self._await_acknowledgement()

    def _prepare(self, prepare: Prepare) -> None:
        """Arm the cameras for the next vehicle; a camera that fails is found by its start."""
        code = self._refusal(prepare)
        if code is not None:
            self._line.refuse(prepare.sequence, code)
            return
        for wheel in prepare.wheels:
            try:
                self._positions[wheel].rig.arm()
            except TruewheelError as error:
                self._provoked.say((Severity.WARNING, "not_prepared"), f"{wheel}: {error}")

    def _refusal(self, trigger: Trigger | Prepare) -> LineErrorCode | None:
        """Why this trigger cannot be served, if it cannot."""
        if self.state is not StationState.IDLE:
            return LineErrorCode.RESET_REQUIRED
        if trigger.mode is Mode.CALIBRATE:
            known = self._images is not None and set(trigger.wheels) <= set(self._positions)
            return None if known else LineErrorCode.MODE_NOT_AVAILABLE
        kind = self._vehicle_types.get(trigger.vehicle_type)
        if kind is None:
            return LineErrorCode.UNKNOWN_VEHICLE_TYPE
        if all(wheel in self._positions and axle_of(wheel) in kind.axles for wheel in trigger.wheels):
            return None
        return LineErrorCode.WHEEL_NOT_AVAILABLE

    def _measured(self, positions: Sequence[WheelPosition], trigger: Trigger) -> tuple[WheelResult, ...]:
        """Arm, shoot and measure; one result for each position, whatever happens."""
        results: dict[str, WheelResult] = {}
        armed = []
        try:
            # Asked for at every start, so that a revoked zero measurement corrects nothing any more.
            installed = [(p.in_force.calibration.rig, p.in_force.calibration.id) for p in positions]
            zeros = self._store_thread.call(self._store.zeros_in_force, installed)
        except StoreError as error:
            return tuple(p.failed(fault(LineErrorCode.STORE_FAULT, f"{p.name}: {error}")) for p in positions)
        for position in positions:
            try:
                position.rig.arm()
                armed.append(position)
            except TruewheelError as error:
                results[position.name] = position.failed(fault(LineErrorCode.CAMERA_FAULT, str(error)))
        if trigger.mode is Mode.ADJUST and len(armed) > 0 and not self._poll(trigger):
            self._adjust(armed, zeros, trigger)
        if armed and not self._poll(trigger):
            self._machine.enter(StationState.MEASURING)
            results |= self._run_wheels(armed, zeros, trigger)
        return tuple(results.get(p.name) or p.failed(ABORTED) for p in positions)

    def _adjust(
        self, positions: Sequence[WheelPosition], zeros: Sequence[ZeroRecord], trigger: Trigger
    ) -> None:
        """Show live angles until a stop; an abort, a reset or the end of patience interrupts the cycle."""
        self._machine.enter(StationState.ADJUSTING)
        kind = self._vehicle_types[trigger.vehicle_type]
        deadline = self._clock() + self._bounds.adjust_s
        with Adjusting(
            self._wheel_threads, positions, zeros, kind, self._coverage_factor, self._line, self._clock
        ) as adjusting:
            while self._interruption is None:
                adjusting.step(POLL_S)
                command = self._line.next_command(0.0)
                if isinstance(command, Stop) and command.sequence == trigger.sequence:
                    break
                if not self._interrupt(command, trigger) and self._clock() >= deadline:
                    self._interruption = Abort(trigger.sequence, LineErrorCode.ADJUST_TIMEOUT)
        for position in positions:
            # Adjusting has armed them for another shot each time; once more for the one that counts.
            with contextlib.suppress(TruewheelError):
                position.rig.arm()

    def _run_wheels(
        self, positions: Sequence[WheelPosition], zeros: Sequence[ZeroRecord], trigger: Trigger
    ) -> dict[str, WheelResult]:
        by_future = {self._wheel_threads.submit(position.run, zeros): position for position in positions}
        results: dict[str, WheelResult] = {}
        deadline = self._clock() + self._bounds.measure_s
        self._running = set(by_future)
        while self._running and not self._poll(trigger) and self._clock() < deadline:
            done, self._running = wait(self._running, POLL_S, FIRST_COMPLETED)
            for future in done:
                result = result_of(future, by_future[future])
                results[result.wheel] = result
                self._observer.wheel_done(result)
        if self._interruption is None:
            for position in (by_future[future] for future in self._running):
                text = f"{position.name}: expected images and angles within {self._bounds.measure_s:g} s"
                results[position.name] = position.failed(fault(LineErrorCode.CYCLE_TIMEOUT, text))
        return results

    def _record(
        self, trigger: Trigger, kind: VehicleType, evaluation: Evaluation, received_utc: datetime
    ) -> CycleRecord:
        record, self._error, self._fault_wheel = cycle_record(
            self._identity,
            trigger,
            kind,
            evaluation,
            self._interruption,
            received_utc=received_utc,
            measured_s=self._measured_s,
        )
        return record

    def _commit(self, trigger: Trigger, record: CycleRecord) -> float | None:
        """Store the record; the time of the commit, or None when there was none."""
        try:
            if trigger.mode is Mode.MASTER_CHECK:
                for check in master_checks(record):
                    self._store_thread.call(self._store.record_check, check)
            self._store_thread.call(self._store.write_cycle, record)
        except (StoreError, InputError) as error:
            _LOG.error("cycle %s was not stored: %s", record.uuid, error)
            self._error = LineErrorCode.STORE_FAULT
            return None
        return self._clock()

    def _tell(self, record: CycleRecord, committed_s: float | None) -> Outcome | None:
        """Tell the line what the record says, or that there is none."""
        sequence = record.trigger_sequence
        if isinstance(self._interruption, Reset):
            # The line forgot this vehicle; its number may be in use again.
            return None
        standing = Standing.COMMITTED if committed_s is not None else Standing.NOT_COMMITTED
        if self._interruption is not None:
            standing = Standing.ABORTED
            if record.outcome is not CycleOutcome.ABORTED:
                self._note(Severity.WARNING, Closing.ABORTED_LATE, closing_text(record.uuid, sequence))
        answers = answers_of(record, standing)
        try:
            return self._line.send_results(sequence, answers.wheels, answers.axles, answers.vehicle)
        except (LineError, InputError) as error:
            _LOG.error("results of cycle %s were not sent: %s", record.uuid, error)
            self._note(Severity.ERROR, "not_reported", f"cycle {record.uuid}: {error}")
            self._error = LineErrorCode.LINE_FAULT
            return None

    def _offer_again(self) -> None:
        """Hold the last cycle's results when the program ended before the line acknowledged them."""
        found = self._store_thread.call(unacknowledged, self._store, self._identity.station)
        if found is None:
            return
        record, standing = found
        answers = answers_of(record, standing)
        self._line.restore_results(record.trigger_sequence, answers.wheels, answers.axles, answers.vehicle)
        self._held = Held(record.trigger_sequence, record.uuid, StationState.IDLE)
        self._machine = StateMachine(self._entered, StationState.REPORTING)
        _LOG.warning("results of cycle %s were not acknowledged and are offered again", record.uuid)

    def _await_acknowledgement(self) -> None:
        """Wait for a while here, so that a cycle ends in one step; the results stay held beyond it."""
        assert self._held is not None
        sequence = self._held.sequence
        deadline = self._clock() + self._bounds.acknowledge_s
        while (remaining := deadline - self._clock()) > 0:
            command = self._line.next_command(min(remaining, 5 * POLL_S))
            if isinstance(command, Acknowledge) and command.sequence == sequence:
                self._close_held(Closing.ACKNOWLEDGED)
                return
            if isinstance(command, Reset):
                self._recover()
                return
        self._note(
            Severity.WARNING,
            str(LineErrorCode.NOT_ACKNOWLEDGED),
            f"results of start {sequence} were not acknowledged within {self._bounds.acknowledge_s:g} s and "
            "are held",
        )

    def _close_held(self, how: Closing) -> None:
        """Record what became of the held results, and go on."""
        held, self._held = self._held, None
        assert held is not None
        if held.cycle is not None:
            severity = Severity.INFO if how is Closing.ACKNOWLEDGED else Severity.WARNING
            self._note(severity, how, closing_text(held.cycle, held.sequence))
        self._machine.enter(held.after)

    def _needs_reset(self, report: CycleReport) -> bool:
        not_told = report.told is None and not isinstance(self._interruption, Reset)
        return (
            report.committed_s is None
            or not_told
            or bool(self._running)
            or any(failure.needs_reset for failure in report.evaluation.failures)
        )

    def _drain(self) -> None:
        """After an abort, wait for the wheels that were left behind: their cameras are still in use."""
        if self._running and self._interruption is not None:
            _, self._running = wait(self._running, self._bounds.measure_s)
            if self._running:
                self._error = LineErrorCode.CYCLE_TIMEOUT

    def _recover(self) -> None:
        """Leave the fault if what failed is back; held results are given up."""
        if self._held is not None:
            self._close_held(Closing.DISCARDED)
        if self.state is not StationState.FAULT:
            self._entered(self.state)
            return
        self._running = {future for future in self._running if not future.done()}
        failures = connect_all([position.rig for position in self._positions.values()])
        if self._running:
            self._error = LineErrorCode.CYCLE_TIMEOUT
        elif failures:
            self._error = LineErrorCode.CAMERA_FAULT
            self._provoked.say((Severity.ERROR, str(self._error)), "; ".join(map(str, failures)))
        elif not self._note(Severity.INFO, "reset", "the line reset the station"):
            self._error = LineErrorCode.STORE_FAULT
        else:
            self._machine.enter(StationState.IDLE)
            return
        self._entered(StationState.FAULT)

    def _poll(self, trigger: Trigger) -> bool:
        """Look for an abort of this trigger or a reset; true when the cycle is to end."""
        if self._interruption is None:
            self._interrupt(self._line.next_command(0.0), trigger)
        return self._interruption is not None

    def _interrupt(self, command: Command | None, trigger: Trigger) -> bool:
        of_this = isinstance(command, Abort) and command.sequence == trigger.sequence
        if of_this or isinstance(command, Reset):
            self._interruption = command
        return self._interruption is not None

    def _entered(self, state: StationState) -> None:
        if state is StationState.IDLE:
            self._error, self._fault_wheel = LineErrorCode.NONE, None
        self._line.publish(StationStatus(state, self._error, self._fault_wheel))
        self._observer.entered(state)

    def _note(self, severity: Severity, code: str, text: str) -> bool:
        """Record an event; false when the database did not take it, which the next commit will meet too."""
        try:
            self._store_thread.call(self._store.record_event, self._event(severity, code, text))
        except StoreError as error:
            _LOG.error("event %s was not stored: %s (%s)", code, text, error)
            return False
        return True

    def _event(self, severity: Severity, code: str, text: str) -> EventRecord:
        return EventRecord(
            self._now(), self._identity.station, severity, "station.cycle", code, text, self._clock()
        )
