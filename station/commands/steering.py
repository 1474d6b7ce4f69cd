"""`truewheel simulate steering` and `truewheel steering-axis`: a sweep of the steering."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_new_folder
from station.commands.warm_up import compiled_for, compiled_for_images

if TYPE_CHECKING:
    from alignment.vehicle import SteeringAxis
    from station.commands.steering_folder import MeasuredSweep

_LENGTHS = ("trail", "scrub")
_WORDS = {
    "caster": "caster",
    "kpi": "kingpin inclination",
    "included_angle": "included angle",
    "camber": "camber",
    "trail": "trail",
    "scrub": "scrub radius",
}


def simulate_steering_command(
    seed: Annotated[int, typer.Option(help="Of stand, vehicle, steering and noise.", min=0, max=2**32 - 1)],
    out: Annotated[Path, typer.Option(help="New folder for rigs, vehicle.json and steering_truth.json.")],
    sweep_deg: Annotated[
        float, typer.Option(help="To which the rack is turned to both sides, degrees.", min=0.1, max=12)
    ] = 10.0,
    positions: Annotated[
        int, typer.Option(help="Of the steering, even over the sweep.", min=1, max=400)
    ] = 41,
    yaw_deg: Annotated[
        float, typer.Option(help="Of the vehicle on the stand, to the left, degrees.", min=-5, max=5)
    ] = 0.0,
    load_mm: Annotated[
        float, typer.Option(help="Bulge of the front tyres under load; 0: in the air.", min=0, max=15)
    ] = 0.0,
    runout_mm: Annotated[
        float, typer.Option(help="Largest run-out of a tyre, peak to peak, millimetres.", min=0, max=5)
    ] = 0.0,
    brakes_held: Annotated[
        bool, typer.Option("--brakes-held", help="Wheels slip on their turn plates and do not roll.")
    ] = False,
    give_deg: Annotated[
        float,
        typer.Option(help="By which a bushing lets the axis lean inboard at 10° to the left.", min=-2, max=2),
    ] = 0.0,
    config: Annotated[
        Path | None, typer.Option(help="TOML with rig, tyre, light and noise.", show_default=False)
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Render a vehicle whose steering is turned: pos_01 … of the front rigs, a shot of each rear one."""
    import numpy as np

    from sensors.simulation import (
        VehicleDraw,
        VehicleSpec,
        build_stand,
        draw_steering,
        draw_vehicle,
        straight_vehicle,
    )
    from station.rehearsal import read_simulation, write_steered_vehicle

    ready_new_folder(out)
    settings = read_simulation(config)
    compiled_for(("deformed_wheel_images" if load_mm or runout_mm else "wheel_images",), as_json)
    spec = VehicleSpec(shape=settings.tyre)
    draw = VehicleDraw(load_mm=load_mm, runout_mm=runout_mm)
    vehicle = straight_vehicle(draw_vehicle(seed, spec, draw, math.radians(yaw_deg)))
    steered = draw_steering(vehicle, 0.0 if brakes_held else 1.0, math.radians(give_deg))
    steers = np.radians(np.linspace(-sweep_deg, sweep_deg, positions) if positions > 1 else [0.0])
    truth = write_steered_vehicle(
        out,
        settings,
        steered,
        build_stand(spec, seed, settings.rig, settings.spec()),
        tuple(float(steer) for steer in steers),
    )
    if as_json:
        print_json({"vehicle": str(out), **truth.model_dump(mode="json", by_alias=True)})
    else:
        typer.echo(f"wrote {out}: {positions} positions of {', '.join(truth.wheels)}, vehicle.json")


def steering_axis_command(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="Folder with vehicle.json; for each front rig calibration.json and pos_01 …, one shot "
            "at each position of the steering; for each rear rig calibration.json and a shot.",
            show_default=False,
        ),
    ],
    brakes_held: Annotated[
        bool,
        typer.Option("--brakes-held", help="The wheels did not roll while the steering was turned."),
    ] = False,
    config: Annotated[
        Path | None,
        typer.Option(help="Station's configuration whose [measure] counts.", show_default=False),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Measure caster, kingpin inclination and the steering axes of a sweep; exit status 1 when refused."""
    from alignment.measure_steering import steered_settings
    from alignment.values import MeasureSettings
    from sensors.formats import read_shot
    from station.commands.steering_folder import measured_sweep, recorded_sweep
    from station.configuration import read_configuration

    settings = MeasureSettings() if config is None else read_configuration(config).settings.measure.settings()
    sweep = recorded_sweep(folder)
    first = sweep.wheels[0]
    images = read_shot(first.shots[0], first.calibration).images
    compiled_for_images(images, as_json)
    found = measured_sweep(sweep, steered_settings(settings), rolls=not brakes_held)
    result = sweep_as_json(found)
    if as_json:
        print_json(result)
    else:
        _print(result)
    if result["outcome"] == "refused":
        raise typer.Exit(GOAL_MISSED)


def sweep_as_json(found: MeasuredSweep) -> dict[str, Any]:
    """Return what `truewheel steering-axis --json` prints; what is not known is null."""
    from alignment.values import Refusal

    wheels = {name: _axis_as_json(axis) for name, axis in found.axes.items()}
    reasons = [f"{name}: {axis.reason}" for name, axis in found.axes.items() if isinstance(axis, Refusal)]
    pair = found.pair
    return {
        "outcome": "refused" if reasons else "measured",
        "reason": "; ".join(reasons) or None,
        "reference": found.reference,
        "coverage_factor": found.coverage_factor,
        "thrust_angle_deg": math.degrees(found.heading),
        "run_out": found.run_out,
        "wheels": wheels,
        "inner_angle_deg": None if pair is None else math.degrees(pair.inner_angle),
        "toe_out_left_turn_deg": None if pair is None else math.degrees(pair.toe_out_left),
        "toe_out_right_turn_deg": None if pair is None else math.degrees(pair.toe_out_right),
        "caster_difference_deg": None if pair is None else math.degrees(pair.differences["caster"]),
        "kpi_difference_deg": None if pair is None else math.degrees(pair.differences["kpi"]),
    }


def _axis_as_json(axis: Any) -> dict[str, Any]:
    from alignment.values import Refusal

    out: dict[str, Any] = {
        "outcome": "measured",
        "reason": None,
        "code": None,
        "warning": None,
        **{key: None for name in _WORDS for key in _keys(name)},
        "classic_caster_deg": None,
        "steered_right_deg": None,
        "steered_left_deg": None,
        "positions": None,
        "scatter_over_stated": None,
        "residual_rms_arcmin": None,
        "pattern_arcmin": None,
        "point_mm": None,
    }
    if isinstance(axis, Refusal):
        return out | {"outcome": "refused", "reason": axis.reason, "code": axis.code.value}
    found: SteeringAxis = axis
    for name in found.values:
        unit = 1.0 if name in _LENGTHS else math.degrees(1.0)
        value, u95 = _keys(name)
        out |= {value: unit * found.value(name), u95: unit * found.u95(name)}
    right, left = found.reach
    rms = math.sqrt(float((found.residuals**2).mean()))
    return out | {
        "warning": found.warning,
        "classic_caster_deg": math.degrees(found.classic_caster),
        "steered_right_deg": math.degrees(right),
        "steered_left_deg": math.degrees(left),
        "positions": len(found.angles),
        "scatter_over_stated": found.scatter,
        "residual_rms_arcmin": 60.0 * math.degrees(rms),
        "pattern_arcmin": 60.0 * math.degrees(found.pattern),
        "point_mm": [float(c) for c in found.point],
    }


def _keys(name: str) -> tuple[str, str]:
    unit = "mm" if name in _LENGTHS else "deg"
    return f"{name}_{unit}", f"{name}_u95_{unit}"


def _print(result: dict[str, Any]) -> None:
    wheels = result["wheels"]
    typer.echo(f"{'':<24}" + "".join(f"{name.replace('_', ' '):>24}" for name in wheels))
    for name, words in _WORDS.items():
        value, u95 = _keys(name)
        sign, digits = (" mm", 2) if name in _LENGTHS else ("°", 4)
        cells = [
            "–" if wheel[value] is None else f"{wheel[value]:+.{digits}f}{sign} ± {wheel[u95]:.{digits}f}"
            for wheel in wheels.values()
        ]
        typer.echo(f"{words:<24}" + "".join(f"{cell:>24}" for cell in cells))
    for side in ("left", "right"):
        angle = result[f"toe_out_{side}_turn_deg"]
        if angle is not None:
            typer.echo(
                f"toe-out on a turn to the {side}: {angle:+.3f}°, "
                f"inner wheel at {result['inner_angle_deg']:.2f}°"
            )
    typer.echo(f"caster and kingpin inclination to the {result['reference']}; {result['run_out']}")
    for name, wheel in wheels.items():
        if wheel["warning"] is not None:
            typer.echo(f"{name}: {wheel['warning']}")
    if result["reason"] is not None:
        typer.echo(f"refused: {result['reason']}")
