"""How soon a vehicle whose wheels turned is answered: four wheels with sixteen prepared exposures each.

Rendered once, or taken from a folder of `truewheel simulate wheel --turns 16`. Every wheel's exposures come
at their times; they are measured while the next are taken. Station, database and bus are real, and run in a
process that does nothing else. Beside it the time of one measurement alone, since machines differ.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, RigCalibration, StereoImages
from station.configuration import default_config
from station.rehearsal import images_station, run_turning

EXPOSURES = 16
MOST_MS = 150.0
INTERVAL_S = 0.28


def rendered(preset: str, seed: int) -> tuple[list[Sequence[StereoImages]], RigCalibration]:
    """Render the exposures of one wheel, twice round with 2 mm of run-out."""
    import math

    import numpy as np

    from sensors.simulation import (
        RIG_SPECS,
        Rollers,
        TurningWheel,
        build_rig,
        draw_pose,
        draw_scene,
        simulate_shot,
    )

    rng = np.random.default_rng(seed)
    spec = RIG_SPECS[preset]
    calibration = build_rig(spec, "front_left", "left", rng)
    pose = draw_pose(rng, math.radians(-0.5), math.radians(0.1), run_out=math.radians(0.19))
    wheel = TurningWheel(draw_scene(spec, "left", pose, rng, seed=seed), Rollers(interval_s=INTERVAL_S), rng)
    scenes = (wheel.exposure(k) for k in range(1, EXPOSURES + 1))
    return [simulate_shot(scene, calibration, rng).images for scene in scenes], calibration


def recorded(folder: Path) -> tuple[list[Sequence[StereoImages]], RigCalibration]:
    """Read the exposures of a folder."""
    from sensors.formats import read_calibration, read_shot

    calibration = read_calibration(folder / "calibration.json")
    shots = [read_shot(folder / f"turn_{k:02d}", calibration) for k in range(1, EXPOSURES + 1)]
    return [shot.images for shot in shots], calibration


def measure_alone() -> None:
    """Read pickled exposures, calibration and number of cycles from standard input; print the figures."""
    exposures, calibration, cycles = pickle.load(sys.stdin.buffer)
    rig, settings = PreparedRig.of(calibration, MeasureSettings()), MeasureSettings()
    single, worked = [], []
    for images in [*exposures, *exposures]:
        start, start_cpu = time.perf_counter(), time.process_time()
        measure_wheel(images, rig, settings)
        single.append(1e3 * (time.perf_counter() - start))
        worked.append(time.process_time() - start_cpu)
    with tempfile.TemporaryDirectory() as folder:
        found = run_turning(
            Path(folder),
            default_config(None, "line.dbc").resolve(),
            cycles + 1,
            images_station(exposures, calibration),
            INTERVAL_S,
        )
    answers = [1e3 * answer_s for answer_s in found.answer_s[1:]]
    measure_ms = statistics.median(single[len(exposures) :])
    figures = {
        "answer_median_ms": statistics.median(answers),
        "answer_max_ms": max(answers),
        # Of all cores together: on two that do nothing else the answer takes half of it, and the commit.
        "answer_cpu_ms": 1e3 * statistics.median(found.cpu_s[1:]),
        "measure_wheel_ms": measure_ms,
        "measure_wheel_cpu_ms": 1e3 * statistics.median(worked[len(exposures) :]),
        "answer_over_measure_wheel": statistics.median(answers) / measure_ms,
        "not_judged": float(sum(outcome not in ("ok", "nok") for outcome in found.outcomes)),
        "peak_memory_mb": max(found.rss_mb),
    }
    sys.stdout.write(json.dumps(figures))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; 1 when the goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--folder", type=Path, help="of exposures, turn_01 to turn_16, with their calibration"
    )
    parser.add_argument("--preset", default="standard", help="of the rig that is rendered without a folder")
    parser.add_argument("--cycles", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    options = parser.parse_args(arguments)
    exposures, calibration = recorded(options.folder) if options.folder else rendered(options.preset, 1)
    alone = subprocess.run(
        [sys.executable, "-c", f"from {measure_alone.__module__} import measure_alone; measure_alone()"],
        input=pickle.dumps((exposures, calibration, options.cycles)),
        stdout=subprocess.PIPE,
        check=True,
    )
    figures = json.loads(alone.stdout)
    met = figures["answer_median_ms"] <= MOST_MS and not figures["not_judged"]
    if options.json:
        print(json.dumps({"figures": figures, "goals_met": met, "cores": os.cpu_count()}))
    else:
        for name, value in figures.items():
            print(f"{name:28s} {value:12.3f}")
    return 0 if met else 1


if __name__ == "__main__":
    # Under its own name, so that the process of its own finds it.
    from benchmarks.spin_cycle import main as named

    sys.exit(named())
