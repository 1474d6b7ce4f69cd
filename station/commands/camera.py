"""`truewheel camera`: which camera drivers are installed."""

from __future__ import annotations

import typer

from station.commands.output import BAD_INPUT, JsonFlag, print_json

camera_app = typer.Typer(no_args_is_help=True, help="Cameras: drivers, images, exposure.")


@camera_app.command("list")
def list_drivers(as_json: JsonFlag = False) -> None:
    """List the installed camera drivers: name, package, version. None of them is loaded.

    Exit status 2 when two packages bring a driver of one name.
    """
    from sensors.drivers.installed import conflicts, installed_drivers

    installed = installed_drivers()
    findings = conflicts(installed)
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
                "findings": [str(finding) for finding in findings],
                "figures": {"drivers": len(installed), "findings": len(findings)},
            }
        )
    else:
        rows = [("name", "package", "version"), *((one.name, one.package, one.version) for one in installed)]
        widths = [max(len(row[column]) for row in rows) for column in range(3)]
        for row in rows:
            typer.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    for finding in findings if not as_json else []:
        typer.echo(f"truewheel: {finding}", err=True)
    if findings:
        raise typer.Exit(BAD_INPUT)
