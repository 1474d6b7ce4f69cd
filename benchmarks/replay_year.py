"""How an archive of a year is measured again: 100 000 wheels, memory, the time to the first one, and a kill.

The images of one wheel are so small that measuring them refuses at once, and all folders are hard links to
them: what is left is what the asking process does for each folder. Two stretches of the same replay are
compared, and the replay is killed in the middle and begun again.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path

import numpy as np

from alignment.geometry import PosedCamera
from alignment.values import RigCalibration, StereoImages
from benchmarks.replay import fill

FOLDERS, DAYS = 100_000, 365
MOST_GROWTH_MB, MOST_START_S = 30.0, 10.0
"""Goals: growth of memory from a tenth to the end, and time to the first result over that of one folder."""
_SIZE = 48


def small_wheel() -> tuple[list[StereoImages], RigCalibration]:
    """Six dark images that no wheel is seen in, and a calibration of cameras of that size."""
    from sensors.simulation import RIG_SPECS, build_rig

    rig = build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1))

    def shrunk(camera: PosedCamera) -> PosedCamera:
        model = camera.model
        share = _SIZE / model.width
        small = replace(
            model,
            width=_SIZE,
            height=_SIZE,
            fx=model.fx * share,
            fy=model.fy * share,
            cx=_SIZE / 2,
            cy=_SIZE / 2,
        )
        return replace(camera, model=small)

    heads = tuple(replace(h, left=shrunk(h.left), right=shrunk(h.right)) for h in rig.heads)
    rig = replace(rig, heads=heads, covariance=1e-14 * np.eye(len(rig.parameter_names)))
    dark = np.full((_SIZE, _SIZE), 20, np.uint8)
    return [StereoImages(dark, dark)] * len(heads), rig


def spread(folder: Path, folders: int, days: int) -> Path:
    """Archive one wheel as a station does, and link it so often, over so many days; the archive."""
    images, rig = small_wheel()
    made = folder / "made"
    made.mkdir()
    fill(made, images, rig, 1)
    [first] = (made / "images").glob("*/*")
    files = [path for path in first.iterdir() if path.is_file()]
    archive = folder / "images"
    for number in range(folders):
        day = archive / str(date(2026, 1, 1) + timedelta(days=number * days // folders))
        place = day / f"00000000-0000-4000-8000-{number:012d}-front_left"
        place.mkdir(parents=True)
        for path in files:
            os.link(path, place / path.name)
    return archive


def command(archive: Path, journal: Path, *options: str) -> list[str]:
    """The replay of an archive, with one worker."""
    words = [sys.executable, "-m", "station.cli", "replay", str(archive), "--journal", str(journal)]
    return [*words, "--workers", "1", "--json", *options]


def followed(archive: Path, journal: Path, folders: int, kill_at: int | None = None) -> dict[str, float]:
    """Replay; time to the first result, seconds a folder, and memory at a tenth and at the end, megabytes."""
    before = lines_of(journal)
    start = time.perf_counter()
    found: dict[str, float] = {}
    with tempfile.TemporaryFile() as out, subprocess.Popen(command(archive, journal), stdout=out) as process:
        while process.poll() is None:
            time.sleep(0.02)
            done = lines_of(journal) - 1
            memory = resident_mb(process.pid)
            if done > max(0, before - 1) and "first_s" not in found:
                found["first_s"] = time.perf_counter() - start
            if done >= folders // 10 and "tenth_mb" not in found:
                found["tenth_mb"] = memory
            if memory:
                found["end_mb"] = memory
            if kill_at is not None and done >= kill_at:
                process.send_signal(signal.SIGKILL)
                process.wait()
        found["seconds"] = time.perf_counter() - start
        out.seek(0)
        said = json.loads(out.read() or b"{}")
    if said:
        found |= {"folders": said["folders"], "earlier": said["measured_by_earlier_run"]}
        found["identical"] = said["states"]["identical"]
    return found


_read: dict[Path, tuple[int, int]] = {}


def lines_of(journal: Path) -> int:
    """Lines of the journal so far; what was counted before is not read again."""
    place, lines = _read.get(journal, (0, 0))
    if not journal.exists():
        return 0
    with journal.open("rb") as stream:
        stream.seek(place)
        while block := stream.read(1 << 20):
            place, lines = place + len(block), lines + block.count(b"\n")
    _read[journal] = place, lines
    return lines


def resident_mb(process: int) -> float:
    """Memory of a process in use; 0 when it has ended."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    sizes = [line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")]
    return int(sizes[0]) / 1024 if sizes else 0.0


def figures_of(folder: Path, folders: int, days: int) -> dict[str, float]:
    """Fill a folder with archives and replay them; the figures."""
    (folder / "one").mkdir()
    alone = followed(spread(folder / "one", 1, 1), folder / "one.jsonl", 1)
    start = time.perf_counter()
    archive = spread(folder, folders, days)
    filled_s = time.perf_counter() - start
    journal = folder / "year.jsonl"
    half = followed(archive, journal, folders, kill_at=folders // 2)
    rest = followed(archive, journal, folders)
    return {
        "folders": rest["folders"],
        "identical": rest["identical"],
        "filled_s": filled_s,
        "one_folder_s": alone["seconds"],
        "start_s": half["first_s"] - alone["seconds"],
        "start_again_s": rest["first_s"] - alone["seconds"],
        "folders_per_s": folders // 2 / half["seconds"],
        "kept_by_the_journal": rest["earlier"],
        "memory_at_a_tenth_mb": half["tenth_mb"],
        "memory_at_half_mb": half["end_mb"],
        "memory_at_the_end_mb": rest["end_mb"],
        "growth_mb": max(half["end_mb"], rest["end_mb"]) - half["tenth_mb"],
    }


def main() -> int:
    """Print the figures; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folders", type=int, default=FOLDERS)
    parser.add_argument("--days", type=int, default=DAYS)
    parser.add_argument("--place", type=Path, help="where the archive is made; links need one file system")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.place) as name:
        figures = figures_of(Path(name), options.folders, options.days)
    met = figures["growth_mb"] <= MOST_GROWTH_MB and figures["start_s"] <= MOST_START_S
    met = met and figures["identical"] == options.folders
    if options.json:
        print(json.dumps({"figures": figures, "goals_met": met}))
    else:
        for figure, value in figures.items():
            print(f"{figure:24s} {value:10.2f}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
