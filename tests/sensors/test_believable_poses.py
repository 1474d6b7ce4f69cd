"""Poses and sides in files: what no rig can have is refused, with the slip that would explain it.

A calibration with the pose of the other side was read without a word, and every sign after it was wrong.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import ConfigurationError, FormatError
from alignment.geometry.transforms import RigidTransform
from alignment.values import Side, nominal_vehicle_from_rig
from sensors.formats import read_calibration, read_gauge_frame, read_plate_session, write_calibration
from tests.sensors.samples import TIME, calibration

GAUGE = Path(__file__).parents[2] / "configs" / "plates" / "gauge.toml"
NONE = np.zeros(3)


def stands(tmp_path: Path, side: Side, pose: RigidTransform) -> None:
    """Read a calibration of a rig on that side with that pose back."""
    data = json.loads(written(tmp_path).read_text())
    data |= {"rig": "rig_1", "side": side}
    data["vehicle_from_rig"] |= {
        "rotation": pose.rotation.tolist(),
        "translation_mm": pose.translation.tolist(),
    }
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(data))
    read_calibration(path)


def written(tmp_path: Path) -> Path:
    path = tmp_path / "c.json"
    if not path.exists():
        bare = replace(calibration(), covariance=None)
        write_calibration(path, bare, method="test", created_utc=TIME)
    return path


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rig_may_lean_by_ten_degrees_and_no_more(
    tmp_path: Path, side: Side, axis: int, sign: float
) -> None:
    for lean, good in ((9.99, True), (10.01, False)):
        pose = nominal_vehicle_from_rig(side).perturbed(sign * math.radians(lean) * np.eye(3)[axis], NONE)
        if good:
            stands(tmp_path, side, pose)
            continue
        with pytest.raises(FormatError, match=r"vehicle_from_rig\.rotation.*within 10° .*turned by 10\.0°"):
            stands(tmp_path, side, pose)


def turned(side: Side, quarters: int) -> RigidTransform:
    about_z = np.array([0.0, 0.0, quarters * math.pi / 2.0])
    return nominal_vehicle_from_rig(side) @ RigidTransform.from_rotvec(about_z, NONE)


@pytest.mark.parametrize(
    ("side", "pose", "words"),
    [
        ("left", nominal_vehicle_from_rig("right"), "left and right exchanged"),
        ("right", nominal_vehicle_from_rig("left"), "left and right exchanged"),
        ("right", nominal_vehicle_from_rig("right").inverse(), "the rotation transposed"),
        ("left", turned("left", 1), "a quarter turn about its z axis"),
        ("left", turned("left", 2), "half a turn about its z axis"),
        ("right", turned("right", 3), "three quarters of a turn about its z axis"),
        ("left", RigidTransform.identity(), "Check 'side' and the rotation"),
    ],
)
def test_the_slip_that_explains_a_pose_is_named(
    tmp_path: Path, side: Side, pose: RigidTransform, words: str
) -> None:
    with pytest.raises(FormatError, match=words):
        stands(tmp_path, side, pose)


@pytest.mark.parametrize(
    ("side", "place", "words"),
    [
        ("left", (1.35, 0.8, 0.0), "It would fit with metres"),
        ("left", (53.1, 31.5, 0.0), "It would fit with inches"),
        ("right", (5e5, -3e5, 0.0), "with micrometres"),
        ("right", (1350.0, 800.0, 0.0), "left and right exchanged"),
        ("left", (1350.0, -800.0, 0.0), "opposite sign of Y"),
    ],
)
def test_a_place_where_no_rig_stands_is_refused(
    tmp_path: Path, side: Side, place: tuple[float, float, float], words: str
) -> None:
    pose = replace(nominal_vehicle_from_rig(side), translation=np.array(place))
    with pytest.raises(FormatError, match=words):
        stands(tmp_path, side, pose)
    right = (1350.0, 800.0 if side == "left" else -800.0, 0.0)
    stands(tmp_path, side, replace(pose, translation=np.array(right)))
    stands(tmp_path, side, replace(pose, translation=NONE))


def test_a_side_that_contradicts_the_rig_s_name_is_refused(tmp_path: Path) -> None:
    data = json.loads(written(tmp_path).read_text()) | {"rig": "rear_right", "side": "left"}
    (tmp_path / "x.json").write_text(json.dumps(data))
    with pytest.raises(FormatError, match=r"field 'side': expected 'right', as the rig's name 'rear_right'"):
        read_calibration(tmp_path / "x.json")


def test_a_session_whose_side_contradicts_its_rig_is_refused(tmp_path: Path) -> None:
    """The calibration made of it would have turned all signs."""
    from sensors.formats import write_plate_session
    from tests.sensors.test_plate_sessions import session

    write_plate_session(tmp_path / "s", replace(session(), rig="front_left", side="left"))
    path = tmp_path / "s" / "session.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"side": "right"}))
    with pytest.raises(FormatError, match="expected 'left', as the rig's name 'front_left' says"):
        read_plate_session(tmp_path / "s")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[1350.0, 800.0, 0.0]", "[1.35, 0.8, 0.0]", "It would fit with metres"),
        ("[1350.0, 800.0, 0.0]", "[1350.0, -800.0, 0.0]", "opposite sign of Y"),
        ("[-1350.0, 800.0, 0.0]", "[1350.0, 800.0, 0.0]", "found that of front_left"),
        ("position_sigma_mm = 0.02", "position_sigma_mm = 20.0", "at most 1"),
        ("position_sigma_mm = 0.02", "position_sigma_mm = 0.00002", "from 0.0001 upward"),
        ("angle_sigma_arcmin = 0.05", "angle_sigma_arcmin = 5.1", "at most 5"),
        ("angle_sigma_arcmin = 0.05", "angle_sigma_arcmin = 0.00083", "from 0.001 upward"),
    ],
)
def test_a_gauge_frame_that_no_certificate_states_is_refused(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    text = GAUGE.read_text()
    assert old in text
    (tmp_path / "gauge.toml").write_text(text.replace(old, new, 1))
    (tmp_path / "rig.toml").symlink_to(GAUGE.parent / "rig.toml")
    with pytest.raises(ConfigurationError, match=words):
        read_gauge_frame(tmp_path / "gauge.toml")
