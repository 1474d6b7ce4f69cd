"""The command line as a user calls it, a simulated wheel on disk, and stations that play it."""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from station.cli import main
from tests.once import folder_once

CONFIGS = Path(__file__).parents[2] / "configs"
_channels = (f"end-to-end-{number}" for number in itertools.count())


@dataclass(frozen=True)
class Ended:
    """What a command left: exit status, standard output, standard error."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Truewheel = Callable[..., Ended]


@pytest.fixture
def truewheel(capfd: pytest.CaptureFixture[str]) -> Truewheel:
    def call(*arguments: object) -> Ended:
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        assert "Traceback" not in out + err
        code = ended.value.code
        return Ended(0 if code is None else int(code), out, err)

    return call


@folder_once
def simulated(folder: Path, what: str) -> None:
    """What `truewheel simulate` makes of these words."""
    with pytest.raises(SystemExit) as ended:
        main(["simulate", *what.split(), "--out", str(folder / "made")])
    assert ended.value.code in (0, None)


@pytest.fixture(scope="session")
def rendered_wheel() -> Path:
    return simulated("wheel --camber 1.2 --toe -0.4 --seed 5 --offset 3 -2 4 --spin 40") / "made"


@pytest.fixture
def wheel(rendered_wheel: Path, tmp_path: Path) -> Path:
    """A copy of the rendered wheel that a test may damage."""
    folder = tmp_path / "wheel"
    shutil.copytree(rendered_wheel, folder)
    return folder


@pytest.fixture
def configs(tmp_path: Path) -> Path:
    """A copy of the shipped configuration on a channel of its own."""
    folder = tmp_path / "configs"
    shutil.copytree(CONFIGS, folder)
    change(folder / "station.toml", 'channel = "truewheel"', f'channel = "{next(_channels)}"')
    return folder


@pytest.fixture
def replay(configs: Path, rendered_wheel: Path) -> Path:
    """Configuration of a station with one rig that plays the rendered wheel again and again."""
    path = configs / "station.toml"
    shutil.copytree(rendered_wheel, configs / "shots" / "001")
    head = path.read_text().split("[[rigs]]")[0]
    path.write_text(
        f"""{head}
[[rigs]]
name = "front_left"
calibration = "shots/001/calibration.json"
recorded = {{ shots = "shots", at_end = "repeat" }}
"""
    )
    return path


def change(path: Path, old: str, new: str) -> Path:
    """Replace the first occurrence of a text in a file."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path
