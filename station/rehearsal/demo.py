"""The demonstration: a simulated line from trigger to committed result, with the truth beside it."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from alignment.errors import ConfigurationError, LineError, StoreError
from db.records import CycleOutcome, Verdict, WheelOutcome
from sensors.formats import LoadOptions, WheelTruth
from sensors.simulation import PoseDrawer, SimulatedOptions, SimulatedRig, angles_about
from station.configuration import Configuration, RigSettings, Tolerance, VehicleType
from station.cycle import CycleReport, JudgedWheel, Observer, Outcome, WheelResult, axle_of, combined
from station.line.plc import PlcOrder, PlcResult, PlcSimulator, PlcTimeouts
from station.line.tools import decode_log, trace_cycles
from station.line.wire import BusSettings, open_bus
from station.running import OpenStation, open_station

# A screen behind other work may be slow; a real line would not wait so long.
_TIMEOUTS = PlcTimeouts(
    connect_s=60.0, ready_s=60.0, busy_s=30.0, done_s=900.0, acknowledged_s=30.0, silence_s=30.0
)
_SPREAD = 0.2  # of the tolerance: wheels of a good vehicle
_REAR_LOAD = 0.8  # of the front tyres' bulge
_FAR_OUT = 1.6  # of the tolerance: the bad wheel of every second vehicle
_CHANNELS = itertools.count(1)


@dataclass(frozen=True)
class DemoWheel:
    """One wheel as measured, with what it really was. Angles in degrees, errors in arcminutes."""

    wheel: str
    outcome: WheelOutcome
    verdict: Verdict
    reason: str | None
    camber_deg: float | None
    toe_deg: float | None
    camber_u95_deg: float | None
    toe_u95_deg: float | None
    truth: WheelTruth
    camber_error_arcmin: float | None
    toe_error_arcmin: float | None


@dataclass(frozen=True)
class OrderCheck:
    """When things happened, seconds after the start command; `in_order` also needs the CAN log to agree."""

    trigger_s: float
    busy_s: float
    committed_s: float
    first_result_s: float
    done_s: float
    in_order: bool


@dataclass(frozen=True)
class DemoVehicle:
    """One vehicle: what the line was told, what was stored, and the order of events."""

    vin: str
    vehicle_type: str
    outcome: Outcome
    stored_outcome: CycleOutcome
    cycle: str
    wheels: tuple[DemoWheel, ...]
    order: OrderCheck


@dataclass(frozen=True)
class DemoResult:
    """The whole demonstration.

    Attributes
    ----------
    counts
        Rows of each table of the database afterwards.
    """

    vehicles: tuple[DemoVehicle, ...]
    database: str
    can_log: Path
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def goal_met(self) -> bool:
        """Whether every wheel was measured and every answer followed its commit."""
        wheels = (wheel for vehicle in self.vehicles for wheel in vehicle.wheels)
        return all(vehicle.order.in_order for vehicle in self.vehicles) and all(
            wheel.outcome is WheelOutcome.MEASURED for wheel in wheels
        )


class _Reports(Observer):
    def __init__(self, wheel_done: Callable[[], None]) -> None:
        self.cycles: list[CycleReport] = []
        self._wheel_done = wheel_done

    def wheel_done(self, result: WheelResult) -> None:
        self._wheel_done()

    def cycle_done(self, report: CycleReport) -> None:
        self.cycles.append(report.without_images())


def demo_configuration(
    configuration: Configuration, database_url: str, can_log: Path, load_mm: float = 0.0
) -> Configuration:
    """Return a configuration with a line in this process, and database and log where the demo wants them.

    Its wheels stand on their tyres with a bulge of `load_mm` in front and less behind, but for rigs of whom
    the file says what wheels they see.

    Raises
    ------
    ConfigurationError
        When a rig is not simulated: only then is the truth known.
    """
    settings = configuration.settings
    for index, rig in enumerate(settings.rigs):
        if rig.driver != "simulated":
            raise ConfigurationError(
                file=configuration.file,
                field=f"rigs[{index}].simulated",
                expected="simulated cameras, because a demonstration needs the truth",
                seen="others",
                cure="Use configs/station.toml",
            )
    channel = f"demo-{next(_CHANNELS)}"
    line = settings.line.model_copy(
        update={
            "interface": "virtual",
            "channel": channel,
            "log": str(can_log.resolve()),
            "options": {},
            "acknowledge_timeout_s": 30.0,
            "communication_timeout_s": 30.0,
        }
    )
    database = settings.database.model_copy(update={"url": database_url, "create": True})
    return Configuration(
        configuration.file,
        settings.model_copy(
            update={
                "line": line,
                "database": database,
                "rigs": tuple(_on_the_road(rig, load_mm) for rig in settings.rigs),
            }
        ),
        configuration.vehicle_types,
    )


def _on_the_road(rig: RigSettings, load_mm: float) -> RigSettings:
    options = rig.options
    assert isinstance(options, SimulatedOptions)
    if not load_mm or options.load is not None or options.vehicle is not None:
        return rig
    load = LoadOptions(bulge_mm=load_mm if rig.axle == "front" else _REAR_LOAD * load_mm)
    return rig.model_copy(update={rig.tables[rig.driver]: options.model_copy(update={"load": load})})


def run_demo(
    configuration: Configuration,
    vehicles: int,
    seed: int = 0,
    wheel_done: Callable[[], None] = lambda: None,
) -> DemoResult:
    """Run vehicles through a station with simulated rigs; the real pipeline, line and database.

    Parameters
    ----------
    configuration
        From `demo_configuration`.
    vehicles
        How many.
    seed
        Of the vehicles' angles.
    wheel_done
        Called for every finished wheel, in the station's thread.

    Raises
    ------
    TruewheelError
        When the station does not start, or a cycle does not end.
    """
    kind = configuration.vehicle_types[min(configuration.vehicle_types)]
    rng = np.random.default_rng(seed)
    reports = _Reports(wheel_done)
    shown: list[tuple[PlcResult, dict[str, WheelTruth]]] = []
    with (
        open_station(configuration, reports) as station,
        _served(station),
        _plc(configuration, station) as plc,
    ):
        rigs = [position.rig for position in station.positions]
        simulated = [rig for rig in rigs if isinstance(rig, SimulatedRig)]
        for number in range(vehicles):
            poses = vehicle_poses(kind, [rig.name for rig in simulated], number, rng)
            for rig in simulated:
                rig.pose = poses[rig.name]
            vin = f"TWDEMX{seed % 100_000:05d}{number + 1:06d}"
            order = PlcOrder(vin, kind.number, tuple(rig.name for rig in simulated))
            result = plc.run(order)
            shown.append((result, {rig.name: rig.truth for rig in simulated}))
        counts = station.store.counts()
        line_database = station.line_database
    log = Path(configuration.settings.line.log or "")
    traces = trace_cycles(decode_log(log, line_database))
    if len(traces) != len(shown):
        raise LineError(f"expected {len(shown)} cycles in {log}, found {len(traces)}")
    return DemoResult(
        tuple(
            _vehicle(kind, report, result, truth, trace.in_order)
            for report, (result, truth), trace in zip(reports.cycles, shown, traces, strict=True)
        ),
        configuration.database_url,
        log,
        counts,
    )


def vehicle_poses(
    kind: VehicleType, wheels: Sequence[str], number: int, rng: np.random.Generator
) -> dict[str, PoseDrawer]:
    """Draw the wheels of one vehicle: inside the limits, but one wheel of every second one far outside."""
    poses: dict[str, PoseDrawer] = {}
    bad = wheels[int(rng.integers(len(wheels)))] if number % 2 else None
    bad_angle = int(rng.integers(2))
    for wheel in wheels:
        tolerances = kind.axles[axle_of(wheel)]
        angles = []
        for index, tolerance in enumerate((tolerances.camber, tolerances.toe)):
            middle, half = _middle_and_half_deg(tolerance)
            far = _FAR_OUT * half * rng.choice([-1.0, 1.0]) if wheel == bad and index == bad_angle else 0.0
            angles.append(middle + far + _SPREAD * half * rng.uniform(-1.0, 1.0))
        poses[wheel] = angles_about(angles[0], angles[1], spread_deg=0.0)
    return poses


def _middle_and_half_deg(tolerance: Tolerance) -> tuple[float, float]:
    limits = tolerance.limits()
    return math.degrees(limits.low + limits.high) / 2, math.degrees(limits.high - limits.low) / 2


@contextmanager
def _served(station: OpenStation) -> Iterator[None]:
    """Serve in a thread of its own while the controller works here."""
    stopping = threading.Event()
    with ThreadPoolExecutor(1, "station") as pool:
        served: Future[None] = pool.submit(station.cycle.serve, stopping)
        try:
            yield
        finally:
            stopping.set()
    served.result()


@contextmanager
def _plc(configuration: Configuration, station: OpenStation) -> Iterator[PlcSimulator]:
    line = configuration.settings.line
    settings = BusSettings(line.interface, line.channel, line.bitrate)
    with (
        open_bus(settings) as bus,
        PlcSimulator(bus, station.line_database, time.monotonic, _TIMEOUTS) as plc,
    ):
        yield plc


def _vehicle(
    kind: VehicleType,
    report: CycleReport,
    result: PlcResult,
    truth: dict[str, WheelTruth],
    log_in_order: bool,
) -> DemoVehicle:
    if report.committed_s is None or report.record.vehicle is None:
        raise StoreError(
            f"the cycle of start {result.sequence} was not stored, and the line was told "
            f"{result.vehicle.outcome}"
        )
    start = result.started_s
    first_result_s = min(
        message.time_s
        for message in result.received
        if ("Result" in message.name or "Uncertainty" in message.name)
        and message.values["Sequence"] == result.sequence
    )
    times = (start, result.busy_s, report.committed_s, first_result_s, result.done_s)
    return DemoVehicle(
        vin=report.record.vehicle.vin,
        vehicle_type=kind.name,
        outcome=result.vehicle.outcome,
        stored_outcome=report.record.outcome,
        cycle=str(report.record.uuid),
        wheels=tuple(_wheel(wheel, truth[wheel.result.wheel]) for wheel in report.evaluation.wheels),
        order=OrderCheck(
            trigger_s=0.0,
            busy_s=result.busy_s - start,
            committed_s=report.committed_s - start,
            first_result_s=first_result_s - start,
            done_s=result.done_s - start,
            in_order=log_in_order and list(times) == sorted(times),
        ),
    )


def _wheel(wheel: JudgedWheel, truth: WheelTruth) -> DemoWheel:
    result, found = wheel.result, wheel.result.measurement
    camber, toe = (None, None) if found is None else (math.degrees(found.camber), math.degrees(found.toe))
    return DemoWheel(
        wheel=result.wheel,
        outcome=WheelOutcome.MEASURED if result.failure is None else result.failure.outcome,
        verdict=combined(wheel.angles).verdict,
        reason=None if result.failure is None else result.failure.text,
        camber_deg=camber,
        toe_deg=toe,
        camber_u95_deg=None if found is None else math.degrees(found.camber_u95),
        toe_u95_deg=None if found is None else math.degrees(found.toe_u95),
        truth=truth,
        camber_error_arcmin=None if camber is None else 60.0 * (camber - truth.camber_deg),
        toe_error_arcmin=None if toe is None else 60.0 * (toe - truth.toe_deg),
    )
