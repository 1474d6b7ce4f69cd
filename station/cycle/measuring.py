"""The measuring cycle: from a trigger to a committed result, and only then to the answer.

Whatever fails on the way, the cycle ends in a defined state with a record that says why; the line is told OK
of a wheel only when its record is committed. Every wait is bounded, and what was given up and goes on all the
same is remembered: a wheel keeps the station at fault, a commit is set right by `station.cycle.ledger`.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from datetime import datetime, timedelta
from pathlib import Path
from uuid import UUID

from alignment.errors import InputError, LineError, StoreError
from db.records import CycleRecord, Severity, ZeroRecord
from station.configuration.vehicle_types import VehicleType
from station.cycle.adjusting import Adjusting
from station.cycle.answers import Standing, answers_of
from station.cycle.coalesced import Coalesced
from station.cycle.held import Closing, Held
from station.cycle.judging import axle_of, evaluate
from station.cycle.ledger import Ledger
from station.cycle.master_check import master_checks, unfit_master
from station.cycle.plate_images import CalibrationImages
from station.cycle.ports import Bounds, CycleReport, Identity, Line, Observer, Store
from station.cycle.positions import (
    ABORTED,
    Failure,
    WheelPosition,
    WheelResult,
    fault,
    result_of,
    utc_now,
)
from station.cycle.record import cycle_record
from station.cycle.states import StateMachine
from station.cycle.wheel_threads import WheelThreads
from station.cycle.words import (
    Abort,
    Acknowledge,
    Command,
    ErrorCode,
    Mode,
    Outcome,
    Prepare,
    Reset,
    StationState,
    StationStatus,
    Stop,
    Trigger,
)
from station.threads.health import ThreadHealth, ThreadWatch, Watched

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
    threads
        Of others, to be looked after with its own.
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
        threads: Sequence[Watched] = (),
    ) -> None:
        self._identity = identity
        self._positions = {position.name: position for position in positions}
        self._vehicle_types = vehicle_types
        self._line = line
        self._bounds = bounds
        self._coverage_factor = coverage_factor
        self._observer = observer or Observer()
        self._clock = clock
        self._now = now
        self._machine = StateMachine(self._entered)
        self._error = ErrorCode.NONE
        self._fault_wheel: str | None = None
        self._held: Held | None = None
        self._interruption: Command | None = None
        self._stopping = threading.Event()
        self._measured_s = 0.0
        self._wheel_threads = WheelThreads(self._positions)
        self._images = (
            None if image_folder is None else CalibrationImages(image_folder, self._wheel_threads, bounds)
        )
        self._ledger = Ledger(store, identity, bounds.store_s, clock, now)
        self._watch = ThreadWatch([*threads, self._ledger.worker, *self._wheel_threads.workers])
        self._provoked = Coalesced[tuple[Severity, str]](lambda kind, text: self._note(*kind, text), clock)

    @property
    def state(self) -> StationState:
        """Where the cycle is."""
        return self._machine.state

    @property
    def threads(self) -> tuple[ThreadHealth, ...]:
        """How the threads of the station are."""
        return self._watch.health

    def start(self) -> None:
        """Record the calibrations and the start, and be ready for triggers.

        Results of an earlier run that the line did not acknowledge are offered again first.

        Raises
        ------
        StoreError
            When they cannot be recorded.
        """
        self._ledger.begin(position.in_force.record() for position in self._positions.values())
        self._offer_again()
        self._line.publish(StationStatus(self.state))

    def close(self) -> None:
        """End the threads within a bound; a wheel or a commit that hangs is left to itself."""
        self._wheel_threads.close()
        self._provoked.flush()
        self._ledger.close()

    def serve(self, stopping: threading.Event) -> None:
        """Serve commands until told to stop; a cycle that has begun is finished, but for adjusting.

        Whatever unforeseen error ends it, the line is told of a fault first.
        """
        self._stopping = stopping
        try:
            while not stopping.is_set():
                self.step(5 * POLL_S)
        except BaseException:
            self._error = ErrorCode.INTERNAL_FAULT
            if self.state is StationState.FAULT:
                self._entered(StationState.FAULT)
            else:
                self._machine.enter(StationState.FAULT)
            raise

    def step(self, timeout_s: float) -> CycleReport | None:
        """Serve the next command, waiting at most `timeout_s` for it; return the report if it was a cycle."""
        self._provoked.flush_due()
        self._ledger.look()
        for text in self._watch.news(self._clock()):
            _LOG.error("%s", text)
            self._note(Severity.ERROR, "thread_failed", text)
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
        self._error, self._fault_wheel = ErrorCode.NONE, None
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
        record, self._error, self._fault_wheel = cycle_record(
            self._identity,
            trigger,
            kind,
            evaluation,
            self._interruption,
            received_utc=received_utc,
            measured_s=self._measured_s,
        )
        self._machine.enter(StationState.STORING)
        committed_s = self._commit(trigger, record)
        self._poll(trigger)
        self._machine.enter(StationState.REPORTING)
        told, cycle = self._tell(record, committed_s)
        report = CycleReport(trigger, record, evaluation, committed_s, told)
        self._observer.cycle_done(report)
        self._drain()
        after = StationState.FAULT if self._needs_reset(report) else StationState.IDLE
        if told is not None:
            self._held = Held(trigger.sequence, cycle, after)
            self._await_acknowledgement()
            return report
        # Nobody will take over what nobody was told.
        if not self._ledger.end(cycle, trigger.sequence, Closing.DISCARDED):
            self._error, after = ErrorCode.STORE_FAULT, StationState.FAULT
        self._machine.enter(after)
        if isinstance(self._interruption, Reset):
            self._recover()
        return report

    def _record_images(self, trigger: Trigger) -> None:
        """Record images of the calibration plate; nothing is judged, so there is no record of a cycle."""
        assert self._images is not None
        self._machine.enter(StationState.MEASURING)
        positions = [self._positions[wheel] for wheel in trigger.wheels]
        answers, self._error, text = self._images.record(positions, trigger.sequence, self._now())
        self._machine.enter(StationState.EVALUATING)
        self._machine.enter(StationState.STORING)
        self._note(Severity.INFO if self._error is ErrorCode.NONE else Severity.ERROR, "images", text)
        self._machine.enter(StationState.REPORTING)
        after = StationState.IDLE if self._error is ErrorCode.NONE else StationState.FAULT
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
        for failure in self._arm([self._positions[wheel] for wheel in prepare.wheels]).values():
            self._provoked.say((Severity.WARNING, "not_prepared"), failure.text)

    def _arm(self, positions: Sequence[WheelPosition]) -> dict[str, Failure]:
        calls = {position.name: position.rig.arm for position in positions}
        return self._wheel_threads.each(calls, self._bounds.measure_s)

    def _refusal(self, trigger: Trigger | Prepare) -> ErrorCode | None:
        """Why this trigger cannot be served, if it cannot."""
        if self.state is not StationState.IDLE:
            return ErrorCode.RESET_REQUIRED
        if trigger.mode is Mode.CALIBRATE:
            known = self._images is not None and set(trigger.wheels) <= set(self._positions)
            return None if known else ErrorCode.MODE_NOT_AVAILABLE
        kind = self._vehicle_types.get(trigger.vehicle_type)
        if kind is None:
            return ErrorCode.UNKNOWN_VEHICLE_TYPE
        if all(wheel in self._positions and axle_of(wheel) in kind.axles for wheel in trigger.wheels):
            return None
        return ErrorCode.WHEEL_NOT_AVAILABLE

    def _measured(self, positions: Sequence[WheelPosition], trigger: Trigger) -> tuple[WheelResult, ...]:
        """Arm, shoot and measure; one result for each position, whatever happens."""
        try:
            # Asked for at every start, so that a revoked zero measurement corrects nothing any more.
            installed = [(p.in_force.calibration.rig, p.in_force.calibration.id) for p in positions]
            zeros = self._ledger.zeros(installed)
        except StoreError as error:
            return tuple(p.failed(fault(ErrorCode.STORE_FAULT, f"{p.name}: {error}")) for p in positions)
        failures = self._arm(positions)
        results = {p.name: p.failed(failures[p.name]) for p in positions if p.name in failures}
        armed = [position for position in positions if position.name not in failures]
        if trigger.mode is Mode.ADJUST and len(armed) > 0 and not self._poll(trigger):
            for position in self._adjust(armed, zeros, trigger):
                results[position.name] = position.late(self._bounds.measure_s)
                armed.remove(position)
        if armed and not self._poll(trigger):
            self._machine.enter(StationState.MEASURING)
            results |= self._run_wheels(armed, zeros, trigger)
        return tuple(results.get(p.name) or p.failed(ABORTED) for p in positions)

    def _adjust(
        self, positions: Sequence[WheelPosition], zeros: Sequence[ZeroRecord], trigger: Trigger
    ) -> tuple[WheelPosition, ...]:
        """Show live angles until a stop; an abort, a reset or the end of patience interrupts the cycle.

        Returns the positions whose last shot does not end.
        """
        self._machine.enter(StationState.ADJUSTING)
        kind, k = self._vehicle_types[trigger.vehicle_type], self._coverage_factor
        deadline, last_s = self._clock() + self._bounds.adjust_s, self._bounds.measure_s
        with Adjusting(
            self._wheel_threads, positions, zeros, kind, k, self._line, self._clock, last_s
        ) as adjusting:
            while self._interruption is None:
                adjusting.step(POLL_S)
                command = self._line.next_command(0.0)
                if isinstance(command, Stop) and command.sequence == trigger.sequence:
                    break
                stopping = self._stopping.is_set()
                if not self._interrupt(command, trigger) and (stopping or self._clock() >= deadline):
                    self._interruption = Abort(trigger.sequence, ErrorCode.ADJUST_TIMEOUT)
        if self._stopping.is_set():
            text = f"adjusting of start {trigger.sequence} was ended: the station was told to stop"
            self._note(Severity.WARNING, "stopping", text)
        # Adjusting has armed them for another shot each time; once more for the one that counts.
        self._arm([position for position in positions if position not in adjusting.late])
        return adjusting.late

    def _run_wheels(
        self, positions: Sequence[WheelPosition], zeros: Sequence[ZeroRecord], trigger: Trigger
    ) -> dict[str, WheelResult]:
        results: dict[str, WheelResult] = {}
        running = {self._wheel_threads.submit(p.name, p.run, zeros): p for p in positions}
        deadline = self._clock() + self._bounds.measure_s
        while running and not self._poll(trigger) and self._clock() < deadline:
            done, _ = wait(running, POLL_S, FIRST_COMPLETED)
            for future in done:
                result = result_of(future, running.pop(future))
                results[result.wheel] = result
                self._observer.wheel_done(result)
        self._wheel_threads.leave(running)
        if self._interruption is None:
            results |= {position.name: position.late(self._bounds.measure_s) for position in running.values()}
        return results

    def _commit(self, trigger: Trigger, record: CycleRecord) -> float | None:
        """Store the record; the time of the commit, or None when it is not certain that there was one."""
        checks = master_checks(record) if trigger.mode is Mode.MASTER_CHECK else ()
        if trigger.mode is Mode.MASTER_CHECK and (why := unfit_master(record)) is not None:
            self._note(Severity.WARNING, "no_master", why)
        committed_s = self._ledger.commit(record, checks)
        if committed_s is None:
            self._error = ErrorCode.STORE_FAULT
        return committed_s

    def _tell(self, record: CycleRecord, committed_s: float | None) -> tuple[Outcome | None, UUID]:
        """Tell the line what is stored, or that nothing is; what it was told, and the cycle that says so."""
        sequence = record.trigger_sequence
        standing = Standing.COMMITTED if committed_s is not None else Standing.NOT_COMMITTED
        why = f"the commit was not confirmed within {self._bounds.store_s:g} s"
        if self._interruption is not None:
            standing, why = Standing.ABORTED, f"the line sent {self._interruption}"
        cycle = self._ledger.tell(record, standing, committed=committed_s is not None, why=why)
        if committed_s is not None and self._ledger.owes and not self._ledger.settle():
            # After a restart the cycle alone would be believed.
            self._error = ErrorCode.STORE_FAULT
        if isinstance(self._interruption, Reset):
            # The line forgot this vehicle; its number may be in use again.
            return None, cycle
        answers = answers_of(record, standing)
        try:
            told = self._line.send_results(sequence, answers.wheels, answers.axles, answers.vehicle)
        except (LineError, InputError) as error:
            _LOG.error("results of cycle %s were not sent: %s", record.uuid, error)
            self._note(Severity.ERROR, "not_reported", f"cycle {record.uuid}: {error}")
            self._error = ErrorCode.LINE_FAULT
            if standing is Standing.COMMITTED:
                why = f"its results were not sent: {error}"
                cycle = self._ledger.tell(record, Standing.NOT_COMMITTED, committed=True, why=why)
            return None, cycle
        return told, cycle

    def _offer_again(self) -> None:
        """Hold the last cycle's results when the program ended before the line acknowledged them."""
        found = self._ledger.unacknowledged()
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
        while not self._stopping.is_set() and (remaining := deadline - self._clock()) > 0:
            command = self._line.next_command(min(remaining, 5 * POLL_S))
            if isinstance(command, Acknowledge) and command.sequence == sequence:
                self._close_held(Closing.ACKNOWLEDGED)
                return
            if isinstance(command, Reset):
                self._recover()
                return
        self._note(
            Severity.WARNING,
            str(ErrorCode.NOT_ACKNOWLEDGED),
            f"results of start {sequence} were not acknowledged within {self._bounds.acknowledge_s:g} s and "
            "are held",
        )

    def _close_held(self, how: Closing) -> None:
        """Record what became of the held results, and go on; without that record the station is not ready."""
        held, self._held = self._held, None
        assert held is not None
        after = held.after
        stored = held.cycle is None or self._ledger.end(held.cycle, held.sequence, how)
        if not stored and after is not StationState.FAULT:
            self._error, self._fault_wheel, after = ErrorCode.STORE_FAULT, None, StationState.FAULT
        self._machine.enter(after)

    def _needs_reset(self, report: CycleReport) -> bool:
        not_told = report.told is None and not isinstance(self._interruption, Reset)
        return (
            report.committed_s is None
            or not_told
            or self._wheel_threads.left
            or self._ledger.owes
            or any(failure.needs_reset for failure in report.evaluation.failures)
        )

    def _drain(self) -> None:
        """After an abort, wait for the wheels that were left behind: their cameras are still in use."""
        if self._interruption is not None and not self._wheel_threads.drain(self._bounds.measure_s):
            self._error = ErrorCode.CYCLE_TIMEOUT

    def _recover(self) -> None:
        """Leave the fault if what failed is back; held results are given up."""
        if self._held is not None:
            self._close_held(Closing.DISCARDED)
        if self.state is not StationState.FAULT:
            self._entered(self.state)
            return
        if self._wheel_threads.left:
            # Their cameras are in use, and are not to be touched from here.
            self._error = ErrorCode.CYCLE_TIMEOUT
        elif failures := self._wheel_threads.each(
            {position.name: position.rig.connect for position in self._positions.values()},
            self._bounds.measure_s,
        ):
            self._error = ErrorCode.CAMERA_FAULT
            text = "; ".join(failure.text for failure in failures.values())
            self._provoked.say((Severity.ERROR, str(self._error)), text)
        elif not (self._ledger.settle() and self._note(Severity.INFO, "reset", "the line reset the station")):
            self._error = ErrorCode.STORE_FAULT
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
            self._error, self._fault_wheel = ErrorCode.NONE, None
        self._line.publish(StationStatus(state, self._error, self._fault_wheel))
        self._observer.entered(state)

    def _note(self, severity: Severity, code: str, text: str) -> bool:
        return self._ledger.note(severity, code, text)
