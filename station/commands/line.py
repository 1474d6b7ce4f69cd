"""`truewheel line …`: the bus between PLC and station."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from alignment.counting import count_of
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_file
from station.configuration import default_config

if TYPE_CHECKING:
    import can

    from station.configuration import Configuration
    from station.cycle import SteeringAnswer, WheelAnswer
    from station.line.plc import PlcOrder, PlcResult
    from station.line.tools import DecodedFrame, PointVerdict, Trial, Vehicles
    from station.line.wire import BusSettings, LineDatabase

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
SimulatedFlag = Annotated[
    bool, typer.Option("--simulated", help="A station with prepared shots, started for this.")
]


@line_app.command()
def plc(
    vin: Annotated[
        list[str] | None, typer.Option(help="VIN of a vehicle; repeat it for several.", show_default=False)
    ] = None,
    scenario: Annotated[
        Path | None, typer.Option(help="File of scenarios to play instead.", show_default=False)
    ] = None,
    vehicle_type: Annotated[int, typer.Option(help="Number of the vehicle type.", min=0, max=65535)] = 1,
    wheel: Annotated[
        list[str] | None, typer.Option(help="Wheel to measure; repeat it.", show_default="all")
    ] = None,
    simulated: SimulatedFlag = False,
    silence_s: Annotated[
        float,
        typer.Option(
            help="A station that is silent for so long is lost. A real PLC takes the 0.5 s of the line "
            "interface; a computer that renders the wheels beside may pause for longer.",
            min=0.1,
            max=600,
        ),
    ] = 5.0,
    config: ConfigOption = None,
    interface: InterfaceOption = None,
    channel: ChannelOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Play the PLC against a station: vehicles by their VIN, or a file of scenarios.

    Exit status 1 unless all vehicles are ok, or all scenarios are answered as they must be.
    """
    from alignment.errors import ConfigurationError
    from station.line.plc import PlcOrder
    from station.line.tools import play_scenarios, read_scenarios
    from station.line.wire import checked_vin

    if (vin is None) == (scenario is None):
        raise ConfigurationError(
            field="--vin, --scenario", expected="either VINs or a scenario file", seen="both or none"
        )
    file = None if scenario is None else read_scenarios(scenario)
    orders = [PlcOrder(checked_vin(one), vehicle_type, tuple(wheel) if wheel else None) for one in vin or []]
    configuration = _read(config)
    database = _database(configuration)
    with _reached(_bus(configuration, interface, channel), database, simulated) as settings:
        if file is None:
            _order_vehicles(settings, database, orders, silence_s, as_json)
            return
        with _trial(settings, database, file.vehicle.vehicles()) as trial:
            played = [
                (one.scenario, _said(one.verdict, one.scenario, as_json))
                for one in play_scenarios(file, trial)
            ]
    verdicts = [verdict for _, verdict in played]
    if as_json:
        rows = [{"scenario": name, **_as_json(verdict)} for name, verdict in played]
        print_json({"figures": _counted(verdicts), "played": rows})
    _end(verdicts)


@line_app.command()
def check(
    simulated: SimulatedFlag = False,
    vin: Annotated[str, typer.Option(help="VIN of the vehicle that stands there.")] = "TWCHKX00000000001",
    vehicle_type: Annotated[
        int, typer.Option(help="Number of a vehicle type that the station knows.", min=0, max=65535)
    ] = 1,
    unknown_type: Annotated[
        int, typer.Option(help="Number of one that it does not know.", min=0, max=65535)
    ] = 65_535,
    wheel: Annotated[
        list[str] | None,
        typer.Option(help="Wheel that the station has; repeat it.", show_default="all"),
    ] = None,
    patience_s: Annotated[
        float, typer.Option(help="Longest time that a measurement takes.", min=1, max=3600)
    ] = 60.0,
    config: ConfigOption = None,
    interface: InterfaceOption = None,
    channel: ChannelOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Try out on a station everything that the line interface demands; exit status 1 unless all is passed."""
    from alignment.errors import ConfigurationError
    from station.line.tools import Vehicles, check_station
    from station.line.wire import checked_vin

    wheels = tuple(wheel) if wheel else None
    vehicles = Vehicles(checked_vin(vin), vehicle_type, unknown_type, patience_s, wheels)
    configuration = _read(config)
    database = _database(configuration)
    unknown = set(wheels or ()) - set(database.wheels)
    if unknown:
        raise ConfigurationError(
            field="--wheel",
            expected=f"wheels of {', '.join(database.wheels)}",
            seen=", ".join(sorted(unknown)),
        )
    with (
        _reached(_bus(configuration, interface, channel), database, simulated) as settings,
        _trial(settings, database, vehicles) as trial,
    ):
        verdicts = [_said(verdict, None, as_json) for verdict in check_station(trial)]
    if as_json:
        print_json({"figures": _counted(verdicts), "points": [_as_json(verdict) for verdict in verdicts]})
    else:
        typer.echo(f"{_counted(verdicts)['passed']} of {len(verdicts)} points passed")
    _end(verdicts)


@line_app.command()
def monitor(
    log: Annotated[
        Path | None, typer.Argument(help="Recorded traffic (.log, .asc, .blf).", show_default="live")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File that takes the frames too (.log, .asc, .blf).", show_default=False),
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long to listen live.", min=0.1, max=1e6)] = 10.0,
    message: Annotated[
        list[str] | None,
        typer.Option(
            help="Only this message of the DBC; * stands for anything. Several.", show_default=False
        ),
    ] = None,
    cycles: Annotated[
        bool,
        typer.Option(
            "--cycles",
            help="One line for each start: number, VIN, result, and seconds until busy, done, taken over.",
        ),
    ] = False,
    everything: Annotated[
        bool, typer.Option("--all", help="Every frame with all its signals, not only what changed.")
    ] = False,
    counters: Annotated[
        bool, typer.Option("--counters", help="Show CRCs, counters and signs of life too.")
    ] = False,
    config: ConfigOption = None,
    interface: InterfaceOption = None,
    channel: ChannelOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Show traffic decoded by the DBC, live or from a log, as it changes.

    Exit status 1 for a frame in error or lost. With --json all signals of all frames.
    """
    from station.line.tools import chosen_messages, decoded, live_frames, read_log, recorded
    from station.line.wire import open_bus

    ready_file(out)
    configuration = _read(config)
    # Traffic that was recorded before the interface changed is read by its own DBC still.
    database = _database(configuration, older=True)
    wanted = chosen_messages(message or [], database.protected)
    errors, count, shown, reading = 0, 0, [], None
    lines = _view(database, wanted, cycles, every=everything, counting=counters)
    with ExitStack() as stack:
        frames: Iterable[can.Message]
        if log is not None:
            frames = reading = read_log(log)
        else:
            bus = stack.enter_context(open_bus(_shared(_bus(configuration, interface, channel))))
            frames = live_frames(bus, seconds)
        if out is not None:
            frames = recorded(frames, out)
        for frame in decoded(frames, database):
            errors += frame.error is not None
            count += 1
            if not as_json:
                _echo(lines(frame))
            elif not wanted or frame.name in wanted:
                shown.append(asdict(frame))
    if not as_json:
        _echo(lines(None))
    lost = 0 if reading is None else reading.notes.lost
    if as_json:
        read = {} if reading is None else {"skipped": lost, "read": reading.summary}
        print_json({"frames": shown, "errors": errors, **read})
    else:
        heard = f"{count_of(count, 'frame')} in {seconds:g} s" if reading is None else reading.summary
        typer.echo(f"{heard}, {errors} in error" if errors else heard, err=True)
    if errors or lost:
        raise typer.Exit(GOAL_MISSED)


def _view(
    database: LineDatabase, wanted: frozenset[str], cycles: bool, *, every: bool, counting: bool
) -> Callable[[DecodedFrame | None], Iterable[str]]:
    """What takes frames, and None at their end, and returns the lines that a person sees of them."""
    from station.line.tools import ChangeView, VehicleView

    width = max(map(len, database.protected))
    changes = ChangeView(database.vin_messages, every=every, counting=counting, width=width)
    vehicles = VehicleView(database.vin_messages)

    def lines(frame: DecodedFrame | None) -> Iterable[str]:
        if cycles:
            return vehicles.end() if frame is None else vehicles.lines(frame)
        if frame is None or (wanted and frame.name not in wanted):
            return ()
        return filter(None, [changes.line(frame)])

    return lines


def _echo(lines: Iterable[str]) -> None:
    for line in lines:
        typer.echo(line)


@line_app.command()
def cable(as_json: JsonFlag = False) -> None:
    """Join two serial devices back to back until SIGINT or SIGTERM: a line without hardware."""
    import threading

    from station.line.tools import SLCAN_OPTIONS, Cable
    from station.running import stop_on_signals

    stopping = threading.Event()
    with stop_on_signals(stopping), Cable() as opened:
        if as_json:
            print_json({"interface": "slcan", "ends": list(opened.ends), "options": SLCAN_OPTIONS})
        else:
            options = ", ".join(f"{name} = {value}" for name, value in SLCAN_OPTIONS.items())
            typer.echo(f"interface slcan, options {{ {options} }}: {opened.ends[0]} and {opened.ends[1]}")
        stopping.wait()


@line_app.command()
def document(
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("docs/line-interface.md"),
    config: ConfigOption = None,
) -> None:
    """Write the description of the line interface, from the DBC and the program's own tables."""
    from station.line.tools import interface_document

    ready_file(out)
    out.write_text(interface_document(_database(_read(config))), encoding="utf-8")
    typer.echo(f"wrote {out}")


def _read(config: Path | None) -> Configuration:
    from station.configuration import read_configuration

    return read_configuration(default_config(config))


def _database(configuration: Configuration, *, older: bool = False) -> LineDatabase:
    from station.line.wire import load_line_database

    return load_line_database(configuration.path(configuration.settings.line.dbc), older=older)


def _bus(configuration: Configuration, interface: str | None, channel: str | None) -> BusSettings:
    from station.line.tools import SLCAN_OPTIONS
    from station.line.wire import BusSettings

    line = configuration.settings.line
    settings = BusSettings(line.interface, line.channel, line.bitrate, options=line.options)
    if interface is not None and interface != line.interface:
        # The configured options are another interface's.
        options = SLCAN_OPTIONS if interface == "slcan" else {}
        settings = replace(settings, interface=interface, options=options)
    return replace(settings, channel=channel or settings.channel)


def _shared(settings: BusSettings, otherwise: str = "") -> BusSettings:
    """The bus, when a station can be on it that is another program."""
    from alignment.errors import ConfigurationError
    from station.line.wire import ONE_PROCESS

    if settings.interface == ONE_PROCESS:
        raise ConfigurationError(
            field="line.interface",
            expected="one that reaches other programs",
            seen=f"'{ONE_PROCESS}', which is in one process only: no station can hear this command",
            cure="Start the station with `truewheel run --cable out/plc`, and add --interface slcan "
            f"--channel out/plc here{otherwise}",
        )
    return settings


@contextmanager
def _reached(settings: BusSettings, database: LineDatabase, simulated: bool) -> Iterator[BusSettings]:
    """The configured bus, or that of a station which is started here."""
    if not simulated:
        yield _shared(settings, "; or add --simulated for a station of its own")
        return
    import logging

    from station.rehearsal import simulated_station

    # What its log says of commands that are wrong on purpose is no news to who sends them.
    log = logging.getLogger("truewheel.line")
    before = log.level
    log.setLevel(logging.ERROR)
    try:
        with simulated_station(database) as own:
            yield own
    finally:
        log.setLevel(before)


@contextmanager
def _trial(settings: BusSettings, database: LineDatabase, vehicles: Vehicles) -> Iterator[Trial]:
    from station.line.plc import PlcSimulator, PlcTimeouts
    from station.line.tools import Trial
    from station.line.wire import open_bus

    timeouts = PlcTimeouts(done_s=vehicles.patience_s)
    with open_bus(settings) as bus, PlcSimulator(bus, database, timeouts=timeouts) as simulator:
        simulator.connect()
        yield Trial(simulator, database, vehicles)


def _order_vehicles(
    settings: BusSettings, database: LineDatabase, orders: list[PlcOrder], silence_s: float, as_json: bool
) -> None:
    from station.cycle import Outcome
    from station.line.plc import PlcTimeouts, run_plc

    results = []
    for result in run_plc(settings, database.file, orders, PlcTimeouts(silence_s=silence_s)):
        results.append(result)
        if not as_json:
            _show(result)
    if as_json:
        print_json({"vehicles": [_vehicle_as_json(result) for result in results]})
    if any(result.vehicle.outcome is not Outcome.OK for result in results):
        raise typer.Exit(GOAL_MISSED)


def _show(result: PlcResult) -> None:
    from station.cycle import GEOMETRY_ANGLES, Outcome

    typer.echo(f"{result.order.vin if result.order else 'held from before:'} {result.vehicle.outcome}")
    for answer in result.wheels:
        angles = (
            ""
            if answer.camber_deg is None or answer.toe_deg is None
            else f"  camber {answer.camber_deg:+.4f}°  toe {answer.toe_deg:+.4f}°  {_axis_in_words(answer)}"
        )
        typer.echo(f"  {answer.wheel:<12} {answer.outcome}{angles}")
    for line in _steering_in_words(result.vehicle.steering):
        typer.echo(f"  {line}")
    if any(answer.outcome is Outcome.FAULT for answer in result.wheels):
        typer.echo("  fault: the station's log says why, and `truewheel report vin`")
    geometry = result.vehicle.geometry
    if any(quantity.state.measured for quantity in geometry.quantities):
        between = str(geometry.between).replace("_", " ")
        typer.echo(f"  toe and thrust angle against the {geometry.reference}, lengths between {between}")
    for quantity in geometry.quantities:
        if quantity.value is not None and quantity.u95 is not None:
            unit = "°" if quantity.name in GEOMETRY_ANGLES else " mm"
            value = f"{quantity.value:+.4f} ± {quantity.u95:.4f}{unit}"
            typer.echo(f"  {quantity.name:<28} {quantity.state:<9} {value}")


def _steering_in_words(steering: SteeringAnswer) -> Iterator[str]:
    """What wheels may be not judged for, or be corrected by; nothing where nothing was asked."""
    from station.cycle import HeightState, StraightAhead

    wheel = steering.wheel
    if wheel.straight_ahead is not StraightAhead.NONE:
        used = "" if wheel.used_deg is None else f" by {wheel.used_deg:+.1f}° of the steering wheel"
        yield f"straight ahead {str(wheel.straight_ahead).replace('_', ' ')}{used}"
    for corner in steering.corners:
        if corner.height in (HeightState.MISSING, HeightState.ABSURD):
            yield f"ride height of {corner.wheel} {corner.height}"


def _axis_in_words(answer: WheelAnswer) -> str:
    kind = str(answer.kind).replace("_", " ")
    if answer.run_out_mm is None:
        return kind
    return f"{kind}, run-out {answer.run_out_mm:.2f} mm {answer.run_out_state}"


def _vehicle_as_json(result: PlcResult) -> dict[str, Any]:
    return {
        "vin": result.order.vin if result.order else None,
        "sequence": result.sequence,
        "outcome": str(result.vehicle.outcome),
        "wheels": [asdict(answer) for answer in result.wheels],
        "axles": [asdict(answer) for answer in result.axles],
        "thrust_angle_deg": result.vehicle.thrust_angle_deg,
        "geometry": asdict(result.vehicle.geometry),
        "busy_after_s": result.busy_s - result.started_s,
        "done_after_s": result.done_s - result.started_s,
    }


def _said(verdict: PointVerdict, scenario: str | None, as_json: bool) -> PointVerdict:
    if not as_json:
        head = "" if scenario is None else f"{scenario}: "
        typer.echo(
            f"{'passed' if verdict.passed else 'FAILED'}  {head}{verdict.point:<24} {verdict.requirement}"
        )
        if verdict.failure is not None:
            typer.echo(f"        {verdict.failure}")
    return verdict


def _as_json(verdict: PointVerdict) -> dict[str, Any]:
    return {**asdict(verdict), "passed": verdict.passed}


def _counted(verdicts: list[PointVerdict]) -> dict[str, int]:
    passed = sum(verdict.passed for verdict in verdicts)
    return {"passed": passed, "failed": len(verdicts) - passed}


def _end(verdicts: list[PointVerdict]) -> None:
    if not all(verdict.passed for verdict in verdicts):
        raise typer.Exit(GOAL_MISSED)
