"""A station of two rigs, from the controller to the database, while one camera is lost and comes back."""

from __future__ import annotations

import itertools
import shutil
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import pytest

from alignment.errors import CameraConnectionError
from db.queries import ResultReader, events
from db.records import WheelOutcome
from sensors.formats import read_calibration_file
from station.configuration.settings import read_configuration
from station.cycle.words.cycle import ErrorCode, Outcome
from station.line.plc import PlcOrder, PlcSimulator, PlcTimeouts
from station.line.wire import BusSettings, open_bus
from station.running.composition import OpenStation, open_station
from tests.end_to_end.conftest import Truewheel
from tests.plugins import install
from tests.sensors import scripted
from tests.sensors.scripted import Device

RIGS = ("front_left", "rear_left")
BAD = "rear_left/head_2/right"
TIMEOUTS = PlcTimeouts(ready_s=60.0, busy_s=10.0, done_s=60.0, acknowledged_s=10.0, silence_s=10.0)
_modules = (f"scripted_driver_{number}" for number in itertools.count())
DRIVER = """
from sensors.drivers import CameraDriver, StrictModel
from tests.sensors.scripted import DEVICES

class Settings(StrictModel):
    pass

DRIVER = CameraDriver(Settings, lambda settings, place: DEVICES[place.name].make())
"""
TYPE = """
number = 1
name = "Any"
[axles.front]
camber = { lower_deg = -3.0, upper_deg = 3.0 }
toe = { lower_deg = -1.0, upper_deg = 1.0 }
[axles.rear]
camber = { lower_deg = -3.0, upper_deg = 3.0 }
toe = { lower_deg = -1.0, upper_deg = 1.0 }
"""


def device(rig: str, head: str, side: str, serial: int, folder: Path) -> Device:
    seen = cv2.imread(str(folder / f"{head}_{side}.png"), cv2.IMREAD_UNCHANGED)

    def image(number: int) -> Any:
        """Of this shot: two images of a real camera are never the same."""
        taken = seen.copy()
        taken[0, :8] = [number % 251, len(rig), *map(ord, rig[:6])]
        return taken

    found = Device(f"{rig}/{head}/{side}", serial=str(serial), image=image, clock=time.monotonic)
    found.rows = seen.shape[0]
    return found


@pytest.fixture
def devices(
    configs: Path, rendered_wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[dict[str, Device]]:
    """Cameras of two rigs that look at the rendered wheel, and the station that is configured for them."""
    serials = itertools.count(40123400)
    heads = [head.name for head in read_calibration_file(rendered_wheel / "calibration.json").heads]
    made = [
        device(rig, head, side, next(serials), rendered_wheel)
        for rig in RIGS
        for head in heads
        for side in ("left", "right")
    ]
    found = {one.name: one for one in made}
    monkeypatch.setattr(scripted, "DEVICES", found)
    module = next(_modules)
    install(tmp_path / "packages", "scripted", {"scripted": f"{module}:DRIVER"}, {module: DRIVER})
    monkeypatch.syspath_prepend(str(tmp_path / "packages"))
    text = (configs / "station.toml").read_text().split("[[rigs]]")[0]
    for rig in RIGS:
        known = (rendered_wheel / "calibration.json").read_text().replace("front_left", rig)
        (configs / f"{rig}.json").write_text(known)
        text += f'[[rigs]]\nname = "{rig}"\ncalibration = "{rig}.json"\nscripted = {{}}\n'
    (configs / "station.toml").write_text(text)
    shutil.rmtree(configs / "vehicles")
    (configs / "vehicles").mkdir()
    (configs / "vehicles" / "any.toml").write_text(TYPE)
    yield found
    for one in made:
        one.go_on.set()


@contextmanager
def running(config: Path) -> Iterator[tuple[OpenStation, PlcSimulator]]:
    """A station that serves, and its controller."""
    configuration = read_configuration(config)
    line, stopping = configuration.settings.line, threading.Event()
    with open_station(configuration) as station, ThreadPoolExecutor(1, "station") as pool:
        served = pool.submit(station.cycle.serve, stopping)
        with (
            open_bus(BusSettings(line.interface, line.channel, line.bitrate)) as bus,
            PlcSimulator(bus, station.line_database, time.monotonic, TIMEOUTS) as plc,
        ):
            plc.start_up()
            yield station, plc
        stopping.set()
        served.result()


def measured(plc: PlcSimulator, number: int) -> dict[str, Outcome]:
    result = plc.run(PlcOrder(f"TWDEMX{number:011d}", 1, RIGS))
    assert {answer.wheel for answer in result.wheels} >= set(RIGS)
    return {answer.wheel: answer.outcome for answer in result.wheels if answer.wheel in RIGS}


@pytest.mark.slow
def test_lost_camera_costs_its_wheel_and_comes_back_at_the_reset_the_others_go_on(
    devices: dict[str, Device], configs: Path
) -> None:
    good = dict.fromkeys(RIGS, Outcome.OK)
    bad = devices[BAD]
    with running(configs / "station.toml") as (station, plc):
        assert measured(plc, 1) == good
        bad.once["fetch"] = CameraConnectionError(BAD, "the connection broke")
        bad.plugged = False
        assert measured(plc, 2) == good | {"rear_left": Outcome.FAULT}
        [record] = [stored.record for stored in station.store.recent_cycles(1)]
        status = plc.view.wait("fault", 10.0, lambda status: status.fault)
        assert status.error_code is ErrorCode.CAMERA_FAULT
        bad.plugged = True
        plc.reset()
        assert measured(plc, 3) == good
    states = {wheel.wheel: wheel for wheel in record.wheels}
    assert states["front_left"].outcome is WheelOutcome.MEASURED
    where = f"wheel rear left, head 2, right camera, serial {bad.serial}"
    assert where in str(states["rear_left"].reason_text)
    assert [one.opened for one in devices.values() if one.name.startswith("front")] == [1] * 6


@pytest.mark.slow
def test_loose_plug_amid_a_shot_costs_nothing_but_the_time_of_another_and_is_remembered(
    devices: dict[str, Device], configs: Path, truewheel: Truewheel
) -> None:
    bad = devices[BAD]
    bad.temperature_c = 41.5
    with running(configs / "station.toml") as (_, plc):
        assert measured(plc, 1) == dict.fromkeys(RIGS, Outcome.OK)
        bad.once["fetch"] = CameraConnectionError(BAD, "the connection broke")
        assert measured(plc, 2) == dict.fromkeys(RIGS, Outcome.OK)
        database = read_configuration(configs / "station.toml").database_url
    assert bad.opened == 2
    with ResultReader(database) as reader:
        [event] = events(reader, codes=("shot_retaken",))
    assert f"serial {bad.serial}" in event.text
    said = truewheel("camera", "health", "--database", database, "--camera", BAD, "--json").json
    trends = {one["figure"]: one for one in said["trends"]}
    assert trends["temperature_c"]["newest"] == 41.5
    assert trends["failures"]["maximum"] == 1.0
    assert 0.5 < trends["line_width_px"]["first"] < 10.0
    assert trends["line_strength"]["shots"] == 2
    assert trends["row_px"]["newest"] < 0.1
    bad.serial = "77"
    with running(configs / "station.toml") as (_, plc):
        assert measured(plc, 3)["rear_left"] is Outcome.FAULT, "exchanged while the station was off"
