"""A station whose wheels are measured at once: real line, real cycle, real database, prepared angles.

The n-th shot of every wheel has the angles `prepared_angles_deg(n)`, so a result shows which shot it is of.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import NoReturn

import numpy as np

from alignment.geometry import CameraModel, PosedCamera, RigidTransform
from alignment.values import (
    HeadCalibration,
    MeasureSettings,
    RigCalibration,
    Side,
    WheelMeasurement,
    nominal_vehicle_from_rig,
)
from alignment.wheel import LiveSpin
from db.records import ZeroRecord
from db.store import ResultStore
from sensors.shot import WheelShot
from station.configuration import VehicleType
from station.cycle import (
    Bounds,
    CalibrationInForce,
    Identity,
    Line,
    MeasuringCycle,
    Observer,
    SeriesChoice,
    Store,
    WheelPosition,
    WheelResult,
    utc_now,
)
from station.line import StationLine
from station.line.wire import DEFAULT_OPTIONS, LineBus, LineDatabase, LineOptions

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
STATION = "rehearsal"
CAMBER_STEP_DEG, CAMBERS = 2e-4, 4000
_UNCERTAINTY_RAD = 1e-5
_TOLERANCE = {"nominal_deg": 0.0, "tolerance_deg": 0.5}
_AXLE = {"camber": _TOLERANCE, "toe": _TOLERANCE, "total_toe": _TOLERANCE, "camber_difference": _TOLERANCE}
KIND = VehicleType.model_validate(
    {
        "number": 1,
        "name": "Rehearsal",
        "axles": {"front": _AXLE, "rear": _AXLE},
        "thrust_angle": _TOLERANCE,
        "sweep": {"largest_deg": 60.0, "positions": 5, "step_timeout_s": 10.0},
    }
)


def prepared_angles_deg(shot: int) -> tuple[float, float]:
    """Camber and toe of the n-th shot, degrees; within the limits, another camber for 4000 shots."""
    return (shot % CAMBERS - CAMBERS // 2) * CAMBER_STEP_DEG, 0.1


class ArmedRig:
    """Stands for the cameras of one wheel; counts how often it was armed."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.shots = 0

    def connect(self) -> None:
        """Nothing to reach."""

    def arm(self) -> None:
        """Take the next prepared shot."""
        self.shots += 1

    def shoot(self, timeout_s: float) -> WheelShot:
        """There are no images: `PreparedPosition` does not ask for any."""
        raise NotImplementedError

    def close(self) -> None:
        """Nothing to let go."""


class PreparedPosition(WheelPosition):
    """A wheel position that answers after `shot_s` seconds with the rig's prepared angles."""

    def __init__(self, rig: ArmedRig, shot_s: float) -> None:
        calibration = prepared_calibration(rig.name)
        in_force = CalibrationInForce(
            calibration, datetime(2026, 1, 1, tzinfo=UTC), 36_500.0, {"id": calibration.id}
        )
        super().__init__(rig, in_force, _never, MeasureSettings(), 1.0)
        self._prepared = rig
        self._shot_s = shot_s

    def run(
        self, zeros: Sequence[ZeroRecord] = (), live: LiveSpin | None = None, *, steered: bool = False
    ) -> WheelResult:
        """Return the result of the shot that the rig was armed for."""
        if self._shot_s > 0.0:
            time.sleep(self._shot_s)
        camber, toe = (math.radians(angle) for angle in prepared_angles_deg(self._prepared.shots))
        found = WheelMeasurement(
            camber=camber,
            toe=toe,
            angle_covariance=np.diag([_UNCERTAINTY_RAD**2] * 2),
            normal=np.array([0.0, 0.0, 1.0]),
            centre=np.zeros(3),
            offset_mm=0.0,
            points_used=9000,
            residual_rms_mm=0.03,
            heads=(),
            method="tyre_plane/prepared",
        )
        return WheelResult(self.name, self.in_force.calibration.id, True, found, None, utc_now(), None, 0.0)


def _never(*arguments: object) -> NoReturn:
    raise NotImplementedError("a prepared position measures no images")


def prepared_calibration(rig: str) -> RigCalibration:
    """Return a calibration of one small head, for a rig whose images nobody measures."""
    side: Side = "left" if rig.endswith("_left") else "right"
    camera = PosedCamera(
        CameraModel(40, 30, 90.0, 90.0, 19.5, 14.5, "brown", (0.0,) * 5),
        RigidTransform.from_rotvec(np.zeros(3), np.zeros(3)),
    )
    head = HeadCalibration("head_1", camera, camera)
    return RigCalibration(f"prepared-{rig}", rig, side, (head,), nominal_vehicle_from_rig(side))


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A station with prepared shots, ready to serve."""

    cycle: MeasuringCycle
    line: StationLine
    store: ResultStore


@contextmanager
def open_rehearsal(
    bus: LineBus,
    database: LineDatabase,
    url: str,
    *,
    observer: Observer | None = None,
    shot_s: float = 0.0,
    options: LineOptions = DEFAULT_OPTIONS,
    acknowledge_s: float = 2.0,
    positions: Sequence[WheelPosition] | None = None,
    kind: VehicleType = KIND,
    series: SeriesChoice | None = None,
    wrapped: Callable[[Line, Store], tuple[Line, Store]] = lambda line, store: (line, store),
) -> Iterator[Rehearsal]:
    """Open a station with prepared shots on an open bus.

    Parameters
    ----------
    bus, database
        Its end of the line.
    url
        Of the result database, made when it is missing.
    observer
        Watches the cycle.
    shot_s
        How long each wheel takes.
    options, acknowledge_s
        Of the line.
    positions, kind, series
        Other wheels than those with prepared shots, another vehicle type, and how series are taken.
    wrapped
        Puts something between the cycle and its line and store.

    Raises
    ------
    TruewheelError
        When the database cannot be opened.
    """
    with ResultStore(url, create=True) as store, StationLine(bus, database, options=options) as line:
        seen_line, seen_store = wrapped(line, store)
        cycle = MeasuringCycle(
            Identity(STATION, "rehearsal", "rehearsal"),
            positions or [PreparedPosition(ArmedRig(name), shot_s) for name in WHEELS],
            {kind.number: kind},
            seen_line,
            seen_store,
            Bounds(measure_s=30.0, store_s=10.0, acknowledge_s=acknowledge_s),
            observer=observer,
            series=series,
        )
        try:
            cycle.start()
            yield Rehearsal(cycle, line, store)
        finally:
            cycle.close()
