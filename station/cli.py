"""The command line. Loads only what a verb needs: `truewheel --help` answers at once."""

from __future__ import annotations

import logging
import sys
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.main import get_command

from alignment.errors import (
    ConfigurationError,
    InputError,
    SeveralErrors,
    StoreDamagedError,
    StoreSchemaError,
    TruewheelError,
    told,
)
from station.commands import wheel
from station.commands.bench import bench
from station.commands.calibrate import calibrate
from station.commands.calibration import calibration_app
from station.commands.calibration_frame import simulate_gauge_session_command
from station.commands.camera import camera_app
from station.commands.camera_health import camera_health
from station.commands.camera_work import exposure, live, show
from station.commands.capture import capture_app
from station.commands.concession import concession_app
from station.commands.configuration import config_app, init
from station.commands.database import db_app
from station.commands.demo import demo
from station.commands.export import export
from station.commands.gauge import gauge_app
from station.commands.line import line_app
from station.commands.master import master_app
from station.commands.measure_vehicle import measure_vehicle_command
from station.commands.output import BAD_INPUT, STATION_FAULT, print_json
from station.commands.plate import simulate_plate_session_command
from station.commands.replay import replay
from station.commands.report import report
from station.commands.simulate import simulate_app
from station.commands.simulate_vehicle import simulate_vehicle_command
from station.commands.steering import simulate_steering_command, steering_axis_command
from station.commands.study import study
from station.commands.version import print_version
from station.commands.warm_up import warm_up
from station.commands.words import Running, Verbs
from station.commands.zero import zero_app
from station.commands.zero_vehicle import measure_vehicle_zeros_command
from station.configuration import damaged_package, own_config

OWN_PACKAGES = frozenset({"alignment", "sensors", "db", "station"})

app = typer.Typer(
    name="truewheel",
    help="Wheel alignment at the end of the line: camber and toe of every wheel, without touching it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit status: 0 done; 1 done, but a goal was missed or a wheel refused; 2 bad input; 3 station "
    "fault.",
)
app.command()(demo)
app.command()(init)
app.command()(wheel.measure)
app.command("measure-vehicle")(measure_vehicle_command)
app.command("steering-axis")(steering_axis_command)
app.command()(calibrate)
simulate_app.command("vehicle")(simulate_vehicle_command)
simulate_app.command("steering")(simulate_steering_command)
simulate_app.command("plate-session")(simulate_plate_session_command)
simulate_app.command("gauge-session")(simulate_gauge_session_command)
app.command()(study)
app.command()(bench)
app.command()(export)
app.command()(warm_up)
app.command()(report)
app.command()(replay)
app.add_typer(simulate_app, name="simulate", cls=Verbs)
app.add_typer(calibration_app, name="calibration", cls=Verbs)
app.add_typer(gauge_app, name="gauge", cls=Verbs)
app.add_typer(line_app, name="line", cls=Verbs)
app.add_typer(config_app, name="config", cls=Verbs)
camera_app.command("health")(camera_health)
camera_app.command()(show)
camera_app.command()(live)
camera_app.command()(exposure)
app.add_typer(camera_app, name="camera", cls=Verbs)
app.add_typer(capture_app, name="capture", cls=Verbs)
app.add_typer(db_app, name="db", cls=Verbs)
app.add_typer(master_app, name="master", cls=Verbs)
zero_app.command("measure-vehicle")(measure_vehicle_zeros_command)
app.add_typer(zero_app, name="zero", cls=Verbs)
app.add_typer(concession_app, name="concession", cls=Verbs)


@app.callback(cls=Verbs, invoke_without_command=True)
def _truewheel(
    show_version: Annotated[
        bool, typer.Option("--version", help="Print the versions of all parts and end.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="With --version: one JSON object.")] = False,
) -> None:
    if show_version:
        print_version(as_json=as_json)
        raise typer.Exit
    if as_json:
        raise ConfigurationError(
            field="--json", expected="it behind a command, or with --version", seen="it before the command"
        )


@app.command()
def run(
    config: Annotated[
        Path | None, typer.Option(help="Station's configuration.", show_default="configs/station.toml")
    ] = None,
    cable: Annotated[
        Path | None,
        typer.Option(
            help="To try it out without a bus: one end of a cable instead of the configured line. Another "
            "program on this computer finds the other end by this name: --interface slcan --channel NAME.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Run the station until SIGINT, SIGTERM, SIGHUP or SIGQUIT ends it in order."""
    from station.running import run_station

    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(levelname)s %(message)s")
    # A station says what it does itself; that a schema's library began to look is no news.
    logging.getLogger("alembic").setLevel(logging.WARNING)
    run_station(own_config(config), plug=cable)


@app.command()
def schema(
    name: Annotated[
        str, typer.Argument(help="shot, calibration, plate, plate-session, …; another name lists all.")
    ],
) -> None:
    """Print the JSON schema of a file that this program reads."""
    from station.commands.schemas import schema_of

    print_json(schema_of(name))


def exit_status(error: TruewheelError) -> int:
    """Return the exit status of an error: bad input, which a person can correct, or a station fault."""
    if isinstance(error, SeveralErrors):
        parts = [part for part in error.exceptions if isinstance(part, TruewheelError)]
        return max(map(exit_status, parts), default=STATION_FAULT)
    return (
        BAD_INPUT if isinstance(error, InputError | StoreSchemaError | StoreDamagedError) else STATION_FAULT
    )


@cache
def commands() -> Any:
    """All verbs with their options; building them takes longer than most commands, so once in a process."""
    return get_command(app)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; ends the program with the exit status."""
    running = Running()
    try:
        commands()(args=arguments, obj=running)
    except TruewheelError as error:
        typer.echo(f"truewheel: {error.told(running.words())}", err=True)
        sys.exit(exit_status(error))
    except ImportError as error:
        if (error.name or "").partition(".")[0] in OWN_PACKAGES:
            raise
        problem = ConfigurationError(
            expected="all packages that this program needs",
            seen=told(error),
            cure="Install truewheel anew, with what it needs: `pip install .` in its folder, or `make setup`",
        )
        typer.echo(f"truewheel: {problem}", err=True)
        sys.exit(BAD_INPUT)
    except OSError as error:
        # What the formats do not translate: an output folder that cannot be made, a broken pipe.
        problem = ConfigurationError(
            file=error.filename, expected="to read or write it", seen=error.strerror or str(error)
        )
        typer.echo(f"truewheel: {problem}", err=True)
        sys.exit(BAD_INPUT)
    except Exception:
        damaged = damaged_package()
        if damaged is None:
            raise
        typer.echo(f"truewheel: {damaged}", err=True)
        sys.exit(BAD_INPUT)


if __name__ == "__main__":
    main()
