"""Spin axis and zero measurement from the command line."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import pytest

import alignment.measure_spin
from db.store import ResultStore
from sensors.formats import read_image, write_image
from station.configuration.settings import read_configuration
from station.running.composition import open_station
from tests.alignment.wheel.test_spin import FULL_TURN, NOISE, RUN_OUT, plane, series
from tests.end_to_end.conftest import Truewheel
from tests.once import folder_once


@folder_once
def eight_shots(folder: Path, wheel: Path) -> None:
    for number in range(8):
        shot = folder / f"shot_{number}"
        shutil.copytree(wheel, shot)
        path = shot / "head_1_left.png"
        image = read_image(path).copy()
        image[0, 0] = number
        path.unlink()
        write_image(path, image)


@pytest.fixture
def turned(rendered_wheel: Path) -> list[Path]:
    """Eight shots whose images differ in a pixel."""
    return sorted(eight_shots(rendered_wheel).iterdir())


def test_spin_axis_of_eight_shots(
    truewheel: Truewheel, turned: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = iter(2 * series(FULL_TURN, camber=0.01, toe=-0.005))
    monkeypatch.setattr(alignment.measure_spin, "measure_wheel", lambda *_: next(found))
    arguments = ("measure", *turned, "--spin", "--calibration", turned[0] / "calibration.json")
    ended = truewheel(*arguments, "--json")
    assert ended.status == 0
    assert (ended.json["outcome"], ended.json["reason"], ended.json["method"]) == (
        "measured",
        None,
        "spin_axis",
    )
    assert ended.json["camber_deg"] == pytest.approx(math.degrees(0.01))
    assert ended.json["toe_deg"] == pytest.approx(math.degrees(-0.005))
    assert 0 < ended.json["toe_u95_deg"] < 1e-3
    assert ended.json["runout_deg"] == pytest.approx(0.5)
    assert ended.json["runout_mm"] == pytest.approx(600 * math.sin(RUN_OUT))
    assert ended.json["runout_radius_mm"] == 300.0
    assert ended.json["covered_turn_deg"] == pytest.approx(315.0, abs=0.1)
    assert ended.json["shots_used"] == len(ended.json["shots"]) == 8
    assert all(shot["used"] and -180 <= shot["phase_deg"] <= 180 for shot in ended.json["shots"])
    text = truewheel(*arguments, "--runout-radius", 200).out
    assert "spin axis" in text
    assert "mm peak to peak at 200 mm" in text


def test_run_out_in_the_noise_is_said(
    truewheel: Truewheel, turned: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = iter(2 * [plane(0.01, NOISE * k) for k in range(8)])
    monkeypatch.setattr(alignment.measure_spin, "measure_wheel", lambda *_: next(found))
    arguments = ("measure", *turned, "--spin", "--calibration", turned[0] / "calibration.json")
    ended = truewheel(*arguments, "--json")
    assert ended.status == 0
    assert ended.json["runout_deg"] is None
    assert ended.json["covered_turn_deg"] is None
    assert "how far the wheel turned is unknown" in truewheel(*arguments).out


def test_too_few_shots_and_a_shot_given_twice_are_refused(truewheel: Truewheel, turned: list[Path]) -> None:
    known = ("--spin", "--calibration", turned[0] / "calibration.json")
    ended = truewheel("measure", *turned[:2], *known, "--json")
    assert ended.status == 1
    assert (ended.json["outcome"], ended.json["reason_code"]) == ("refused", "too_few_shots")
    assert ended.json["camber_deg"] is None
    ended = truewheel("measure", turned[0], turned[0], *known)
    assert ended.status == 1
    assert "shots 1 and 2 are the same images" in ended.out


def test_several_shots_without_spin_are_bad_usage(truewheel: Truewheel, turned: list[Path]) -> None:
    ended = truewheel("measure", *turned[:2], "--calibration", turned[0] / "calibration.json")
    assert ended.status == 2
    assert "add --spin" in ended.err


def test_a_zero_measurement_is_stored_applied_listed_and_revoked(
    truewheel: Truewheel, replay: Path, rendered_wheel: Path
) -> None:
    configuration = read_configuration(replay)
    shots = replay.parent / "shots" / "001"
    database = ("--database", configuration.database_url)
    assert truewheel("db", "migrate", *database).status == 0
    measured = truewheel("measure", shots, "--calibration", shots / "calibration.json", "--json").json
    assert "no zero measurements" in truewheel("zero", "list", *database).out

    certified = ("--camber", 1.25, "--toe", -0.35, "--certified-u95", 0.001, "--master", "M-17")
    stored = truewheel(
        "zero", "measure", shots, "--calibration", shots / "calibration.json", *certified, *database, "--json"
    )
    assert stored.status == 0
    assert stored.json["camber_deg"] == pytest.approx(measured["camber_deg"])
    assert stored.json["certified_toe_deg"] == pytest.approx(-0.35)
    assert stored.json["camber_u95_deg"] == pytest.approx(math.hypot(measured["camber_u95_deg"], 0.001))
    (listed,) = truewheel("zero", "list", *database, "--json").json["zero_measurements"]
    assert listed["id"] == stored.json["id"]
    assert listed["in_force"]
    assert (listed["rig"], listed["master"], listed["method"]) == (
        "front_left",
        "M-17",
        "tyre_plane/revolution",
    )
    assert "in force" in truewheel("zero", "list", *database).out

    with open_station(configuration) as station, ResultStore(configuration.database_url) as store:
        (position,) = station.positions
        position.rig.arm()
        result = position.run(store.zeros_in_force())
        assert result.measurement is not None
        assert math.degrees(result.measurement.camber) == pytest.approx(1.25, abs=1e-6)
        assert math.degrees(result.measurement.toe) == pytest.approx(-0.35, abs=1e-6)
        assert result.zero_id == listed["id"]

    revoked = truewheel("zero", "revoke", listed["id"], *database, "--reason", "dropped", "--json")
    assert revoked.status == 0
    assert (revoked.json["in_force"], revoked.json["revoked_reason"]) == (False, "dropped")
    assert "revoked" in truewheel("zero", "list", *database).out
    ended = truewheel("zero", "revoke", "zero-unknown", *database)
    assert ended.status == 2
    assert "zero list" in ended.err


def test_a_master_far_from_its_certificate_stores_nothing(
    truewheel: Truewheel, wheel: Path, tmp_path: Path
) -> None:
    database = ("--database", f"sqlite:///{tmp_path / 'results.db'}")
    truewheel("db", "migrate", *database)
    known = ("--calibration", wheel / "calibration.json", "--toe", 0, *database)
    ended = truewheel("zero", "measure", wheel, "--camber", -9.5, *known)
    assert ended.status == 2
    assert "of the measured camber 1.200°" in ended.err
    path = wheel / "head_1_left.png"
    dark = read_image(path) * 0
    path.unlink()
    write_image(path, dark)
    ended = truewheel("zero", "measure", wheel, "--camber", 1.2, *known, "--json")
    assert ended.status == 1
    assert ended.json["reason_code"] == "head_dark"
    assert "no zero measurements" in truewheel("zero", "list", *database).out
