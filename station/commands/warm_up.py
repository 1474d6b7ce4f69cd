"""`truewheel warm-up`, and how every verb that measures compiles first what is missing."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from alignment.counting import count_of
from station.commands.output import JsonFlag, print_json

if TYPE_CHECKING:
    from alignment.values import StereoImages
    from station.warm_up import WarmedUp, WarmUpProgress

_WHAT = "compiling for this computer (once)"
_EVERY_S = 5.0


def warm_up(as_json: JsonFlag = False) -> None:
    """Compile the image functions for this computer, once, so that nothing waits for it later."""
    from station.warm_up import Work
    from station.warm_up import warm_up as prepare

    with _shown(as_json) as report:
        done = prepare(Work, report, loaded=False)
    if as_json:
        print_json(warmed_up_as_json(done))
    elif done.compiled:
        longest = sorted(done.compiled, key=lambda one: -one.seconds)[:5]
        typer.echo(f"compiled {len(done.compiled)} of {done.functions} functions in {done.seconds:.0f} s")
        for one in longest:
            typer.echo(f"  {one.seconds:5.1f} s  {one.what.name}")
    else:
        typer.echo(f"all {done.functions} functions are compiled already")
    if done.unsaved is not None:
        typer.echo(
            f"nothing of it was kept ({done.unsaved}): make room, or name a folder that can be written in "
            "NUMBA_CACHE_DIR",
            err=True,
        )
        raise typer.Exit(1)


def warmed_up_as_json(done: WarmedUp) -> dict[str, Any]:
    """Return what `truewheel warm-up --json` prints."""
    return {
        "functions": done.functions,
        "compiled": [
            {"name": one.what.name, "signature": one.what.signature, "seconds": round(one.seconds, 3)}
            for one in done.compiled
        ],
        "seconds": round(done.seconds, 3),
        "kept": done.unsaved is None,
        "reason": done.unsaved,
    }


def compiled_for(works: Iterable[str], as_json: bool) -> None:
    """Compile what these works need and the disk does not hold, and show it; silent when there is nothing.

    Raises
    ------
    WarmUpError
        When something does not compile.
    """
    from station.warm_up import Work, missing

    wanted = [Work(work) for work in works]
    if missing(wanted):
        from station.warm_up import warm_up as prepare

        with _shown(as_json) as report:
            prepare(wanted, report, loaded=False)


def compiled_for_images(images: Iterable[StereoImages], as_json: bool, *more: str) -> None:
    """`compiled_for` the measurement of images as deep as these, and for more works."""
    deep = any(image.dtype.itemsize > 1 for pair in images for image in (pair.left, pair.right))
    compiled_for(("measure_16" if deep else "measure_8", *more), as_json)


def lines_of_progress(
    clock: Callable[[], float] = time.monotonic, every_s: float = _EVERY_S
) -> Callable[[WarmUpProgress], None]:
    """Return what writes a line at the beginning and at the end, and at most one in `every_s` between.

    For a log, a pipe, a service: where nobody sees a bar, somebody waits all the same.
    """
    started = told = clock()

    def tell(progress: WarmUpProgress) -> None:
        nonlocal told
        now = clock()
        if progress.done == 0:
            typer.echo(f"{_WHAT}: {count_of(progress.total, 'function')}, about a minute", err=True)
        elif progress.done == progress.total or now - told >= every_s:
            told = now
            share, passed = f"{100.0 * progress.share:.0f} %", f"{now - started:.0f} s"
            typer.echo(f"  {progress.done} of {progress.total} functions, {share}, {passed}", err=True)

    return tell


@contextmanager
def _shown(as_json: bool) -> Iterator[Callable[[WarmUpProgress], None]]:
    """Yield what shows progress on standard error: a bar at a terminal, else lines, with --json none."""
    from rich import progress as bars
    from rich.console import Console

    if as_json or not sys.stderr.isatty():
        yield (lambda progress: None) if as_json else lines_of_progress()
        return
    columns = (
        bars.TextColumn("{task.description}"),
        bars.BarColumn(),
        bars.TextColumn("{task.fields[doing]}"),
        bars.TimeElapsedColumn(),
    )
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(_WHAT, total=1.0, doing="")

        def show(progress: WarmUpProgress) -> None:
            bar.update(task, completed=progress.share, doing=f"{progress.done} of {progress.total}")

        yield show
