"""One vehicle through everything: controller, cameras, mathematics, database, answer."""

from __future__ import annotations

import shutil
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest

from db.store import ResultStore
from station.configuration.settings import read_configuration
from station.configuration.vehicle_types import read_vehicle_types
from station.line.tools.monitor import decode_log, trace_cycles
from station.line.wire.dbc import load_line_database
from station.rehearsal.demo import demo_configuration, vehicle_poses
from tests.end_to_end.conftest import CONFIGS, Truewheel

WHEELS = ["front_left", "front_right", "rear_left", "rear_right"]


@pytest.mark.slow(14)
def test_one_vehicle_from_trigger_to_committed_result(truewheel: Truewheel, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'results.sqlite'}"
    ended = truewheel("demo", "--vehicles", 1, "--database", url, "--out", tmp_path / "out", "--json")
    assert ended.status == 0, ended.err
    result = ended.json
    assert result["database"] == url
    (vehicle,) = result["vehicles"]
    assert vehicle["outcome"] == "ok"
    assert [wheel["wheel"] for wheel in vehicle["wheels"]] == WHEELS
    for wheel in vehicle["wheels"]:
        assert (wheel["outcome"], wheel["verdict"]) == ("measured", "ok")
        for angle in ("camber", "toe"):
            assert abs(wheel["error_arcmin"][angle]) <= 0.1
            assert 0.0 < wheel[f"{angle}_u95_deg"] < 0.01
            error = 60 * (wheel[f"{angle}_deg"] - wheel["truth"][f"{angle}_deg"])
            assert abs(error - wheel["error_arcmin"][angle]) < 1e-9
    order = vehicle["order"]
    times = [order[f"{name}_s"] for name in ("trigger", "busy", "committed", "first_result", "done")]
    assert times == sorted(times)
    assert order["in_order"] is True

    with ResultStore(url) as store:
        counts = store.counts()
        assert (counts["vehicles"], counts["wheel_results"], counts["calibrations"]) == (1, 4, 4)
        stored = store.cycle(UUID(vehicle["cycle"]))
        assert stored is not None
        assert stored.record.vehicle is not None
        assert stored.record.vehicle.vin == vehicle["vin"]
        assert len(stored.record.axles) == 2
        assert stored.record.vehicle_angles is not None
    frames = list(decode_log(result["can_log"], load_line_database(CONFIGS / "line.dbc")))
    assert [frame.error for frame in frames if frame.error] == []
    (trace,) = trace_cycles(frames)
    assert trace.in_order
    assert truewheel("line", "monitor", result["can_log"], "--config", CONFIGS / "station.toml").status == 0

    report = truewheel("report", "all", "--database", url, "--out", tmp_path / "report.html", "--json").json
    assert (report["figures"]["cycles"], report["figures"]["yield_percent"]) == (1, 100.0)
    of_vin = truewheel("report", "vin", "--vin", vehicle["vin"], "--database", url, "--json").json
    angles = {
        row["angle"]: row["value_deg"]
        for part in of_vin["sections"]
        for row in part["rows"]
        if "angle" in row
    }
    for wheel in vehicle["wheels"]:
        assert abs(angles[f"{wheel['wheel']}.toe"] - wheel["toe_deg"]) < 1e-9
    for name, *options in (("certificate", "--vin", vehicle["vin"]), ("aqdef",)):
        ending = {"certificate": "pdf", "aqdef": "dfq"}[name]
        out = tmp_path / f"results.{ending}"
        assert truewheel("export", name, "--database", url, *options, "--out", out).status == 0


@pytest.mark.parametrize(("load_mm", "front", "rear"), [(4.0, 4.0, 3.2), (0.0, None, None)])
def test_vehicles_of_the_demonstration_stand_on_their_tyres(
    tmp_path: Path, load_mm: float, front: float | None, rear: float | None
) -> None:
    """They hung in the air, as no vehicle of a line does."""
    known = read_configuration(CONFIGS / "station.toml")
    found = demo_configuration(known, f"sqlite:///{tmp_path / 'r.db'}", tmp_path / "can.log", load_mm)
    loads = {rig.name: rig.options.load for rig in found.settings.rigs}  # type: ignore[attr-defined]
    told = {name: None if load is None else pytest.approx(load.bulge_mm) for name, load in loads.items()}
    assert told == {name: front if name.startswith("front") else rear for name in WHEELS}


def test_a_load_that_the_file_states_stays(tmp_path: Path) -> None:
    shutil.copytree(CONFIGS, tmp_path / "configs")
    path = tmp_path / "configs" / "station.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("seed = 1,", "load = { bulge_mm = 7.0 }, seed = 1,", 1), encoding="utf-8")
    known = read_configuration(path)
    found = demo_configuration(known, f"sqlite:///{tmp_path / 'r.db'}", tmp_path / "can.log", 4.0)
    loads = {rig.name: rig.options.load.bulge_mm for rig in found.settings.rigs}  # type: ignore[attr-defined]
    assert (loads["front_left"], loads["front_right"]) == (7.0, 4.0)


def test_every_second_vehicle_has_one_wheel_out_of_tolerance() -> None:
    kind = read_vehicle_types(CONFIGS / "vehicles")[1]
    rng = np.random.default_rng(0)
    for number in range(6):
        outside = []
        for wheel, draw in vehicle_poses(kind, WHEELS, number, rng).items():
            pose = draw(np.random.default_rng(1))
            limits = kind.axles[wheel.rpartition("_")[0]]
            for angle, value in ((limits.camber.limits(), pose.camber), (limits.toe.limits(), pose.toe)):
                if not angle.low < value < angle.high:
                    outside.append(wheel)
        assert len(outside) == number % 2
