"""A station whose wheels turn: prepared exposures, real series, cycle, line and database.

Exposures come at their times from memory. They are measured from their images, or with prepared tyre planes.
"""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from alignment.arrays import Array
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, RigCalibration, StereoImages, WheelMeasurement
from alignment.vehicle import camber_toe, normal_from_angles
from sensors.camera import Frame
from sensors.shot import HeadFrames, WheelShot
from station.configuration import VehicleType
from station.cycle import CalibrationInForce, MeasureFunction, Outcome, SeriesChoice, WheelPosition
from station.line.plc import PlcOrder, PlcSimulator, PlcTimeouts
from station.line.wire import BusSettings, load_line_database, open_bus
from station.rehearsal.prepared import KIND, WHEELS, open_rehearsal, prepared_calibration
from station.rehearsal.processes import rss_mb

EXPOSURES = 16
_IN_TURN = itertools.count()
# A computer that does other work at the same time must not end the run.
_TIMEOUTS = PlcTimeouts(busy_s=20.0, done_s=120.0, ready_s=60.0, acknowledged_s=20.0, silence_s=10.0)
_RUN_OUT, _WANDER, _STEP = math.radians(0.19), 3.0 * ARCMIN, 2.0 * math.pi / 8.0
_NOISE = 0.02 * ARCMIN
_WIDE = {"nominal_deg": 0.0, "tolerance_deg": 1.0}
_AXLE = {"camber": _WIDE, "toe": _WIDE, "run_out_mm": 2.5}
TURNING_KIND = VehicleType.model_validate(
    {
        "number": KIND.number,
        "name": "Rehearsal on rollers",
        "measure": "spin_axis",
        "exposures": EXPOSURES,
        "axles": {"front": _AXLE, "rear": _AXLE},
    }
)


@dataclass(frozen=True)
class TurningTimes:
    """Of each cycle: from the last exposure of all wheels to the answer on the bus; memory after it.

    `cpu_s` is what the processor worked in that time, PLC and bus included: on a computer that does other
    work too it says what the answer would take alone.
    """

    answer_s: tuple[float, ...]
    rss_mb: tuple[float, ...]
    outcomes: tuple[Outcome, ...]
    cpu_s: tuple[float, ...] = ()

    def growth_mb(self, settled: int) -> float:
        """Highest memory after so many cycles, less that of then."""
        index = min(settled, len(self.rss_mb)) - 1
        return max(self.rss_mb[index:]) - self.rss_mb[index]

    def answer_ms(self, percent: float) -> float:
        """Percentile of the time to the answer, milliseconds."""
        return float(np.percentile([1e3 * time_s for time_s in self.answer_s], percent))


class PreparedRollers:
    """Stands for the cameras of one wheel on rollers: gives its exposures one after the other."""

    def __init__(self, name: str, exposures: Sequence[Sequence[StereoImages]], heads: Sequence[str]) -> None:
        self.name = name
        self._exposures, self._heads = exposures, heads
        self._taken = 0
        self.last_s = self.last_cpu_s = 0.0

    def connect(self) -> None:
        """Nothing to reach."""

    def arm(self) -> None:
        """Begin anew."""
        self._taken = 0

    def shoot(self, timeout_s: float) -> WheelShot:
        """Give the next exposure."""
        images = self._exposures[self._taken % len(self._exposures)]
        self._taken += 1
        self.last_s, self.last_cpu_s = time.monotonic(), time.process_time()

        def frame(name: str, pair: StereoImages, side: str) -> Frame:
            camera = f"{self.name}/{name}/{side}"
            return Frame(camera, getattr(pair, side), self._taken, self.last_s, self.last_s, 5.0)

        heads = tuple(
            HeadFrames(name, frame(name, pair, "left"), frame(name, pair, "right"))
            for name, pair in zip(self._heads, images, strict=True)
        )
        return WheelShot(self.name, datetime.now(UTC), heads)

    def close(self) -> None:
        """Nothing to let go."""


def prepared_planes(seed: int) -> list[WheelMeasurement]:
    """Tyre planes of a wheel that goes twice round and wanders slowly, on the left; its axis lies at zero."""
    rng = np.random.default_rng(seed)
    at = np.arange(EXPOSURES) + rng.uniform(-0.2, 0.2, EXPOSURES)
    swing = np.sin(2.0 * math.pi * at[:, None] / rng.uniform(14.0, 36.0, 5) + rng.uniform(0.0, 6.28, 5))
    planes = []
    for turned, moved in zip(_STEP * at, swing, strict=True):
        lean = _RUN_OUT * np.array([math.cos(turned), math.sin(turned)])
        camber, toe = lean + _WANDER * moved[:2] + _NOISE * rng.normal(size=2)
        planes.append(_plane(normal_from_angles(camber, toe, "left"), moved[2:]))
    return planes


def _plane(normal: Array, centre: Array) -> WheelMeasurement:
    camber, toe = camber_toe(normal, "left")
    return WheelMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=np.diag([_NOISE**2] * 2),
        normal=np.array([0.0, 0.0, 1.0]),
        centre=centre,
        offset_mm=0.0,
        points_used=9000,
        residual_rms_mm=0.03,
        heads=(),
        method="prepared",
    )


def _position(rig: PreparedRollers, calibration: RigCalibration, measure: MeasureFunction) -> WheelPosition:
    mine = replace(calibration, rig=rig.name, id=f"{calibration.id}-{rig.name}")
    in_force = CalibrationInForce(mine, datetime(2026, 1, 1, tzinfo=UTC), 36_500.0, {"id": mine.id})
    return WheelPosition(rig, in_force, measure, MeasureSettings(), 10.0)


def images_station(
    exposures: Sequence[Sequence[StereoImages]], calibration: RigCalibration
) -> tuple[list[PreparedRollers], list[WheelPosition]]:
    """Four wheels that all show the same exposures, measured from their images."""
    heads = [head.name for head in calibration.heads]
    rigs = [PreparedRollers(name, exposures, heads) for name in WHEELS]
    return rigs, [_position(rig, calibration, measure_wheel) for rig in rigs]


def planes_station(seed: int) -> tuple[list[PreparedRollers], list[WheelPosition]]:
    """Four wheels with prepared tyre planes, and small images that nobody looks at."""
    calibration = prepared_calibration(WHEELS[0])
    model = calibration.heads[0].left.model
    rng = np.random.default_rng(seed)
    shape = (model.height, model.width)

    def pictures() -> list[StereoImages]:
        left, right = rng.integers(0, 255, (2, *shape), dtype=np.uint8)
        return [StereoImages(left, right)]

    rigs, positions = [], []
    for k, name in enumerate(WHEELS):
        planes = itertools.cycle(prepared_planes(seed + k))
        rig = PreparedRollers(name, [pictures() for _ in range(EXPOSURES)], ["head_1"])

        def measure(
            images: Sequence[StereoImages],
            known: PreparedRig,
            settings: MeasureSettings,
            planes: object = planes,
        ) -> WheelMeasurement:
            found = next(planes)  # type: ignore[call-overload]
            assert isinstance(found, WheelMeasurement)
            return found

        rigs.append(rig)
        positions.append(_position(rig, calibration, measure))
    return rigs, positions


def _next_of(planes: Iterator[WheelMeasurement]) -> MeasureFunction:
    def measure(
        images: Sequence[StereoImages], known: PreparedRig, settings: MeasureSettings
    ) -> WheelMeasurement:
        return next(planes)

    return measure


def run_turning(
    folder: Path,
    dbc: Path,
    cycles: int,
    wheels: tuple[list[PreparedRollers], list[WheelPosition]],
    interval_s: float,
    progress: Callable[[int], None] = lambda done: None,
) -> TurningTimes:
    """Run cycles of four wheels with sixteen exposures each, over a bus in this process.

    Parameters
    ----------
    folder
        For the database.
    dbc
        Of the line.
    cycles
        How many.
    wheels
        Of `images_station` or `planes_station`.
    interval_s
        Between two exposures.
    progress
        Told the number of cycles that are done.

    Raises
    ------
    TruewheelError
        When a cycle fails.
    """
    rigs, positions = wheels
    settings = BusSettings("virtual", f"turning-{next(_IN_TURN)}", 500_000)
    database = load_line_database(dbc)
    answers, worked, memory = (np.full(cycles, np.nan) for _ in range(3))
    outcomes: list[Outcome] = []
    stopping = threading.Event()
    with ExitStack() as stack:
        bus, plc_bus = (stack.enter_context(open_bus(settings)) for _ in range(2))
        station = stack.enter_context(
            open_rehearsal(
                bus,
                database,
                f"sqlite:///{folder / 'turning.db'}",
                positions=positions,
                kind=TURNING_KIND,
                series=SeriesChoice(interval_s=interval_s),
            )
        )
        serving = threading.Thread(target=station.cycle.serve, args=(stopping,), name="turning station")
        serving.start()
        try:
            with PlcSimulator(plc_bus, database, timeouts=_TIMEOUTS) as plc:
                plc.start_up()
                for number in range(cycles):
                    result = plc.run(PlcOrder(f"TWTURN{number:011d}"))
                    worked[number] = time.process_time() - max(rig.last_cpu_s for rig in rigs)
                    answers[number] = result.done_s - max(rig.last_s for rig in rigs)
                    memory[number] = rss_mb()
                    outcomes.append(result.vehicle.outcome)
                    progress(number + 1)
        finally:
            stopping.set()
            serving.join(30.0)
    return TurningTimes(
        tuple(answers.tolist()), tuple(memory.tolist()), tuple(outcomes), tuple(worked.tolist())
    )
