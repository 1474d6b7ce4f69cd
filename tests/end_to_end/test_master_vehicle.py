"""A master vehicle from its images to the zero measurements of all rigs, and a vehicle measured after it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from db.store import ResultStore
from tests.end_to_end.conftest import Truewheel, simulated

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


@pytest.fixture
def vehicle(tmp_path: Path) -> Path:
    """A rendered vehicle that stands askew by 0.4°."""
    made = simulated("vehicle --seed 3 --yaw-deg 0.4 --offset-mm -15.0") / "made"
    shutil.copytree(made, tmp_path / "vehicle")
    return tmp_path / "vehicle"


def certificate(vehicle: Path, off_deg: dict[str, float] | None = None, track_mm: float = 0.0) -> Path:
    """What a measuring room would say of it; some of its toes and a track are stated otherwise."""
    truth: Any = json.loads((vehicle / "truth.json").read_text(encoding="utf-8"))
    lines = ['name = "MV-7"', "u95_deg = 0.0005", "u95_mm = 0.02", "[wheels]"]
    for name in WHEELS:
        camber, toe = (truth["wheels"][name][f"{angle}_deg"] for angle in ("camber", "toe"))
        toe += (off_deg or {}).get(name, 0.0)
        lines.append(f"{name} = {{ camber_deg = {camber:.6f}, toe_deg = {toe:.6f} }}")
    lines += ["[lengths_mm]", f"track_front = {truth['track_front_mm'] + track_mm:.4f}"]
    path = vehicle.parent / "master.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.fixture
def url(truewheel: Truewheel, tmp_path: Path) -> str:
    found = f"sqlite:///{tmp_path / 'results.db'}"
    assert truewheel("db", "migrate", "--database", found).status == 0
    return found


@pytest.mark.slow
def test_a_master_vehicle_that_stands_askew_sets_all_rigs_right(
    truewheel: Truewheel, vehicle: Path, url: str
) -> None:
    """Images, certificate, database and what is printed, in one run; its yaw is no error of any rig."""
    off = {"rear_left": 0.02}
    master = certificate(vehicle, off)
    told = ("zero", "measure-vehicle", vehicle, "--certificate", master, "--database", url)
    ended = truewheel(*told, "--json")
    assert ended.status == 0, ended.err
    assert ended.json["yaw_deg"] == pytest.approx(0.4, abs=0.005)
    assert len(ended.json["zero_measurements"]) == 4
    length = ended.json["lengths"]["track_front"]
    assert length["measured_mm"] == pytest.approx(
        length["certified_mm"], abs=2.0 * length["difference_u95_mm"]
    )
    with ResultStore(url) as store:
        zeros = {record.rig: record for record in store.zeros_in_force()}
    assert set(zeros) == set(WHEELS)
    for name, record in zeros.items():
        assert record.master == f"MV-7, {name.replace('_', ' ')}"
        found = record.toe - record.certified_toe
        assert found == pytest.approx(-0.000349 * (name in off), abs=5e-5)
        assert record.camber == pytest.approx(record.certified_camber, abs=5e-5)
    again = truewheel(*told)
    assert again.status == 0
    assert again.out.count("stored ") == 4
    assert "track front: measured less certified" in again.out
    listed = truewheel("zero", "list", "--database", url)
    assert listed.out.count("MV-7") == 8


def test_a_master_vehicle_with_one_refused_wheel_corrects_no_rig(
    truewheel: Truewheel, vehicle: Path, url: str
) -> None:
    image = next((vehicle / "rear_right").glob("head_1_*.png"))
    shutil.copyfile(vehicle / "rear_left" / image.name, image)
    ended = truewheel(
        "zero", "measure-vehicle", vehicle, "--certificate", certificate(vehicle), "--database", url, "--json"
    )
    assert ended.status == 1
    assert ended.json["outcome"] == "refused"
    assert "rear_right: " in ended.json["reason"]
    with ResultStore(url) as store:
        assert store.zeros() == ()


@pytest.mark.parametrize(
    ("off", "track_mm", "said"),
    [({"front_right": 0.5}, 0.0, "front right"), ({}, 6.0, "track_front")],
    ids=["an angle", "a length"],
)
def test_a_certificate_that_is_not_believed_is_one_clear_error_and_stores_nothing(
    truewheel: Truewheel, vehicle: Path, url: str, off: dict[str, float], track_mm: float, said: str
) -> None:
    master = certificate(vehicle, off, track_mm)
    told = ("zero", "measure-vehicle", vehicle, "--certificate", master, "--database", url)
    ended = truewheel(*told)
    assert ended.status == 2
    assert said in ended.err
    with ResultStore(url) as store:
        assert store.zeros() == ()
    forced = truewheel(*told, "--force", "--reason", "another master's certificate")
    assert forced.status == 0, forced.err
    with ResultStore(url) as store:
        assert {record.forced_reason for record in store.zeros_in_force()} >= {"another master's certificate"}


def test_a_missing_certificate_is_named(truewheel: Truewheel, vehicle: Path, url: str) -> None:
    ended = truewheel(
        "zero", "measure-vehicle", vehicle, "--certificate", vehicle / "none.toml", "--database", url
    )
    assert ended.status == 2
    assert "none.toml" in ended.err
