"""The measuring cycle: from a trigger to a committed result, and only then to the answer.

Whatever fails on the way, the cycle ends in a defined state with a record that says why; the line is told OK
of a wheel only when its record is committed. Every wait is bounded; what was given up and still goes on
is remembered: a wheel keeps the station at fault, `station.cycle.ledger` sets a commit right.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path

from alignment.errors import InputError, LineError, StoreError, together
from db.records import CycleRecord, Severity
from station.configuration import VehicleType
from station.cycle.accepting import why_declined
from station.cycle.answering import Standing, answers_of
from station.cycle.coalesced import Coalesced
from station.cycle.judging import Evaluation, lengths_missed
from station.cycle.modes import (
    Adjusting,
    CalibrationImages,
    LearnedDrifts,
    RunOutBefore,
    sweep_steering,
)
from station.cycle.ports import Bounds, CycleReport, Identity, Line, Observer, Store
from station.cycle.recording import (
    Closing,
    Held,
    Ledger,
    MasterDuty,
    Masters,
    cycle_record,
    evaluated,
    run_out_notes,
)
from station.cycle.states import StateMachine
from station.cycle.under_way import NO_TROUBLE, CycleUnderWay, Trouble
from station.cycle.wheel_runs import POLL_S, run_wheels
from station.cycle.wheels import CommonFrame, SeriesChoice, WheelPosition, WheelResult, WheelThreads, utc_now
from station.cycle.words import (
    Abort,
    Acknowledge,
    ErrorCode,
    Failure,
    Mode,
    Prepare,
    Reset,
    StationState,
    StationStatus,
    Stop,
    Trigger,
    fault,
)
from station.threads import ThreadHealth, ThreadWatch, Watched

_LOG = logging.getLogger("truewheel.station")


class MeasuringCycle:
    """Serves triggers, one at a time. All methods are called from one thread.

    It keeps what lives longer than a cycle: its state and why it stands there, results that wait for their
    acknowledgement, what is owed to the database. What is of one cycle is in a `CycleUnderWay`.

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
    frame
        Of the rigs, when all stand in one, and what toes refer to.
    series
        Whether single exposures or series of them are measured, where a vehicle type does not say.
    masters
        When master checks are due; without it none is asked for.
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
        frame: CommonFrame | None = None,
        series: SeriesChoice | None = None,
        masters: Masters | None = None,
    ) -> None:
        self._identity, self._frame = identity, frame
        self._positions = {position.name: position for position in positions}
        self._vehicle_types = vehicle_types
        self._line = line
        self._bounds = bounds
        self._coverage_factor = coverage_factor
        self._observer = observer or Observer()
        self._clock = clock
        self._now = now
        self._machine = StateMachine(self._entered)
        self._trouble = NO_TROUBLE
        self._held: Held | None = None
        self._stopping = threading.Event()
        self._series = series or SeriesChoice()
        turning = any(self._series.plan(kind) is not None for kind in vehicle_types.values())
        self._wheel_threads = WheelThreads(self._positions, series=turning)
        self._images = (
            None if image_folder is None else CalibrationImages(image_folder, self._wheel_threads, bounds)
        )
        self._ledger = Ledger(store, identity, bounds.store_s, clock, now)
        self._duty = MasterDuty(masters, line, self._ledger, clock, now)
        self._drifts = LearnedDrifts(self._ledger.adjustings)
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
        self._duty.begin()
        if (held := self._ledger.offer_again(self._line)) is not None:
            self._held, self._machine = held, StateMachine(self._entered, StationState.REPORTING)
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
            self._trouble = Trouble(ErrorCode.INTERNAL_FAULT)
            if self.state is StationState.FAULT:
                self._entered(StationState.FAULT)
            else:
                self._machine.enter(StationState.FAULT)
            raise

    def step(self, timeout_s: float) -> CycleReport | None:
        """Serve the next command, waiting at most `timeout_s` for it; return the report if it was a cycle."""
        self._provoked.flush_due()
        self._ledger.look()
        self._duty.look()
        self._wheel_threads.look()
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
            self._provoked.say((Severity.WARNING, str(code)), f"{trigger}, was refused: {code}")
            return None
        received_utc = self._now() - timedelta(seconds=max(0.0, self._clock() - trigger.received_s))
        positions = [self._positions[wheel] for wheel in trigger.wheels]
        if trigger.mode is Mode.CALIBRATE:
            self._record_images(CycleUnderWay(trigger, received_utc, positions, None))
            return None
        kind = self._vehicle_types[trigger.vehicle_type]
        cycle = CycleUnderWay(trigger, received_utc, positions, kind, plan=self._series.plan(kind))
        self._enter(StationState.ARMED)
        self._measure(cycle)
        self._enter(StationState.EVALUATING)
        evaluation, record = self._judge(cycle)
        self._enter(StationState.STORING, cycle.trouble)
        self._commit(cycle, record)
        self._enter(StationState.REPORTING, cycle.trouble)
        self._tell(cycle, record)
        report = CycleReport(trigger, record, evaluation, cycle.committed_s, cycle.told)
        self._observer.cycle_done(report)
        self._end(cycle, evaluation)
        return report

    def _end(self, cycle: CycleUnderWay, evaluation: Evaluation) -> None:
        """Hold results that were told until they are acknowledged, and be ready again or not."""
        if cycle.committed_s is not None:
            # After the answer, which must not wait for it.
            self._ledger.note_run_outs(run_out_notes(evaluation), cycle.uuid)
            self._duty.after_answer()
        self._drain(cycle)
        after = StationState.FAULT if self._needs_reset(cycle, evaluation) else StationState.IDLE
        if cycle.told is not None:
            self._held = Held(cycle.sequence, cycle.last_word, after, cycle.trouble)
            self._await_acknowledgement()
            return
        # Nobody will take over what nobody was told.
        if not self._ledger.end(cycle.last_word, cycle.sequence, Closing.DISCARDED):
            cycle.trouble, after = Trouble(ErrorCode.STORE_FAULT), StationState.FAULT
        self._enter(after, cycle.trouble)
        if cycle.forgotten:
            self._recover()

    def _record_images(self, cycle: CycleUnderWay) -> None:
        """Record images of the calibration plate; nothing is judged, so there is no record of a cycle."""
        assert self._images is not None
        self._enter(StationState.ARMED)
        self._enter(StationState.MEASURING)
        answers, text = self._images.record(cycle)
        failed = cycle.trouble.code is not ErrorCode.NONE
        self._enter(StationState.EVALUATING, cycle.trouble)
        self._enter(StationState.STORING, cycle.trouble)
        self._note(Severity.ERROR if failed else Severity.INFO, "images", text)
        self._enter(StationState.REPORTING, cycle.trouble)
        after = StationState.FAULT if failed else StationState.IDLE
        if self._poll(cycle) and cycle.forgotten:
            self._enter(after, cycle.trouble)
            self._recover()
            return
        self._line.send_results(cycle.sequence, answers)
        self._held = Held(cycle.sequence, None, after, cycle.trouble)
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
        calls = {position.name: position.arm for position in positions}
        return self._wheel_threads.each(calls, self._bounds.measure_s)

    def _refusal(self, asked: Trigger | Prepare) -> ErrorCode | None:
        images, kinds = self._images is not None, self._vehicle_types
        why = why_declined(asked, self.state, self._positions, kinds, self._frame, images=images)
        return why or self._duty.refuses(asked.mode)

    def _measure(self, cycle: CycleUnderWay) -> None:
        """Arm, shoot and measure; whatever happens, `cycle.wheels` has a result of each position."""
        self._measure_wheels(cycle)
        cycle.measured_s = self._clock()

    def _measure_wheels(self, cycle: CycleUnderWay) -> None:
        try:
            # Asked for at every start, so that a revoked zero measurement corrects nothing any more.
            installed = [(p.in_force.calibration.rig, p.in_force.calibration.id) for p in cycle.positions]
            cycle.zeros = self._ledger.zeros(installed)
        except StoreError as error:
            failed = {p.name: fault(ErrorCode.STORE_FAULT, f"{p.name}: {error}") for p in cycle.positions}
            cycle.take({p.name: p.failed(failed[p.name]) for p in cycle.positions})
            return
        failures = self._arm(cycle.positions)
        cycle.take({p.name: p.failed(failures[p.name]) for p in cycle.positions if p.name in failures})
        armed = [position for position in cycle.positions if position.name not in failures]
        if cycle.trigger.mode is Mode.ADJUST and len(armed) > 0 and not self._poll(cycle):
            for position in self._adjust(cycle, armed):
                cycle.take({position.name: position.late(self._bounds.measure_s)})
                armed.remove(position)
        if cycle.trigger.mode is Mode.SWEEP and armed and not self._poll(cycle):
            self._enter(StationState.SWEEPING)
            last_s, threads = self._bounds.measure_s, self._wheel_threads
            armed = sweep_steering(threads, cycle, armed, self._line, self._clock, last_s, self._stopping)
        if armed and not self._poll(cycle):
            self._enter(StationState.MEASURING)
            cycle.said.append(self._line.told())
            self._run_wheels(cycle, armed)
            cycle.said.append(self._line.told())

    def _adjust(self, cycle: CycleUnderWay, positions: Sequence[WheelPosition]) -> tuple[WheelPosition, ...]:
        """Show live angles until a stop; an abort, a reset or the end of patience interrupts the cycle.

        Returns the positions whose last shot does not end.
        """
        self._enter(StationState.ADJUSTING)
        deadline, last_s = self._clock() + self._bounds.adjust_s, self._bounds.measure_s
        before = RunOutBefore(cycle, self._line)
        if cycle.plan is not None:
            before.find(self._wheel_threads, positions, last_s, self._clock)
        late = tuple(position for position in positions if position.name in before.late)
        ready = [position for position in positions if position not in late]
        if cycle.interrupted or before.stopped or not ready:
            self._arm(ready)
            return late
        guiding = self._drifts.guiding(cycle)
        with Adjusting(
            self._wheel_threads, cycle, ready, self._coverage_factor, self._line, self._clock, last_s,
            self._frame, before, guiding,
        ) as adjusting:  # fmt: skip
            while not cycle.interrupted:
                adjusting.step(POLL_S)
                command = self._line.next_command(0.0)
                if isinstance(command, Stop) and command.sequence == cycle.sequence:
                    break
                stopping = self._stopping.is_set()
                if not cycle.heed(command) and (stopping or self._clock() >= deadline):
                    cycle.heed(Abort(cycle.sequence, ErrorCode.ADJUST_TIMEOUT))
        for text in self._drifts.learn(cycle, guiding):
            self._note(Severity.INFO, "adjusted", text, cycle)
        if self._stopping.is_set():
            text = f"adjusting of start {cycle.sequence} was ended: the station was told to stop"
            self._note(Severity.WARNING, "stopping", text, cycle)
        # Adjusting has armed the others for another shot each time; once more for the one that counts.
        self._arm([p for p in ready if p not in adjusting.late and p.name not in adjusting.armed])
        return (*late, *adjusting.late)

    def _run_wheels(self, cycle: CycleUnderWay, positions: Sequence[WheelPosition]) -> None:
        def done(result: WheelResult) -> None:
            cycle.take({result.wheel: result})
            self._observer.wheel_done(result)

        bound_s = self._bounds.measure_s
        run_wheels(
            self._wheel_threads, cycle, positions, bound_s, self._clock, lambda: self._poll(cycle), done
        )

    def _judge(self, cycle: CycleUnderWay) -> tuple[Evaluation, CycleRecord]:
        """Judge by the limits of the vehicle type, and make the record."""
        evaluation = evaluated(cycle, self._coverage_factor, self._frame)
        self._poll(cycle)
        record, cycle.trouble = cycle_record(self._identity, cycle, evaluation)
        if (why := lengths_missed(evaluation)) is not None:
            self._note(Severity.WARNING, "geometry", why, cycle)
        return evaluation, record

    def _commit(self, cycle: CycleUnderWay, record: CycleRecord) -> None:
        """Store the record; there is no time of the commit when it is not certain that there was one."""
        cycle.committed_s = self._duty.commit(cycle, record)
        if cycle.committed_s is None:
            cycle.trouble = Trouble(ErrorCode.STORE_FAULT)
        self._poll(cycle)

    def _tell(self, cycle: CycleUnderWay, record: CycleRecord) -> None:
        """Tell the line what is stored, or that nothing is."""
        committed = cycle.committed_s is not None
        standing = Standing.COMMITTED if committed else Standing.NOT_COMMITTED
        why = f"the commit was not confirmed within {self._bounds.store_s:g} s"
        if cycle.interrupted:
            standing, why = Standing.ABORTED, f"the line sent {cycle.interruption}"
        cycle.last_word = self._ledger.tell(record, standing, committed=committed, why=why)
        if committed and self._ledger.owes and not self._ledger.settle():
            # After a restart the cycle alone would be believed.
            cycle.trouble = Trouble(ErrorCode.STORE_FAULT)
        if cycle.forgotten:
            # The line forgot this vehicle; its number may be in use again.
            return
        answers = answers_of(record, standing)
        try:
            cycle.told = self._line.send_results(
                cycle.sequence, answers.wheels, answers.axles, answers.vehicle
            )
        except (LineError, InputError) as error:
            _LOG.error("results of cycle %s were not sent: %s", cycle.uuid, error)
            self._note(Severity.ERROR, "not_reported", f"cycle {cycle.uuid}: {error}", cycle)
            cycle.trouble = Trouble(ErrorCode.LINE_FAULT)
            if standing is Standing.COMMITTED:
                why = f"its results were not sent: {error}"
                cycle.last_word = self._ledger.tell(record, Standing.NOT_COMMITTED, committed=True, why=why)

    def _await_acknowledgement(self) -> None:
        """Wait for a while here, so that a cycle ends in one step; the results stay held beyond it."""
        assert self._held is not None
        held = self._held
        deadline = self._clock() + self._bounds.acknowledge_s
        while not self._stopping.is_set() and (remaining := deadline - self._clock()) > 0:
            command = self._line.next_command(min(remaining, 5 * POLL_S))
            if isinstance(command, Acknowledge) and command.sequence == held.sequence:
                self._close_held(Closing.ACKNOWLEDGED)
                return
            if isinstance(command, Reset):
                self._recover()
                return
        bound_s = self._bounds.acknowledge_s
        text = f"results of start {held.sequence} were not acknowledged within {bound_s:g} s and are held"
        self._ledger.note(Severity.WARNING, str(ErrorCode.NOT_ACKNOWLEDGED), text, held.cycle)

    def _close_held(self, how: Closing) -> None:
        """Record what became of the held results, and go on; without that record the station is not ready."""
        held, self._held = self._held, None
        assert held is not None
        stored = held.cycle is None or self._ledger.end(held.cycle, held.sequence, how)
        if stored or held.after is StationState.FAULT:
            self._enter(held.after, held.trouble)
        else:
            self._enter(StationState.FAULT, Trouble(ErrorCode.STORE_FAULT))

    def _needs_reset(self, cycle: CycleUnderWay, evaluation: Evaluation) -> bool:
        return (
            cycle.committed_s is None
            or (cycle.told is None and not cycle.forgotten)
            or self._wheel_threads.left
            or self._ledger.owes
            or any(failure.needs_reset for failure in evaluation.failures)
        )

    def _drain(self, cycle: CycleUnderWay) -> None:
        """After an abort, wait for the wheels that were left behind: their cameras are still in use."""
        if cycle.interrupted and not self._wheel_threads.drain(self._bounds.measure_s):
            cycle.trouble = Trouble(ErrorCode.CYCLE_TIMEOUT)

    def _recover(self) -> None:
        """Leave the fault if what failed is back; held results are given up."""
        if self._held is not None:
            self._close_held(Closing.DISCARDED)
        if self.state is not StationState.FAULT:
            self._entered(self.state)
            return
        if self._wheel_threads.left:
            # Their cameras are in use, and are not to be touched from here.
            self._trouble = Trouble(ErrorCode.CYCLE_TIMEOUT)
        elif failures := self._wheel_threads.each(
            {position.name: position.rig.connect for position in self._positions.values()},
            self._bounds.measure_s,
        ):
            self._trouble = Trouble(ErrorCode.CAMERA_FAULT, next(iter(failures)))
            text = together(failure.text for failure in failures.values())
            self._provoked.say((Severity.ERROR, str(self._trouble.code)), text)
        elif not (self._ledger.settle() and self._note(Severity.INFO, "reset", "the line reset the station")):
            self._trouble = Trouble(ErrorCode.STORE_FAULT)
        else:
            self._enter(StationState.IDLE)
            return
        self._entered(StationState.FAULT)

    def _poll(self, cycle: CycleUnderWay) -> bool:
        """Look for an abort of this cycle or a reset; true when the cycle is to end."""
        return cycle.interrupted or cycle.heed(self._line.next_command(0.0))

    def _enter(self, state: StationState, trouble: Trouble = NO_TROUBLE) -> None:
        self._trouble = trouble
        self._machine.enter(state)

    def _entered(self, state: StationState) -> None:
        if state is StationState.IDLE:
            self._trouble = NO_TROUBLE
        self._line.publish(StationStatus(state, self._trouble.code, self._trouble.wheel))
        self._observer.entered(state)
        self._duty.entered(state)

    def _note(self, severity: Severity, code: str, text: str, cycle: CycleUnderWay | None = None) -> bool:
        return self._ledger.note(severity, code, text, None if cycle is None else cycle.uuid)
