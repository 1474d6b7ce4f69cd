"""`truewheel measure` and `truewheel simulate wheel`."""

from __future__ import annotations

import math
import time
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_new_folder
from station.commands.warm_up import compiled_for, compiled_for_images

if TYPE_CHECKING:
    from alignment.values import Refusal, WheelMeasurement

simulate_app = typer.Typer(no_args_is_help=True, help="Render images in the recorded formats.")


class LoadShapeOption(StrEnum):
    """How the bulge of a loaded tyre falls off."""

    GAUSSIAN = "gaussian"
    WAVE = "wave"


class SideOption(StrEnum):
    """Side of the vehicle."""

    LEFT = "left"
    RIGHT = "right"


def measure(
    shots: Annotated[
        list[Path],
        typer.Argument(
            metavar="SHOT...",
            help="Folder of a recorded shot; with --spin at least eight of one wheel.",
            show_default=False,
        ),
    ],
    calibration: Annotated[
        Path, typer.Option(help="Calibration file of the rig that took it.", show_default=False)
    ],
    config: Annotated[
        Path | None, typer.Option(help="Station's configuration whose [measure] counts.", show_default=False)
    ] = None,
    spin: Annotated[
        bool, typer.Option("--spin", help="Spin axis of a wheel that was turned between the shots.")
    ] = False,
    runout_radius: Annotated[
        float, typer.Option(help="With --spin: where the run-out is given, millimetres.", min=1, max=1000)
    ] = 300.0,
    as_json: JsonFlag = False,
) -> None:
    """Measure camber and toe of one wheel from recorded images; exit status 1 when refused."""
    from alignment.errors import ConfigurationError
    from alignment.measure import measure_wheel
    from alignment.values import MeasureSettings
    from sensors.formats import read_calibration, read_shot
    from station.commands.spin import measure_turned_wheel
    from station.configuration import read_configuration

    settings = MeasureSettings() if config is None else read_configuration(config).settings.measure.settings()
    if spin:
        if not measure_turned_wheel(shots, calibration, settings, runout_radius, as_json):
            raise typer.Exit(GOAL_MISSED)
        return
    if len(shots) > 1:
        raise ConfigurationError(
            field="SHOT",
            expected="one shot",
            seen=str(len(shots)),
            cure="For the spin axis of a wheel that was turned between them add --spin",
        )
    (shot,) = shots
    known = read_calibration(calibration)
    images = read_shot(shot, known).images
    compiled_for_images(images, as_json)
    started = time.perf_counter()
    found = measure_wheel(images, known, settings)
    duration_ms = 1000.0 * (time.perf_counter() - started)
    result = measurement_as_json(found, known.id, duration_ms)
    if as_json:
        print_json(result)
    elif found:
        typer.echo(f"camber {result['camber_deg']:+.4f}° ± {result['camber_u95_deg']:.4f}°")
        typer.echo(f"toe    {result['toe_deg']:+.4f}° ± {result['toe_u95_deg']:.4f}°")
        if result["camber_unseen_deg"] is not None:
            camber, toe = (60.0 * result[f"{angle}_unseen_deg"] for angle in ("camber", "toe"))
            typer.echo(
                "± holds as calibrated; a camera or head that moved since and shows in no image could add up "
                f"to ±{camber:.2f}′ of camber and ±{toe:.2f}′ of toe"
            )
        typer.echo(
            f"{result['method']}, {result['points_used']} points, residual "
            f"{result['residual_rms_mm']:.4f} mm, calibration {known.id}, {duration_ms:.0f} ms"
        )
        rows = [head["row_px"] for head in result["heads"] if head["row_px"] is not None]
        if rows:
            typer.echo(f"rows of the cameras differ by at most {max(rows):.3f} px")
        if result["warning"]:
            typer.echo(f"warning: {result['warning']}")
    else:
        typer.echo(f"refused ({result['reason_code']}): {result['reason']}")
    if not found:
        raise typer.Exit(GOAL_MISSED)


def measurement_as_json(
    found: WheelMeasurement | Refusal, calibration_id: str, duration_ms: float
) -> dict[str, Any]:
    """Return what `truewheel measure --json` prints."""
    from alignment.values import Refusal

    result: dict[str, Any] = {
        "outcome": "refused",
        "reason": None,
        "reason_code": None,
        "camber_deg": None,
        "toe_deg": None,
        "camber_u95_deg": None,
        "toe_u95_deg": None,
        "camber_unseen_deg": None,
        "toe_unseen_deg": None,
        "plane": None,
        "points_used": None,
        "residual_rms_mm": None,
        "method": None,
        "heads": None,
        "knock_evidence": None,
        "warning": None,
        "duration_ms": duration_ms,
        "calibration_id": calibration_id,
    }
    if isinstance(found, Refusal):
        return result | {"reason": found.reason, "reason_code": str(found.code)}
    unseen = (None, None) if found.unseen is None else tuple(map(math.degrees, found.unseen))
    return result | {
        "outcome": "measured",
        "camber_deg": math.degrees(found.camber),
        "toe_deg": math.degrees(found.toe),
        "camber_u95_deg": math.degrees(found.camber_u95),
        "toe_u95_deg": math.degrees(found.toe_u95),
        "camber_unseen_deg": unseen[0],
        "toe_unseen_deg": unseen[1],
        "plane": {"normal": [float(n) for n in found.normal], "offset_mm": found.offset_mm},
        "points_used": int(found.points_used),
        "residual_rms_mm": float(found.residual_rms_mm),
        "method": found.method,
        "heads": [asdict(head) for head in found.heads],
        "knock_evidence": found.knock_evidence,
        "warning": found.warning,
    }


@simulate_app.command("wheel")
def simulate_wheel_command(
    camber: Annotated[float, typer.Option(help="Camber of the spin axis, degrees.", min=-10, max=10)],
    toe: Annotated[float, typer.Option(help="Toe of the spin axis, degrees.", min=-10, max=10)],
    seed: Annotated[int, typer.Option(help="Of rig, tyre and noise.", min=0, max=2**32 - 1)],
    out: Annotated[Path, typer.Option(help="New folder for shot, truth and calibration.")],
    side: Annotated[SideOption, typer.Option(help="Side of the vehicle.")] = SideOption.LEFT,
    spin: Annotated[float, typer.Option(help="Turn of the wheel, degrees.", min=-3600, max=3600)] = 0.0,
    runout: Annotated[
        float, typer.Option(help="Angle between tyre plane and spin axis, degrees.", min=0, max=5)
    ] = 0.0,
    runout_phase: Annotated[
        float, typer.Option(help="Where in the wheel the tyre leans to, degrees.", min=-360, max=360)
    ] = 0.0,
    offset: Annotated[
        tuple[float, float, float],
        typer.Option(help="Position of the wheel's centre in the rig frame: x y z, millimetres."),
    ] = (0.0, 0.0, 0.0),
    load_mm: Annotated[
        float,
        typer.Option(help="Bulge of the sidewall over the contact patch, millimetres.", min=0, max=30),
    ] = 0.0,
    load_width_deg: Annotated[
        float,
        typer.Option(help="Half width of the bulge: a Gaussian's sigma, degrees.", min=5, max=60),
    ] = 24.0,
    load_shape: Annotated[
        LoadShapeOption, typer.Option(help="How the bulge falls off; a wave swings back.")
    ] = LoadShapeOption.GAUSSIAN,
    side_force_mm: Annotated[
        float, typer.Option(help="Shift of the tread by side force, outboard positive.", min=-30, max=30)
    ] = 0.0,
    longitudinal_mm: Annotated[
        float,
        typer.Option(help="Bulge ahead of the contact patch by longitudinal force.", min=-10, max=10),
    ] = 0.0,
    config: Annotated[
        Path | None, typer.Option(help="TOML with rig, tyre, light and noise.", show_default=False)
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Render one wheel: a shot, truth.json, and calibration.json with the true cameras."""
    from alignment.errors import ConfigurationError
    from sensors.formats import TyreLoad
    from sensors.simulation import WheelPose
    from station.rehearsal import read_simulation, simulate_wheel, write_simulated_wheel

    ready_new_folder(out)
    farthest = max(map(abs, offset))
    if not farthest <= 100.0:
        raise ConfigurationError(field="--offset", expected="at most 100 mm", seen=f"{farthest:g} mm")
    load = None
    if load_mm or side_force_mm or longitudinal_mm:
        load = TyreLoad(
            bulge_mm=load_mm,
            width_deg=load_width_deg,
            shape="wave" if load_shape is LoadShapeOption.WAVE else "gaussian",
            side_mm=side_force_mm,
            side_width_deg=2.0 * load_width_deg,
            longitudinal_mm=longitudinal_mm,
        )
    compiled_for(("wheel_images" if load is None else "deformed_wheel_images",), as_json)
    pose = WheelPose(
        camber=math.radians(camber),
        toe=math.radians(toe),
        spin=math.radians(spin),
        run_out=math.radians(runout),
        run_out_phase=math.radians(runout_phase),
        offset_mm=offset,
    )
    shot, truth, calibration = simulate_wheel(
        read_simulation(config), "left" if side is SideOption.LEFT else "right", pose, seed, load
    )
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
        typer.echo(f"wrote {out}: {2 * len(shot.heads)} images, truth.json, calibration.json")
