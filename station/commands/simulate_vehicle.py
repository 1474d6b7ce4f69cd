"""`truewheel simulate vehicle`: four wheels of one vehicle on a stand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from station.commands.output import JsonFlag, print_json
from station.commands.outputs import ready_new_folder
from station.commands.warm_up import compiled_for


def simulate_vehicle_command(
    seed: Annotated[int, typer.Option(help="Of stand, vehicle and noise.", min=0, max=2**32 - 1)],
    out: Annotated[Path, typer.Option(help="New folder for rigs, vehicle.json and truth.json.")],
    yaw_deg: Annotated[
        float, typer.Option(help="Of the vehicle on the stand, to the left, degrees.", min=-5, max=5)
    ] = 0.0,
    offset_mm: Annotated[
        float, typer.Option(help="Of the vehicle to the left, millimetres.", min=-40, max=40)
    ] = 0.0,
    along_mm: Annotated[
        float, typer.Option(help="Of the vehicle forward, millimetres.", min=-40, max=40)
    ] = 0.0,
    load_mm: Annotated[
        float, typer.Option(help="Bulge of the front tyres under load; 0: in the air.", min=0, max=15)
    ] = 0.0,
    runout_mm: Annotated[
        float, typer.Option(help="Largest run-out of a tyre, peak to peak, millimetres.", min=0, max=5)
    ] = 0.0,
    tyre_width_sigma_mm: Annotated[
        float, typer.Option(help="Spread of the widths of the tyres, millimetres.", min=0, max=5)
    ] = 0.0,
    turns: Annotated[
        int, typer.Option(help="Exposures of wheels that rollers turn; 0: they stand.", min=0, max=99)
    ] = 0,
    wander_mm: Annotated[
        float, typer.Option(help="With --turns: most that a wheel wanders.", min=0, max=20)
    ] = 1.0,
    wander_deg: Annotated[
        float, typer.Option(help="With --turns: most that camber and toe wander.", min=0, max=2)
    ] = 0.05,
    config: Annotated[
        Path | None, typer.Option(help="TOML with rig, tyre, light and noise.", show_default=False)
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Render a vehicle: a shot or turn_01 … and the true calibration of each rig, vehicle.json, truth."""
    from sensors.simulation import Rollers, VehicleDraw, VehicleSpec, build_stand, draw_vehicle
    from station.rehearsal import read_simulation, write_simulated_vehicle

    ready_new_folder(out)
    settings = read_simulation(config)
    compiled_for(("deformed_wheel_images" if load_mm or runout_mm else "wheel_images",), as_json)
    spec = VehicleSpec(shape=settings.tyre)
    draw = VehicleDraw(tyre_width_sigma_mm=tyre_width_sigma_mm, load_mm=load_mm, runout_mm=runout_mm)
    vehicle = draw_vehicle(seed, spec, draw, math.radians(yaw_deg), (along_mm, offset_mm))
    truth = write_simulated_vehicle(
        out,
        settings,
        vehicle,
        build_stand(spec, seed, settings.rig, settings.spec()),
        turns=turns,
        rollers=Rollers(wander_mm=wander_mm, wander=math.radians(wander_deg)),
        tyre_width_sigma_mm=tyre_width_sigma_mm,
    )
    if as_json:
        print_json({"vehicle": str(out), **truth.model_dump(mode="json", by_alias=True)})
    else:
        typer.echo(f"wrote {out}: {', '.join(truth.wheels)}, vehicle.json, truth.json")
