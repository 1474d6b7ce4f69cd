"""Study `vehicle-budget`: what each source of error contributes to the angles and lengths of a vehicle.

Four rigs are calibrated with a plate and placed with one view of a gauge frame, as in study `vehicles`.
Images of a wheel in the air and of one under load tell what noise and load leave unknown, a series of planes
what is left of a run-out. Each source goes alone through the vehicle's own frame; together they make the
uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.calibration import axis_sensitivity
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, Placing, RigCalibration, WheelMeasurement
from alignment.vehicle import (
    FOUR_WHEELS,
    LENGTHS,
    Stand,
    WheelAxis,
    placing_covariance,
    pose_by_frame,
    vehicle_geometry,
)
from alignment.wheel import SeriesRules, SpinMeasurement, fit_series
from db.exports import in_style
from sensors.formats import TyreLoad, WholeFrame
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.rehearsal import prepared_planes
from station.studies.vehicle_stand import (
    CERTIFICATE_ANGLE,
    CERTIFICATE_MM,
    STAND,
    DrawnVehicle,
    draw_vehicle_on_stand,
    placed_rig,
    tyres,
)
from station.studies.vehicles import WIDTH_SPREAD_MM, wheel_scene
from station.studies.wheels import exposed, lights

BUDGETED = (
    "front_left.camber",
    "front_left.toe",
    "front.total_toe",
    "thrust_angle",
    "wheelbase_left",
    "track_front",
)
LOAD_MM = 5.0
_RUN_OUT_MM, _RADIUS_MM = 2.0, 300.0
FRAME = WholeFrame(tilt_sigma_arcmin=0.05, yaw_sigma_arcmin=0.5, position_sigma_mm=0.5, length_sigma_ppm=6.0)
"""The frame as a whole: how it rests on the wheel supports, and its length, to half a kelvin of steel."""
_SERIES = 8
_NOTHING = Stand(road_z_mm=STAND.road_z_mm)


@dataclass(frozen=True, eq=False)
class ErrorSource:
    """What one source leaves unknown.

    Attributes
    ----------
    name
        In words.
    own
        (5, 5) covariance of the axis of each wheel, on its own.
    common
        (20, 20) of all four axes together; None where they share nothing.
    warm, uneven
        Whether the stand's temperature counts, and the spread of tyre widths.
    """

    name: str
    own: Mapping[str, Array]
    common: Array | None = None
    warm: bool = False
    uneven: bool = False


def contributions(axes: Mapping[str, WheelAxis], sources: list[ErrorSource]) -> dict[str, dict[str, float]]:
    """Standard uncertainties by source and quantity, radians or millimetres, and those of all together."""
    found = {source.name: _alone(axes, [source]) for source in sources}
    return found | {"all together": _alone(axes, sources)}


def _alone(axes: Mapping[str, WheelAxis], sources: list[ErrorSource]) -> dict[str, float]:
    own = {name: sum((s.own.get(name, np.zeros((5, 5))) for s in sources), np.zeros((5, 5))) for name in axes}
    common = sum((s.common for s in sources if s.common is not None), np.zeros((20, 20)))
    stand = STAND if any(source.warm for source in sources) else _NOTHING
    spread = WIDTH_SPREAD_MM if any(source.uneven for source in sources) else 0.0
    seen = {name: replace(axis, covariance=own[name]) for name, axis in axes.items()}
    geometry = vehicle_geometry(seen, stand, tyres(spread), common=common)
    return {name: geometry.u(name) for name in BUDGETED}


def sources_of(seed: int, progress: Progress) -> tuple[dict[str, WheelAxis], list[ErrorSource]]:
    """Return the axes of a vehicle, and all that is not known of them."""
    rigs: dict[str, RigCalibration] = {name: placed_rig(name, seed) for name in FOUR_WHEELS}
    rng = np.random.default_rng([seed, 5])
    vehicle = draw_vehicle_on_stand(rng)
    noise, load, axes = {}, {}, {}
    for number, (name, rig) in enumerate(rigs.items()):
        progress(0.1 + 0.2 * number, f"images of {name}")
        free, loaded = (_measured(vehicle, name, rig, mm, rng) for mm in (0.0, LOAD_MM))
        assert free.reference is not None
        assert loaded.load_covariance is not None
        known = PreparedRig.of(rig, MeasureSettings()).axis_covariance
        assert known is not None
        axes[name] = WheelAxis.of(free, free.reference, rig)
        noise[name] = free.reference.covariance - known
        load[name] = _of_angles(loaded.load_covariance)
    cameras = {name: _of_cameras(rig) for name, rig in rigs.items()}
    placing = {name: _all_known(rig) - cameras[name] for name, rig in rigs.items()}
    plane = np.eye(2) * (math.asin(0.5 * _RUN_OUT_MM / _RADIUS_MM) ** 2) / 2.0
    shared = FRAME.covariance()
    spin = _of_angles(_spin(seed))
    together = {name: _standing(rig, shared) for name, rig in rigs.items()}
    return axes, [
        ErrorSource("noise of the images", noise),
        ErrorSource("calibration of the cameras", cameras),
        ErrorSource("placing of the rigs", placing),
        ErrorSource("gauge frame as a whole", {}, placing_covariance(axes, together)),
        ErrorSource("temperature of the stand", {}, warm=True),
        ErrorSource(f"load of {LOAD_MM:g} mm", load),
        ErrorSource(f"run-out of {_RUN_OUT_MM:g} mm, spin axis", dict.fromkeys(axes, spin)),
        ErrorSource(f"tyre widths of ±{WIDTH_SPREAD_MM:g} mm", {}, uneven=True),
        ErrorSource(f"run-out of {_RUN_OUT_MM:g} mm, one exposure", dict.fromkeys(axes, _of_angles(plane))),
    ]


def _measured(
    vehicle: DrawnVehicle, name: str, rig: RigCalibration, load_mm: float, rng: np.random.Generator
) -> WheelMeasurement:
    scene = wheel_scene(vehicle, name, rig, rng)
    if load_mm:
        scene = replace(scene, load=TyreLoad(load_mm))
    found = measure_wheel(exposed(lights(scene, rig), scene, rng), rig, MeasureSettings())
    assert isinstance(found, WheelMeasurement), f"the wheel before {name} was refused: {found.reason}"
    return found


def _of_angles(covariance: Array) -> Array:
    out = np.zeros((5, 5))
    out[:2, :2] = covariance
    return out


def _all_known(rig: RigCalibration) -> Array:
    assert rig.covariance is not None
    lever = axis_sensitivity(rig)
    out: Array = lever @ rig.covariance @ lever.T
    return out


def _of_cameras(rig: RigCalibration) -> Array:
    """(5, 5) by the cameras alone; what the view of the gauge frame takes off them is the placing's."""
    assert rig.covariance is not None
    size = len(rig.camera_parameter_names)
    lever = axis_sensitivity(rig)[:, :size]
    out: Array = lever @ rig.covariance[:size, :size] @ lever.T
    return out


def _standing(rig: RigCalibration, shared: Array) -> RigCalibration:
    """The rig as if nothing but the frame as a whole were unknown."""
    by = pose_by_frame(rig.vehicle_from_rig)
    return replace(rig, covariance=None, placing=Placing("one view", by @ shared @ by.T, shared))


def _spin(seed: int) -> Array:
    """(2, 2) mean covariance of the spin axes of some series of planes, twice round, with wander."""
    found = [fit_series(prepared_planes(seed + k), "left", SeriesRules()) for k in range(_SERIES)]
    known = [each.angle_covariance for each in found if isinstance(each, SpinMeasurement)]
    assert len(known) == _SERIES
    out: Array = np.mean(known, axis=0)
    return out


def budget_of(axes: Mapping[str, WheelAxis], sources: list[ErrorSource]) -> StudyResult:
    """Sum the budget up; the last source stands for a single exposure, and is in no sum."""
    counted, alone = sources[:-1], sources[-1]
    found = contributions(axes, counted)
    equal = contributions(axes, [source for source in counted if not source.uneven])["all together"]
    single = _alone(axes, [alone])
    table = found | {"all but tyre widths": equal, f"beside it: {alone.name}": single}
    rows: list[Row] = [
        {"source": name, **{_figure(q): _told(q, 2.0 * values[q]) for q in BUDGETED}}
        for name, values in table.items()
    ]
    squares = {q: sum(found[source.name][q] ** 2 for source in counted) for q in BUDGETED}
    figures = {f"{_figure(q)}": _told(q, 2.0 * found["all together"][q]) for q in BUDGETED}
    figures |= {f"equal_tyres_{_figure(q)}": _told(q, 2.0 * equal[q]) for q in BUDGETED}
    figures |= {f"single_exposure_{_figure(q)}": _told(q, 2.0 * single[q]) for q in BUDGETED[:2]}
    figures["largest_sum_over_together"] = max(
        abs(math.sqrt(squares[q]) / found["all together"][q] - 1.0) for q in BUDGETED
    )
    goals = (Goal("largest_sum_over_together", "at_most", 1e-6),)
    return StudyResult(tuple(rows), figures, goals, _text(rows), {"vehicle-budget": _plot(rows)})


def _figure(quantity: str) -> str:
    unit = "mm" if quantity in LENGTHS else "arcmin"
    return f"{quantity.partition('.')[2] or quantity}_u95_{unit}"


def _told(quantity: str, value: float) -> float:
    return value if quantity in LENGTHS else value / ARCMIN


def _text(rows: list[Row]) -> str:
    names = [name for name in rows[0] if name != "source"]
    head = f"""
Expanded uncertainties (95 %, k = 2) of a vehicle on a stand with heads at 90, 210 and 330°. Rigs are
calibrated with the plate and placed with one view of a gauge frame: plates certified to {CERTIFICATE_MM:g} mm
and {CERTIFICATE_ANGLE / ARCMIN:.2g}′, the frame as a whole to {FRAME.tilt_sigma_arcmin:g}′ of tilt,
{FRAME.yaw_sigma_arcmin:g}′ of yaw and {FRAME.length_sigma_ppm:g} ppm, one standard deviation each. Toe and
thrust angle are against the vehicle's own centreline, camber against the road plane, lengths between contact
centres. What one exposure makes of a run-out is in no sum: it is there to be compared with the spin axis. Not
in it: side force, whose share the heads cannot tell from camber, and a road other than the wheel supports.
"""
    units = " | ".join(name.replace("_u95", "").replace("_", " ") for name in names)
    lines = [head, f"| source | {units} |", "|---" * (len(names) + 1) + "|"]
    for row in rows:
        cells = [f"{float(row[name] or 0.0):.3f}" for name in names]
        lines.append(f"| {row['source']} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


@in_style
def _plot(rows: list[Row]) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    places = np.arange(len(rows) - 1)
    for axes, angle in zip(figure.subplots(1, 2, sharey=True), ("camber", "toe"), strict=True):
        axes.barh(places, [float(row[f"{angle}_u95_arcmin"] or 0.0) for row in rows[:-1]])
        axes.set_yticks(places, [str(row["source"]) for row in rows[:-1]])
        axes.invert_yaxis()
        axes.set_xlabel(f"{angle}, ′ (95 %)")
    return figure


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`. It is quick in any case."""
    progress(0.0, "four rigs")
    return budget_of(*sources_of(seed, progress))


STUDY = Study("vehicle-budget", "What limits camber, toe and lengths of a vehicle, source by source.", run)
