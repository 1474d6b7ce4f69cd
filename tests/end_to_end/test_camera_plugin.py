"""The driver of docs/how-to/add-a-camera.md, word for word: its contract, and a station that runs with it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from sqlalchemy import create_engine, text

from sensors.formats import write_image
from station.line.tools.cable import Cable
from tests.documents import snippets
from tests.end_to_end.conftest import CONFIGS, Truewheel, change
from tests.plugins import GROUP, install

PAGE = "docs/how-to/add-a-camera.md"
DRIVER, CONTRACT = snippets(PAGE, "python")
PACKAGE, STATION = map(tomllib.loads, snippets(PAGE, "toml"))
[NAME] = PACKAGE["tool"]["setuptools"]["py-modules"]
HEADS = ("head_1", "head_2", "head_3")
WAIT_S = 120.0


def installed(folder: Path) -> Path:
    project = PACKAGE["project"]
    return install(
        folder, project["name"], project["entry-points"][GROUP], {NAME: DRIVER}, project["version"]
    )


@contextmanager
def driver_loaded() -> Iterator[None]:
    """Let the driver be a module that can be imported."""
    module = sys.modules[NAME] = ModuleType(NAME)
    try:
        exec(compile(DRIVER, f"{PAGE}: {NAME}", "exec"), module.__dict__)
        yield
    finally:
        sys.modules.pop(NAME, None)


@pytest.fixture(autouse=True)
def frames_of_the_contract(tmp_path: Path) -> None:
    """What the camera sees in the contract."""
    for number in range(1, 5):
        write_image(tmp_path / f"frame_{number:03d}.png", np.full((30, 40), 10 * number, np.uint8))


@pytest.fixture(autouse=True)
def module_unloaded() -> Iterator[None]:
    yield
    sys.modules.pop(NAME, None)


@pytest.fixture
def configured(configs: Path, rendered_wheel: Path) -> Path:
    """The page's rig in a station, its devices exchanged for files."""
    path = configs / "station.toml"
    shutil.copyfile(rendered_wheel / "calibration.json", configs / "front_left.json")
    head = path.read_text().split("[[rigs]]")[0]
    rig = snippets(PAGE, "toml")[1]
    for number, (name, side) in enumerate((name, side) for name in HEADS for side in ("left", "right")):
        shutil.copyfile(rendered_wheel / f"{name}_{side}.png", configs / f"{name}_{side}_001.png")
        rig = rig.replace(f"/dev/video{number}", str(configs / f"{name}_{side}_%03d.png"))
    assert "/dev/video" not in rig
    path.write_text(f"{head}\n{rig}")
    return path


@pytest.mark.slow
def test_a_station_measures_a_vehicle_with_a_driver_that_was_installed_beside_it(
    configured: Path, tmp_path: Path, truewheel: Truewheel
) -> None:
    environment = os.environ | {"PYTHONPATH": str(installed(tmp_path / "packages"))}
    with Cable() as cable:
        change(configured, 'interface = "virtual"', 'interface = "slcan"')
        channel = next(one for one in configured.read_text().splitlines() if one.startswith("channel"))
        change(configured, channel, f'channel = "{cable.ends[0]}"\noptions = {{ sleep_after_open = 0.0 }}')
        command = [sys.executable, "-m", "station.cli", "run", "--config", str(configured)]
        with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            timer = threading.Timer(WAIT_S, process.kill)
            timer.start()
            try:
                said = []
                for line in process.stderr:
                    said.append(line)
                    if "is ready" in line:
                        break
                assert "is ready" in said[-1], said
                order = ("--vin", "WVWZZZ1KZAW123456", "--wheel", "front_left", "--json")
                bus = ("--interface", "slcan", "--channel", cable.ends[1])
                ended = truewheel("line", "plc", *order, *bus, "--config", CONFIGS / "station.toml")
                assert ended.json["vehicles"][0]["outcome"] in ("ok", "nok"), ended
                process.send_signal(signal.SIGTERM)
                rest = process.stderr.read()
                assert process.wait(WAIT_S) == 0, rest
            finally:
                timer.cancel()
                process.kill()
    with create_engine(f"sqlite:///{configured.parents[1] / 'truewheel.db'}").connect() as database:
        described = database.execute(text("SELECT configuration FROM station_versions")).scalar_one()
        [(camber,)] = database.execute(text("SELECT camber FROM wheel_results")).all()
    assert "truewheel_usb:DRIVER of truewheel-usb 1.0" in str(described)
    assert camber == pytest.approx(np.radians(1.2), abs=np.radians(0.05))


def test_the_page_s_commands_see_the_driver(
    configured: Path, tmp_path: Path, truewheel: Truewheel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(installed(tmp_path / "packages")))
    assert "usb        truewheel-usb  1.0" in truewheel("camera", "list").out
    assert truewheel("config", "check", configured).status == 0
    properties = truewheel("schema", "station").json["$defs"]["RigSettings"]["properties"]
    own = {"name", "calibration", "heads", "projector"}
    assert set(properties) == own | {"genicam", "pylon", "recorded", "simulated", "usb"}
    change(configured, "head_3 = [", "head_4 = [")
    ended = truewheel("config", "check", configured)
    assert ended.status == 2
    assert f"{configured}, field 'rigs[0].usb.sources': expected two cameras for each head" in ended.err


def contract() -> Any:
    """The page's class of tests, for the driver that stands there."""
    space: dict[str, Any] = {"__name__": __name__}
    with driver_loaded():
        exec(compile(CONTRACT, f"{PAGE}: contract", "exec"), space)
    return space["TestUsbCamera"]


TestUsbCamera = contract()
