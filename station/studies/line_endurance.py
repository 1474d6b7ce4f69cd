"""Study `line-endurance`: ten thousand cycles between two processes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from db.exports import SERIES, in_style, legend_outside
from station.configuration import default_config
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.rehearsal import SETTLED, Endurance, run_endurance

CYCLES, QUICK_CYCLES = 10_000, 300
TIMES = ("busy_s", "first_result_s", "all_results_s")


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`. Nothing in it is random."""
    cycles = QUICK_CYCLES if quick else CYCLES
    with tempfile.TemporaryDirectory() as folder:
        found = run_endurance(
            Path(folder),
            default_config(None, "line.dbc").resolve(),
            cycles,
            lambda done: progress(done / cycles, f"cycle {done} of {cycles}"),
        )
    settled = min(SETTLED, cycles // 3)
    station_growth, controller_growth = found.growth_mb(settled)
    figures = {
        "cycles": float(found.cycles),
        "wrong_results": float(len(found.wrong)),
        "station_memory_growth_mb": station_growth,
        "controller_memory_growth_mb": controller_growth,
        "trigger_to_busy_p99_ms": found.percentile_ms("busy_s", 99),
        "trigger_to_busy_median_ms": found.percentile_ms("busy_s", 50),
        "commit_to_first_result_p99_ms": found.percentile_ms("first_result_s", 99),
        "commit_to_first_result_median_ms": found.percentile_ms("first_result_s", 50),
        "commit_to_all_results_p99_ms": found.percentile_ms("all_results_s", 99),
        "commit_to_all_results_median_ms": found.percentile_ms("all_results_s", 50),
    }
    goals = (
        Goal("wrong_results", "at_most", 0),
        Goal("station_memory_growth_mb", "at_most", 5.0),
        Goal("controller_memory_growth_mb", "at_most", 5.0),
        Goal("trigger_to_busy_p99_ms", "at_most", 10.0),
        Goal("commit_to_first_result_p99_ms", "at_most", 5.0),
    )
    rows: list[Row] = [
        {"percentile": p, **{f"{name[:-2]}_ms": found.percentile_ms(name, p) for name in TIMES}}
        for p in (50, 90, 95, 99, 99.9, 100)
    ]
    problems = "; ".join(found.wrong[:5])
    text = f"""
{cycles} cycles of four wheels with prepared angles, station and controller in two processes joined by two
slcan ends back to back, a real database, every frame protected. Times are seen at the controller's end, so
they hold the way over the cable. Memory grows by {station_growth:.2f} MB (station) and
{controller_growth:.2f} MB (controller) after the first {settled} cycles.
{f"Wrong: {problems}." if problems else "No result was lost, doubled, or of another cycle than it says."}
"""
    return StudyResult(tuple(rows), figures, goals, text, {"line-endurance": _plot(found)})


@in_style
def _plot(found: Endurance) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, label in zip(TIMES, ("start to busy", "commit to first result", "to all results"), strict=True):
        values = np.sort([1e3 * getattr(times, name) for times in found.times])
        left.plot(values, np.linspace(0, 100, len(values)), label=label)
    left.set_xlabel("time, ms")
    left.set_ylabel("% of cycles")
    left.set_xscale("log")
    right.plot(found.station_rss_mb, color=SERIES[3], label="station")
    right.plot(found.controller_rss_mb, color=SERIES[4], label="controller")
    right.set_xlabel("cycle")
    right.set_ylabel("memory, MB")
    legend_outside(figure)
    return figure


STUDY = Study("line-endurance", "Ten thousand cycles between two processes: results, times, memory.", run)
