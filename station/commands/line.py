"""`truewheel line plc` and `truewheel line monitor`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, default_config, print_json

if TYPE_CHECKING:
    from station.config import Configuration
    from station.line.channel import BusSettings

line_app = typer.Typer(no_args_is_help=True, help="The bus between PLC and station.")

ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config", help="Station's configuration whose [line] counts.", show_default="configs/station.toml"
    ),
]
InterfaceOption = Annotated[
    str | None, typer.Option(help="Kind of interface instead of the configured one.", show_default=False)
]
ChannelOption = Annotated[
    str | None, typer.Option(help="Channel instead of the configured one.", show_default=False)
]


@line_app.command()
def plc(
    vin: Annotated[list[str], typer.Option(help="VIN of a vehicle; repeat it for several.")],
    vehicle_type: Annotated[int, typer.Option(help="Number of the vehicle type.", min=0, max=65535)] = 1,
    wheel: Annotated[
        list[str] | None, typer.Option(help="Wheel to measure; repeat it.", show_default="all")
    ] = None,
    config: ConfigOption = None,
    interface: InterfaceOption = None,
    channel: ChannelOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Play the PLC: trigger a station for each VIN and show its answers; exit status 1 unless all are ok."""
    from station.line.messages import Outcome
    from station.line.orders import PlcOrder
    from station.line.plc import run_plc

    configuration = _read(config)
    orders = [PlcOrder(one, vehicle_type, tuple(wheel) if wheel else None) for one in vin]
    dbc = configuration.path(configuration.settings.line.dbc)
    answers = []
    for result in run_plc(_bus(configuration, interface, channel), dbc, orders):
        answers.append(result)
        if not as_json:
            typer.echo(
                f"{result.order.vin if result.order else 'held from before:'} {result.vehicle.outcome}"
            )
            for answer in result.wheels:
                angles = (
                    ""
                    if answer.camber_deg is None or answer.toe_deg is None
                    else f"  camber {answer.camber_deg:+.4f}°  toe {answer.toe_deg:+.4f}°"
                )
                typer.echo(f"  {answer.wheel:<12} {answer.outcome}{angles}")
    if as_json:
        print_json(
            {
                "vehicles": [
                    {
                        "vin": result.order.vin if result.order else None,
                        "sequence": result.sequence,
                        "outcome": str(result.vehicle.outcome),
                        "wheels": [asdict(answer) for answer in result.wheels],
                        "axles": [asdict(answer) for answer in result.axles],
                        "thrust_angle_deg": result.vehicle.thrust_angle_deg,
                        "busy_after_s": result.busy_s - result.started_s,
                        "done_after_s": result.done_s - result.started_s,
                    }
                    for result in answers
                ]
            }
        )
    if any(result.vehicle.outcome is not Outcome.OK for result in answers):
        raise typer.Exit(GOAL_MISSED)


@line_app.command()
def monitor(
    log: Annotated[
        Path | None, typer.Argument(help="Recorded traffic (.log, .asc, .blf).", show_default="live")
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long to listen live.", min=0.1, max=1e6)] = 10.0,
    config: ConfigOption = None,
    interface: InterfaceOption = None,
    channel: ChannelOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Show traffic decoded by the DBC, live or from a log; exit status 1 when a frame was in error."""
    from station.line.bus import open_bus
    from station.line.dbc import load_line_database
    from station.line.monitor import DecodedFrame, decode_log, watch

    configuration = _read(config)
    database = load_line_database(configuration.path(configuration.settings.line.dbc))

    def frames() -> Iterator[DecodedFrame]:
        if log is not None:
            yield from decode_log(log, database)
            return
        with open_bus(_bus(configuration, interface, channel)) as bus:
            yield from watch(bus, database, seconds)

    errors, shown = 0, []
    for frame in frames():
        errors += frame.error is not None
        if as_json:
            shown.append(asdict(frame))
        else:
            typer.echo(str(frame))
    if as_json:
        print_json({"frames": shown, "errors": errors})
    if errors:
        raise typer.Exit(GOAL_MISSED)


def _read(config: Path | None) -> Configuration:
    from station.config import read_configuration

    return read_configuration(default_config(config))


def _bus(configuration: Configuration, interface: str | None, channel: str | None) -> BusSettings:
    from station.line.channel import BusSettings

    line = configuration.settings.line
    settings = BusSettings(line.interface, line.channel, line.bitrate)
    return replace(settings, interface=interface or settings.interface, channel=channel or settings.channel)
