"""`truewheel simulate wheel`: a wheel in the air or on the road, that stands or turns."""

from __future__ import annotations

import math
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.commands.output import JsonFlag, print_json
from station.commands.outputs import ready_new_folder
from station.commands.warm_up import compiled_for
from station.commands.wheel import SideOption

if TYPE_CHECKING:
    from alignment.values import Side
    from sensors.formats import TyreLoad

simulate_app = typer.Typer(no_args_is_help=True, help="Render images in the recorded formats.")


class LoadShapeOption(StrEnum):
    """How the bulge of a loaded tyre falls off."""

    GAUSSIAN = "gaussian"
    WAVE = "wave"


_Camber = Annotated[float, typer.Option(help="Camber of the spin axis, degrees.", min=-10, max=10)]
_Toe = Annotated[float, typer.Option(help="Toe of the spin axis, degrees.", min=-10, max=10)]
_Seed = Annotated[int, typer.Option(help="Of rig, tyre and noise.", min=0, max=2**32 - 1)]
_Out = Annotated[Path, typer.Option(help="New folder for shot, truth and calibration.")]
_Side = Annotated[SideOption, typer.Option(help="Side of the vehicle.")]
_Spin = Annotated[float, typer.Option(help="Turn of the wheel, degrees.", min=-3600, max=3600)]
_Runout = Annotated[
    float, typer.Option(help="Angle between tyre plane and spin axis, degrees.", min=0, max=5)
]
_RunoutPhase = Annotated[
    float, typer.Option(help="Where in the wheel the tyre leans to, degrees.", min=-360, max=360)
]
_SecondHarmonic = Annotated[
    float, typer.Option(help="Second harmonic of the tyre's run-out, peak to peak.", min=0, max=5)
]
_RimRunout = Annotated[
    float, typer.Option(help="Run-out of the rim, peak to peak at its edge.", min=0, max=5)
]
_Offset = Annotated[
    tuple[float, float, float],
    typer.Option(
        help="Position of the wheel's centre in the rig frame, millimetres: 3 -2 4.",
        metavar="X Y Z",
        show_default="0 0 0",
    ),
]
_LoadMm = Annotated[
    float,
    typer.Option(help="Bulge of the sidewall over the contact patch, millimetres.", min=0, max=30),
]
_LoadWidth = Annotated[
    float,
    typer.Option(help="Half width of the bulge: a Gaussian's sigma, degrees.", min=5, max=60),
]
_LoadShape = Annotated[LoadShapeOption, typer.Option(help="How the bulge falls off; a wave swings back.")]
_SideForce = Annotated[
    float, typer.Option(help="Shift of the tread by side force, outboard positive.", min=-30, max=30)
]
_Longitudinal = Annotated[
    float,
    typer.Option(help="Bulge ahead of the contact patch by longitudinal force.", min=-10, max=10),
]
_Turns = Annotated[
    int, typer.Option(help="Exposures of a wheel that rollers turn; 0: one that stands.", min=0, max=99)
]
_Speed = Annotated[
    float,
    typer.Option(help="With --turns: of the wheel, degrees per second, forward.", min=-720, max=720),
]
_Interval = Annotated[
    float, typer.Option(help="With --turns: mean time between exposures.", min=0.01, max=10)
]
_WanderMm = Annotated[float, typer.Option(help="With --turns: most that the centre wanders.", min=0, max=20)]
_WanderDeg = Annotated[
    float, typer.Option(help="With --turns: most that camber and toe wander.", min=0, max=2)
]
_Config = Annotated[
    Path | None, typer.Option(help="TOML with rig, tyre, light and noise.", show_default=False)
]


@simulate_app.command("wheel")
def simulate_wheel_command(
    camber: _Camber,
    toe: _Toe,
    seed: _Seed,
    out: _Out,
    side: _Side = SideOption.LEFT,
    spin: _Spin = 0.0,
    runout: _Runout = 0.0,
    runout_phase: _RunoutPhase = 0.0,
    second_harmonic_mm: _SecondHarmonic = 0.0,
    rim_runout_mm: _RimRunout = 0.0,
    offset: _Offset = (0.0, 0.0, 0.0),
    load_mm: _LoadMm = 0.0,
    load_width_deg: _LoadWidth = 24.0,
    load_shape: _LoadShape = LoadShapeOption.GAUSSIAN,
    side_force_mm: _SideForce = 0.0,
    longitudinal_mm: _Longitudinal = 0.0,
    turns: _Turns = 0,
    speed_deg_s: _Speed = 170.0,
    interval_s: _Interval = 0.28,
    wander_mm: _WanderMm = 1.0,
    wander_deg: _WanderDeg = 0.05,
    config: _Config = None,
    as_json: JsonFlag = False,
) -> None:
    """Render one wheel: a shot or turn_01 …, truth.json, and calibration.json with the true cameras."""
    from alignment.errors import ConfigurationError
    from sensors.simulation import Road, Rollers, WheelPose, Wobble
    from station.rehearsal import (
        read_simulation,
        simulate_turning_wheel,
        simulate_wheel,
        write_simulated_wheel,
        write_turning_wheel,
    )

    ready_new_folder(out)
    farthest = max(map(abs, offset))
    if not farthest <= 100.0:
        raise ConfigurationError(field="--offset", expected="at most 100 mm", seen=f"{farthest:g} mm")
    pose = WheelPose(
        camber=math.radians(camber),
        toe=math.radians(toe),
        spin=math.radians(spin),
        run_out=math.radians(runout),
        run_out_phase=math.radians(runout_phase),
        offset_mm=offset,
    )
    load = _load(load_mm, load_width_deg, load_shape, side_force_mm, longitudinal_mm)
    wobble = None
    if second_harmonic_mm or rim_runout_mm:
        wobble = Wobble(second_mm=second_harmonic_mm, rim_mm=rim_runout_mm)
    rollers = Rollers(
        math.radians(speed_deg_s), interval_s, wander_mm=wander_mm, wander=math.radians(wander_deg)
    )
    road = Road(load, wobble, rollers)
    plain = load is None and wobble is None
    compiled_for(("wheel_images" if plain else "deformed_wheel_images",), as_json)
    settings = read_simulation(config)
    of_vehicle: Side = "left" if side is SideOption.LEFT else "right"
    if turns:
        exposures, calibration = simulate_turning_wheel(settings, of_vehicle, pose, seed, road, turns)
        truth = write_turning_wheel(out, exposures, calibration)
    else:
        shot, truth, calibration = simulate_wheel(settings, of_vehicle, pose, seed, road)
        write_simulated_wheel(out, shot, truth, calibration)
    if as_json:
        print_json(
            {
                "shot": str(out),
                "truth": str(out / "truth.json"),
                "calibration": str(out / "calibration.json"),
                "calibration_id": calibration.id,
                **asdict(truth),
            }
        )
    else:
        what = f"turn_01 to turn_{turns:02d}" if turns else f"{2 * len(calibration.heads)} images"
        typer.echo(f"wrote {out}: {what}, truth.json, calibration.json")


def _load(
    bulge_mm: float, width_deg: float, shape: LoadShapeOption, side_mm: float, longitudinal_mm: float
) -> TyreLoad | None:
    from sensors.formats import TyreLoad

    if not (bulge_mm or side_mm or longitudinal_mm):
        return None
    return TyreLoad(
        bulge_mm=bulge_mm,
        width_deg=width_deg,
        shape="wave" if shape is LoadShapeOption.WAVE else "gaussian",
        side_mm=side_mm,
        side_width_deg=2.0 * width_deg,
        longitudinal_mm=longitudinal_mm,
    )
