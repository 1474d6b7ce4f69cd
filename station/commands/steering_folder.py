"""A folder of a steered vehicle: which shots it holds, and what they say."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from alignment.errors import FormatError
from alignment.measure import measure_wheel
from alignment.measure_steering import measure_steered
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, Refusal, RigCalibration, WheelMeasurement
from alignment.vehicle import (
    SIGN,
    RunOut,
    SteeredPair,
    SteeredWheel,
    SteeringAxis,
    SteeringRules,
    SteeringStand,
    steered_pair,
    steering_axis,
    straight_toe,
)
from sensors.formats import VEHICLE_FILE, VehicleFile, read_calibration, read_shot, read_vehicle_facts

FRONT, REAR = ("front_left", "front_right"), ("rear_left", "rear_right")
UNKNOWN_RUN_OUT = 4.0 * ARCMIN
"""Lean of a tyre plane that is expected where nobody measured it, in each direction, one standard
deviation; that of a run-out of 1 mm, peak to peak at a radius of 300 mm."""


@dataclass(frozen=True, eq=False)
class RecordedSweepWheel:
    """One wheel of a folder: shots at positions of the steering, or one."""

    wheel: str
    calibration: RigCalibration
    shots: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class RecordedSweep:
    """A folder, what is stated of its vehicle, its front wheels, and its rear ones where they are there."""

    folder: Path
    vehicle: VehicleFile
    wheels: tuple[RecordedSweepWheel, ...]
    rear: tuple[RecordedSweepWheel, ...]


@dataclass(frozen=True, eq=False)
class MeasuredSweep:
    """What came of a sweep: axes or refusals by front wheel, and what both say together.

    `heading` is the thrust line's direction on the stand, radians; `reference` and `run_out` say in words
    what caster refers to, and what is known of the run-out.
    """

    axes: dict[str, SteeringAxis | Refusal]
    pair: SteeredPair | None
    heading: float
    reference: str
    run_out: str
    coverage_factor: float


def recorded_sweep(folder: Path) -> RecordedSweep:
    """Find the rigs of a steered vehicle, before anything is measured.

    Raises
    ------
    FormatError
        When a file is missing or wrong, or a front wheel has no positions.
    """
    vehicle = read_vehicle_facts(folder / VEHICLE_FILE)
    rigs = {str(wheel): rig for wheel, rig in vehicle.rigs.items()}
    missing = [wheel for wheel in FRONT if wheel not in rigs]
    if missing:
        raise FormatError(
            file=folder / VEHICLE_FILE, field="rigs", expected="both front wheels", seen=", ".join(rigs)
        )
    front = tuple(_front(folder, wheel, rigs[wheel]) for wheel in FRONT)
    if len({len(wheel.shots) for wheel in front}) > 1:
        raise FormatError(
            file=folder,
            expected="as many positions of both front wheels",
            seen=" and ".join(str(len(wheel.shots)) for wheel in front),
        )
    rear: tuple[RecordedSweepWheel, ...] = ()
    if all(wheel in rigs for wheel in REAR):
        rear = tuple(_rear(folder, wheel, rigs[wheel]) for wheel in REAR)
    return RecordedSweep(folder, vehicle, front, rear)


def _front(folder: Path, wheel: str, rig: str) -> RecordedSweepWheel:
    home = folder / rig
    calibration = _calibration(home, wheel, rig)
    shots = tuple(sorted((path for path in home.glob("pos_*") if path.is_dir()), key=_number))
    if not shots:
        raise FormatError(
            file=home, expected="pos_01 …, one shot at each position of the steering", seen="none"
        )
    return RecordedSweepWheel(wheel, calibration, shots)


def _rear(folder: Path, wheel: str, rig: str) -> RecordedSweepWheel:
    return RecordedSweepWheel(wheel, _calibration(folder / rig, wheel, rig), (folder / rig,))


def _number(path: Path) -> tuple[int, str]:
    """Positions come in the order of their numbers; with a hundred of them pos_100 is after pos_99."""
    digits = path.name.rpartition("_")[2]
    return (int(digits) if digits.isdigit() else 0), path.name


def _calibration(home: Path, wheel: str, rig: str) -> RigCalibration:
    calibration = read_calibration(home / "calibration.json")
    side = wheel.rpartition("_")[2]
    for field, expected, seen in (("rig", rig, calibration.rig), ("side", side, calibration.side)):
        if expected != seen:
            raise FormatError(
                file=home / "calibration.json",
                field=field,
                expected=f"a calibration of {field} '{expected}', which sees {wheel}",
                seen=f"'{seen}'",
                cure="Copy the calibration of this rig here",
            )
    return calibration


def measured_sweep(sweep: RecordedSweep, settings: MeasureSettings, *, rolls: bool) -> MeasuredSweep:
    """Measure a sweep; settings as `steered_settings` makes them.

    Raises
    ------
    FormatError
        When a shot cannot be read, or a run-out is to roll and neither road nor tyre width is stated.
    """
    vehicle = sweep.vehicle
    if rolls and (vehicle.road_z_mm is None or vehicle.tyre_width_mm is None):
        raise FormatError(
            file=sweep.folder / VEHICLE_FILE,
            field="road_z_mm, tyre_width_mm",
            expected="height of the wheel supports and width of the tyres, by which a run-out rolls",
            seen="null",
            cure="State both, or hold the brakes while the steering is turned and say so",
        )
    heading, heading_u, reference = _heading(sweep, settings)
    series = {wheel.wheel: _series(wheel, settings) for wheel in sweep.wheels}
    known = {name: one for name, one in series.items() if not isinstance(one, Refusal)}
    axes: dict[str, SteeringAxis | Refusal] = {
        name: one for name, one in series.items() if isinstance(one, Refusal)
    }
    told = (
        "the run-out is not known; up to 2 mm of it are in the uncertainty"
        if rolls
        else "the brakes were held, so that no run-out rolls; camber is that of the tyre plane"
    )
    toe = _straight(known, heading)
    for wheel in sweep.wheels:
        if wheel.wheel not in known:
            continue
        positions = known[wheel.wheel]
        stand = SteeringStand(
            heading,
            heading_u,
            vehicle.road_z_mm,
            vehicle.tyre_width_mm,
            vehicle.tyre_width_sigma_mm,
            toe,
            1.0 if rolls else 0.0,
        )
        lean = RunOut(0.0, 0.0, np.eye(2) * UNKNOWN_RUN_OUT**2) if rolls else None
        rules = SteeringRules(coverage_factor=settings.coverage_factor)
        axes[wheel.wheel] = steering_axis(positions, stand, rules, lean)
    left, right = (axes[name] for name in FRONT)
    both = isinstance(left, SteeringAxis) and isinstance(right, SteeringAxis)
    pair = steered_pair(left, right) if both else None  # type: ignore[arg-type]
    ordered = {name: axes[name] for name in FRONT}
    return MeasuredSweep(ordered, pair, heading, reference, told, settings.coverage_factor)


def _heading(sweep: RecordedSweep, settings: MeasureSettings) -> tuple[float, float, str]:
    """Direction of the thrust line on the stand, its standard uncertainty, and what it is in words."""
    toes, variances = [], []
    for wheel in sweep.rear:
        shot = read_shot(wheel.shots[0], wheel.calibration)
        found = measure_wheel(shot.images, PreparedRig.of(wheel.calibration, settings), settings)
        if not isinstance(found, WheelMeasurement):
            return 0.0, 0.0, f"stand's X, since the thrust line is not known ({wheel.wheel}: {found.reason})"
        toes.append(-SIGN[wheel.calibration.side] * found.toe)
        variances.append(found.toe_u**2)
    if not toes:
        return 0.0, 0.0, "stand's X, since there are no rear wheels"
    return float(np.mean(toes)), 0.5 * math.sqrt(sum(variances)), "thrust line"


def _series(wheel: RecordedSweepWheel, settings: MeasureSettings) -> list[SteeredWheel] | Refusal:
    shots = (read_shot(shot, wheel.calibration).images for shot in wheel.shots)
    return measure_steered(shots, PreparedRig.of(wheel.calibration, settings), settings)


def _straight(series: dict[str, list[SteeredWheel]], heading: float) -> float:
    """Toe of both wheels straight ahead; 0 where a sweep never passes there, which is refused afterwards."""
    if len(series) < 2:
        return 0.0
    left, right = (series[name] for name in FRONT)
    off = [a.axis.toe - b.axis.toe + 2.0 * heading for a, b in zip(left, right, strict=True)]
    return straight_toe(left, right, heading) if min(off) <= 0.0 <= max(off) else 0.0
