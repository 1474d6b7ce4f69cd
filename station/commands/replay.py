"""`truewheel replay`: archived images measured again, and compared with what was stored."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from alignment.counting import count_of
from alignment.errors import ConfigurationError
from alignment.units import ARCMIN
from station.commands.database import DATABASE_VARIABLE
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_file
from station.commands.selection import FromOption, UntilOption
from station.commands.warm_up import compiled_for

if TYPE_CHECKING:
    from station.replay import Replayed, ReplayProgress, ReplaySummary

_SHOWN = 20
_MOST_WORKERS = 256
_PARTS = 20
_ANGLES = ("camber", "toe", "camber_u", "toe_u", "camber_unseen", "toe_unseen", "run_out", "run_out_u")


def _cores() -> int:
    return max(1, len(os.sched_getaffinity(0)))


def replay(
    archive: Annotated[
        Path,
        typer.Argument(
            metavar="ARCHIVE",
            help="Folder of archived images: all of a station's, one of its days, or those of one wheel.",
            show_default=False,
        ),
    ],
    calibration: Annotated[
        list[Path] | None,
        typer.Option(
            help="Calibration file, in place of that which was in force; one for each rig. Several.",
            show_default="as archived",
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            help="Station's configuration whose [measure] counts in place of what was.",
            show_default="as archived",
        ),
    ] = None,
    database: Annotated[
        str | None,
        typer.Option(
            help="Result database that is held against the archive; archives of earlier programs need it.",
            envvar=DATABASE_VARIABLE,
            show_default=False,
        ),
    ] = None,
    vin: Annotated[str | None, typer.Option(help="Only this vehicle.", show_default=False)] = None,
    from_time: FromOption = None,
    until_time: UntilOption = None,
    within_arcmin: Annotated[
        float,
        typer.Option(
            help="Above 0 only angles, verdict and method count, and angles only where they are further "
            "apart; 0 compares every value to its last bit.",
            min=0,
            max=600,
        ),
    ] = 0.0,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Processes of this computer.",
            min=1,
            max=_MOST_WORKERS,
            show_default="one for each core",
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Measure on a cluster: address of its Dask scheduler, tcp://HOST:PORT. Its workers see the "
            "archive at the same path.",
            show_default=False,
        ),
    ] = None,
    journal: Annotated[
        Path | None,
        typer.Option(
            help="Keep one line of JSON for each folder here; a replay that was ended goes on from it.",
            show_default="a file of its own, which goes at the end",
        ),
    ] = None,
    anew: Annotated[
        bool, typer.Option("--anew", help="Measure what an earlier run has measured once more.")
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Measure archived images again and compare; exit status 1 when something differs or is damaged."""
    from station.replay import load_ahead

    if scheduler is None:
        load_ahead()
    from db.queries import ResultReader
    from station.configuration import read_configuration
    from station.replay import Choices, ReplayRequest, StoredResults, replay_archive

    ready_file(journal, "journal")
    settings = None if config is None else read_configuration(config).settings.measure.settings()
    choices = Choices(_by_rig(calibration or []), settings, within_arcmin * ARCMIN)
    with ExitStack() as stack:
        stored = None
        if database is not None:
            reader = stack.enter_context(ResultReader(database))
            stored, database = StoredResults(reader, vin), reader.where
        request = ReplayRequest(
            archive,
            choices,
            stored,
            database,
            vin,
            *_days(from_time, until_time),
            workers=workers or _cores(),
            scheduler=scheduler,
            journal=journal,
            anew=anew,
        )
        if scheduler is None and archive.is_dir():
            # Once, and not in every process at the same time.
            compiled_for(("measure_8", *_deep(request)), as_json)
        with _shown(as_json) as report:
            summary = replay_archive(request, report)
    if as_json:
        print_json(summary_as_json(summary))
    else:
        _print(summary)
    if not summary.identical:
        raise typer.Exit(GOAL_MISSED)


def _by_rig(files: list[Path]) -> dict[str, dict[str, Any]]:
    from sensors.formats import read_calibration_file

    found: dict[str, dict[str, Any]] = {}
    for path in files:
        file = read_calibration_file(path)
        if file.rig in found:
            raise ConfigurationError(
                file=path,
                choice="calibration",
                expected="one calibration for each rig",
                seen=f"a second one of {file.rig}",
                cure="Name one of the two",
            )
        found[file.rig] = file.model_dump(mode="json", by_alias=True)
    return found


def _days(from_time: str | None, until_time: str | None) -> tuple[str, str]:
    """Return the first and the last day, as folders of an archive are named."""
    from station.quality import read_time

    since, until = read_time("from", from_time), read_time("until", until_time)
    first = "" if since is None else f"{since:%Y-%m-%d}"
    # The end is not included.
    return first, "~" if until is None else f"{until - timedelta(microseconds=1):%Y-%m-%d}"


def _deep(request: Any) -> tuple[str, ...]:
    """What images of more than 8 bits need, if the first of the archive are such."""
    from alignment.errors import FormatError
    from sensors.formats import read_image

    first = next(request.folders(), None)
    image = None if first is None else next(iter(sorted(first.path.rglob("*.png"))), None)
    try:
        return () if image is None or read_image(image).dtype.itemsize == 1 else ("measure_16",)
    except FormatError:
        return ()


@contextmanager
def _shown(as_json: bool) -> Iterator[Callable[[ReplayProgress], None]]:
    """Yield what shows progress on standard error: a bar at a terminal, else some lines, with --json none."""
    from rich import progress as bars
    from rich.console import Console

    if as_json:
        yield lambda _: None
        return
    if not sys.stderr.isatty():
        yield lines_of_progress()
        return
    columns = (
        bars.TextColumn("measuring again"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TextColumn("{task.fields[others]}"),
        bars.TimeRemainingColumn(),
    )
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, others="")

        def show(progress: ReplayProgress) -> None:
            others = f"{progress.others} not identical" if progress.others else ""
            bar.update(task, completed=progress.done, total=progress.total, others=others)

        yield show


def lines_of_progress() -> Callable[[ReplayProgress], None]:
    """Return what writes about twenty lines over a replay, for a log or a pipe."""
    told = 0

    def tell(progress: ReplayProgress) -> None:
        nonlocal told
        part = _PARTS * progress.done // max(1, progress.total)
        if part > told:
            told = part
            others = f", {progress.others} not identical" if progress.others else ""
            typer.echo(f"  {progress.done} of {progress.total} folders{others}", err=True)

    return tell


def summary_as_json(summary: ReplaySummary) -> dict[str, Any]:
    """Return what `truewheel replay --json` prints."""
    from station.replay import ReplayState

    return {
        "archive": str(summary.archive),
        "identical_to_stored": summary.identical,
        "folders": summary.folders,
        "measured": summary.measured,
        "measured_by_earlier_run": summary.earlier,
        "states": {str(state): summary.states[state] for state in ReplayState},
        "causes": dict(summary.causes),
        "lacks": dict(summary.lacks),
        "largest_difference_arcmin": {name: value / ARCMIN for name, value in summary.largest.items()},
        "listed": [each.plain() for each in summary.listed],
        "not_listed": summary.folders - summary.states[ReplayState.IDENTICAL] - len(summary.listed),
        "measure_s": round(summary.measure_s, 3),
        "seconds": round(summary.seconds, 3),
        "journal": None if summary.journal is None else str(summary.journal),
    }


def _print(summary: ReplaySummary) -> None:
    from station.replay import ReplayState

    for each in summary.listed[:_SHOWN]:
        for line in _lines(each):
            typer.echo(line)
    others = summary.folders - summary.states[ReplayState.IDENTICAL]
    if others > _SHOWN:
        where = "name a journal to have all" if summary.journal is None else f"all are in {summary.journal}"
        typer.echo(f"… and {others - _SHOWN} more; {where}")
    counts = [f"{count} {state}" for state, count in summary.states.items()]
    earlier = f", {summary.earlier} of them by an earlier run" if summary.earlier else ""
    typer.echo(f"{count_of(summary.folders, 'wheel')}: {', '.join(counts)}{earlier}")
    for name, count in summary.causes.most_common():
        typer.echo(f"  {count} × {name}")
    for name, count in summary.lacks.most_common():
        typer.echo(f"  not known of {count}: {name}")
    if summary.largest:
        most = ", ".join(f"{name} {value / ARCMIN:.4g}′" for name, value in summary.largest.items())
        typer.echo(f"largest differences: {most}")
    if summary.identical:
        typer.echo("what is stored was found again, to the last bit of what was compared")


def _lines(done: Replayed) -> Iterator[str]:
    """What is said of one wheel."""
    vehicle = "" if done.vin is None else f", VIN {done.vin}"
    yield f"{done.key}{vehicle}: {done.state}"
    for text in done.damage:
        yield f"    damage: {text}"
    for each in done.differences:
        yield f"    {each.field}: {_value(each.field, each.stored)} → {_value(each.field, each.found)}"
    if done.causes:
        yield f"    because of {'; '.join(done.causes)}"
    for text in done.lacks:
        yield f"    not known: {text}"


def _value(name: str, value: float | str | bool | None) -> str:
    if value is None:
        return "none"
    if isinstance(value, float) and name in _ANGLES:
        return f"{math.degrees(value):.7f}°"
    return f"{value:.9g}" if isinstance(value, float) else str(value)
