"""Study `line-noise`: a million random and mutated frames while cycles run."""

from __future__ import annotations

import tempfile
from pathlib import Path

from station.configuration import default_config
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.rehearsal import run_noise

FRAMES, QUICK_FRAMES = 1_000_000, 50_000


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    frames = QUICK_FRAMES if quick else FRAMES
    with tempfile.TemporaryDirectory() as folder:
        found = run_noise(
            Path(folder),
            default_config(None, "line.dbc").resolve(),
            frames,
            seed,
            lambda done: progress(done / frames, f"frame {done} of {frames}"),
        )
    assert found.health is not None
    link, bus = found.health.link, found.health.bus
    rows: list[Row] = [{"kind": kind, "frames": count} for kind, count in sorted(found.frames.items())]
    figures = {
        "frames": float(sum(found.frames.values())),
        "wrong_crc": float(link.wrong_crc),
        "wrong_counter": float(link.wrong_counter),
        "malformed": float(link.malformed),
        "good_cycles": float(found.good_cycles),
        "failed_cycles": float(found.failed_cycles),
        "receive_failures": float(bus.receive_failures),
        "wrong": float(len(found.wrong)),
    }
    goals = (
        Goal("wrong", "at_most", 0),
        Goal("receive_failures", "at_most", 0),
        Goal("good_cycles", "at_least", 1),
    )
    problems = "; ".join(found.wrong[:5])
    text = f"""
{frames} frames of noise, random, flipped, repeated, of wrong length, remote, extended and foreign, on a bus
with a station and a controller that went on measuring: {found.good_cycles} cycles ended with a result,
{found.failed_cycles} were ended by the noise and begun anew. The station's counters hold every frame of its
messages that did not count. {f"Wrong: {problems}." if problems else "No verdict came without a record."}
"""
    return StudyResult(tuple(rows), figures, goals, text)


STUDY = Study("line-noise", "A million random and mutated frames on the line while cycles run.", run)
