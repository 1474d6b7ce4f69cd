"""Every branch of the modules that decide is run by their own tests: `python tools/branches.py`, or by name.

Each module is measured with nothing but the tests that are its own, so that what another test happens to run
does not count. Status 1 when a line or a branch is left out; which ones is printed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mutate import TESTS

ROOT = Path(__file__).resolve().parents[1]
DECIDING = TESTS | {
    **{
        f"station.duty.{name}": ("tests/station/duty/test_histories.py",)
        for name in ("plan", "rig", "station", "table", "words")
    },
    "station.cycle.judging.evaluation": (
        "tests/station/cycle/judging/test_evaluation.py",
        "tests/station/cycle/test_turning_wheels.py",
        "tests/station/cycle/test_vehicle_frame.py",
        "tests/station/cycle/judging/test_corrections.py",
    ),
}


def left_out(module: str, tests: Sequence[str], folder: Path = ROOT) -> str:
    """Run a module's own tests; return what they leave out or why they failed, empty when all is run."""
    command = [sys.executable, "-m", "pytest", "-q", "--no-header", *tests, f"--cov={module}", "--cov-branch"]
    command += ["--cov-fail-under=100", "--cov-report=term-missing:skip-covered"]
    with tempfile.TemporaryDirectory() as place:
        settings = Path(place) / "coverage.ini"
        # Nothing is left out by a comment either.
        settings.write_text("[report]\nexclude_lines =\npartial_branches =\n")
        environment = os.environ | {"COVERAGE_FILE": str(Path(place) / "data")}
        command.append(f"--cov-config={settings}")
        ended = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
    said = ended.stdout + ended.stderr
    # Without any data the limit is not looked at.
    reached = ended.returncode == 0 and "Required test coverage of 100% reached" in said
    return "" if reached else said


def main(names: Sequence[str]) -> int:
    """Measure these modules, or all of them; the exit status."""
    unknown = set(names) - set(DECIDING)
    if unknown:
        print(f"expected some of {', '.join(DECIDING)}, found {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    status, wanted = 0, list(names or DECIDING)
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        found = list(pool.map(lambda module: left_out(module, DECIDING[module]), wanted))
    for module, said in zip(wanted, found, strict=True):
        print(f"{module}: {'not every' if said else 'every'} branch is run by its own tests\n{said}".rstrip())
        status = max(status, int(bool(said)))
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
