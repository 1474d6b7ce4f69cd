"""`truewheel study`: the accuracy studies."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from alignment.errors import SeveralErrors, TruewheelError
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_folder
from station.studies import STUDIES

if TYPE_CHECKING:
    from station.figures import StudyResult


def study(
    name: Annotated[str, typer.Argument(help=f"{', '.join(sorted(STUDIES))}, or all.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder for table, plots and text.", show_default=False)],
    seed: Annotated[int, typer.Option(help="Of all random choices.", min=0, max=2**32 - 1)] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer repetitions.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Run an accuracy study: table, plots and text in a folder; exit status 1 when a goal is missed."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    from station.figures import write_study
    from station.studies import load_study

    ready_folder(out)
    results: dict[str, dict[str, Any]] = {}
    failures: list[TruewheelError] = []
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        for each in sorted(STUDIES) if name == "all" else [name]:
            one = load_study(each)
            task = bar.add_task(each, total=1.0)

            def show(done: float, doing: str, task: TaskID = task, each: str = each) -> None:
                bar.update(task, completed=done, description=f"{each}: {doing}")

            try:
                result = one.run(seed, quick, show)
            except TruewheelError as error:
                # The others still tell something; all failures are reported together.
                failures.append(error)
                bar.update(task, description=f"{each}: failed")
                continue
            files = write_study(one, result, out / each if name == "all" else out)
            bar.update(task, completed=1.0, description=each)
            results[each] = result.as_json() | {"files": [str(file) for file in files]}
            if not as_json:
                bar.stop()
                _show(each, result, files)
                bar.start()
    if as_json and results:
        head = {"seed": seed, "quick": quick}
        print_json(head | ({"studies": results} if name == "all" else {"study": name} | results[name]))
    if failures:
        raise failures[0] if name != "all" else SeveralErrors(f"{len(failures)} studies failed", failures)
    if any(not goal["met"] for found in results.values() for goal in found["goals"]):
        raise typer.Exit(GOAL_MISSED)


def _show(name: str, result: StudyResult, files: list[Path]) -> None:
    typer.echo(name)
    for figure, value in result.figures.items():
        goals = [goal for goal in result.goals if goal.figure == figure]
        beside = ", ".join(f"goal {goal}: {'met' if goal.met(value) else 'MISSED'}" for goal in goals)
        typer.echo(f"  {figure} = {value:.4g}{f'  ({beside})' if goals else ''}")
    typer.echo(f"  wrote {', '.join(str(file) for file in files)}")
