"""The program as it is installed: a wheel in an environment of its own, used in an empty folder."""

from __future__ import annotations

import os
import shutil
import signal
import site
import subprocess
import sys
import threading
import venv
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command `truewheel` of an environment that holds the wheel and what it depends on."""
    folder = tmp_path_factory.mktemp("installed")
    source = folder / "source"
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if tracked.returncode != 0:
        pytest.skip("no checkout: which files belong to the program is not known")
    for name in filter(None, tracked.stdout.decode().split("\0")):
        if not name.startswith("tests/") and (ROOT / name).exists():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, source / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    built = subprocess.run(
        [*pip, "wheel", "--no-deps", "--wheel-dir", folder, source],
        capture_output=True,
        text=True,
        check=False,
    )
    if built.returncode != 0 and "setuptools" in built.stderr:
        pytest.skip("no package index within reach, from which the build's setuptools could come")
    assert built.returncode == 0, built.stderr
    environment = folder / "environment"
    venv.create(environment, with_pip=False)
    packages = environment / "lib" / f"python3.{sys.version_info.minor}" / "site-packages"
    # The dependencies are those of this environment; the checkout is not among them.
    own = [path for path in [*site.getsitepackages(), *sys.path] if Path(path).name == "site-packages"]
    (packages / "dependencies.pth").write_text("\n".join(dict.fromkeys(own)) + "\n")
    [wheel] = folder.glob("*.whl")
    command = [*pip, "--python", environment / "bin" / "python", "install", "--no-deps", "--no-index", wheel]
    subprocess.run(command, check=True, capture_output=True)
    # What is compiled already need not be compiled again: the stamps are of contents, not of places.
    for cached in [*ROOT.glob("alignment/**/*.nb[ic]"), *ROOT.glob("sensors/**/*.nb[ic]")]:
        target = packages / cached.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(cached, target)
    return environment / "bin" / "truewheel"


def outside() -> dict[str, str]:
    """The environment without what leads back to the checkout."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


@contextmanager
def running(program: Path, folder: Path, *arguments: str) -> Iterator[Callable[[], str]]:
    """Run the program beside what follows; yields what waits for its end and returns what it printed."""
    command = [program, *arguments]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, cwd=folder, env=outside(), text=True, **streams) as process:

        def ended() -> str:
            out, err = process.communicate(timeout=280.0)
            assert process.returncode == 0, err
            return out

        try:
            yield ended
        finally:
            process.kill()


def run(program: Path, folder: Path, *arguments: str) -> str:
    with running(program, folder, *arguments) as ended:
        return ended()


def of_one_rig(station: Path) -> Path:
    """The configuration beside it of the same station with its first rig alone."""
    head, first, *_ = station.read_text(encoding="utf-8").split("[[rigs]]")
    path = station.with_name("one.toml")
    path.write_text(f"{head}[[rigs]]{first}", encoding="utf-8")
    return path


@pytest.mark.slow(32)
def test_first_hour_of_an_integrator_in_an_empty_folder(program: Path, tmp_path: Path) -> None:
    """The wheel carried no configurations: outside of a checkout these verbs ended with status 2."""
    assert "wrote" in run(program, tmp_path, "init", "home")
    assert "is sound" in run(program, tmp_path, "config", "check", "home/configs/station.toml")
    # The line's timeouts are waited for; the rest is done meanwhile.
    with running(program, tmp_path, "line", "check", "--simulated") as checked:
        assert "station" in run(program, tmp_path, "schema", "station")
        run(program, tmp_path, "simulate", "plate-session", "--seed", "3", "--views", "3", "--head", "head_1",
            "--out", "plate")  # fmt: skip
        assert (tmp_path / "plate" / "session.json").is_file()
        # One wheel is rendered as four are.
        config = of_one_rig(tmp_path / "home" / "configs" / "station.toml")
        demo = run(program, tmp_path, "demo", "--vehicles", "1", "--out", "demo", "--config", str(config))
        assert "in order" in demo
        assert (tmp_path / "demo" / "results.db").is_file()
        assert "44 of 44 points passed" in checked()
    assert "simulated  truewheel" in run(program, tmp_path, "camera", "list")
    run(program, tmp_path, "db", "migrate", "--database", "sqlite:///results.db")
    run(program, tmp_path, "report", "all", "--database", "sqlite:///results.db", "--out", "report.html")
    assert "Quality report" in (tmp_path / "report.html").read_text(encoding="utf-8")
    with zipfile.ZipFile(next(program.parents[2].glob("*.whl"))) as wheel:
        carried = set(wheel.namelist())
    assert {str(path.relative_to(ROOT)) for path in ROOT.glob("station/**/templates/*")} <= carried
    # Nothing was written beside the program.
    assert not list((program.parents[1]).rglob("*.db"))


def test_station_of_a_new_home_runs_until_it_is_told_to_end(program: Path, tmp_path: Path) -> None:
    run(program, tmp_path, "init", "home")
    home = tmp_path / "home"
    with subprocess.Popen(
        [program, "run"], cwd=home, env=outside(), stderr=subprocess.PIPE, text=True
    ) as station:
        assert station.stderr is not None
        bound = threading.Timer(240.0, station.kill)
        bound.start()
        try:
            said = ""
            for line in station.stderr:
                said += line
                if "is ready: 4 rigs" in line:
                    station.send_signal(signal.SIGTERM)
            assert station.wait() == 0, said
        finally:
            bound.cancel()
            bound.join()
            station.kill()
    assert "is ready" in said
    assert said.rstrip().endswith("stopped")
    assert (home / "truewheel.db").is_file()
