"""Bad input gets one clear sentence naming file and field, exit status 2, and no traceback."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import station.line.plc
from sensors.formats import read_image, write_image
from station.line.plc.orders import PlcResult
from station.line.plc.simulator import run_plc
from station.line.tools.cable import Cable
from tests.end_to_end.conftest import CONFIGS, Truewheel, change

Damage = Callable[[Path], None]


def missing(path: Path) -> None:
    path.unlink()


def smaller(path: Path) -> None:
    image = read_image(path)
    path.unlink()
    write_image(path, image[:-2, :-3])


def coloured(path: Path) -> None:
    grey = np.asarray(Image.open(path))
    Image.fromarray(np.dstack([grey, grey, grey])).save(path)


def truncated(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


@pytest.mark.parametrize("damage", [missing, smaller, coloured, truncated])
def test_damaged_image_is_named(truewheel: Truewheel, wheel: Path, damage: Damage) -> None:
    damage(wheel / "head_2_right.png")
    ended = truewheel("measure", wheel, "--calibration", wheel / "calibration.json", "--json")
    assert (ended.status, ended.out) == (2, "")
    assert "head_2" in ended.err
    assert ended.err.count("\n") == 1


@pytest.mark.parametrize(
    ("file", "old", "new", "field"),
    [
        ("shot.json", '"exposure_ms"', '"exposur_ms"', "exposur_ms"),
        ("shot.json", '"exposure_ms": 5.0', '"exposure_ms": -5.0', "exposure_ms"),
        ("shot.json", '"rig": "front_left"', '"rig": "rear_left"', "rig"),
        ("shot.json", "{", "{{", "line"),
        ("shot.json", "truewheel.shot/1", "truewheel.shot/9", "schema"),
        ("calibration.json", '"skew"', '"skeww"', "skew"),
        ("calibration.json", '"width": 1280', '"width": -1280', "heads[0].left.width"),
        ("calibration.json", '"width": 1280', '"width": 1281', "1281"),
    ],
)
def test_wrong_field_of_a_recorded_file_is_named(
    truewheel: Truewheel, wheel: Path, file: str, old: str, new: str, field: str
) -> None:
    change(wheel / file, old, new)
    ended = truewheel("measure", wheel, "--calibration", wheel / "calibration.json")
    assert (ended.status, ended.out) == (2, "")
    assert field in ended.err
    assert str(wheel) in ended.err
    assert ended.err.count("\n") == 1


def test_calibration_of_another_rig_is_named(truewheel: Truewheel, wheel: Path) -> None:
    text = (wheel / "calibration.json").read_text().replace('"front_left"', '"rear_left"')
    (wheel / "calibration.json").write_text(text)
    ended = truewheel("measure", wheel, "--calibration", wheel / "calibration.json")
    assert ended.status == 2
    assert "'front_left'" in ended.err
    assert "'rear_left'" in ended.err


@pytest.mark.parametrize("missing_name", ["shot", "calibration"])
def test_missing_file_is_named(truewheel: Truewheel, wheel: Path, missing_name: str) -> None:
    shot = wheel.parent / "none" if missing_name == "shot" else wheel
    calibration = wheel / ("none.json" if missing_name == "calibration" else "calibration.json")
    ended = truewheel("measure", shot, "--calibration", calibration)
    assert ended.status == 2
    assert "none" in ended.err


@pytest.mark.parametrize(
    ("file", "old", "new", "field"),
    [
        ("station.toml", "bitrate", "bit_rate", "line.bit_rate"),
        ("station.toml", "coverage_factor = 2.0", "coverage_factor = 20.0", "measure.coverage_factor"),
        ("vehicles/van.toml", "guard_band", "guardband", "guardband"),
        (
            "vehicles/van.toml",
            "tolerance_deg = 0.75",
            "tolerance_deg = 75",
            "axles.front.camber.tolerance_deg",
        ),
        ("line.dbc", "WheelResultRearLeft", "WheelAnswerRearLeft", "WheelResultRearLeft"),
        ("line.dbc", "BO_ 288 Status: 8", "BO_ 288 Status: eight", "line.dbc"),
        ("line.dbc", 'Time" BO_ 288 100;', 'Time" BO_ 288 "x";', 'a number, found "x"'),
    ],
)
@pytest.mark.parametrize("command", ["run", "demo"])
def test_wrong_configuration_is_named(
    truewheel: Truewheel, configs: Path, command: str, file: str, old: str, new: str, field: str
) -> None:
    path = configs / file
    path.write_text(path.read_text().replace(old, new))
    out = ["--out", configs / "out"] if command == "demo" else []
    ended = truewheel(command, "--config", configs / "station.toml", *out)
    assert (ended.status, ended.out) == (2, "")
    assert field in ended.err
    assert str(path) in ended.err


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("tire = 'sport'", "tire"),
        ("[optics]\nblur_px = 50", "optics.blur_px"),
        ("[pattern]\nedge_mm = 19", "pattern"),
    ],
)
def test_wrong_simulation_file_is_named(truewheel: Truewheel, tmp_path: Path, text: str, field: str) -> None:
    path = tmp_path / "simulation.toml"
    path.write_text(text)
    arguments = f"simulate wheel --camber 0 --toe 0 --seed 1 --out {tmp_path / 'out'} --config {path}"
    ended = truewheel(*arguments.split())
    assert ended.status == 2
    assert field in ended.err
    assert str(path) in ended.err
    assert not (tmp_path / "out").exists()


def test_nothing_recorded_is_ever_replaced(truewheel: Truewheel, wheel: Path) -> None:
    before = (wheel / "shot.json").read_bytes()
    arguments = f"simulate wheel --camber 0 --toe 0 --seed 1 --out {wheel}"
    ended = truewheel(*arguments.split())
    assert ended.status == 2
    assert str(wheel) in ended.err
    assert (wheel / "shot.json").read_bytes() == before


@pytest.mark.parametrize(
    "arguments",
    [
        "simulate wheel --camber 30 --toe 0 --seed 1 --out x",
        "simulate wheel --camber 0 --toe 0 --seed 1 --out x --offset 900 0 0",
        "simulate wheel --toe 0 --seed 1 --out x",
        "simulate wheel --camber 0 --toe 0 --seed 1 --out x --load-mm 300",
        "simulate wheel --camber 0 --toe 0 --seed 1 --out x --load-shape square",
        "simulate wheel --camber 0 --toe 0 --seed 1 --out x --turns -1",
        "simulate vehicle --out x",
        "simulate vehicle --seed 1 --out x --yaw-deg 45",
        "simulate vehicle --seed 1 --out x --offset-mm nan",
        "demo --vehicles 0",
        "measure",
        "schema poem",
        "fly",
    ],
)
def test_wrong_usage_ends_with_2(truewheel: Truewheel, arguments: str) -> None:
    ended = truewheel(*arguments.split())
    assert (ended.status, ended.out) == (2, "")
    assert ended.err


def test_database_of_a_newer_schema_is_refused(truewheel: Truewheel, replay: Path, tmp_path: Path) -> None:
    file = tmp_path / "newer.sqlite"
    assert truewheel("db", "migrate", "--database", f"sqlite:///{file}", "--json").json["revision"]
    with sqlite3.connect(file) as connection:
        connection.execute("UPDATE alembic_version SET version_num = 'zzzz'")
    connection.close()
    change(replay, "sqlite:///../truewheel.db", f"sqlite:///{file}")
    ended = truewheel("run", "--config", replay)
    assert ended.status == 2
    assert "newer" in ended.err
    assert str(file) in ended.err


@pytest.mark.parametrize("url", ["nonsense", "mysql://host/x", "sqlite:///:memory:"])
def test_wrong_database_url_is_refused(truewheel: Truewheel, url: str) -> None:
    ended = truewheel("db", "migrate", "--database", url)
    assert ended.status == 2
    assert "database URL" in ended.err


def test_calibration_of_another_wheel_is_refused_by_the_station(truewheel: Truewheel, replay: Path) -> None:
    change(replay, 'name = "front_left"', 'name = "rear_right"')
    ended = truewheel("run", "--config", replay)
    assert ended.status == 2
    assert "rigs[0].calibration" in ended.err
    assert "'rear_right'" in ended.err


def test_folder_without_recorded_shots_is_refused(truewheel: Truewheel, replay: Path) -> None:
    change(replay, 'shots = "shots"', 'shots = "vehicles"')
    ended = truewheel("run", "--config", replay)
    assert ended.status == 2
    assert "rigs[0].recorded.shots" in ended.err


def test_everything_that_keeps_a_station_from_starting_is_told_together(
    truewheel: Truewheel, replay: Path
) -> None:
    change(replay, "create = true", "create = false")
    change(replay, 'interface = "virtual"', 'interface = "carrier_pigeon"')
    (replay.parent / "shots" / "001" / "head_3_left.png").unlink()
    ended = truewheel("run", "--config", replay)
    assert ended.status == 3
    for part in ("carrier_pigeon", "truewheel.db", "head_3_left"):
        assert part in ended.err


def test_demonstration_needs_simulated_rigs(truewheel: Truewheel, replay: Path, tmp_path: Path) -> None:
    ended = truewheel("demo", "--config", replay, "--out", tmp_path / "out")
    assert ended.status == 2
    assert "rigs[0].simulated" in ended.err


@pytest.mark.slow
def test_damaged_log_and_silent_line_are_named(
    truewheel: Truewheel, configs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = configs / "station.toml"
    log = tmp_path / "can.log"
    log.write_text("not a log\n")
    ended = truewheel("line", "monitor", log, "--config", config)
    assert ended.status == 2
    assert str(log) in ended.err
    assert truewheel("line", "monitor", tmp_path / "none.log", "--config", config).status == 2

    # As the command does, but not for ten seconds.
    def briefly(*given: Any) -> Iterator[PlcResult]:
        return run_plc(*given[:3], replace(given[3], connect_s=0.3))

    monkeypatch.setattr(station.line.plc, "run_plc", briefly)
    with Cable() as cable:
        silent = ("--interface", "slcan", "--channel", cable.ends[0], "--config", config)
        ended = truewheel("line", "plc", "--vin", "TWDEMX00000000001", *silent)
    assert ended.status == 3
    assert "within 0.3 s" in ended.err


def test_truth_is_never_read_by_the_measurement(truewheel: Truewheel, wheel: Path) -> None:
    (wheel / "truth.json").write_text("{")
    ended = truewheel("measure", wheel, "--calibration", wheel / "calibration.json", "--json")
    assert ended.status == 0
    assert json.loads(ended.out)["outcome"] == "measured"


def test_shipped_configuration_is_found_beside_the_program(
    truewheel: Truewheel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert (CONFIGS / "station.toml").is_file()
    with Cable() as cable:
        bus = ("--interface", "slcan", "--channel", cable.ends[0])
        ended = truewheel("line", "monitor", "--seconds", "0.1", "--json", *bus)
    assert (ended.status, ended.json) == (0, {"frames": [], "errors": 0})
