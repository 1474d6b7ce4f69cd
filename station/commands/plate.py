"""`truewheel simulate plate-session`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.commands.output import JsonFlag, print_json
from station.commands.outputs import ready_new_folder
from station.commands.warm_up import compiled_for
from station.commands.wheel import SideOption
from station.configuration import default_config


def simulate_plate_session_command(
    out: Annotated[Path, typer.Option(help="New folder for session, truth and calibration.")],
    seed: Annotated[int, typer.Option(help="Of rig, plate, stage and noise.", min=0, max=2**32 - 1)],
    plate: Annotated[
        Path | None,
        typer.Option(help="Description of the plate.", show_default="configs/plates/rig.toml, or head.toml"),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="TOML with rig, optics and cameras.", show_default=False)
    ] = None,
    views: Annotated[int, typer.Option(help="Positions of the plate.", min=3, max=9)] = 7,
    side: Annotated[SideOption, typer.Option(help="Side of the vehicle.")] = SideOption.LEFT,
    head: Annotated[
        str | None, typer.Option(help="Only this head, with the plate below it.", show_default="all heads")
    ] = None,
    shift_mm: Annotated[
        float,
        typer.Option(help="How far shifted positions lie aside; more for small plates.", min=0, max=200),
    ] = 7.5,
    as_json: JsonFlag = False,
) -> None:
    """Render images of a plate: a session, truth.json, and calibration.json with the true cameras."""
    from sensors.formats import read_plate
    from station.rehearsal import read_simulation, simulate_session, write_simulated_session

    ready_new_folder(out)
    compiled_for(("plate_images",), as_json)
    path = default_config(plate, "plates/rig.toml" if head is None else "plates/head.toml")
    session, truth, calibration = simulate_session(
        read_simulation(config),
        read_plate(path),
        "left" if side is SideOption.LEFT else "right",
        seed,
        views,
        head,
        shift_mm,
    )
    write_simulated_session(out, session, truth, calibration)
    images = sum(len(view.images) for view in session.views)
    if as_json:
        print_json(
            {
                "session": str(out),
                "truth": str(out / "truth.json"),
                "calibration": str(out / "calibration.json"),
                "calibration_id": calibration.id,
                "rig": session.rig,
                "side": session.side,
                "plate": session.plate.file.name,
                "seed": seed,
                "views": [view.name for view in session.views],
                "images": images,
            }
        )
    else:
        typer.echo(f"wrote {out}: {images} images, truth.json, calibration.json")
