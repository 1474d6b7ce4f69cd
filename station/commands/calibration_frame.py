"""`truewheel calibration frame`, and `truewheel simulate gauge-session`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json, reason_of_force
from station.commands.outputs import ready_database, ready_new_folder
from station.commands.warm_up import compiled_for
from station.commands.words import remedy_in_commands
from station.configuration import default_config


def frame_command(
    session: Annotated[
        Path,
        typer.Argument(
            help="Gauge session: a folder with a plate session for each rig, one view each.",
            show_default=False,
        ),
    ],
    calibration: Annotated[
        list[Path],
        typer.Option(help="Calibration file of a rig; give one for each rig.", show_default=False),
    ],
    out: Annotated[
        Path,
        typer.Option(help="New folder for the calibrations with the measured poses.", show_default=False),
    ],
    frame: Annotated[
        Path | None,
        typer.Option(help="Description of the gauge frame.", show_default="configs/plates/gauge.toml"),
    ] = None,
    database: Annotated[
        str | None,
        typer.Option(help="URL of the result database that keeps the calibrations.", show_default=False),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Place a rig though its pose is not what is believed.")
    ] = False,
    reason: Annotated[
        str, typer.Option(help="Why it is forced; the calibration's method keeps it.", show_default=False)
    ] = "",
    as_json: JsonFlag = False,
) -> None:
    """Put all rigs into the vehicle frame: one view of a gauge frame with a plate for each.

    Nothing is written unless every rig is accepted; exit status 1 when one is refused.
    """
    from datetime import UTC, datetime

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from sensors.formats import read_gauge_frame
    from station.calibration import framed_as_json, keep, place_rigs

    ready_new_folder(out)
    ready_database(database)
    forced_reason = reason_of_force(force, reason, "placing", longest=100)
    compiled_for(("calibrate",), as_json)
    gauge = read_gauge_frame(default_config(frame, "plates/gauge.toml"))
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    now = datetime.now(UTC)
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reading the images", total=1.0)
        framed = place_rigs(
            session,
            gauge,
            calibration,
            now,
            lambda done, doing: bar.update(task, completed=done, description=doing),
            forced_reason,
        )
    accepted = all(each.calibration is not None for each in framed)
    files = keep(out, framed, gauge, now, database) if accepted else {}
    result = framed_as_json(framed, files, remedy_in_commands) | {
        "frame": gauge.file.name,
        "stored": accepted and database is not None,
    }
    if as_json:
        print_json(result)
    else:
        _print(result)
    if not accepted:
        raise typer.Exit(GOAL_MISSED)


def _print(result: dict[str, Any]) -> None:
    for rig in result["rigs"]:
        if rig["outcome"] == "refused":
            remedy = f". {rig['remedy']}" if rig["remedy"] else ""
            typer.echo(f"{rig['rig']}: REFUSED, {rig['reason']}{remedy}")
            continue
        x, y, z = rig["position_mm"]
        typer.echo(
            f"{rig['rig']}: at ({x:.2f}, {y:.2f}, {z:.2f}) mm in the vehicle, camber changes by "
            f"{rig['camber_change_arcmin']:+.2f}′ and toe by {rig['toe_change_arcmin']:+.2f}′; "
            f"±{rig['transfer_u95_arcmin']:.3f}′ (95 %) from seeing the plate"
        )
        if rig["forced_reason"] is not None:
            typer.echo(f"{rig['rig']}: FORCED: {rig['forced_reason']}")
        if rig["calibration"] is not None:
            typer.echo(f"wrote {rig['calibration']}: {rig['calibration_id']}")
    if result["outcome"] == "refused":
        typer.echo("nothing written")


def simulate_gauge_session_command(
    out: Annotated[Path, typer.Option(help="New folder for the rigs' sessions, truths and calibrations.")],
    seed: Annotated[int, typer.Option(help="Of rigs, plates and noise.", min=0, max=2**32 - 1)],
    frame: Annotated[
        Path | None,
        typer.Option(help="Description of the gauge frame.", show_default="configs/plates/gauge.toml"),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="TOML with rig, optics and cameras.", show_default=False)
    ] = None,
    askew: Annotated[
        float,
        typer.Option(
            help="By which rigs are turned from their plan, one standard deviation, degrees; 0 as wheels are "
            "rendered.",
            min=0,
            max=5,
        ),
    ] = 0.3,
    as_json: JsonFlag = False,
) -> None:
    """Render one view of a gauge frame by all rigs: for each a session, truth.json and calibration.json.

    The calibrations hold the true cameras and the nominal pose of the rig; the truths hold the true pose.
    """
    from sensors.formats import read_gauge_frame
    from station.rehearsal import read_simulation, simulate_gauge_session, write_gauge_session

    ready_new_folder(out)
    compiled_for(("plate_images",), as_json)
    gauge = read_gauge_frame(default_config(frame, "plates/gauge.toml"))
    rigs = simulate_gauge_session(read_simulation(config), gauge, seed, askew)
    write_gauge_session(out, rigs)
    images = sum(len(rig.session.views[0].images) for rig in rigs)
    names = [rig.session.rig for rig in rigs]
    if as_json:
        print_json(
            {
                "session": str(out),
                "frame": gauge.file.name,
                "seed": seed,
                "images": images,
                "rigs": [
                    {
                        "rig": name,
                        "session": str(out / name),
                        "truth": str(out / name / "truth.json"),
                        "calibration": str(out / name / "calibration.json"),
                    }
                    for name in names
                ],
            }
        )
    else:
        typer.echo(f"wrote {out}: {images} images of {', '.join(names)}, truth.json, calibration.json")
