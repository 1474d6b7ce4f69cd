"""`truewheel calibration frame`: rendered views of a gauge frame put the rigs into the vehicle."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from alignment.geometry.transforms import RigidTransform
from alignment.units import ARCMIN
from db.store import ResultStore
from sensors.formats import (
    read_calibration,
    read_calibration_file,
    read_gauge_frame,
    read_image,
    read_plate_truth,
    write_image,
)
from station.cli import main
from tests.once import folder_once

ROOT = Path(__file__).parents[3]
RIGS = ("front_left", "front_right")


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@folder_once
def gauge(folder: Path) -> None:
    """A gauge frame with the plates of the front rigs alone, and rendered views of it."""
    shutil.copy(ROOT / "configs" / "plates" / "rig.toml", folder)
    head, *plates = (ROOT / "configs" / "plates" / "gauge.toml").read_text().split("[[plates]]")
    (folder / "gauge.toml").write_text("[[plates]]".join([head, *plates[:2]]), encoding="utf-8")
    frame = folder / "gauge.toml"
    assert run("simulate", "gauge-session", "--seed", 4, "--frame", frame, "--out", folder / "session") == 0


@pytest.fixture
def frame() -> Path:
    return gauge() / "gauge.toml"


@pytest.fixture
def session() -> Path:
    return gauge() / "session"


@pytest.fixture
def copy(session: Path, tmp_path: Path) -> Path:
    """A session that a test may spoil."""
    shutil.copytree(session, tmp_path / "session")
    return tmp_path / "session"


def known(session: Path, rigs: tuple[str, ...] = RIGS) -> list[object]:
    return [part for rig in rigs for part in ("--calibration", session / rig / "calibration.json")]


@pytest.mark.slow
def test_rigs_get_their_true_pose_in_the_vehicle(
    session: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, url = tmp_path / "placed", f"sqlite:///{tmp_path / 'results.db'}"
    command = "calibration", "frame", session, *known(session), "--frame", frame, "--out", out
    assert run("db", "migrate", "--database", url) == 0
    capsys.readouterr()
    assert run(*command, "--database", url, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["outcome"], said["reason"], said["stored"]) == ("accepted", None, True)
    assert said["figures"]["largest_transfer_u95_arcmin"] < 0.05
    views: set[str] = set()
    for rig, one in zip(RIGS, said["rigs"], strict=True):
        assert one["rig"] == rig
        before = read_calibration(session / rig / "calibration.json")
        after = read_calibration(one["calibration"])
        truth = read_plate_truth(session / rig / "truth.json")
        assert truth.vehicle_from_rig is not None
        assert after.vehicle_from_rig_measured
        assert after.id == one["calibration_id"] != before.id == one["predecessor_id"]
        assert before.id in read_calibration_file(one["calibration"]).method
        # The plate in the rig without, the rig in the vehicle with the certificate's errors.
        seen = read_calibration(out / f"{rig}.json").vehicle_from_rig.inverse() @ pose_of_plate(frame, rig)
        turn = (truth.rig_from_plate["gauge"].inverse() @ seen).rotvec()
        assert np.abs(turn).max() < 0.03 * ARCMIN
        off = (truth.vehicle_from_rig.inverse() @ after.vehicle_from_rig).rotvec()
        assert np.abs(off).max() < 3.0 * 0.06 * ARCMIN
        assert np.abs(after.vehicle_from_rig.translation - truth.vehicle_from_rig.translation).max() < 0.08
        assert max(abs(one["camber_change_arcmin"]), abs(one["toe_change_arcmin"])) > 1.0
        assert after.placing is not None
        assert after.placing.view.startswith("gauge, seen 20")
        views.add(after.placing.view)
        stated = read_gauge_frame(frame).file.whole.covariance()
        np.testing.assert_array_equal(after.placing.shared_covariance, stated)
        assert after.covariance is None or np.allclose(
            after.covariance[-6:, -6:], after.placing.pose_covariance, rtol=1e-6
        )
        # How the frame stands is in the pose of each rig too: half a minute of yaw.
        assert after.placing.pose_covariance[1, 1] >= (0.5 * ARCMIN) ** 2
        with ResultStore(url) as store:
            stored = store.calibration(after.id)
        assert stored is not None
        assert stored.document["vehicle_from_rig"]["measured"] is True
    assert len(views) == 1


def pose_of_plate(frame: Path, rig: str) -> RigidTransform:
    return read_gauge_frame(frame).plates[rig].vehicle_from_plate


def test_a_rig_that_is_refused_keeps_all_calibrations_as_they_are(
    copy: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dark = next((copy / "front_right").glob("*_head_2_left.png"))
    image = read_image(dark)
    dark.unlink()
    write_image(dark, np.zeros_like(image))
    out = tmp_path / "placed"
    assert run("calibration", "frame", copy, *known(copy), "--frame", frame, "--out", out) == 1
    said = capsys.readouterr().out
    assert "front_left: at (" in said
    assert "front_right: REFUSED" in said
    assert "head_2 left" in said
    assert "nothing written" in said
    assert not out.exists()


def test_a_plate_turned_in_the_frame_s_description_is_noticed(
    session: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = frame.read_text()
    turned = tmp_path / "gauge.toml"
    # A quarter turn of the first plate about its own z axis.
    old = "rotation = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]"
    assert old in text
    new = "rotation = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]"
    turned.write_text(text.replace(old, new, 1))
    shutil.copy(frame.parent / "rig.toml", tmp_path)
    out = tmp_path / "placed"
    assert (
        run("calibration", "frame", session, *known(session), "--frame", turned, "--out", out, "--json") == 1
    )
    said = json.loads(capsys.readouterr().out)
    assert said["outcome"] == "refused"
    assert "the rig would be turned by" in said["reason"]
    assert "it would fit with a quarter turn about its z axis" in said["reason"]
    assert not out.exists()


def without_session(folder: Path) -> None:
    shutil.rmtree(folder / "front_right")


def another_plate(folder: Path) -> None:
    path = folder / "front_left" / "session.json"
    data = json.loads(path.read_text())
    data["plate"]["mark_diameter_mm"] = 9.0
    path.write_text(json.dumps(data))


def empty(folder: Path) -> None:
    for rig in RIGS:
        (folder / rig / "session.json").unlink()


@pytest.mark.parametrize(
    ("spoil", "rigs", "expected"),
    [
        (without_session, RIGS, "expected a session for each calibration, found none for front_right"),
        (lambda folder: None, ("front_left",), "field '--calibration': expected a calibration for each rig"),
        (lambda folder: None, ("front_left", "front_left"), "expected one for each rig"),
        (another_plate, RIGS, "field 'plate': expected the gauge frame's plate 'rig'"),
        (empty, RIGS, "expected a gauge session"),
    ],
)
def test_what_does_not_belong_together_is_named(
    session: Path,
    copy: Path,
    frame: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    spoil: Callable[[Path], None],
    rigs: tuple[str, ...],
    expected: str,
) -> None:
    arguments = known(copy, rigs)
    spoil(copy)
    if "front_right" not in {path.name for path in copy.iterdir()}:
        arguments = known(copy, ("front_left",)) + known(session, ("front_right",))
    out = tmp_path / "placed"
    assert run("calibration", "frame", copy, *arguments, "--frame", frame, "--out", out) == 2
    assert expected in capsys.readouterr().err
    assert not out.exists()


def test_a_failing_database_leaves_nothing_behind(
    session: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "placed"
    url = f"sqlite:///{tmp_path / 'no' / 'such' / 'folder' / 'x.db'}"
    (tmp_path / "no").write_text("a file")
    command = "calibration", "frame", session, *known(session), "--frame", frame, "--out", out
    assert run(*command, "--database", url) == 3
    assert "database" in capsys.readouterr().err
    assert not out.exists()


def test_a_rig_that_would_stand_askew_needs_a_reason_that_is_kept(
    session: Path, frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plate said to lean by 3° turned every later wheel by 3°, without a word."""
    c, s = math.cos(math.radians(3.0)), math.sin(math.radians(3.0))
    old = "rotation = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]"
    new = f"rotation = [[-1.0, 0.0, 0.0], [0.0, {s!r}, {c!r}], [0.0, {c!r}, {-s!r}]]"
    leaning, out = tmp_path / "gauge.toml", tmp_path / "placed"
    leaning.write_text(frame.read_text().replace(old, new, 1))
    shutil.copy(frame.parent / "rig.toml", tmp_path)
    command = "calibration", "frame", session, *known(session), "--frame", leaning, "--out", out
    assert run(*command) == 1
    said = capsys.readouterr().out
    assert "front_left: REFUSED, the rig would be turned by" in said
    assert "add --force with --reason, which is recorded" in said
    assert not out.exists()
    for wrong in (("--force",), ("--reason", "because"), ("--force", "--reason", "x" * 101)):
        assert run(*command, *wrong) == 2
    assert run(*command, "--force", "--reason", "leaning bracket", "--json") == 0
    left, right = json.loads(capsys.readouterr().out)["rigs"]
    assert (left["forced_reason"], right["forced_reason"]) == ("leaning bracket", None)
    assert read_calibration_file(left["calibration"]).method.startswith("FORCED: leaning bracket; ")
    assert "FORCED" not in read_calibration_file(right["calibration"]).method
