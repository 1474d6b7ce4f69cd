"""`truewheel calibration …`: calibrations as files, and their life."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.commands.calibration_check import check_command
from station.commands.calibration_frame import frame_command
from station.commands.calibration_refresh import refresh_command
from station.commands.output import JsonFlag, print_json
from station.commands.outputs import ready_file, ready_folder
from station.commands.wheel import SideOption

if TYPE_CHECKING:
    pass

calibration_app = typer.Typer(no_args_is_help=True, help="Calibrations of rigs.")
calibration_app.command("check")(check_command)
calibration_app.command("refresh")(refresh_command)
calibration_app.command("frame")(frame_command)


class FormatOption(StrEnum):
    """Format of another program."""

    OPENCV = "opencv"
    KALIBR = "kalibr"
    MRCAL = "mrcal"


class UnitOption(StrEnum):
    """Unit of length of a file."""

    MILLIMETRE = "mm"
    METRE = "m"


@calibration_app.command("export")
def export_command(
    calibration: Annotated[Path, typer.Argument(help="Calibration file.", show_default=False)],
    kind: Annotated[FormatOption, typer.Option("--format", help="Format of the other program.")],
    out: Annotated[Path, typer.Option(help="New file; for mrcal a new folder.")],
    as_json: JsonFlag = False,
) -> None:
    """Write a calibration for another program.

    The covariance and the pose of the rig in the vehicle stay behind.
    """
    from sensors.formats import export_calibration, read_calibration

    if kind is FormatOption.MRCAL:
        ready_folder(out)
    else:
        ready_file(out, new=True)
    known = read_calibration(calibration)
    export_calibration(out, known, kind)
    cameras = 2 * len(known.heads)
    if as_json:
        print_json({"out": str(out), "format": str(kind), "calibration_id": known.id, "cameras": cameras})
    else:
        typer.echo(f"wrote {out}: {cameras} cameras of {known.id}")


@calibration_app.command("import")
def import_command(
    files: Annotated[list[Path], typer.Argument(help="Files of the other program.", show_default=False)],
    kind: Annotated[FormatOption, typer.Option("--format", help="Format of the other program.")],
    out: Annotated[Path, typer.Option(help="New calibration file.")],
    rig: Annotated[str, typer.Option(help="Name of the rig.")],
    side: Annotated[SideOption, typer.Option(help="Side of the vehicle.")],
    identity: Annotated[
        str | None, typer.Option("--id", help="Identity of the calibration.", show_default="from its content")
    ] = None,
    unit: Annotated[
        UnitOption | None, typer.Option(help="Unit of the poses.", show_default="mm for opencv, else m")
    ] = None,
    size: Annotated[
        tuple[int, int] | None,
        typer.Option(
            help="Size of the images, where an OpenCV file does not say: 1920 1080.", metavar="WIDTH HEIGHT"
        ),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Make a calibration from the files of another program.

    The frame in which they state the poses becomes the frame of the rig: origin at the wheel's centre, z
    outboard, y up. The rig's pose in the vehicle is taken to be nominal.
    """
    from dataclasses import replace
    from datetime import UTC, datetime

    from alignment.calibration import content_digest
    from sensors.formats import baselines_mm, import_calibration, write_calibration

    ready_file(out, new=True)
    imported = import_calibration(
        files,
        kind,
        identity=identity or "imported",
        rig=rig,
        side="left" if side is SideOption.LEFT else "right",
        unit_mm=None if unit is None else {UnitOption.MILLIMETRE: 1.0, UnitOption.METRE: 1000.0}[unit],
        size=size,
    )
    if identity is None:
        imported = replace(imported, id=f"imported-{rig}-{content_digest(imported)[:12]}")
    write_calibration(out, imported, method=f"imported from {kind}", created_utc=datetime.now(UTC))
    baselines = {name: round(length, 3) for name, length in baselines_mm(imported).items()}
    if as_json:
        print_json(
            {
                "out": str(out),
                "format": str(kind),
                "calibration_id": imported.id,
                "heads": list(baselines),
                "baselines_mm": baselines,
            }
        )
    else:
        heads = ", ".join(f"{name} (baseline {length:g} mm)" for name, length in baselines.items())
        typer.echo(f"wrote {out}: {imported.id}, heads {heads}")
