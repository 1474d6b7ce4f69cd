"""`truewheel report`: what the stored results say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from alignment.statistics import ChartKind, RuleSet
from station.commands.database import DatabaseOption
from station.commands.output import JsonFlag, print_json
from station.commands.outputs import ready_file
from station.commands.selection import (
    FromOption,
    PlantOption,
    ShiftOption,
    StationOption,
    TypeOption,
    UntilOption,
    VerdictOption,
    VinOption,
    WheelOption,
    ZoneOption,
)
from station.quality.reports import ReportKind, SplitBy

if TYPE_CHECKING:
    from station.quality.reports import Report

_LONGEST_TABLE = 30


def report(
    database: DatabaseOption,
    kind: Annotated[
        ReportKind, typer.Argument(help="What is asked; all is everything but vin.")
    ] = ReportKind.ALL,
    from_time: FromOption = None,
    until_time: UntilOption = None,
    shift: ShiftOption = None,
    timezone: ZoneOption = "UTC",
    station: StationOption = None,
    plant: PlantOption = None,
    vehicle_type: TypeOption = None,
    wheel: WheelOption = None,
    verdict: VerdictOption = None,
    vin: VinOption = None,
    characteristic: Annotated[
        list[str] | None,
        typer.Option(
            help="Only this angle: front_left.toe, rear.total_toe, vehicle.thrust_angle, … Several.",
            show_default=False,
        ),
    ] = None,
    chart: Annotated[ChartKind, typer.Option(help="Kind of control charts.")] = ChartKind.INDIVIDUALS,
    rules: Annotated[RuleSet, typer.Option(help="Which signals of a chart count.")] = RuleSet.THREE_SIGMA,
    size: Annotated[int, typer.Option(help="Values of one subgroup of a chart.", min=2, max=100)] = 5,
    limits_from: Annotated[
        str | None,
        typer.Option(
            help="Charts take their limits from results of an earlier, good period: its beginning.",
            show_default=False,
        ),
    ] = None,
    limits_until: Annotated[str | None, typer.Option(help="And its end.", show_default=False)] = None,
    split: Annotated[
        SplitBy, typer.Option("--by", help="Capability for each of these by itself.")
    ] = SplitBy.NOTHING,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write it with pictures: .html, which needs no network, or .pdf.", show_default=False
        ),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Report on stored results: yield, Pareto, capability, charts, comparisons, drift, adjusting, …"""
    from datetime import UTC, datetime

    from db.queries import Characteristic, ResultReader, require_known
    from station.quality import read_filter, read_time
    from station.quality.reports import ReportOptions, make_report, require_ending, write_report

    if out is not None:
        require_ending(out)
        ready_file(out)
    where = read_filter(
        from_time, until_time, shift, timezone, station, plant, vehicle_type, wheel, verdict, vin
    )
    angles = tuple(Characteristic.parse(text) for text in characteristic or ())
    options = ReportOptions(
        angles,
        chart,
        rules,
        size,
        split,
        read_time("limits from", limits_from),
        read_time("limits until", limits_until),
    )
    with ResultReader(database) as reader:
        require_known(reader, where, angles)
        found = make_report(reader, kind, where, options, datetime.now(UTC))
    if out is not None:
        write_report(out, found)
    if as_json:
        print_json(found.as_json() | {"files": [] if out is None else [str(out)]})
    else:
        _show(found, out)


def _show(found: Report, out: Path | None) -> None:
    from station.quality import heading, print_table, shown, terminal

    console = terminal()
    console.print(f"{found.title}: {found.about}", markup=False, highlight=False)
    for section in found.sections:
        console.print(f"\n{section.title}", style="bold", markup=False, highlight=False)
        for name, value in section.figures.items():
            console.print(f"  {heading(name)} = {shown(name, value)}", markup=False, highlight=False)
        names = section.brief or (list(section.rows[0]) if section.rows else [])
        rows = [{name: row[name] for name in names} for row in section.rows[:_LONGEST_TABLE]]
        if rows:
            print_table(console, rows)
        else:
            console.print(section.empty, markup=False, highlight=False)
        if len(section.rows) > _LONGEST_TABLE:
            console.print(f"… {len(section.rows) - _LONGEST_TABLE} more rows; --json has all")
        if section.text:
            console.print(section.text, markup=False, highlight=False)
    if out is not None:
        console.print(f"wrote {out}", soft_wrap=True, highlight=False, markup=False)
