"""Following a wheel beside measuring it whole: processor time, and four wheels live from exposure to the bus.

A few views of a wheel whose tie rod is turned are rendered, or read from a folder that an earlier run kept.
Both ways take the same images in turns, on one core, and the processor time of the thread is what counts: it
does not depend on what else the computer does. Then a station adjusts four wheels, cycle, line and bus real.
All of it runs in a process that does nothing else.
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

import numpy as np

from alignment.follow import FollowRules, follow_wheel
from alignment.kernels import on_one_core
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, RigCalibration, StereoImages
from station.configuration import default_config
from station.rehearsal import run_live

VIEWS, REPEATS, SECONDS, RATE = 4, 100, 5.0, 30.0
MOST_CPU_MS, LEAST_RESULTS, MOST_BUSY, MOST_DELAY_MS = 4.0, 25.0, 0.5, 80.0
_CORES = 2
_WARM = 10


def rendered(preset: str, seed: int) -> tuple[list[Sequence[StereoImages]], RigCalibration]:
    """Render the views."""
    from station.studies import tie_rod_images

    return tie_rod_images(preset, VIEWS, seed)


def processor_time(
    views: Sequence[Sequence[StereoImages]], calibration: RigCalibration, repeats: int
) -> dict[str, float]:
    """Of a whole measurement and of following, in turns, milliseconds of the thread's time."""
    settings = MeasureSettings()
    rig = PreparedRig.of(calibration, settings)
    never = FollowRules(10**9)
    places = [*range(len(views)), *range(len(views) - 2, 0, -1)]
    times: dict[str, list[float]] = {"whole": [], "follow": []}
    followed = 0
    with on_one_core():
        wheel = follow_wheel(views[0], rig, settings, None, never).wheel
        for k in range(1, repeats + _WARM + 1):
            images = views[places[k % len(places)]]
            started = time.thread_time()
            measure_wheel(images, rig, settings)
            between = time.thread_time()
            found = follow_wheel(images, rig, settings, wheel, never)
            ended = time.thread_time()
            wheel = found.wheel
            if k > _WARM:
                times["whole"].append(1e3 * (between - started))
                if found.whole is None:
                    times["follow"].append(1e3 * (ended - between))
                    followed += 1
    whole, follow = (statistics.median(each or [float("nan")]) for each in times.values())
    ratios = [b / a for a, b in zip(times["whole"], times["follow"], strict=False)]
    return {
        "whole_cpu_ms": whole,
        "follow_cpu_ms": follow,
        "follow_least_cpu_ms": min(times["follow"], default=float("nan")),
        "whole_least_cpu_ms": min(times["whole"]),
        "follow_over_whole": statistics.median(ratios or [float("nan")]),
        "followed_share": followed / repeats,
    }


def live(
    views: Sequence[Sequence[StereoImages]], calibration: RigCalibration, seconds: float, follow: bool
) -> dict[str, float]:
    """Of a station that adjusts four wheels."""
    with tempfile.TemporaryDirectory() as folder:
        dbc = default_config(None, "line.dbc").resolve()
        found = run_live(Path(folder), dbc, views, calibration, seconds, RATE, follow=follow)
    delays = [1e3 * delay for delay in found.delays_s] or [float("nan")]
    shares = [f / max(f + w, 1) for f, w in zip(found.followed, found.whole, strict=True)]
    return {
        "results_per_wheel_and_s": min(found.results) / found.seconds,
        "busy_share_of_two_cores": found.cpu_s / found.seconds / _CORES,
        "cpu_ms_per_result": 1e3 * found.cpu_s / max(sum(found.results), 1),
        "delay_median_ms": statistics.median(delays),
        "delay_p95_ms": float(np.quantile(delays, 0.95)),
        "without_angles": float(found.without_angles),
        "followed_share": min(shares),
        "stop_to_result_ms": 1e3 * found.stop_s,
    }


def measure_alone() -> None:
    """Read pickled views, calibration, repeats and seconds from standard input; print the figures."""
    views, calibration, repeats, seconds = pickle.load(sys.stdin.buffer)
    figures = processor_time(views, calibration, repeats)
    for name, follow in (("live", True), ("live_whole", False)):
        if seconds > 0.0:
            figures |= {f"{name}_{k}": v for k, v in live(views, calibration, seconds, follow).items()}
    figures["load_average"] = os.getloadavg()[0]
    sys.stdout.write(json.dumps(figures))


def goals_met(figures: dict[str, float]) -> dict[str, bool]:
    """Which goals of the product are met."""
    met = {"follow_cpu_ms": figures["follow_cpu_ms"] <= MOST_CPU_MS}
    if "live_delay_p95_ms" in figures:
        met |= {
            "live_results_per_wheel_and_s": figures["live_results_per_wheel_and_s"] >= LEAST_RESULTS,
            "live_busy_share_of_two_cores": figures["live_busy_share_of_two_cores"] <= MOST_BUSY,
            "live_delay_p95_ms": figures["live_delay_p95_ms"] <= MOST_DELAY_MS,
        }
    return met


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="standard", help="of the rig that is rendered")
    parser.add_argument("--views", type=Path, help="file that keeps the rendered views for the next run")
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each live run; 0 for none")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    options = parser.parse_args(arguments)
    if options.views is not None and options.views.exists():
        views, calibration = pickle.loads(options.views.read_bytes())
    else:
        views, calibration = rendered(options.preset, 1)
        if options.views is not None:
            options.views.write_bytes(pickle.dumps((views, calibration)))
    alone = subprocess.run(
        [sys.executable, "-c", f"from {measure_alone.__module__} import measure_alone; measure_alone()"],
        input=pickle.dumps((views, calibration, options.repeats, options.seconds)),
        stdout=subprocess.PIPE,
        check=True,
    )
    figures = json.loads(alone.stdout)
    met = goals_met(figures)
    if options.json:
        print(json.dumps({"figures": figures, "goals_met": met, "cores": os.cpu_count()}))
    else:
        for name, value in figures.items():
            said = "" if name not in met else "  met" if met[name] else "  MISSED"
            print(f"{name:40s} {value:10.3f}{said}")
    return 0 if all(met.values()) else 1


if __name__ == "__main__":
    # Under its own name, so that the process of its own finds it.
    from benchmarks.following import main as named

    sys.exit(named())
