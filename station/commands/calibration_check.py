"""`truewheel calibration check`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_database
from station.commands.warm_up import compiled_for

if TYPE_CHECKING:
    from station.calibration import Checked


def check_command(
    folder: Annotated[
        Path,
        typer.Argument(
            help="Plate session, or shot of a master wheel.", show_default=False, metavar="FOLDER"
        ),
    ],
    calibration: Annotated[Path, typer.Option(help="Calibration file in force.", show_default=False)],
    camber: Annotated[
        float | None, typer.Option(help="Certified camber of the master wheel, degrees.", min=-10, max=10)
    ] = None,
    toe: Annotated[
        float | None, typer.Option(help="Certified toe of the master wheel, degrees.", min=-10, max=10)
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            help="Largest change of camber and toe, minutes of arc; for a master wheel the certificate's "
            "expanded uncertainty and the allowed drift.",
            min=0.01,
            max=10,
        ),
    ] = 0.2,
    database: Annotated[
        str | None, typer.Option(help="URL of the result database that keeps the check.", show_default=False)
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="Station's configuration whose [measure] counts.", show_default=False)
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Compare a new plate session, or a master wheel, with the calibration in force.

    Exit status 1 when the calibration is out of tolerance.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from alignment.errors import ConfigurationError
    from alignment.units import ARCMIN
    from alignment.values import MeasureSettings
    from sensors.formats import read_calibration_file
    from station.calibration import CheckLimits, MasterWheel, check_folder, store_check
    from station.configuration import read_configuration

    ready_database(database)
    if (camber is None) != (toe is None):
        raise ConfigurationError(
            field="--camber, --toe", expected="both certified angles of a master wheel", seen="only one"
        )
    master = None
    if camber is not None and toe is not None:
        master = MasterWheel(math.radians(camber), math.radians(toe))
    settings = MeasureSettings() if config is None else read_configuration(config).settings.measure.settings()
    file = read_calibration_file(calibration)
    compiled_for(("calibrate",) if master is None else ("measure_8",), as_json)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("check", total=1.0)
        checked = check_folder(
            folder,
            file.calibration(),
            master,
            CheckLimits(angle=tolerance * ARCMIN),
            settings,
            lambda done, doing: bar.update(task, completed=done, description=doing),
        )
    if database is not None:
        store_check(database, checked, file, file.model_dump(mode="json", by_alias=True))
    if as_json:
        print_json(_as_json(checked, file.id, database is not None))
    else:
        _print(checked, file.id)
    if checked.outcome != "within":
        raise typer.Exit(GOAL_MISSED)


def _as_json(checked: Checked, identity: str, stored: bool) -> dict[str, Any]:
    return {
        "outcome": str(checked.outcome),
        "reason": checked.reason,
        "kind": str(checked.kind),
        "rig": checked.rig,
        "calibration_id": identity,
        "time_utc": checked.utc.isoformat(),
        "figures": checked.figures,
        "stored": stored,
    }


def _print(checked: Checked, identity: str) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    cameras: list[dict[str, Any]] = checked.figures.get("cameras", [])
    if cameras:
        names = ("camera", "marks", "RMS px", "shift px", "turn ′", "corrected px", "blur px", "contrast")
        table = Table(*names, box=None)
        for each in cameras:
            u, v = each["shift_px"]
            table.add_row(
                f"{each['head']} {each['camera']}",
                str(each["marks"]),
                f"{each['residual_rms_px']:.3f}",
                f"{u:+.3f} {v:+.3f}",
                f"{math.hypot(*each['turn_arcmin']):.2f}",
                f"{each['corrected_rms_px']:.3f}",
                "" if each["blur_px"] is None else f"{each['blur_px']:.2f}",
                "" if each["contrast"] is None else f"{each['contrast']:.0f}",
            )
        console.print(table)
    console.print(
        f"{identity}: {'within' if checked.outcome == 'within' else 'OUT OF'} tolerance; {checked.reason}",
        markup=False,
        highlight=False,
    )
    for warning in checked.figures.get("warnings", []):
        console.print(f"warning: {warning}", markup=False, highlight=False)
