"""`truewheel calibration refresh`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from station.commands.output import JsonFlag, print_json


def refresh_command(
    shots: Annotated[
        list[Path],
        typer.Argument(help="Folders of shots of ordinary wheels; ten tell more.", show_default=False),
    ],
    calibration: Annotated[Path, typer.Option(help="Calibration file in force.", show_default=False)],
    out: Annotated[
        Path,
        typer.Option(help="New calibration file; not written when no camera changed.", show_default=False),
    ],
    focal: Annotated[
        bool, typer.Option("--focal", help="The lens may have been refocused: its focal length too.")
    ] = False,
    config: Annotated[
        Path | None, typer.Option(help="Station's configuration whose [measure] counts.", show_default=False)
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Find the one camera that was moved, from shots of ordinary wheels, and estimate its pose anew.

    Light lines must meet their epipolar lines, and all heads must see one body of revolution. All other
    cameras are held. What wheels cannot tell stays uncertain, and the calibration says how much: when its
    angles are too uncertain, calibrate with the plate.
    """
    from datetime import UTC, datetime

    from alignment.values import MeasureSettings
    from station.calibration_refresh import refresh_file, refreshed_as_json
    from station.config import read_configuration

    settings = MeasureSettings() if config is None else read_configuration(config).settings.measure.settings()
    found, new = refresh_file(shots, calibration, out, datetime.now(UTC), settings, focal=focal)
    result = refreshed_as_json(found, new) | {"out": None if new is None else str(out), "shots": len(shots)}
    if as_json:
        print_json(result)
    else:
        _print(result)


def _print(result: dict[str, Any]) -> None:
    for head in result["heads"]:
        verdict = "CHANGED" if head["changed"] else "as calibrated"
        typer.echo(f"{head['head']}: {head['row_rms_px']:.3f} px RMS of {head['pairs']} crosses, {verdict}")
    if result["camera"] is None:
        typer.echo("no camera changed; nothing written")
        return
    turn = ", ".join(f"{angle:+.2f}′" for angle in result["turn_arcmin"])
    move = ", ".join(f"{value:+.3f}" for value in result["move_mm"])
    typer.echo(
        f"{' '.join(result['camera'])} changed: turned {turn}, moved {move} mm; its head's rows now "
        f"{result['row_rms_px']:.3f} px RMS, from the surfaces of {result['wheels']} wheels"
    )
    other = result["other"]
    if other is not None:
        typer.echo(
            f"undecided: with {100 * other['share']:.0f} % it was {' '.join(other['camera'])}, which would "
            f"change camber by {other['camber_difference_arcmin']:+.2f}′ and toe by "
            f"{other['toe_difference_arcmin']:+.2f}′; the uncertainty below covers both, more shots tell more"
        )
    if result["predicted_camber_u95_deg"] is not None:
        camber, toe = (60.0 * result[f"predicted_{name}_u95_deg"] for name in ("camber", "toe"))
        typer.echo(f"angles from now on: camber ±{camber:.2f}′, toe ±{toe:.2f}′ (95 %) from the calibration")
    typer.echo(f"wrote {result['out']}: {result['calibration_id']}")
