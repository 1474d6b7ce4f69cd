"""`truewheel init` and `truewheel config`: a configuration to start from, and whether one is sound."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from alignment.counting import count_of, listed
from alignment.errors import Words
from station.commands.output import BAD_INPUT, JsonFlag, print_json
from station.commands.words import remedy_in_commands
from station.configuration import own_config

config_app = typer.Typer(no_args_is_help=True, help="The station's configuration.")


def init(
    folder: Annotated[
        Path, typer.Argument(help="Home of the station; made when missing.", show_default=False)
    ],
    station: Annotated[str, typer.Option(help="Identity of the station in every record.")] = "station_1",
    as_json: JsonFlag = False,
) -> None:
    """Write a configuration with simulated rigs that starts as it stands, to be edited."""
    from station.configuration import write_starter

    written = write_starter(folder, station)
    if as_json:
        print_json({"files": [str(path) for path in written]})
        return
    for path in written:
        typer.echo(f"wrote {path}")
    settings = folder / "configs" / "station.toml"
    typer.echo(f"\nEdit {settings}, then:")
    typer.echo(f"  truewheel config check {settings}")
    typer.echo(f"  truewheel run --config {settings}")


@config_app.command()
def check(
    file: Annotated[
        Path | None, typer.Argument(help="Station's configuration.", show_default="configs/station.toml")
    ] = None,
    uncalibrated: Annotated[
        bool,
        typer.Option(
            "--uncalibrated",
            help="Rigs may have no calibration yet, as while their cameras are commissioned.",
        ),
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Validate a configuration and all that it names, without starting; every mistake at once."""
    from station.line.wire import ONE_PROCESS
    from station.running import check_configuration

    path = own_config(file)
    configuration, errors = check_configuration(path, uncalibrated=uncalibrated)
    rigs = () if configuration is None else configuration.settings.rigs
    bare = [rig.name for rig in rigs if rig.calibration is None and not rig.knows_calibration]
    findings = [error.told(Words(remedy=remedy_in_commands)) for error in errors]
    if as_json:
        print_json(
            {
                "file": str(path),
                "findings": findings,
                "uncalibrated": bare,
                "hash": None if configuration is None else configuration.hash,
                "figures": {"findings": len(findings)},
            }
        )
    elif findings:
        for finding in findings:
            typer.echo(f"truewheel: {finding}", err=True)
    else:
        assert configuration is not None
        settings = configuration.settings
        typer.echo(
            f"{path} is sound: station {settings.station.id}, {count_of(len(settings.rigs), 'rig')},"
            f" {len(configuration.vehicle_types)} vehicle types, line {settings.line.interface}"
            f" {settings.line.channel}"
        )
        if bare:
            typer.echo(f"not calibrated yet, the station does not start with them: {listed(bare)}")
        if settings.line.interface == ONE_PROCESS:
            typer.echo(
                f"the interface {ONE_PROCESS} is in one process only, no PLC reaches it: name that of your "
                "bus, or try the station without one, `truewheel run --cable NAME`"
            )
    if findings:
        raise typer.Exit(BAD_INPUT)
