"""`truewheel calibration refresh`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_file
from station.commands.warm_up import compiled_for


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
    largest_u95: Annotated[
        float,
        typer.Option(
            help="Largest expanded uncertainty of an angle that the new calibration may state, arcminutes.",
            min=0.01,
            max=60,
        ),
    ] = 0.2,
    config: Annotated[
        Path | None, typer.Option(help="Station's configuration whose [measure] counts.", show_default=False)
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Find the one camera that was moved, from shots of ordinary wheels, and estimate its pose anew.

    Light lines must meet their epipolar lines, and all heads must see one body of revolution. All other
    cameras are held. What wheels cannot tell stays uncertain, and the calibration says how much: when its
    angles would be too uncertain, or more so than they are wrong now, nothing is written, exit status 1:
    calibrate with the plate.
    """
    from datetime import UTC, datetime

    from alignment.units import ARCMIN
    from alignment.values import MeasureSettings
    from station.calibration import refresh_file, refreshed_as_json
    from station.configuration import read_configuration

    ready_file(out)
    settings = MeasureSettings() if config is None else read_configuration(config).settings.measure.settings()
    compiled_for(("measure_8", "refresh"), as_json)
    done = refresh_file(
        shots, calibration, out, datetime.now(UTC), settings, focal=focal, largest_u95=largest_u95 * ARCMIN
    )
    written = None if done.calibration is None else str(out)
    result = refreshed_as_json(done) | {"out": written, "shots": len(shots)}
    if as_json:
        print_json(result)
    else:
        _print(result)
    if done.refused is not None:
        raise typer.Exit(GOAL_MISSED)


def _print(result: dict[str, Any]) -> None:
    for head in result["heads"]:
        verdict = "CHANGED" if head["changed"] else "as calibrated"
        typer.echo(f"{head['head']}: {head['row_rms_px']:.3f} px RMS of {head['pairs']} crosses, {verdict}")
    if result["contradiction"] is not None:
        typer.echo(
            f"surfaces of the wheels: {result['contradiction']:.2f} of what an unchanged rig stays below"
        )
    old = [60.0 * result[f"old_{name}_u95_deg"] for name in ("camber", "toe")]
    if result["camera"] is None:
        typer.echo("no camera changed; nothing written")
        if result["contradiction"] is None:
            typer.echo("fewer than three wheels: a turn that moves no line off its row would not show")
        if result["unseen_u95_deg"] is not None:
            camber, toe = (60.0 * each for each in result["unseen_u95_deg"])
            typer.echo(
                "what these wheels cannot show, such as a head that came nearer by 0.05 mm: "
                f"camber ±{camber:.2f}′, toe ±{toe:.2f}′ (95 %); a check with plate or master wheel shows it"
            )
        typer.echo(f"angles as before: camber ±{old[0]:.2f}′, toe ±{old[1]:.2f}′ (95 %) from the calibration")
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
    change = [result[f"{name}_change_arcmin"] for name in ("camber", "toe")]
    typer.echo(f"camber changes by {change[0]:+.2f}′, toe by {change[1]:+.2f}′")
    camber, toe = (60.0 * result[f"predicted_{name}_u95_deg"] for name in ("camber", "toe"))
    typer.echo(
        f"angles from now on: camber ±{camber:.2f}′, toe ±{toe:.2f}′ (95 %) from the calibration; "
        f"the one in force states ±{old[0]:.2f}′, ±{old[1]:.2f}′"
    )
    if result["reason"] is not None:
        typer.echo(f"refused, nothing written: {result['reason']}")
        return
    typer.echo(f"wrote {result['out']}: {result['calibration_id']}")
