"""`truewheel demo`: the simulated line, from trigger to committed result."""

from __future__ import annotations

import itertools
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from alignment.counting import count_of
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_database, ready_folder
from station.commands.warm_up import compiled_for
from station.configuration import default_config

if TYPE_CHECKING:
    from rich.table import Table

    from station.rehearsal import DemoResult, DemoVehicle, DemoWheel


def demo(
    vehicles: Annotated[int, typer.Option(help="How many vehicles.", min=1, max=10_000)] = 3,
    database: Annotated[
        str | None,
        typer.Option(help="URL of the result database.", show_default="a new SQLite file in --out"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for CAN log and database.", show_default="out/demo- and the time"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the vehicles' angles.", min=0, max=99_999)] = 0,
    load_mm: Annotated[
        float, typer.Option(help="Bulge of the front tyres under load; 0: wheels in the air.", min=0, max=8)
    ] = 4.0,
    config: Annotated[
        Path | None, typer.Option(help="A station with simulated rigs.", show_default="configs/station.toml")
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Run a simulated line: PLC, vehicles, cameras; the real pipeline, line interface and database."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    from station.configuration import read_configuration

    ready_folder(out)
    ready_database(database, create=True)
    folder = out or Path("out") / f"demo-{datetime.now(UTC):%Y-%m-%dT%H-%M-%S}"
    configuration = read_configuration(default_config(config))
    compiled_for(("measure_8", "deformed_wheel_images" if load_mm else "wheel_images"), as_json)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    wheels = vehicles * len(configuration.settings.rigs)
    with Progress(*columns, console=console, disable=as_json and not console.is_terminal) as progress:
        task = progress.add_task("loading", total=wheels)
        # Loads renderer and mathematics, which takes seconds: the bar is there first.
        from station.rehearsal import demo_configuration, run_demo

        folder.mkdir(parents=True, exist_ok=True)
        url = database or f"sqlite:///{folder.resolve() / 'results.db'}"
        progress.update(task, description="wheels")
        done = itertools.count(1)

        def wheel_done() -> None:
            progress.advance(task)
            # Where nobody sees a bar.
            if not console.is_terminal and not as_json:
                typer.echo(f"{next(done)} of {count_of(wheels, 'wheel')}", err=True)

        result = run_demo(
            demo_configuration(configuration, url, folder / "can.log", load_mm),
            vehicles,
            seed,
            wheel_done,
        )
    if as_json:
        print_json(demo_as_json(result))
    else:
        _show(result)
    if not result.goal_met:
        raise typer.Exit(GOAL_MISSED)


def demo_as_json(result: DemoResult) -> dict[str, Any]:
    """Return what `truewheel demo --json` prints."""
    return {
        "vehicles": [_vehicle_as_json(vehicle) for vehicle in result.vehicles],
        "database": result.database,
        "can_log": str(result.can_log),
        "counts": result.counts,
        "in_order": all(vehicle.order.in_order for vehicle in result.vehicles),
    }


def _vehicle_as_json(vehicle: DemoVehicle) -> dict[str, Any]:
    return {
        "vin": vehicle.vin,
        "vehicle_type": vehicle.vehicle_type,
        "outcome": str(vehicle.outcome),
        "cycle": vehicle.cycle,
        "order": asdict(vehicle.order),
        "wheels": [_wheel_as_json(wheel) for wheel in vehicle.wheels],
    }


def _wheel_as_json(wheel: DemoWheel) -> dict[str, Any]:
    return {
        "wheel": wheel.wheel,
        "outcome": str(wheel.outcome),
        "reason": wheel.reason,
        "verdict": str(wheel.verdict),
        "camber_deg": wheel.camber_deg,
        "toe_deg": wheel.toe_deg,
        "camber_u95_deg": wheel.camber_u95_deg,
        "toe_u95_deg": wheel.toe_u95_deg,
        "truth": {"camber_deg": wheel.truth.camber_deg, "toe_deg": wheel.truth.toe_deg},
        "error_arcmin": {"camber": wheel.camber_error_arcmin, "toe": wheel.toe_error_arcmin},
    }


def _show(result: DemoResult) -> None:
    from rich.console import Console

    console = Console()
    for vehicle in result.vehicles:
        console.print(_table(vehicle))
        for wheel in vehicle.wheels:
            if wheel.reason is not None:
                console.print(f"{wheel.wheel} {wheel.outcome}: {wheel.reason}", markup=False, highlight=False)
        order = vehicle.order
        console.print(
            f"trigger 0, busy {order.busy_s:.3f}, committed {order.committed_s:.3f}, results "
            f"{order.first_result_s:.3f}, done {order.done_s:.3f} s: "
            f"{'in order' if order.in_order else 'OUT OF ORDER'}\n"
        )
    counts = result.counts
    console.print(
        f"database {result.database}: {counts['vehicles']} vehicles, {counts['wheel_results']} wheel results",
        soft_wrap=True,
    )
    console.print(f"CAN log {result.can_log}: read it with `truewheel line monitor`", soft_wrap=True)


def _table(vehicle: DemoVehicle) -> Table:
    from rich.box import SIMPLE
    from rich.table import Table

    table = Table(
        title=f"{vehicle.vin}, {vehicle.vehicle_type}: {vehicle.outcome}",
        title_justify="left",
        box=SIMPLE,
        pad_edge=False,
        collapse_padding=True,
    )
    table.add_column("wheel", no_wrap=True)
    for heading in ("camber ± 95 %", "error", "toe ± 95 %", "error"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict")
    for wheel in vehicle.wheels:
        table.add_row(
            wheel.wheel,
            _with_uncertainty(wheel.camber_deg, wheel.camber_u95_deg),
            _arcmin(wheel.camber_error_arcmin),
            _with_uncertainty(wheel.toe_deg, wheel.toe_u95_deg),
            _arcmin(wheel.toe_error_arcmin),
            str(wheel.verdict if wheel.reason is None else wheel.outcome),
        )
    return table


def _with_uncertainty(value_deg: float | None, u95_deg: float | None) -> str:
    return "–" if value_deg is None or u95_deg is None else f"{value_deg:+.4f}° ± {60.0 * u95_deg:.3f}′"


def _arcmin(value: float | None) -> str:
    return "–" if value is None else f"{value:+.3f}′"
