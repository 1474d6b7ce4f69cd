"""A station whose 24 Basler cameras are emulated, configured as its page says: from PLC to database."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine, text

from alignment.errors import SeveralErrors
from sensors.drivers.pylon.library import EMULATED_CAMERAS
from station.configuration import read_configuration
from station.line.tools.cable import Cable
from station.running.cameras import open_rig
from tests.documents import snippets
from tests.end_to_end.conftest import CONFIGS, Truewheel, change, simulated

pytest.importorskip("pypylon.pylon", reason="pypylon is not installed: pip install 'truewheel[pylon]'")

PAGE = "docs/how-to/basler-cameras.md"
EMULATED, LINE, ACTION = snippets(PAGE, "toml")
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
OWN = {"cycle_id", "measured_utc", "duration_s", "device_time_s"}
"""What two measurements of the same images differ in; the emulation has no clock."""
WAIT_S = 240.0


def rigs_of(snippet: str, number: int, folder: Path) -> str:
    """The page's rig as that of another wheel, with cameras of its own."""
    wheel = WHEELS[number]
    found = snippet.replace("front_left", wheel).replace("../out/shots/001", str(folder / wheel / "001"))
    found = found.replace("../out/shots", str(folder / wheel))
    for camera in reversed(range(6)):
        found = found.replace(f"0815-{camera:04d}", f"0815-{6 * number + camera:04d}")
    return found


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded shot of each wheel, with its calibration beside its images."""
    folder = tmp_path_factory.mktemp("shots")
    made = simulated("vehicle --seed 3 --yaw-deg 0.4 --offset-mm -15.0") / "made"
    for wheel in WHEELS:
        [shot] = (path.parent for path in (made / wheel).rglob("shot.json"))
        shutil.copytree(shot, folder / wheel / "001")
        [calibration] = (made / wheel).rglob("calibration.json")
        shutil.copyfile(calibration, folder / wheel / "001" / "calibration.json")
    return folder


def stored(configs: Path, rigs: str, truewheel: Truewheel) -> tuple[str, list[dict[str, Any]]]:
    """What a station with these rigs stores of one vehicle that the PLC asks for, and the outcome."""
    config = configs / "station.toml"
    config.write_text(config.read_text().split("[[rigs]]")[0] + rigs)
    environment = {name: value for name, value in os.environ.items() if name != EMULATED_CAMERAS}
    with Cable() as cable:
        change(config, 'interface = "virtual"', 'interface = "slcan"')
        channel = next(one for one in config.read_text().splitlines() if one.startswith("channel"))
        change(config, channel, f'channel = "{cable.ends[0]}"\noptions = {{ sleep_after_open = 0.0 }}')
        command = [sys.executable, "-m", "station.cli", "run", "--config", str(config)]
        with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            timer = threading.Timer(WAIT_S, process.kill)
            timer.start()
            try:
                said: list[str] = []
                for line in process.stderr:
                    said.append(line)
                    if "is ready" in line:
                        break
                assert "is ready" in said[-1], said
                order = ("--vin", "WVWZZZ1KZAW123456", "--json", "--config", CONFIGS / "station.toml")
                ended = truewheel("line", "plc", *order, "--interface", "slcan", "--channel", cable.ends[1])
                process.send_signal(signal.SIGTERM)
                rest = process.stderr.read()
                assert process.wait(WAIT_S) == 0, rest
            finally:
                timer.cancel()
                process.kill()
    with create_engine(f"sqlite:///{configs.parent / 'truewheel.db'}").connect() as database:
        rows = database.execute(text("SELECT * FROM wheel_results ORDER BY wheel")).mappings().all()
    return ended.json["vehicles"][0]["outcome"], [dict(row) for row in rows]


@pytest.mark.slow(10)
def test_a_station_of_emulated_cameras_stores_bit_for_bit_what_one_of_recorded_shots_does(
    configs: Path, shots: Path, truewheel: Truewheel, tmp_path: Path
) -> None:
    emulated = "".join(rigs_of(EMULATED, number, shots) for number in range(len(WHEELS)))
    assert "0815-0023" in emulated
    other = tmp_path / "other" / "configs"
    shutil.copytree(configs, other)
    outcome, found = stored(configs, emulated, truewheel)
    told, known = stored(
        other,
        "".join(
            f'[[rigs]]\nname = "{wheel}"\ncalibration = "{shots / wheel}/001/calibration.json"\n'
            f'recorded = {{ shots = "{shots / wheel}", at_end = "repeat" }}\n'
            for wheel in WHEELS
        ),
        truewheel,
    )
    assert outcome == told
    assert outcome in ("ok", "nok")
    assert len(found) == len(known) == len(WHEELS)

    for mine, theirs in zip(found, known, strict=True):
        assert {name for name in mine if mine[name] != theirs[name]} <= OWN


@pytest.mark.parametrize("snippet", [LINE, ACTION])
def test_the_page_s_real_cameras_are_understood_and_are_missed_where_there_are_none(
    configs: Path, rendered_wheel: Path, truewheel: Truewheel, snippet: str
) -> None:
    shutil.copyfile(rendered_wheel / "calibration.json", configs / "front_left.json")
    path = configs / "station.toml"
    head = path.read_text().split("[[rigs]]")[0]
    cameras = head.index("[cameras]"), head.index("[measure]")
    path.write_text((head[: cameras[0]] + head[cameras[1] :] if "[cameras]" in snippet else head) + snippet)
    assert truewheel("config", "check", path).status == 0
    rig, _ = open_rig(read_configuration(path), 0)
    assert [camera.leads for camera in rig.cameras] == [True] + [False] * 5  # type: ignore[attr-defined]
    # No search for it leaves this computer.
    change(path, 'transport = "GigE"', 'transport = "emulation"')
    rig, _ = open_rig(read_configuration(path), 0)
    with pytest.raises(SeveralErrors, match="6 of 6 cameras did not connect") as caught:
        rig.connect()
    assert "expected a camera '40012345', pylon sees 0815-0000" in str(caught.value)
    change(path, "head_3", "head_4")
    ended = truewheel("config", "check", path)
    assert ended.status == 2
    assert "field 'rigs[0].pylon.cameras': expected two cameras for each head of the calibration" in ended.err
