"""Writes the table of the compiled functions that each work needs: `python tools/kernel_table.py`.

Runs the verbs of the command line on small simulated data, each in a process of its own, and notes with which
types numba's functions were called from Python. A few minutes where nothing is compiled.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from station.warm_up import SIGNATURES

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "station" / "warm_up" / "table.py"
_DEPTHS = {"measure_8", "measure_16"}
_HEAD = '''"""Compiled functions by the work that needs them; written by tools/kernel_table.py.

A test measures with everything of this table loaded and asserts that nothing else is compiled.
"""

# ruff: noqa: E501

from __future__ import annotations

SIGNATURES: dict[str, dict[str, tuple[str, ...]]] = {
'''
# Runs one verb and writes what was called from Python, outermost kernels only: with a filled cache no others
# are loaded.
_RECORDER = """
import json, sys
from station.warm_up import needs
from station.warm_up import called
needs.SIGNATURES = {}
from station.cli import main


def follow(folder, calibration):
    # No verb follows a wheel: the station does, while it is adjusted.
    from alignment.follow import FollowRules, follow_wheel
    from alignment.prepared import PreparedRig
    from alignment.values import MeasureSettings
    from sensors.formats import read_calibration, read_shot

    rig, wheel = PreparedRig.of(read_calibration(calibration), MeasureSettings()), None
    for _ in range(2):
        found = follow_wheel(read_shot(folder).images, rig, MeasureSettings(), wheel, FollowRules())
        wheel = found.wheel
    assert found.whole is None, found.whole


try:
    follow(*sys.argv[3:]) if sys.argv[2] == "follow" else main(sys.argv[2:])
except SystemExit as end:
    if end.code not in (0, 1, None):
        raise
finally:
    json.dump(called(), open(sys.argv[1], "w"))
"""


def scenarios(folder: Path) -> list[tuple[str, list[str]]]:
    """Works and the verbs that show what they need, in an order in which each finds its input."""
    wheel, plates, calibration = folder / "wheel", folder / "plates", folder / "calibration.json"
    simulate = ["simulate", "wheel", "--camber", "-0.8", "--toe", "0.15", "--seed", "7"]
    runs = [("wheel_images", [*simulate, "--out", str(wheel)])]
    loaded = [*simulate, "--load-mm", "5", "--out", str(folder / "loaded")]
    runs.append(("deformed_wheel_images", loaded))
    session = ["simulate", "plate-session", "--seed", "7", "--views", "4"]
    board = ["--plate", str(ROOT / "configs" / "plates" / "charuco.toml"), "--head", "head_1"]
    runs.append(("plate_images", [*session, "--out", str(plates)]))
    runs.append(("plate_images", [*session, *board, "--out", str(folder / "board")]))
    for method in ("heads-then-poses", "joint"):
        calibrate = ["calibrate", str(plates), "--out", str(calibration), "--method", method]
        runs.append(("calibrate", calibrate))
    runs.append(("calibrate", ["calibration", "check", str(plates), "--calibration", str(calibration)]))
    known = ["--calibration", str(wheel / "calibration.json")]
    for method in ("revolution", "plane", "ridges"):
        config = ["--config", str(folder / f"{method}.toml")]
        for bits in (8, 16):
            runs.append((f"measure_{bits}", ["measure", str(folder / f"wheel{bits}"), *known, *config]))
    for bits in (8, 16):
        dark = ["measure", str(folder / f"dark{bits}"), *known, "--config", str(folder / "revolution.toml")]
        stated = ["measure", str(folder / f"wheel{bits}"), "--calibration", str(calibration)]
        runs += [(f"measure_{bits}", dark), (f"measure_{bits}", stated)]
        for shot in (f"wheel{bits}", f"loaded{bits}"):
            follow = ["follow", str(folder / shot), str(folder / "loaded" / "calibration.json")]
            runs.append((f"measure_{bits}", follow))
    turned = [folder / f"turned{k}" for k in range(8)]
    for k, shot in enumerate(turned):
        turn = ["--spin", str(45 * k), "--runout", "0.05", "--out", str(shot)]
        runs.append(("spin_images" if k else "wheel_images", [*simulate, *turn]))
    shots = [str(shot) for shot in turned]
    runs.append(("spin", ["measure", "--spin", *shots, *known]))
    refreshed = ["--calibration", str(calibration), "--out", str(folder / "refreshed.json")]
    return [*runs, ("refresh", ["calibration", "refresh", *shots[:3], *refreshed])]


def prepare(folder: Path) -> None:
    """Write what the simulator does not: settings, and shots of 8 and 16 bit, some with a dark head."""
    import cv2

    station = (
        (ROOT / "configs" / "station.toml").read_text().replace('"vehicles"', f'"{ROOT}/configs/vehicles"')
    )
    for method in ("revolution", "plane", "ridges"):
        text = station.replace('method = "revolution"', f'method = "{method}"')
        text = text.replace("allow_lost_head = false", "allow_lost_head = true")
        (folder / f"{method}.toml").write_text(text.replace('"line.dbc"', f'"{ROOT}/configs/line.dbc"'))
    for bits in (8, 16):
        for name in ("wheel", "dark", "loaded"):
            shot = folder / f"{name}{bits}"
            shutil.copytree(folder / ("loaded" if name == "loaded" else "wheel"), shot)
            for file in shot.glob("*.png"):
                image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
                kept = image * (0 if name == "dark" and file.name.startswith("head_2") else 1)
                cv2.imwrite(str(file), kept.astype("uint8") if bits == 8 else kept.astype("uint16") * 257)


def record(arguments: list[str], runs: int) -> dict[str, list[str]]:
    """Run one verb, twice so that the second finds everything on the disk; return what it called."""
    with tempfile.NamedTemporaryFile(suffix=".json") as out:
        for _ in range(runs):
            if "--out" in arguments:
                place = Path(arguments[arguments.index("--out") + 1])
                if place.is_dir():
                    shutil.rmtree(place)
                elif place.name.startswith("refreshed"):
                    place.unlink(missing_ok=True)
            command = [sys.executable, "-c", _RECORDER, out.name, *arguments]
            done = subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True)
            if done.returncode != 0:
                raise SystemExit(f"{' '.join(arguments)}: {done.stderr}")
        found: dict[str, list[str]] = json.loads(Path(out.name).read_text())
        return found


def table(needs: dict[str, dict[str, set[str]]]) -> str:
    """Return the module of the table as text."""
    lines = [_HEAD]
    for work in set(needs) - _DEPTHS:
        # What each measurement needs is asked for with the depth of its images.
        for name in [name for name in needs[work] if any(name in needs[depth] for depth in _DEPTHS)]:
            needs[work][name] -= {signature for depth in _DEPTHS for signature in needs[depth].get(name, ())}
        needs[work] = {name: signatures for name, signatures in needs[work].items() if signatures}
    for work, kernels in sorted(needs.items()):
        lines.append(f'    "{work}": {{')
        for name, signatures in sorted(kernels.items()):
            lines.append(f'        "{name}": (')
            lines += [f'            "{signature}",' for signature in sorted(signatures)]
            lines.append("        ),")
        lines.append("    },")
    return "\n".join([*lines, "}", ""])


def main() -> None:
    """Record the works that are named, or all, and write the table."""
    asked = set(sys.argv[1:]) or {work for work, _ in scenarios(ROOT)}
    needs = {
        work: {name: set(signatures) for name, signatures in kernels.items()}
        for work, kernels in SIGNATURES.items()
        if work not in asked
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for work, arguments in scenarios(folder):
            if work.startswith("measure") and not (folder / "wheel8").exists():
                prepare(folder)
            # Rendered images serve the works after them.
            if work not in asked and not work.endswith("_images"):
                continue
            for kernel, signatures in record(arguments, runs=2 if work in asked else 1).items():
                if work in asked and work != "spin_images":
                    needs.setdefault(work, {}).setdefault(kernel, set()).update(signatures)
    TABLE.write_text(table(needs))
    subprocess.run([sys.executable, "-m", "ruff", "format", "-q", str(TABLE)], check=True, cwd=ROOT)


if __name__ == "__main__":
    main()
