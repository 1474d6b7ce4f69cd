"""`truewheel bench`: speed and accuracy of one measurement beside its peers."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.warm_up import compiled_for


def bench(
    repeats: Annotated[
        int, typer.Option(help="Timed measurements, in up to seven turns.", min=1, max=1000)
    ] = 70,
    warm_up: Annotated[
        float,
        typer.Option(
            help="Seconds of measuring before the first turn; a tenth of it before each.", min=0, max=60
        ),
    ] = 3.0,
    as_json: JsonFlag = False,
) -> None:
    """Time one wheel's measurement beside dense stereo with a RANSAC plane, in one run, stage by stage.

    Exit status 1 when a goal is missed. Times mean something on a machine that does nothing else.
    """
    from station.rehearsal import LEAST_SPEEDUP, MOST_MEMORY_MB, MOST_MS, goals, run

    compiled_for(("measure_8", "wheel_images"), as_json)
    figures = run(repeats, warm_up)
    met = goals(figures)
    if as_json:
        wanted = {
            "measure_wheel_ms": f"≤ {MOST_MS:g}",
            "speedup_over_sgbm_ransac": f"≥ {LEAST_SPEEDUP:g}",
            "peak_memory_mb": f"< {MOST_MEMORY_MB:g}",
        }
        print_json({"figures": figures, "goals": wanted, "goals_met": met, "cores": os.cpu_count()})
    else:
        for name, value in figures.items():
            typer.echo(f"{name:28s} {value:12.3f}")
        typer.echo(
            f"goals: at most {MOST_MS:g} ms, {LEAST_SPEEDUP:g} times faster than the peers, under "
            f"{MOST_MEMORY_MB:g} MB: {'met' if met else 'MISSED'}"
        )
    if not met:
        raise typer.Exit(GOAL_MISSED)
