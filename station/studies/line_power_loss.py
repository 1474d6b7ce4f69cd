"""Study `line-power-loss`: station and controller killed at every step of a cycle."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Callable
from pathlib import Path

from station.configuration import default_config
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.rehearsal import PowerLoss, open_power_loss

QUICK_STEPS = 4


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`. Quick takes a few steps of each side, chosen by the seed."""
    rows: list[Row] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        open_power_loss(Path(folder), default_config(None, "line.dbc").resolve()) as bench,
    ):
        sides: tuple[tuple[str, list[str], Callable[[int, str], PowerLoss]], ...] = (
            ("station", bench.station_steps(), bench.kill_station),
            ("controller", bench.controller_steps(), bench.kill_controller),
        )
        chosen = [
            (side, kill, number, name)
            for side, names, kill in sides
            for number, name in _chosen(list(enumerate(names)), seed, quick)
        ]
        for done, (side, kill, number, name) in enumerate(chosen):
            progress(done / len(chosen), f"{side}, {name}")
            found = kill(number, name)
            rows.append(
                {
                    "side": side,
                    "step": number,
                    "name": name,
                    "ended": found.ended,
                    "stored": "yes" if found.stored else "no",
                    "wrong": "; ".join(found.wrong),
                }
            )
    counts = {side: sum(row["side"] == side for row in rows) for side in ("station", "controller")}
    wrong = [row for row in rows if row["wrong"]]
    figures = {
        "station_steps": float(counts["station"]),
        "controller_steps": float(counts["controller"]),
        "ended_with_the_result": float(sum(row["ended"] == "result" for row in rows)),
        "ended_with_a_fault": float(sum(row["ended"] == "fault" for row in rows)),
        "wrong": float(len(wrong)),
    }
    text = f"""
The station's process was killed at {counts["station"]} steps of a cycle and the controller's at
{counts["controller"]}: before and after each call to line and database, at each statement and commit, at each
frame. After the restart the controller had the stored result, or a fault: then nothing was stored, or a fault
too; a record was whole or absent; no verdict was on the bus that is not stored.
{"Wrong: " + "; ".join(f"{row['side']} at {row['name']}: {row['wrong']}" for row in wrong) if wrong else ""}
"""
    return StudyResult(tuple(rows), figures, (Goal("wrong", "at_most", 0),), text)


def _chosen(steps: list[tuple[int, str]], seed: int, quick: bool) -> list[tuple[int, str]]:
    return random.Random(seed).sample(steps, min(QUICK_STEPS, len(steps))) if quick else steps


STUDY = Study("line-power-loss", "Station and controller killed at every step of a cycle.", run)
