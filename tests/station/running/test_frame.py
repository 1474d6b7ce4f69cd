"""Whether toes refer to the vehicle or to the stand is decided once, by what is known of the rigs."""

from __future__ import annotations

import logging
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import ConfigurationError
from alignment.geometry.transforms import RigidTransform
from alignment.values import RigCalibration, Side, nominal_vehicle_from_rig
from sensors.formats import write_calibration
from station.configuration import Configuration, read_configuration
from station.running.checking import check_configuration
from station.running.frame import common_frame
from tests.sensors.samples import calibration as sample_calibration
from tests.station.bench import TODAY
from tests.station.cycle.test_vehicle_frame import PLACES

CONFIGS = Path(__file__).resolve().parents[3] / "configs"


def rigs(measured: bool = True) -> dict[str, RigCalibration]:
    out = {}
    for name, place in PLACES.items():
        side: Side = "left" if name.endswith("left") else "right"
        pose = RigidTransform(nominal_vehicle_from_rig(side).rotation, np.array(place))
        sample = sample_calibration(rig=name, covariance=False)
        out[name] = replace(
            sample, side=side, vehicle_from_rig=pose, vehicle_from_rig_measured=measured, covariance=None
        )
    return out


def configuration(folder: Path, stand: str = "") -> Configuration:
    shutil.copytree(CONFIGS, folder, dirs_exist_ok=True)
    path = folder / "station.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[zero]", f"[stand]\n{stand}\n[zero]"), encoding="utf-8")
    return read_configuration(path)


def test_rigs_that_a_gauge_frame_placed_refer_toe_to_the_vehicle(tmp_path: Path) -> None:
    frame = common_frame(configuration(tmp_path), rigs().values())
    assert frame is not None
    assert frame.reference == "vehicle"
    assert frame.stand.temperature_sigma_k == 2.0


def test_stand_that_clamps_the_vehicle_keeps_its_own_axis(tmp_path: Path) -> None:
    known = configuration(tmp_path, 'reference = "stand"\nroad_z_mm = -305.0')
    frame = common_frame(known, rigs().values())
    assert frame is not None
    assert frame.reference == "stand"
    assert frame.stand.road_z_mm == -305.0


@pytest.mark.parametrize("lacking", ["one", "all", "rig"])
def test_rigs_without_a_common_frame_refer_toe_to_the_stand(
    tmp_path: Path, lacking: str, caplog: pytest.LogCaptureFixture
) -> None:
    found = rigs(measured=lacking != "all")
    if lacking == "one":
        found["rear_left"] = rigs(measured=False)["rear_left"]
    if lacking == "rig":
        del found["rear_left"]
    with caplog.at_level(logging.WARNING, "truewheel.station"):
        assert common_frame(configuration(tmp_path), found.values()) is None
    assert "limits of lengths and yaw of Compact are not judged" in caplog.text
    assert "rear_left" in caplog.text


@pytest.mark.parametrize("lacking", ["one", "rig"])
def test_vehicle_as_reference_without_a_frame_is_one_clear_error(tmp_path: Path, lacking: str) -> None:
    found = rigs()
    if lacking == "one":
        found["rear_left"] = rigs(measured=False)["rear_left"]
    else:
        del found["rear_left"]
    known = configuration(tmp_path, 'reference = "vehicle"')
    with pytest.raises(ConfigurationError, match=r"stand\.reference") as caught:
        common_frame(known, found.values())
    assert "rear_left" in str(caught.value)
    assert "gauge frame" in str(caught.value)


@pytest.mark.parametrize("placed", [True, False])
def test_check_finds_it_before_the_start(tmp_path: Path, placed: bool) -> None:
    known = configuration(tmp_path, 'reference = "vehicle"')
    text = known.file.read_text(encoding="utf-8")
    head, _, _ = text.partition("[[rigs]]")
    for name, calibration in rigs(measured=placed).items():
        write_calibration(tmp_path / f"{name}.json", calibration, method="sample", created_utc=TODAY)
        head += f'[[rigs]]\nname = "{name}"\ncalibration = "{name}.json"\nrecorded = {{ shots = "shots" }}\n'
    (tmp_path / "shots").mkdir()
    known.file.write_text(head, encoding="utf-8")
    _, findings = check_configuration(known.file)
    about = [error for error in findings if "stand.reference" in str(error)]
    assert len(about) == (0 if placed else 1)


def test_reference_that_is_no_word_of_it_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"stand\.reference"):
        configuration(tmp_path, 'reference = "road"')
