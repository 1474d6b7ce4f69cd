"""`truewheel gauge`: is the station able to measure what it judges?"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from alignment.errors import ConfigurationError
from alignment.statistics import ChartKind, GrrMethod, RuleSet
from station.commands.database import DatabaseOption
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_folder
from station.commands.selection import FromOption, UntilOption

if TYPE_CHECKING:
    from station.quality.gauge import GaugeReport, GaugeSource

gauge_app = typer.Typer(
    no_args_is_help=True,
    help="Gauge studies: is the station able to measure what it judges? Values come from a CSV file, which "
    "--database and --name keep as a study, or from a study that the result database holds.",
)

_LONGEST_TABLE = 30


def require_finite(param: typer.CallbackParam, value: float | None) -> float | None:
    """Refuse infinity and NaN, which pass every bound or none."""
    if value is not None and not math.isfinite(value):
        raise ConfigurationError(
            field=f"--{(param.name or '').replace('_', '-')}", expected="a finite number", seen=str(value)
        )
    return value


FileOption = Annotated[
    Path | None,
    typer.Option("--from-file", help="CSV with a header line; see docs/quality.md.", show_default=False),
]
DatabaseChoice = Annotated[
    str | None,
    typer.Option("--database", help="URL of the result database.", show_default=False),
]
StudyOption = Annotated[
    str | None, typer.Option("--study", help="UUID or name of a stored study.", show_default=False)
]
NameOption = Annotated[
    str | None,
    typer.Option("--name", help="Keep the file's values as a study of this name.", show_default=False),
]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder for table, plots and text.", show_default=False)
]
UnitOption = Annotated[str, typer.Option("--unit", help="Unit of the values of a file, as it is shown.")]
ToleranceOption = Annotated[
    float | None,
    typer.Option(
        "--tolerance",
        callback=require_finite,
        help="Width of the tolerance, in the unit of the values.",
        show_default=False,
    ),
]
ReferenceOption = Annotated[
    float | None,
    typer.Option(
        "--reference", callback=require_finite, help="Certified value of the master.", show_default=False
    ),
]


@gauge_app.command("type1")
def type1_command(
    from_file: FileOption = None,
    database: DatabaseChoice = None,
    study: StudyOption = None,
    name: NameOption = None,
    reference: ReferenceOption = None,
    tolerance: ToleranceOption = None,
    share: Annotated[
        float,
        typer.Option(
            callback=require_finite, help="Percent of the tolerance that the gauge may use.", min=1, max=100
        ),
    ] = 20.0,
    spread: Annotated[
        float, typer.Option(callback=require_finite, help="Spread in standard deviations.", min=1, max=12)
    ] = 6.0,
    resolution: Annotated[
        float | None,
        typer.Option(callback=require_finite, help="Resolution of the gauge.", show_default=False),
    ] = None,
    unit: UnitOption = "",
    out: OutOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Cg and Cgk: one master, measured again and again; exit status 1 when not capable."""
    from db.records import StudyKind
    from station.quality.gauge import analyse_type1, open_source

    ready_folder(out)
    source = open_source(
        StudyKind.TYPE1,
        from_file,
        database,
        study,
        name,
        unit,
        {"reference": reference, "tolerance": tolerance},
    )
    with source.named_in_errors():
        report = analyse_type1(
            source.rows,
            source.required("reference", reference),
            source.required("tolerance", tolerance),
            share=share / 100.0,
            spread=spread,
            resolution=resolution,
            unit=source.unit,
        )
    _finish(report, source, out, as_json)


@gauge_app.command("grr")
def grr_command(
    from_file: FileOption = None,
    database: DatabaseChoice = None,
    study: StudyOption = None,
    name: NameOption = None,
    method: Annotated[GrrMethod, typer.Option(help="Analysis of variance, or average and range.")] = (
        GrrMethod.ANOVA
    ),
    tolerance: ToleranceOption = None,
    multiplier: Annotated[
        float,
        typer.Option(callback=require_finite, help="Study variation in standard deviations.", min=1, max=12),
    ] = 6.0,
    pooling_p: Annotated[
        float,
        typer.Option(
            callback=require_finite,
            help="An interaction that arises by chance with more than this probability counts as "
            "repeatability (AIAG 0.25; others take 0.05).",
            min=0,
            max=1,
        ),
    ] = 0.25,
    ignore_appraiser: Annotated[
        bool, typer.Option("--ignore-appraiser", help="Type 3: without appraisers.")
    ] = False,
    unit: UnitOption = "",
    out: OutOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Repeatability and reproducibility; exit status 1 above 30 %.

    Columns part, appraiser, trial, value. Without appraisers, or with one, it is a study of type 3.
    """
    from db.records import StudyKind
    from station.quality.gauge import analyse_grr, open_source

    ready_folder(out)
    source = open_source(StudyKind.GRR, from_file, database, study, name, unit, {"tolerance": tolerance})
    with source.named_in_errors():
        report = analyse_grr(
            source.rows,
            method,
            tolerance=source.number("tolerance", tolerance),
            multiplier=multiplier,
            pooling_p=pooling_p,
            ignore_appraiser=ignore_appraiser,
            unit=source.unit,
        )
    _finish(report, source, out, as_json)


@gauge_app.command("linearity")
def linearity_command(
    from_file: FileOption = None,
    database: DatabaseChoice = None,
    study: StudyOption = None,
    name: NameOption = None,
    confidence: Annotated[
        float, typer.Option(callback=require_finite, help="Of band and limits, percent.", min=50, max=99.9)
    ] = 95.0,
    unit: UnitOption = "",
    out: OutOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Bias over the range; exit status 1 when zero bias is outside of the band. Columns reference, value."""
    from db.records import StudyKind
    from station.quality.gauge import analyse_linearity, open_source

    ready_folder(out)
    source = open_source(StudyKind.LINEARITY, from_file, database, study, name, unit, {})
    with source.named_in_errors():
        report = analyse_linearity(source.rows, confidence=confidence / 100.0, unit=source.unit)
    _finish(report, source, out, as_json)


@gauge_app.command("stability")
def stability_command(
    from_file: FileOption = None,
    database: DatabaseChoice = None,
    study: StudyOption = None,
    name: NameOption = None,
    reference: ReferenceOption = None,
    rules: Annotated[RuleSet, typer.Option(help="Which signals count.")] = RuleSet.WESTERN_ELECTRIC,
    chart: Annotated[ChartKind, typer.Option(help="Kind of chart; single values for size 1.")] = (
        ChartKind.XBAR_R
    ),
    size: Annotated[int, typer.Option(help="Values of one subgroup.", min=1, max=100)] = 1,
    unit: UnitOption = "",
    out: OutOption = None,
    as_json: JsonFlag = False,
) -> None:
    """The same master over time: control chart and drift; exit status 1 with a signal.

    Columns time, value.
    """
    from db.records import StudyKind
    from station.quality.gauge import analyse_stability, open_source

    ready_folder(out)
    source = open_source(
        StudyKind.STABILITY, from_file, database, study, name, unit, {"reference": reference}
    )
    with source.named_in_errors():
        report = analyse_stability(
            source.rows,
            size=1 if chart is ChartKind.INDIVIDUALS else size,
            rules=rules,
            kind=chart,
            reference=source.number("reference", reference),
            unit=source.unit,
        )
    _finish(report, source, out, as_json)


@gauge_app.command("budget")
def budget_command(
    tolerance: Annotated[
        float,
        typer.Option(
            callback=require_finite, help="Width of the tolerance, in the unit of u.", show_default=False
        ),
    ],
    from_file: Annotated[
        Path | None,
        typer.Option("--from-file", help="CSV with contribution, u and source.", show_default=False),
    ] = None,
    type1_file: Annotated[
        Path | None,
        typer.Option(help="CSV of a type 1 study: gives EVR, and BI with --reference.", show_default=False),
    ] = None,
    reference: ReferenceOption = None,
    grr_file: Annotated[
        Path | None,
        typer.Option(help="CSV of a GRR study: gives EVO, AV and IA.", show_default=False),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(
            callback=require_finite, help="Resolution of the gauge: gives RE.", min=0, show_default=False
        ),
    ] = None,
    calibration_u: Annotated[
        float | None,
        typer.Option(
            callback=require_finite,
            help="Standard uncertainty of the calibration: CAL.",
            min=0,
            show_default=False,
        ),
    ] = None,
    coverage_factor: Annotated[float, typer.Option(callback=require_finite, help="k.", min=1, max=4)] = 2.0,
    unit: UnitOption = "",
    out: OutOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Uncertainty budget after VDA 5: Q_MS and Q_MP; exit status 1 above 15 % and 30 %.

    Contributions from a file, from the files of gauge studies, or both.
    """
    from station.quality.gauge import GaugeSource, analyse_budget, collect_components

    ready_folder(out)
    given = [str(file) for file in (from_file, type1_file, grr_file) if file is not None]
    source = GaugeSource(", ".join(given), (), unit, {})
    components = collect_components(from_file, type1_file, reference, grr_file, resolution, calibration_u)
    with source.named_in_errors():
        report = analyse_budget(components, tolerance, coverage_factor, unit)
    _finish(report, source, out, as_json)


@gauge_app.command("plan")
def plan_command(
    kind: Annotated[str, typer.Argument(help="type1, grr, linearity or stability.", show_default=False)],
    database: DatabaseOption,
    name: Annotated[str, typer.Option(help="Name of the study.", show_default=False)],
    characteristic: Annotated[
        str, typer.Option(help="front_left.toe, rear.total_toe, vehicle.thrust_angle, …", show_default=False)
    ],
    part: Annotated[
        list[str],
        typer.Option(
            help="VIN of a vehicle or master that is driven in, with its certified angle where the study "
            "needs one: VIN or VIN=DEGREES. Several.",
            show_default=False,
        ),
    ],
    appraiser: Annotated[
        list[str] | None, typer.Option(help="Name of an operator; none for type 3. Several.")
    ] = None,
    trials: Annotated[int, typer.Option(help="Measurements of each part by each appraiser.", min=1)] = 3,
    tolerance: Annotated[
        float | None,
        typer.Option(
            callback=require_finite, help="Width of the tolerance, degrees.", min=0, show_default=False
        ),
    ] = None,
    station: Annotated[
        str | None, typer.Option(help="Only cycles of this station.", show_default=False)
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the order of the runs.", min=0)] = 0,
    as_json: JsonFlag = False,
) -> None:
    """Plan a study that live cycles will fill; shows the order in which to drive."""
    from station.quality.gauge import plan_from_text

    record = plan_from_text(
        database, kind, name, characteristic, part, appraiser or [], trials, tolerance, station, seed
    )
    if as_json:
        print_json({"study": str(record.uuid), "name": name, "kind": kind, "order": record.plan["order"]})
        return
    for number, (vin, who, trial) in enumerate(record.plan["order"], start=1):
        typer.echo(f"{number:4}  {vin}{f'  by {who}' if who else ''}  trial {trial}")
    typer.echo(f"stored {record.uuid}: drive in this order, then `truewheel gauge fill`")


@gauge_app.command("fill")
def fill_command(
    study: Annotated[str, typer.Argument(help="UUID or name of a planned study.", show_default=False)],
    database: DatabaseOption,
    from_time: FromOption = None,
    until_time: UntilOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Take a planned study's values from the cycles since its plan; exit status 1 when some are missing.

    The first cycle of a part is its first run of the plan, and so on. Filling again adds what came meanwhile.
    """
    from station.quality import read_time
    from station.quality.gauge import fill_study

    filled = fill_study(
        database,
        study,
        from_utc=read_time("from", from_time),
        until_utc=read_time("until", until_time),
    )
    missing = [[run.part, run.appraiser, run.trial] for run in filled.missing]
    if as_json:
        head = {"study": str(filled.study.record.uuid), "name": filled.study.record.name}
        print_json(head | {"added": filled.added, "values": len(filled.study.values), "missing": missing})
    else:
        typer.echo(
            f"{filled.added} values added, {len(filled.study.values)} in all, {len(missing)} runs to go"
        )
        for vin, who, trial in missing[:_LONGEST_TABLE]:
            typer.echo(f"  {vin}{f' by {who}' if who else ''} trial {trial}")
    if missing:
        raise typer.Exit(GOAL_MISSED)


@gauge_app.command("list")
def list_command(database: DatabaseOption, as_json: JsonFlag = False) -> None:
    """Show all studies, newest first."""
    from station.quality.gauge import all_studies, planned_runs

    found = [
        {
            "study": str(record.uuid),
            "kind": str(record.kind),
            "name": record.name,
            "characteristic": record.characteristic,
            "created_utc": record.created_utc.isoformat(),
            "values": values,
            "planned": len(planned_runs(record)) or values,
        }
        for record, values in all_studies(database)
    ]
    if as_json:
        print_json({"studies": found})
        return
    for each in found:
        typer.echo(
            f"{each['study']}  {each['kind']:9}  {each['values']} of {each['planned']}  {each['name']} "
            f"({each['characteristic']})"
        )
    if not found:
        typer.echo("no studies")


def _finish(report: GaugeReport, source: GaugeSource, out: Path | None, as_json: bool) -> None:
    """Print, write, and end with status 1 when a limit was missed or nothing could be judged."""
    from station.figures import write_study

    files = [] if out is None else write_study(report, report.result, out)
    if as_json:
        print_json(report.as_json() | {"source": source.name, "files": [str(file) for file in files]})
    else:
        _show(report, source, files)
    if report.result.missed or report.no_verdict:
        raise typer.Exit(GOAL_MISSED)


def _show(report: GaugeReport, source: GaugeSource, files: list[Path]) -> None:
    from station.quality import figure_rows, print_table, terminal

    console = terminal()
    console.print(f"{report.summary} {source.name}", markup=False, highlight=False)
    print_table(console, report.result.rows[:_LONGEST_TABLE])
    if len(report.result.rows) > _LONGEST_TABLE:
        console.print(f"… {len(report.result.rows) - _LONGEST_TABLE} more rows; --out writes them all")
    print_table(console, figure_rows(report.result))
    console.print(report.result.text, markup=False, highlight=False)
    if files:
        console.print(f"wrote {', '.join(str(file) for file in files)}", soft_wrap=True, highlight=False)
