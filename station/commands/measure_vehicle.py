"""`truewheel measure-vehicle`: the wheels of one vehicle from a folder, and the vehicle in its own frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.by_hand import corrected_json, corrected_lines, corrections_by_hand
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.warm_up import compiled_for_images

if TYPE_CHECKING:
    from alignment.values import MeasureSettings, Refusal, RigCalibration, WheelMeasurement, WheelReference
    from alignment.vehicle import Stand, VehicleGeometry, WheelAxis
    from alignment.wheel import SpinMeasurement
    from sensors.formats import VehicleFile

_ANGLES = ("thrust_angle", "yaw")


def measure_vehicle_command(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="Folder with vehicle.json, and for each rig a folder with calibration.json and a shot, or "
            "turn_01 … of a wheel that was turned.",
            show_default=False,
        ),
    ],
    config: Annotated[
        Path | None,
        typer.Option(help="Station's configuration whose [measure] and [stand] count.", show_default=False),
    ] = None,
    vehicle_type: Annotated[
        Path | None,
        typer.Option(
            help="Vehicle type whose [steering] and [ride_height] count: angles are told as they are judged.",
            show_default=False,
        ),
    ] = None,
    steering_wheel_deg: Annotated[
        float | None,
        typer.Option(help="How the steering wheel stood, degrees, positive to the left.", show_default=False),
    ] = None,
    ride_height: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHEEL=MM",
            help="Ride height of a wheel, such as front_left=391.5; once for each.",
            show_default=False,
        ),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Measure all wheels of a recorded vehicle in its own frame; exit status 1 when one is refused."""
    from alignment.values import MeasureSettings
    from sensors.formats import VEHICLE_FILE, read_vehicle_facts
    from station.configuration import StandOptions, read_configuration

    settings, options = MeasureSettings(), StandOptions()
    if config is not None:
        known = read_configuration(config).settings
        settings, options = known.measure.settings(), known.stand
    vehicle = read_vehicle_facts(folder / VEHICLE_FILE)
    if vehicle.road_z_mm is not None:
        options = options.model_copy(update={"road_z_mm": vehicle.road_z_mm})
    recorded = recorded_wheels(folder, vehicle)
    by_hand = corrections_by_hand(
        vehicle_type, steering_wheel_deg, ride_height or (), [one.wheel for one in recorded]
    )
    wheels = [measured_wheel(one, settings, as_json) for one in recorded]
    geometry = geometry_of_wheels(folder, vehicle, wheels, options.stand(), settings.coverage_factor)
    result = vehicle_as_json(wheels, geometry, settings.coverage_factor)
    if by_hand is not None:
        result = corrected_json(result, geometry, *by_hand, settings.coverage_factor)
    if as_json:
        print_json(result)
    else:
        _print(result)
        for line in () if by_hand is None else corrected_lines(result):
            typer.echo(line)
    if result["outcome"] == "refused":
        raise typer.Exit(GOAL_MISSED)


@dataclass(frozen=True, eq=False)
class RecordedWheel:
    """One wheel of a folder: its name, its rig's calibration, and its shots; several of a turned wheel."""

    wheel: str
    calibration: RigCalibration
    shots: tuple[Path, ...]
    turned: bool


@dataclass(frozen=True, eq=False)
class MeasuredWheel:
    """What came of one wheel; `axis` is None when it was refused or has no place."""

    recorded: RecordedWheel
    found: WheelMeasurement | SpinMeasurement | Refusal
    axis: WheelAxis | None


def recorded_wheels(folder: Path, vehicle: VehicleFile) -> list[RecordedWheel]:
    """Find the rigs of a vehicle, before anything is measured."""
    from alignment.errors import FormatError
    from alignment.vehicle import FOUR_WHEELS
    from sensors.formats import VEHICLE_FILE

    rigs = [vehicle.rigs[wheel] for wheel in vehicle.rigs]
    twice = next((rig for rig in rigs if rigs.count(rig) > 1), None)
    if twice is not None:
        raise FormatError(
            file=folder / VEHICLE_FILE, field="rigs", expected="a rig for each wheel", seen=f"'{twice}' twice"
        )
    axles = [wheel.rpartition("_")[0] for wheel in vehicle.rigs]
    if max(map(axles.count, axles)) < 2:
        raise FormatError(
            file=folder / VEHICLE_FILE,
            field="rigs",
            expected="both wheels of at least one axle",
            seen=", ".join(vehicle.rigs),
        )
    return [
        _recorded_wheel(folder, wheel, rig)
        for wheel in FOUR_WHEELS
        if (rig := {str(name): rig for name, rig in vehicle.rigs.items()}.get(wheel)) is not None
    ]


def _recorded_wheel(folder: Path, wheel: str, rig: str) -> RecordedWheel:
    from alignment.errors import FormatError
    from sensors.formats import read_calibration

    home = folder / rig
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
    turns = tuple(sorted(path for path in home.glob("turn_*") if path.is_dir()))
    single = (home / "shot.json").exists()
    if bool(turns) == single:
        raise FormatError(
            file=home,
            expected="either one shot (shot.json and its images), or turn_01 … of a turned wheel",
            seen="both" if single else "neither",
        )
    return RecordedWheel(wheel, calibration, turns or (home,), bool(turns))


def measured_wheel(one: RecordedWheel, settings: MeasureSettings, as_json: bool) -> MeasuredWheel:
    """Measure one wheel of a folder: its tyre plane, or its spin axis where it was turned."""
    from alignment.measure import measure_wheel
    from alignment.measure_spin import measure_spin
    from alignment.prepared import PreparedRig
    from alignment.values import Refusal, WheelMeasurement
    from alignment.vehicle import WheelAxis
    from alignment.wheel import SpinMeasurement, spin_reference
    from sensors.formats import read_shot

    rig = PreparedRig.of(one.calibration, settings)
    images = read_shot(one.shots[0], one.calibration).images
    compiled_for_images(images, as_json, *(("spin",) if one.turned else ()))
    found: WheelMeasurement | SpinMeasurement | Refusal
    reference: WheelReference | None = None
    if one.turned:
        planes: list[WheelMeasurement] = []
        shots = (read_shot(shot, one.calibration).images for shot in one.shots)
        found = measure_spin(shots, rig, settings, planes.append)
        if isinstance(found, SpinMeasurement):
            reference = spin_reference(planes, found, rig.axis_covariance)
    else:
        found = measure_wheel(images, rig, settings)
        if isinstance(found, WheelMeasurement):
            reference = found.reference
    known = reference is not None and not isinstance(found, Refusal)
    axis = WheelAxis.of(found, reference, one.calibration) if known else None  # type: ignore[arg-type]
    return MeasuredWheel(one, found, axis)


def geometry_of_wheels(
    folder: Path, vehicle: VehicleFile, wheels: list[MeasuredWheel], stand: Stand, coverage_factor: float
) -> VehicleGeometry | None:
    """The vehicle in its own frame; None when no axle is left."""
    from alignment.errors import DegenerateInputError, FormatError
    from alignment.vehicle import TyreWidths, placing_covariance, vehicle_geometry

    axes = {one.recorded.wheel: one.axis for one in wheels if one.axis is not None}
    names = [name.rpartition("_")[0] for name in axes]
    if not names or max(map(names.count, names)) < 2:
        return None
    rigs = {one.recorded.wheel: one.recorded.calibration for one in wheels}
    width = vehicle.tyre_width_mm
    tyres = TyreWidths(width, width, vehicle.tyre_width_sigma_mm)
    try:
        common = placing_covariance(axes, rigs)
        return vehicle_geometry(axes, stand, tyres, common=common, coverage_factor=coverage_factor)
    except DegenerateInputError as error:
        raise FormatError(
            file=folder,
            field="vehicle_from_rig of the calibrations",
            expected=error.expected,
            seen=error.seen,
            cure=error.cure,
        ) from error


def vehicle_as_json(
    wheels: list[MeasuredWheel], geometry: VehicleGeometry | None, coverage_factor: float
) -> dict[str, Any]:
    """Return what `truewheel measure-vehicle --json` prints; what is not known is null."""
    from alignment.vehicle import LENGTHS

    told = {one.recorded.wheel: _wheel_as_json(one, geometry, coverage_factor) for one in wheels}
    reasons = [f"{name}: {wheel['reason']}" for name, wheel in told.items() if wheel["reason"] is not None]
    missing = [] if geometry is None else list(geometry.missing)
    absent = [name for name in missing if name not in told]
    if absent and not reasons:
        reasons = [
            "no toe of single wheels, thrust angle, yaw, wheelbase, track or setback without "
            + " and ".join(absent)
        ]
    refused = any(wheel["outcome"] == "refused" for wheel in told.values())
    out: dict[str, Any] = {
        "outcome": "refused" if refused else "incomplete" if missing else "measured",
        "reason": "; ".join(reasons) or None,
        "missing": missing,
        "reference": "vehicle",
        "between": None if geometry is None else geometry.between,
        "coverage_factor": coverage_factor,
        "wheels": told,
        "axles": {
            axle: {
                **_pair(geometry, f"{axle}.total_toe", "total_toe", "deg"),
                **_pair(geometry, f"{axle}.camber_difference", "camber_difference", "deg"),
            }
            for axle in ("front", "rear")
        },
    }
    for name in _ANGLES:
        out |= _pair(geometry, name, name, "deg")
    for name in LENGTHS:
        out |= _pair(geometry, name, name, "mm")
    return out


def _wheel_as_json(
    one: MeasuredWheel, geometry: VehicleGeometry | None, coverage_factor: float
) -> dict[str, Any]:
    from alignment.values import Refusal
    from alignment.vehicle import TYRE_WIDTH

    wheel, found = one.recorded.wheel, one.found
    out: dict[str, Any] = {
        "outcome": "measured",
        "reason": None,
        "kind": "spin_axis" if one.recorded.turned else "tyre_plane",
        "camber_deg": None,
        "camber_u95_deg": None,
        **_pair(geometry, f"{wheel}.toe", "toe", "deg"),
        **_pair(geometry, f"{wheel}.toe_to_thrust", "toe_to_thrust", "deg"),
        "toe_share_of_tyre_widths": None,
        "stand_toe_deg": None,
        "reference_mm": None,
        "calibration_id": one.recorded.calibration.id,
    }
    if isinstance(found, Refusal):
        return out | {"outcome": "refused", "reason": found.reason}
    out |= {
        "camber_deg": math.degrees(found.camber),
        "camber_u95_deg": math.degrees(coverage_factor * found.camber_u),
        "stand_toe_deg": math.degrees(found.toe),
    }
    if one.axis is None:
        return out | {
            "outcome": "refused",
            "reason": "the outermost ring of its sidewall was not seen, so that its place is not known; "
            "check that the heads see the widest part of the tyre",
        }
    if geometry is not None and f"{wheel}.toe" in geometry:
        out["toe_share_of_tyre_widths"] = geometry.share(f"{wheel}.toe", TYRE_WIDTH)
    return out | {"reference_mm": [float(c) for c in one.axis.point]}


def _pair(geometry: VehicleGeometry | None, name: str, told: str, unit: str) -> dict[str, float | None]:
    """A quantity and its expanded uncertainty, in degrees or millimetres; None where it is not known."""
    value: float | None = None
    u95: float | None = None
    if geometry is not None and name in geometry:
        factor = math.degrees(1.0) if unit == "deg" else 1.0
        value, u95 = factor * geometry.value(name), factor * geometry.u95(name)
    return {f"{told}_{unit}": value, f"{told}_u95_{unit}": u95}


def _print(result: Mapping[str, Any]) -> None:
    from alignment.vehicle import LENGTHS

    typer.echo(f"{'wheel':<12}{'camber':>22}{'toe':>22}  of the")
    for name, wheel in result["wheels"].items():
        cells = "".join(f"{_cell(wheel, angle, 'deg', '°', 4):>22}" for angle in ("camber", "toe"))
        typer.echo(f"{name:<12}{cells}  {wheel['kind'].replace('_', ' ')}")
    for axle, values in result["axles"].items():
        if values["total_toe_deg"] is not None:
            typer.echo(f"{axle + ' total toe':<34}{_cell(values, 'total_toe', 'deg', '°', 4):>22}")
    for name in (*_ANGLES, *LENGTHS):
        unit, sign, digits = ("deg", "°", 4) if name in _ANGLES else ("mm", " mm", 3)
        if result[f"{name}_{unit}"] is not None:
            typer.echo(f"{name.replace('_', ' '):<34}{_cell(result, name, unit, sign, digits):>22}")
    if result["between"] is not None:
        typer.echo(
            "toe and thrust angle against the vehicle's own centreline; lengths between "
            + result["between"].replace("_", " ")
        )
        shares = [
            wheel["toe_share_of_tyre_widths"]
            for wheel in result["wheels"].values()
            if wheel["toe_share_of_tyre_widths"]
        ]
        if shares:
            typer.echo(
                f"of the variance of single toes {100 * max(shares):.0f} % is the spread of tyre widths, "
                "which total toe does not feel"
            )
    if result["reason"] is not None:
        typer.echo(f"{result['outcome']}: {result['reason']}")


def _cell(values: Mapping[str, Any], name: str, unit: str, sign: str, digits: int) -> str:
    value, u95 = values[f"{name}_{unit}"], values[f"{name}_u95_{unit}"]
    return "–" if value is None else f"{value:+.{digits}f}{sign} ± {u95:.{digits}f}"
