"""Study `vehicles`: angles and lengths of vehicles that stand askew, against what they truly are.

Four rigs are calibrated with a plate and placed with a gauge frame. Images of one wheel before each give the
covariance of its axis and place; vehicles are then drawn, and what the rigs see of them is off by a draw from
that covariance and by one of the stand's temperature. Some vehicles are rendered and measured from images, by
rigs whose cameras and poses are drawn from their covariance. The quick form renders one vehicle for both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array, Singles
from alignment.measure import measure_wheel
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, RigCalibration, WheelMeasurement
from alignment.vehicle import (
    FOUR_WHEELS,
    LENGTHS,
    VehicleGeometry,
    WheelAngles,
    WheelAxis,
    normal_from_angles,
    vehicle_angles,
    vehicle_geometry,
)
from db.exports import in_style, legend_outside
from sensors.simulation import RIG_SPECS, WheelPose, WheelScene, draw_scene
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.coverage import HIGHEST, LOWEST, drawn
from station.studies.vehicle_stand import (
    STAND,
    WIDTH_MM,
    DrawnVehicle,
    draw_vehicle_on_stand,
    measured_axes,
    placed_rig,
    side_of_wheel,
    tyres,
    warmed,
)
from station.studies.wheels import exposed, lights

VEHICLES, QUICK_VEHICLES = 300, 60
IMAGED, QUICK_IMAGED = 20, 1
WIDTH_SPREAD_MM = 1.0
ALLOWED_ARCMIN, ALLOWED_MM, ALLOWED_BY_YAW_ARCMIN = 0.1, 0.1, 1e-4
_TOES = tuple(f"{name}.toe" for name in FOUR_WHEELS)
_LENGTHS = ("wheelbase_left", "wheelbase_right", "track_front", "track_rear")
_ANGLES = (*_TOES, "thrust_angle")
_JUDGED = (*_TOES, "thrust_angle", *_LENGTHS)


@dataclass(eq=False)
class _Found:
    """Errors of many vehicles and what was stated, by quantity; arcminutes and millimetres."""

    errors: dict[str, list[float]] = field(default_factory=dict)
    stated: dict[str, list[float]] = field(default_factory=dict)

    def add(self, found: VehicleGeometry, truth: Mapping[str, float]) -> None:
        for name in _JUDGED:
            unit = 1.0 if name in LENGTHS else ARCMIN
            self.errors.setdefault(name, []).append((found.value(name) - truth[name]) / unit)
            self.stated.setdefault(name, []).append(found.u95(name) / unit)

    def of(self, names: Sequence[str]) -> Array:
        """Absolute errors of these quantities together."""
        out: Array = np.abs(np.concatenate([np.array(self.errors.get(name, [])) for name in names]))
        return out

    def covered(self, names: Sequence[str]) -> float:
        """Share of these that their 95 % intervals hold; none when there are none."""
        stated = np.concatenate([self.stated.get(name, []) for name in names])
        # k of the stated interval is 2; 95 % are 1.96 standard deviations.
        return float((self.of(names) <= 0.98 * stated).mean()) if len(stated) else math.nan


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    count, imaged = (QUICK_VEHICLES, QUICK_IMAGED) if quick else (VEHICLES, IMAGED)
    progress(0.0, "four rigs")
    rigs: dict[str, RigCalibration] = {name: placed_rig(name, seed) for name in FOUR_WHEELS}
    shown = _Shown(draw_vehicle_on_stand(np.random.default_rng([seed, 3])), rigs, seed) if quick else None
    covariances = _covariances(rigs, seed, shown)
    rng = np.random.default_rng([seed, 1])
    even, odd = _Found(), _Found()
    by_yaw, by_stand = 0.0, 0.0
    rows: list[Row] = []
    for number in range(count):
        progress(0.1 + 0.1 * number / count, f"vehicle {number + 1} of {count}")
        for found, spread in ((even, 0.0), (odd, WIDTH_SPREAD_MM)):
            vehicle = draw_vehicle_on_stand(rng, spread)
            axes = measured_axes(vehicle, covariances, rng)
            geometry = vehicle_geometry(axes, STAND, tyres(spread))
            found.add(geometry, vehicle.truth)
            rows.append(_row(number + 1, "numbers", spread, vehicle, geometry))
        by_yaw = max(by_yaw, _change_by_yaw(vehicle))
        by_stand = max(by_stand, _error_of_stands_own_way(vehicle))
    seen = _Found()
    refused = 0
    for number in range(imaged):
        progress(0.2 + 0.8 * number / imaged, f"images of vehicle {number + 1} of {imaged}")
        vehicle = shown.vehicle if shown else draw_vehicle_on_stand(rng)
        wheels = _measured_from_images(vehicle, rigs, rng, shown)
        if wheels is None:
            refused += 1
            continue
        geometry = vehicle_geometry(wheels, STAND, tyres())
        seen.add(geometry, vehicle.truth)
        rows.append(_row(number + 1, "images", 0.0, vehicle, geometry))
    figures = _figures(even, odd, seen) | {
        "total_toe_change_by_yaw_arcmin": by_yaw / ARCMIN,
        "stands_own_way_toe_error_arcmin": by_stand / ARCMIN,
        "vehicles": float(count),
        "vehicles_from_images": float(imaged - refused),
        "refused": float(refused),
    }
    plots = {"vehicles": _plot(even, odd)}
    return StudyResult(tuple(rows), figures, _goals(quick), _text(figures), plots)


@dataclass(frozen=True, eq=False)
class _Picture:
    """A wheel before its rig, and the light of it on the rig's chips."""

    scene: WheelScene
    light: list[tuple[Singles, Singles]]


class _Shown:
    """One vehicle whose wheels are rendered once, for as many exposures as are wanted."""

    def __init__(self, vehicle: DrawnVehicle, rigs: Mapping[str, RigCalibration], seed: int) -> None:
        rng = np.random.default_rng([seed, 4])
        self.vehicle = vehicle
        self.pictures = {name: _picture(vehicle, name, rig, rng) for name, rig in rigs.items()}


def _covariances(
    rigs: Mapping[str, RigCalibration], seed: int, shown: _Shown | None = None
) -> dict[str, Array]:
    """(5, 5) of axis and place by rig, as a measurement from images states it; of `shown`, or of others."""
    out: dict[str, Array] = {}
    for name, rig in rigs.items():
        rng = np.random.default_rng([seed, 2, FOUR_WHEELS.index(name)])
        picture = shown.pictures[name] if shown else _picture(draw_vehicle_on_stand(rng), name, rig, rng)
        axis = _seen_wheel(picture, rig, rng)
        assert axis is not None, f"the wheel before {name} was refused"
        out[name] = axis.covariance
    return out


def _measured_from_images(
    vehicle: DrawnVehicle,
    rigs: Mapping[str, RigCalibration],
    rng: np.random.Generator,
    shown: _Shown | None,
) -> dict[str, WheelAxis] | None:
    """The vehicle's axes from images, by rigs known as their covariance says, on a stand that is warm."""
    heat = warmed(rng)
    out = {}
    for name, rig in rigs.items():
        assert rig.covariance is not None
        known = drawn(rig, rig.covariance, rng)
        axis = _seen_wheel(shown.pictures[name] if shown else _picture(vehicle, name, rig, rng), known, rng)
        if axis is None:
            return None
        out[name] = replace(
            axis,
            camber=axis.camber + heat[name][0],
            toe=axis.toe + heat[name][1],
            point=axis.point + heat[name][2:],
        )
    return out


def _picture(vehicle: DrawnVehicle, name: str, true: RigCalibration, rng: np.random.Generator) -> _Picture:
    """One wheel of a vehicle, rendered before the true rig."""
    scene = wheel_scene(vehicle, name, true, rng)
    return _Picture(scene, lights(scene, true))


def _seen_wheel(picture: _Picture, known: RigCalibration, rng: np.random.Generator) -> WheelAxis | None:
    """The axis of a rendered wheel as the known rig measures it; None when it is refused."""
    found = measure_wheel(exposed(picture.light, picture.scene, rng), known, MeasureSettings())
    if not isinstance(found, WheelMeasurement) or found.reference is None:
        return None
    return WheelAxis.of(found, found.reference, known)


def wheel_scene(
    vehicle: DrawnVehicle, name: str, rig: RigCalibration, rng: np.random.Generator
) -> WheelScene:
    """The wheel before its rig: all tyres of a vehicle are alike, as wide as stated."""
    side = side_of_wheel(name)
    camber, toe, ring = vehicle.on_stand(name)
    scene = draw_scene(RIG_SPECS["standard"], side, WheelPose(), np.random.default_rng(vehicle.seed))
    origin = ring - scene.tyre.outermost_mm * normal_from_angles(camber, toe, side)
    x, y, z = (float(c) for c in rig.vehicle_from_rig.inverse().apply(origin))
    spin = float(rng.uniform(0.0, 2.0 * math.pi))
    pose = WheelPose(camber=camber, toe=toe, spin=spin, offset_mm=(x, y, z))
    return replace(scene, pose=pose)


def _change_by_yaw(vehicle: DrawnVehicle) -> float:
    """Largest change of a total toe when the vehicle is set straight, radians."""
    straight = replace(vehicle, yaw=0.0, place=np.zeros(2))
    here, there = (vehicle_geometry(_exact(each), STAND, tyres()) for each in (vehicle, straight))
    totals = [f"{axle}.total_toe" for axle in ("front", "rear")]
    return max(abs(here.value(name) - there.value(name)) for name in totals)


def _error_of_stands_own_way(vehicle: DrawnVehicle) -> float:
    """Largest error of a toe or of the thrust angle that the stand's axis makes, radians."""
    wheels = {name: WheelAngles(*vehicle.on_stand(name)[:2]) for name in FOUR_WHEELS}
    front_left, front_right, rear_left, rear_right = wheels.values()
    by_stand = vehicle_angles(front_left, front_right, rear_left, rear_right)
    toes = [wheel.toe - vehicle.angles[name][1] for name, wheel in wheels.items()]
    return float(np.abs([*toes, by_stand.thrust_angle - vehicle.truth["thrust_angle"]]).max())


def _exact(vehicle: DrawnVehicle) -> dict[str, WheelAxis]:
    return {
        name: WheelAxis(side_of_wheel(name), *vehicle.on_stand(name), np.zeros((5, 5)))
        for name in FOUR_WHEELS
    }


def _row(
    number: int, by: str, spread_mm: float, vehicle: DrawnVehicle, found: VehicleGeometry
) -> dict[str, str | float]:
    truth = vehicle.truth
    out: dict[str, str | float] = {
        "vehicle": number,
        "by": by,
        "width_spread_mm": spread_mm,
        "yaw_deg": math.degrees(vehicle.yaw),
    }
    for name in _JUDGED:
        unit, suffix = (1.0, "mm") if name in LENGTHS else (ARCMIN, "arcmin")
        out[f"{name}_error_{suffix}"] = (found.value(name) - truth[name]) / unit
        out[f"{name}_u95_{suffix}"] = found.u95(name) / unit
    return out


def _figures(even: _Found, odd: _Found, seen: _Found) -> dict[str, float]:
    out: dict[str, float] = {}
    for prefix, found in (("", even), ("images_", seen)):
        for label, names, unit in (
            ("toe", _TOES, "arcmin"),
            ("thrust", ("thrust_angle",), "arcmin"),
            ("wheelbase", _LENGTHS[:2], "mm"),
            ("track", _LENGTHS[2:], "mm"),
        ):
            off = found.of(names)
            out[f"{prefix}{label}_error_p95_{unit}"] = (
                float(np.percentile(off, 95.0)) if len(off) else math.nan
            )
            out[f"{prefix}{label}_error_largest_{unit}"] = float(off.max()) if len(off) else math.nan
        out[f"{prefix}angles_covered"] = found.covered(_ANGLES)
        out[f"{prefix}lengths_covered"] = found.covered(_LENGTHS)
    out["widths_toe_covered"] = odd.covered(_TOES)
    out["widths_thrust_covered"] = odd.covered(("thrust_angle",))
    out["widths_lengths_covered"] = odd.covered(_LENGTHS)
    out["widths_covered"] = odd.covered(_JUDGED)
    out["widths_toe_u95_arcmin"] = float(np.mean(odd.stated[_TOES[0]]))
    out["toe_u95_arcmin"] = float(np.mean(even.stated[_TOES[0]]))
    out["track_u95_mm"] = float(np.mean(even.stated["track_front"]))
    out["wheelbase_u95_mm"] = float(np.mean(even.stated["wheelbase_left"]))
    return out


def _goals(quick: bool) -> tuple[Goal, ...]:
    # Few vehicles cannot show 95 %, nor the tail: the quick form allows what chance allows.
    slack, wide = (0.05, 1.3) if quick else (0.0, 1.0)
    return (
        Goal("toe_error_p95_arcmin", "at_most", wide * ALLOWED_ARCMIN),
        Goal("thrust_error_p95_arcmin", "at_most", wide * ALLOWED_ARCMIN),
        Goal("wheelbase_error_largest_mm", "at_most", wide * ALLOWED_MM),
        Goal("track_error_largest_mm", "at_most", wide * ALLOWED_MM),
        Goal("angles_covered", "at_least", LOWEST - slack),
        Goal("lengths_covered", "at_least", LOWEST - slack),
        Goal("widths_covered", "at_least", LOWEST - slack),
        Goal("widths_covered", "at_most", HIGHEST + slack),
        Goal("widths_toe_covered", "at_least", LOWEST - slack),
        Goal("widths_toe_covered", "at_most", HIGHEST + slack),
        Goal("total_toe_change_by_yaw_arcmin", "at_most", ALLOWED_BY_YAW_ARCMIN),
        Goal("refused", "at_most", 0.0),
    )


def _text(figures: Mapping[str, float]) -> str:
    f = figures
    return f"""
{f["vehicles"]:.0f} vehicles with yaw within ±0.5° and place within ±20 mm. What the rigs see is drawn
from the covariance that images of a wheel gave: image noise, cameras calibrated with a plate, poses placed
with a gauge frame whose certificate states 0.01 mm and 0.02′; the stand's temperature is known to ±1 K and
±0.2 K/m (95 %). With equal tyres toe errs by {f["toe_error_p95_arcmin"]:.3f}′ (95 %; largest
{f["toe_error_largest_arcmin"]:.3f}′), the thrust angle by {f["thrust_error_p95_arcmin"]:.3f}′, track by
at most {f["track_error_largest_mm"]:.3f} mm, wheelbase by {f["wheelbase_error_largest_mm"]:.3f} mm. With
tyre widths of ±1 mm the intervals of toe grow from ±{f["toe_u95_arcmin"]:.2f}′ to
±{f["widths_toe_u95_arcmin"]:.2f}′ and hold the truth in {100 * f["widths_toe_covered"]:.1f} %. Against the
stand's axis the same toes err by up to {f["stands_own_way_toe_error_arcmin"]:.0f}′.
{f["vehicles_from_images"]:.0f} vehicles were measured from rendered images, cameras and poses drawn from
their covariance, tyres all {WIDTH_MM:g} mm wide.
"""


@in_style
def _plot(even: _Found, odd: _Found) -> Figure:
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for found, label in ((even, "equal tyres"), (odd, "widths ±1 mm")):
        left.hist(np.concatenate([found.errors[name] for name in _TOES]), bins=40, alpha=0.6, label=label)
    left.set_xlabel("error of individual toe, ′")
    legend_outside(figure)
    right.hist(np.concatenate([even.errors[name] for name in _LENGTHS]), bins=40)
    right.set_xlabel("error of wheelbase and track, equal tyres, mm")
    return figure


STUDY = Study(
    "vehicles",
    "Toe, thrust angle, wheelbase and track of vehicles that stand askew, and their intervals.",
    run,
)
