"""`truewheel camera`: which camera drivers are installed, and which cameras they see."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import TimeoutError as LateError
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from alignment.errors import TruewheelError
from station.commands.output import BAD_INPUT, JsonFlag, print_json

if TYPE_CHECKING:
    from sensors.drivers.driver import SeenCamera

camera_app = typer.Typer(no_args_is_help=True, help="Cameras: drivers, images, exposure, health.")

_SEARCH_S = 20.0


@camera_app.command("list")
def list_cameras(
    drivers: Annotated[
        bool, typer.Option("--drivers", help="Only the drivers; none of them is loaded.")
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """List the installed camera drivers, and the cameras that they see: serial number, model, address.

    Cameras are looked for on the network and on USB by the drivers that can; what keeps one from looking is
    told. With PYLON_CAMEMU set, pylon looks for emulated cameras alone. Exit status 2 when two packages bring
    a driver of one name.
    """
    from sensors.drivers.installed import conflicts, installed_drivers

    installed = installed_drivers()
    findings = conflicts(installed)
    seen, notes = ([], []) if drivers else _search(dict.fromkeys(one.name for one in installed))
    if as_json:
        print_json(
            {
                "drivers": [
                    {
                        "name": one.name,
                        "package": one.package,
                        "version": one.version,
                        "entry_point": one.target,
                    }
                    for one in installed
                ],
                "cameras": [{"driver": name} | asdict(camera) for name, camera in seen],
                "findings": [str(finding) for finding in findings],
                "notes": notes,
                "figures": {"drivers": len(installed), "cameras": len(seen), "findings": len(findings)},
            }
        )
    else:
        _print_table(
            [("name", "package", "version"), *((one.name, one.package, one.version) for one in installed)]
        )
        if seen:
            typer.echo()
            _print_table([("driver", "serial number", "model", "name", "address"), *map(_row, seen)])
    for text in [] if as_json else [*map(str, findings), *notes]:
        typer.echo(f"truewheel: {text}", err=True)
    if findings:
        raise typer.Exit(BAD_INPUT)


def _search(names: Iterable[str]) -> tuple[list[tuple[str, SeenCamera]], list[str]]:
    """Let each driver look for its cameras, within a bound; and what kept one from it."""
    from sensors.drivers.installed import seen_cameras
    from station.threads import Worker

    seen = []
    notes = []
    # Around all of it: a search that hangs would keep what its thread redirects.
    with contextlib.redirect_stdout(sys.stderr):
        for name in names:
            # A maker's library may hang: the next driver has a thread of its own.
            worker = Worker(f"cameras of {name}")
            try:
                seen += [(name, camera) for camera in worker.submit(seen_cameras, name).result(_SEARCH_S)]
            except LateError:
                notes.append(f"{name}: cameras were not found within {_SEARCH_S:g} s")
            except TruewheelError as error:
                notes.append(f"{name}: {error}")
            finally:
                worker.close(0.0)
    return seen, notes


def _row(found: tuple[str, SeenCamera]) -> tuple[str, ...]:
    name, camera = found
    return name, camera.serial_number, camera.model, camera.user_name, camera.address


def _print_table(rows: Sequence[Sequence[str]]) -> None:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        typer.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
