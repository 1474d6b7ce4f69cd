"""`truewheel measure`."""

from __future__ import annotations

import math
import time
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.warm_up import compiled_for_images

if TYPE_CHECKING:
    from alignment.values import Refusal, WheelMeasurement


class SideOption(StrEnum):
    """Side of the vehicle."""

    LEFT = "left"
    RIGHT = "right"


def measure(
    shots: Annotated[
        list[Path],
        typer.Argument(
            metavar="SHOT",
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
        if result["load_mm"] is not None:
            typer.echo(
                f"the tyre carries load: up to {result['load_mm']:.2f} mm where the heads see it, taken off"
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
        "load_mm": None,
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
        "load_mm": found.load_mm,
    }
