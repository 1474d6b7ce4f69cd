"""A measuring cycle with everything around it replaced: rigs, store, line, clock, measurement."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np

from alignment.errors import CameraError, StoreUnavailableError, TruewheelError
from alignment.geometry.transforms import RigidTransform
from alignment.values import MeasureSettings, Refusal, Side, WheelMeasurement, nominal_vehicle_from_rig
from db.records import (
    AdjustingRecord,
    CalibrationCheckRecord,
    CycleRecord,
    EventRecord,
    StoredCycle,
    ZeroRecord,
)
from station.configuration.vehicle_types import VehicleType
from station.cycle.measuring import MeasuringCycle
from station.cycle.ports import Bounds, CycleReport, Identity, Observer
from station.cycle.recording.master_duty import Masters
from station.cycle.wheels.frame import CommonFrame
from station.cycle.wheels.positions import CalibrationInForce, MeasureFunction, WheelPosition
from station.cycle.wheels.series import SeriesChoice
from station.cycle.words.cycle import (
    Acknowledge,
    Command,
    ErrorCode,
    LiveAngles,
    Mode,
    Outcome,
    StationState,
    StationStatus,
    Trigger,
    vehicle_outcome,
)
from station.cycle.words.guidance import Guidance
from station.cycle.words.master import MasterShown
from station.cycle.words.steering import SweepProgress
from station.cycle.words.vehicle import NOTHING_TOLD, ToldOfVehicle
from station.health.observer import WatchingObserver
from station.health.watch import CameraWatch
from tests.sensors.samples import calibration as sample_calibration
from tests.sensors.samples import shot as sample_shot

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
VIN = "TWDEMX00000000001"
TODAY = datetime(2026, 3, 2, 12, tzinfo=UTC)
GATE_S = 10.0
TOLERANCE = {"nominal_deg": 0.0, "tolerance_deg": 0.5}
AXLE = {"camber": TOLERANCE, "toe": TOLERANCE, "total_toe": TOLERANCE, "camber_difference": TOLERANCE}
KIND = VehicleType.model_validate(
    {"number": 1, "name": "Car", "axles": {"front": AXLE, "rear": AXLE}, "thrust_angle": TOLERANCE}
)


_CERTIFIED = {"nominal_deg": 0.0, "tolerance_deg": 0.15}
_MASTER_AXLE = {"camber": _CERTIFIED, "toe": _CERTIFIED}
MASTER = VehicleType.model_validate(
    {"number": 7, "name": "Master", "axles": {"front": _MASTER_AXLE, "rear": _MASTER_AXLE}}
)


class Clock:
    """Seconds that pass only while somebody waits on the line."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


class FakeRig:
    """Delivers a shot, or fails as told; `gate` holds `shoot` until it is set."""

    def __init__(self, name: str, log: list[str]) -> None:
        self.name = name
        self.log = log
        self.arm_error: TruewheelError | None = None
        self.shoot_error: TruewheelError | None = None
        self.connect_error: TruewheelError | None = None
        self.gate: threading.Event | None = None
        self.shooting = threading.Event()
        self.shot = sample_shot(rig=name)

    def connect(self) -> None:
        self.log.append(f"connected {self.name}")
        if self.connect_error is not None:
            raise self.connect_error

    def arm(self) -> None:
        if self.arm_error is not None:
            raise self.arm_error
        self.log.append(f"armed {self.name}")

    def shoot(self, timeout_s: float) -> Any:
        self.shooting.set()
        if self.gate is not None:
            assert self.gate.wait(GATE_S)
        if self.shoot_error is not None:
            raise self.shoot_error
        return self.shot

    def close(self) -> None:
        self.log.append(f"closed {self.name}")


class FakeLine:
    """Delivers queued commands, and others as soon as the cycle is in a certain state."""

    def __init__(self, clock: Clock, log: list[str]) -> None:
        self.clock = clock
        self.log = log
        self.queue: list[Command] = []
        self.at: dict[StationState, Command] = {}
        self.on_poll: Callable[[], None] = lambda: None
        self.on_delivery: Callable[[], None] = lambda: None
        self.acknowledges = True
        self.status = StationStatus(StationState.FAULT, ErrorCode.STARTING)
        self.statuses: list[StationStatus] = []
        self.sent: list[tuple[Any, ...]] = []
        self.refused: list[tuple[int, ErrorCode]] = []
        self.send_error: TruewheelError | None = None
        self.live: list[tuple[LiveAngles, float]] = []
        self.on_live: Callable[[], None] = lambda: None
        self.guided: list[tuple[Guidance, float]] = []
        self.swept: list[SweepProgress] = []
        self.masters: list[MasterShown] = []
        self.on_sweep: Callable[[SweepProgress], None] = lambda progress: None
        self.vehicle: Callable[[], ToldOfVehicle] = lambda: NOTHING_TOLD

    def next_command(self, timeout_s: float) -> Command | None:
        self.on_poll()
        if self.status.state in self.at:
            command = self.at.pop(self.status.state)
            self.on_delivery()
            return command
        if self.queue:
            return self.queue.pop(0)
        self.clock.now += timeout_s
        return None

    def publish(self, status: StationStatus) -> None:
        self.status = status
        self.statuses.append(status)
        self.log.append(f"state {status.state}")

    def send_results(
        self, sequence: int, wheel_answers: Any, axle_answers: Any = (), vehicle_answer: Any = None
    ) -> Outcome:
        if self.send_error is not None:
            raise self.send_error
        self.log.append("results")
        self.sent.append((sequence, wheel_answers, axle_answers, vehicle_answer))
        if self.acknowledges:
            self.queue.append(Acknowledge(sequence))
        return vehicle_outcome(wheel_answers, axle_answers, vehicle_answer)

    def restore_results(
        self, sequence: int, wheel_answers: Any, axle_answers: Any = (), vehicle_answer: Any = None
    ) -> Outcome:
        return self.send_results(sequence, wheel_answers, axle_answers, vehicle_answer)

    def publish_live(self, angles: LiveAngles, measured_s: float) -> None:
        self.live.append((angles, measured_s))
        self.on_live()

    def publish_guidance(self, guidance: Guidance, measured_s: float) -> None:
        self.guided.append((guidance, measured_s))

    def publish_sweep(self, progress: SweepProgress) -> None:
        self.swept.append(progress)
        self.on_sweep(progress)

    def publish_master(self, master: MasterShown) -> None:
        self.masters.append(master)

    def told(self) -> ToldOfVehicle:
        return self.vehicle()

    def refuse(self, sequence: int, code: ErrorCode) -> None:
        self.refused.append((sequence, code))

    @property
    def outcomes(self) -> dict[str, Outcome]:
        return {answer.wheel: answer.outcome for answer in self.sent[-1][1]}


class FakeStore:
    """Keeps records in lists; `error` makes every write fail, `gate` makes writes hang."""

    def __init__(self, log: list[str]) -> None:
        self.log = log
        self.cycles: list[CycleRecord] = []
        self.calibrations: list[Any] = []
        self.events: list[EventRecord] = []
        self.checks: list[CalibrationCheckRecord] = []
        self.zeros: tuple[ZeroRecord, ...] = ()
        self.zeros_error: TruewheelError | None = None
        self.error: TruewheelError | None = None
        self.gate: threading.Event | None = None
        # Called with every record before it is kept: raises, or waits.
        self.hold: Callable[[Any], None] = lambda record: None
        # And after it was kept, before the call returns.
        self.landed: Callable[[Any], None] = lambda record: None

    def _write(self, records: list[Any], record: Any) -> None:
        if self.gate is not None:
            assert self.gate.wait(GATE_S)
        if self.error is not None:
            raise self.error
        self.hold(record)
        if record not in records:
            records.append(record)
        self.landed(record)

    def write_cycle(self, record: CycleRecord) -> None:
        self._write(self.cycles, record)
        self.log.append("commit")

    def record_calibration(self, record: Any) -> None:
        self._write(self.calibrations, record)

    def record_event(self, record: EventRecord) -> None:
        self._write(self.events, record)

    def record_check(self, record: CalibrationCheckRecord) -> None:
        self._write(self.checks, record)

    def write_master_check(self, record: CycleRecord, checks: Any, outcomes: Any) -> None:
        self.write_cycle(record)
        for check in checks:
            self.record_check(check)
        for outcome in outcomes:
            self.record_event(outcome)

    def recent_cycles(self, n: int, station: str | None = None) -> tuple[StoredCycle, ...]:
        found = [record for record in self.cycles[::-1] if station in (None, record.station)]
        return tuple(StoredCycle(record, TODAY) for record in found[:n])

    def cycle(self, uuid: UUID) -> StoredCycle | None:
        return next((StoredCycle(record, TODAY) for record in self.cycles if record.uuid == uuid), None)

    def cycle_events(self, cycle: UUID, codes: Sequence[str]) -> tuple[EventRecord, ...]:
        newest = {event.code: event for event in self.events if event.cycle_uuid == cycle}
        return tuple(event for code, event in newest.items() if code in codes)

    def zeros_in_force(self, installed: Sequence[tuple[str, str]] | None = None) -> tuple[ZeroRecord, ...]:
        if self.zeros_error is not None:
            raise self.zeros_error
        return self.zeros

    def recent_adjustings(self, station: str, vehicle_type: str, n: int) -> tuple[AdjustingRecord, ...]:
        found = []
        for record in self.cycles[::-1]:
            name = None if record.vehicle is None else record.vehicle.vehicle_type
            if (record.station, name) == (station, vehicle_type):
                found += [turned for turned in record.adjustings if turned.nuts_locked]
        return tuple(found[:n])

    @property
    def event_codes(self) -> list[str]:
        return [event.code for event in self.events]


def measurement(camber: float = 0.001, toe: float = 0.001, u: float = 1e-5) -> WheelMeasurement:
    return WheelMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=np.diag([u**2, u**2]),
        normal=np.array([0.0, 0.0, 1.0]),
        centre=np.zeros(3),
        offset_mm=0.0,
        points_used=9000,
        residual_rms_mm=0.03,
        heads=(),
        method="tyre_plane/revolution",
        knock_evidence=-5.0,
        unseen=(2e-4, 1e-4),
    )


class Bench:
    """A cycle in state IDLE with four rigs, and all its parts at hand."""

    def __init__(
        self,
        measure_s: float = 60.0,
        store_s: float = 5.0,
        adjust_s: float = 600.0,
        image_folder: Path | None = None,
        store: Any = None,
        coverage_factor: float = 2.0,
        frame: CommonFrame | None = None,
        places: Mapping[str, tuple[float, float, float]] | None = None,
        series: SeriesChoice | None = None,
        types: Mapping[int, VehicleType] | None = None,
        retake_within_s: float = 0.0,
        stopped: Callable[[Any, WheelMeasurement], str | None] = lambda shot, found: None,
        watch: CameraWatch | None = None,
        masters: Masters | None = None,
        today: datetime = TODAY,
    ) -> None:
        self._retake_within_s, self._stopped = retake_within_s, stopped
        self._places = places or {}
        self._needs_place = frame is not None and frame.reference == "vehicle"
        self.log: list[str] = []
        self.clock = Clock()
        self.today = today
        self.line = FakeLine(self.clock, self.log)
        self.store = FakeStore(self.log) if store is None else store
        self.rigs = {name: FakeRig(name, self.log) for name in WHEELS}
        self.found: dict[str, WheelMeasurement | Refusal] = {}
        self.raises: Exception | None = None
        positions = [self._position(rig) for rig in self.rigs.values()]
        self.types = {
            1: KIND,
            MASTER.number: MASTER,
            9: KIND.model_copy(update={"number": 9, "axles": {"front": KIND.axles["front"]}}),
            **(types or {}),
        }
        self.cycle = MeasuringCycle(
            Identity("station_1", "1.0", "abc"),
            positions,
            self.types,
            self.line,
            self.store,
            Bounds(measure_s, store_s, acknowledge_s=2.0, adjust_s=adjust_s),
            coverage_factor,
            None if watch is None else WatchingObserver(Observer(), watch),
            clock=self.clock,
            now=lambda: self.today,
            image_folder=image_folder,
            frame=frame,
            series=series,
            masters=masters,
        )

    def put_rig(self, rig: Any) -> None:
        """Let another rig stand in the place of that of its name."""
        self.rigs[rig.name] = rig
        self.cycle._positions[rig.name].rig = rig

    def wheels_at_rest(self, timeout_s: float) -> bool:
        """Wait until no wheel is measured any more; whether that came within the time."""
        return self.cycle._wheel_threads.drain(timeout_s)

    def end_thread_of(self, wheel: str) -> None:
        """End the thread of a wheel, as a defect would."""
        next(
            worker for worker in self.cycle._wheel_threads.workers if worker.name == f"wheel {wheel}"
        ).close()

    def everything_stored(self) -> bool:
        """Wait until nothing is on its way into the store; whether that came in time."""
        return self.cycle._ledger.settle()

    @property
    def owes(self) -> bool:
        """Whether the store is still to be given something."""
        return bool(self.cycle._ledger.owes)

    def _position(self, rig: FakeRig) -> WheelPosition:
        calibration = replace(sample_calibration(rig=rig.name, covariance=False), id=f"cal-{rig.name}")
        if rig.name in self._places:
            side: Side = "left" if rig.name.endswith("left") else "right"
            pose = RigidTransform(nominal_vehicle_from_rig(side).rotation, np.array(self._places[rig.name]))
            calibration = replace(calibration, side=side, vehicle_from_rig=pose)
        in_force = CalibrationInForce(calibration, datetime(2026, 3, 1, tzinfo=UTC), 30.0, {"id": "x"})
        measure: MeasureFunction = lambda images, known, settings: self._measure(known.calibration.rig)  # noqa: E731
        return WheelPosition(
            rig,
            in_force,
            measure,
            MeasureSettings(),
            1.0,
            self.clock,
            lambda: self.today,
            needs_place=self._needs_place,
            retake_within_s=self._retake_within_s,
            stopped=self._stopped,
        )

    def _measure(self, rig: str) -> WheelMeasurement | Refusal:
        if self.raises is not None:
            raise self.raises
        return self.found.get(rig, measurement())

    def trigger(
        self,
        sequence: int = 1,
        wheels: Sequence[str] = WHEELS,
        vehicle_type: int = 1,
        mode: Mode = Mode.AUTOMATIC,
    ) -> CycleReport | None:
        self.queue_trigger(sequence, wheels, vehicle_type, mode)
        return self.cycle.step(0.1)

    def queue_trigger(
        self,
        sequence: int = 1,
        wheels: Sequence[str] = WHEELS,
        vehicle_type: int = 1,
        mode: Mode = Mode.AUTOMATIC,
    ) -> None:
        self.line.queue.append(Trigger(sequence, tuple(wheels), vehicle_type, VIN, self.clock.now, mode))

    def let_the_rigs_shoot_too_long(self) -> None:
        """As `line.on_poll`: once all rigs are shooting, time passes."""
        if self.cycle.state is StationState.MEASURING:
            for rig in self.rigs.values():
                assert_set(rig.shooting)
            self.clock.now += 1000.0

    @property
    def states(self) -> list[StationState]:
        return [status.state for status in self.line.statuses]


@contextmanager
def open_bench(**bounds: Any) -> Iterator[Bench]:
    bench = Bench(**bounds)
    bench.cycle.start()
    try:
        yield bench
    finally:
        for part in (*bench.rigs.values(), bench.store):
            if getattr(part, "gate", None) is not None:
                part.gate.set()
        bench.cycle.close()


class Restarted:
    """The same station after its program ended: the same database, a new line, a new cycle."""

    def __init__(self, before: Bench) -> None:
        self.bench = Bench()
        self.bench.store.cycles = list(before.store.cycles)
        self.bench.store.events = list(before.store.events)
        self.bench.today = before.today
        self.bench.cycle.start()

    def __enter__(self) -> Bench:
        return self.bench

    def __exit__(self, *error: object) -> None:
        self.bench.cycle.close()


def assert_set(event: threading.Event) -> None:
    assert event.wait(GATE_S)


def camera_error() -> CameraError:
    return CameraError("front_left/head_1/left", "it burns")


def store_error() -> StoreUnavailableError:
    return StoreUnavailableError("database x is locked")
