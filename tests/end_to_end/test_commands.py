from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from db.store import ResultStore
from sensors.formats import TyreLoad, read_image, read_truth, write_image
from station.cli import exit_status
from station.configuration.settings import read_configuration
from station.cycle.words.cycle import Outcome
from station.line.plc.orders import PlcOrder, PlcTimeouts
from station.line.plc.simulator import run_plc
from station.line.tools.monitor import decode_log, trace_cycles
from station.line.wire.bus import open_bus
from station.line.wire.channel import BusSettings
from station.line.wire.dbc import load_line_database
from station.running.app import run_station
from tests.assertions import assert_angle_within
from tests.end_to_end.conftest import CONFIGS, Truewheel, change

KEYS = {
    "outcome",
    "reason",
    "camber_deg",
    "toe_deg",
    "camber_u95_deg",
    "toe_u95_deg",
    "camber_unseen_deg",
    "toe_unseen_deg",
    "plane",
    "points_used",
    "residual_rms_mm",
    "duration_ms",
    "calibration_id",
}
PATIENT = PlcTimeouts(ready_s=30.0, busy_s=30.0, done_s=60.0, acknowledged_s=30.0, silence_s=30.0)


def test_measure_prints_one_object_with_the_promised_keys(truewheel: Truewheel, wheel: Path) -> None:
    ended = truewheel("measure", wheel, "--calibration", wheel / "calibration.json", "--json")
    assert ended.status == 0
    result = ended.json
    assert set(result) >= KEYS
    assert (result["outcome"], result["reason"]) == ("measured", None)
    assert_angle_within(math.radians(result["camber_deg"]), math.radians(1.2), 0.1, "camber")
    assert_angle_within(math.radians(result["toe_deg"]), math.radians(-0.4), 0.1, "toe")
    assert np.linalg.norm(result["plane"]["normal"]) == pytest.approx(1.0)
    assert result["calibration_id"] == json.loads((wheel / "calibration.json").read_text())["id"]


def test_measure_takes_settings_from_a_station_and_prints_for_people(
    truewheel: Truewheel, wheel: Path
) -> None:
    arguments = ("measure", wheel, "--calibration", wheel / "calibration.json")
    ended = truewheel(*arguments, "--config", CONFIGS / "station.toml")
    assert ended.status == 0
    assert "camber +1.2" in ended.out
    assert "± holds as calibrated; a camera or head that moved since and shows in no image" in ended.out


def test_refused_wheel_prints_its_reason_and_ends_with_1(truewheel: Truewheel, wheel: Path) -> None:
    path = wheel / "head_1_left.png"
    dark = np.zeros_like(read_image(path))
    path.unlink()
    write_image(path, dark)
    arguments = ("measure", wheel, "--calibration", wheel / "calibration.json")
    ended = truewheel(*arguments, "--json")
    assert ended.status == 1
    assert set(ended.json) >= KEYS
    assert ended.json["outcome"] == "refused"
    assert "head_1" in ended.json["reason"]
    for key in ("camber_deg", "toe_deg", "camber_u95_deg", "toe_u95_deg", "camber_unseen_deg", "plane"):
        assert ended.json[key] is None
    assert "refused" in truewheel(*arguments).out


def test_truth_of_a_simulated_wheel_is_what_was_asked(rendered_wheel: Path) -> None:
    truth = read_truth(rendered_wheel / "truth.json")
    assert truth.camber_deg == pytest.approx(1.2)
    assert truth.spin_toe_deg == pytest.approx(-0.4)
    assert truth.spin_angle_deg == pytest.approx(40.0)
    assert truth.centre_mm == (3.0, -2.0, 4.0)


def test_right_wheel_with_run_out_differs_between_tyre_plane_and_spin_axis(
    truewheel: Truewheel, tmp_path: Path
) -> None:
    (tmp_path / "small.toml").write_text('rig = "ccir"\ntyre = "sport"\n[pattern]\ncolumns = 15\n')
    arguments = (
        "simulate wheel --camber -1 --toe 0.5 --seed 8 --side right --runout 0.3 --runout-phase 20"
        f" --config {tmp_path / 'small.toml'} --out {tmp_path / 'right'} --json"
    )
    ended = truewheel(*arguments.split())
    assert ended.status == 0
    assert ended.json["spin_camber_deg"] == pytest.approx(-1.0)
    assert math.hypot(ended.json["camber_deg"] + 1.0, ended.json["toe_deg"] - 0.5) == pytest.approx(0.3, 1e-3)
    calibration = json.loads((tmp_path / "right" / "calibration.json").read_text())
    assert (calibration["rig"], calibration["side"]) == ("front_right", "right")
    assert calibration["id"] == ended.json["calibration_id"]
    assert read_image(tmp_path / "right" / "head_1_left.png").shape == (582, 752)


def test_a_loaded_wheel_tells_its_load_in_the_truth(truewheel: Truewheel, tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text('rig = "ccir"\ntyre = "low_profile"\n')
    loaded = "--load-mm 6 --load-width-deg 20 --load-shape wave --side-force-mm -2"
    arguments = (
        f"simulate wheel --camber -1 --toe 0.5 --seed 8 {loaded} --config {tmp_path / 'small.toml'}"
        f" --out {tmp_path / 'wheel'} --json"
    )
    ended = truewheel(*arguments.split())
    assert ended.status == 0
    load = TyreLoad(6.0, 20.0, "wave", side_mm=-2.0, side_width_deg=40.0)
    assert ended.json["load"] == asdict(load)
    assert read_truth(tmp_path / "wheel" / "truth.json").load == load


@pytest.mark.parametrize("name", ["shot", "calibration", "truth", "station", "vehicle-type", "simulation"])
def test_schema_of_every_file_is_printed(truewheel: Truewheel, name: str) -> None:
    ended = truewheel("schema", name)
    assert ended.status == 0
    assert ended.json["additionalProperties"] is False


def test_help_and_version_load_nothing_heavy(truewheel: Truewheel) -> None:
    assert "measure" in truewheel("--help").out
    assert truewheel("--version").out.count(".") >= 2
    heavy = "{'open3d', 'numba', 'cv2', 'matplotlib', 'scipy', 'sqlalchemy', 'can', 'rich.progress'}"
    code = f"import sys, station.cli; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_station_plays_recorded_shots_to_a_controller(replay: Path) -> None:
    change(replay, 'dbc = "line.dbc"', 'dbc = "line.dbc"\nlog = "can.log"')
    # Nearer limits: the wheel has 1.2 degrees of camber.
    change(
        replay.parent / "vehicles" / "compact.toml",
        "nominal_deg = -0.5, tolerance_deg = 0.5",
        "nominal_deg = 1.2, tolerance_deg = 0.1",
    )
    configuration = read_configuration(replay)
    line = configuration.settings.line
    settings = BusSettings(channel=line.channel)
    stopping = threading.Event()
    orders = [PlcOrder(f"TWDEMX0000000000{n}", 1, ("front_left",)) for n in (1, 2)]
    with ThreadPoolExecutor(1) as pool, open_bus(settings) as listener:
        heard = threading.Event()
        listener.listen(lambda frame: heard.set())
        served = pool.submit(run_station, replay, stopping)
        try:
            assert heard.wait(60.0)
            results = list(run_plc(settings, replay.parent / line.dbc, orders, PATIENT))
        finally:
            stopping.set()
        served.result(60.0)
    assert [result.vehicle.outcome for result in results] == [Outcome.NOK, Outcome.NOK]
    answer = results[0].wheels[0]
    assert answer.camber_deg == pytest.approx(1.2, abs=0.1 / 60)
    assert answer.toe_deg == pytest.approx(-0.4, abs=0.1 / 60)
    assert {other.outcome for other in results[0].wheels[1:]} == {Outcome.NOT_REQUESTED}
    traces = trace_cycles(decode_log(replay.parent / "can.log", load_line_database(replay.parent / line.dbc)))
    assert [trace.in_order for trace in traces] == [True, True]
    with ResultStore(configuration.database_url) as store:
        counts = store.counts()
        assert (counts["vehicles"], counts["cycles"], counts["wheel_results"]) == (2, 2, 2)
        stored = store.wheel_results(orders[0].vin)
        assert stored[0].wheel.camber == pytest.approx(math.radians(answer.camber_deg or 0), abs=1e-5)
        assert store.recent_cycles(1)[0].record.config_hash == configuration.hash


@contextmanager
def ending(process: subprocess.Popen[str]) -> Iterator[None]:
    """Kill what a failed test leaves running, which would be waited for."""
    try:
        yield
    except BaseException:
        process.kill()
        raise


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_station_ends_cleanly_when_told_by_a_signal(replay: Path, number: signal.Signals) -> None:
    # Whoever runs the tests may have it ignored, as `nohup` does, and a station leaves it so.
    default = f"signal.signal({int(number)}, signal.SIG_DFL)"
    run = f"import signal, sys; {default}; from station.cli import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", run, "run", "--config", str(replay)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as station, ending(station):
        assert station.stderr is not None
        lines = []
        for line in station.stderr:
            lines.append(line)
            if "is ready" in line:
                break
        assert lines
        assert "is ready" in lines[-1], "".join(lines)
        station.send_signal(number)
        rest = station.communicate(timeout=60)[1]
    assert station.returncode == 0
    assert "stopped" in rest


def test_one_fault_among_mistakes_is_a_fault() -> None:
    from alignment.errors import CameraError, ConfigurationError, SeveralErrors

    mistake = ConfigurationError(expected="this", seen="that")
    fault = CameraError("left", "no answer")
    assert exit_status(mistake) == 2
    assert exit_status(SeveralErrors("x", [mistake, mistake])) == 2
    assert exit_status(SeveralErrors("x", [mistake, fault])) == 3
