"""`truewheel calibration refresh`: files in, a new file out, or none."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import station.calibration.refresh
from alignment.calibration.crosses import CrossPairs
from alignment.calibration.prediction import NominalWheel, wheel_points
from alignment.calibration.refreshing import Moved, Movement, Refreshed, Sightings, refresh_from
from alignment.geometry.cameras import PosedCamera
from alignment.units import ARCMIN
from alignment.values import HeadCalibration, MeasureSettings, RigCalibration, StereoImages
from sensors.formats import read_calibration_file, write_calibration
from station.calibration.refresh import judge_refreshed
from station.cli import main
from tests.station.calibrations import true_rig

NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


def known_rig() -> RigCalibration:
    true = true_rig()
    return replace(true, covariance=1e-14 * np.eye(len(true.parameter_names)))


def knocked() -> RigCalibration:
    known = known_rig()
    first, *rest = known.heads
    pose = first.left.rig_from_camera.perturbed(np.array([5e-4, 0.0, 5e-4]), np.zeros(3))
    moved = HeadCalibration(first.name, PosedCamera(first.left.model, pose), first.right)
    return replace(known, id="cal-knocked", heads=(moved, *rest))


def as_if_wheels_had_told(found: Refreshed) -> Refreshed:
    """Rows alone leave 30′ open; the surfaces of wheels would not."""
    return replace(found, calibration=replace(found.calibration, covariance=known_rig().covariance))


@pytest.fixture
def seen_by_the_true_rig(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Shots whose crosses are computed, not rendered."""
    rng = np.random.default_rng(2)
    judged = getattr(request, "param", as_if_wheels_had_told)
    pairs = []
    for head in true_rig().heads:
        points = wheel_points(head, NominalWheel())
        left, right = (camera.project(points) for camera in head.cameras)
        pairs.append(
            CrossPairs(*(pixels + 0.02 * rng.standard_normal(pixels.shape) for pixels in (left, right)))
        )

    def refresh(
        shots: Sequence[Sequence[StereoImages]],
        calibration: RigCalibration,
        settings: MeasureSettings,
        movement: Movement,
    ) -> Refreshed:
        assert len(shots) == 2
        return judged(refresh_from(Sightings(tuple(pairs)), calibration, movement))

    monkeypatch.setattr(station.calibration.refresh, "refresh", refresh)
    monkeypatch.setattr(
        station.calibration.refresh, "read_shot", lambda folder, known: SimpleNamespace(images=())
    )


def write(path: Path, calibration: RigCalibration) -> Path:
    write_calibration(path, calibration, method="test", created_utc=NOON)
    return path


@pytest.mark.usefixtures("seen_by_the_true_rig")
def test_a_knocked_camera_gets_a_new_pose_and_the_file_a_new_identity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = write(tmp_path / "old.json", knocked()), tmp_path / "new.json"
    before = old.read_bytes()
    command = "calibration", "refresh", "a", "b", "--calibration", old, "--out", new
    assert run(*command, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["outcome"] == "refreshed"
    assert said["camera"][0] == "head_1"
    # Rows alone do not tell left from right.
    assert said["certain"] is False
    assert said["other"]["camera"][0] == "head_1"
    assert said["other"]["share"] + said["share"] == pytest.approx(1.0)
    assert abs(said["other"]["toe_difference_arcmin"]) > 0.0
    assert said["wheels"] == 0
    assert [head["changed"] for head in said["heads"]] == [True, False, False]
    assert said["heads"][0]["row_rms_px"] > 0.5
    assert said["row_rms_px"] < 0.05
    assert said["predicted_toe_u95_deg"] > 0.0
    file = read_calibration_file(new)
    assert file.id == said["calibration_id"] != "cal-knocked"
    assert "cal-knocked, head_1" in file.method
    assert old.read_bytes() == before

    assert run(*command) == 2
    assert "what is there is not replaced" in capsys.readouterr().err


@pytest.mark.usefixtures("seen_by_the_true_rig")
def test_nothing_is_written_when_no_camera_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = write(tmp_path / "old.json", known_rig()), tmp_path / "new.json"
    assert run("calibration", "refresh", "a", "b", "--calibration", old, "--out", new) == 0
    said = capsys.readouterr().out
    assert "head_3" in said
    assert "no camera changed; nothing written" in said
    assert not new.exists()


@pytest.mark.usefixtures("seen_by_the_true_rig")
def test_a_person_reads_what_changed_and_how_sure_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = write(tmp_path / "old.json", knocked()), tmp_path / "new.json"
    assert run("calibration", "refresh", "a", "b", "--calibration", old, "--out", new, "--focal") == 0
    said = capsys.readouterr().out
    assert "head_1: " in said
    assert "CHANGED" in said
    assert "95 %" in said
    assert "undecided: with " in said
    assert f"wrote {new}" in said
    assert "the one in force states ±0.01′, ±0.01′" in said


@pytest.mark.parametrize("seen_by_the_true_rig", [lambda found: found], indirect=True)
@pytest.mark.usefixtures("seen_by_the_true_rig")
def test_what_would_be_too_uncertain_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A calibration that states ±30′ was written in place of one with ±0.01′ and an error of 0.1′."""
    old, new = write(tmp_path / "old.json", knocked()), tmp_path / "new.json"
    command = "calibration", "refresh", "a", "b", "--calibration", old, "--out", new
    assert run(*command) == 1
    said = capsys.readouterr().out
    assert "refused, nothing written: head_1" in said
    assert "allowed is ±0.20′. Calibrate the rig with the plate" in said
    assert run(*command, "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["outcome"], told["calibration_id"], told["out"]) == ("refused", None, None)
    assert told["reason"].startswith("head_1")
    assert told["predicted_camber_u95_deg"] > 100.0 * told["old_camber_u95_deg"] > 0.0
    assert not new.exists()


@pytest.mark.parametrize("seen_by_the_true_rig", [lambda found: found], indirect=True)
@pytest.mark.usefixtures("seen_by_the_true_rig")
def test_what_is_more_uncertain_than_the_old_one_is_wrong_is_not_written_even_when_much_is_allowed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = write(tmp_path / "old.json", knocked()), tmp_path / "new.json"
    command = "calibration", "refresh", "a", "b", "--calibration", old, "--out", new, "--largest-u95", 60
    assert run(*command) == 1
    assert "the calibration in force is the better one" in capsys.readouterr().out
    assert not new.exists()


@pytest.mark.usefixtures("seen_by_the_true_rig")
def test_too_few_wheels_to_judge_surfaces_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = write(tmp_path / "old.json", known_rig())
    assert run("calibration", "refresh", "a", "b", "--calibration", old, "--out", tmp_path / "new.json") == 0
    said = capsys.readouterr().out
    assert "fewer than three wheels: a turn that moves no line off its row would not show" in said
    assert "angles as before: camber ±0.01′, toe ±0.01′" in said


@pytest.mark.parametrize(
    ("change", "difference", "new_u95", "written"),
    [(0.5, 0.0, 0.19, True), (0.5, 0.0, 0.21, False), (0.1, 0.0, 0.119, True), (0.1, 0.0, 0.121, False),
     (0.05, 0.05, 0.119, True), (0.0, 0.0, 0.01, True), (0.0, 0.0, 0.03, False)],
)  # fmt: skip
def test_a_new_calibration_must_be_worth_more_than_the_old_one(
    change: float, difference: float, new_u95: float, written: bool
) -> None:
    found = Refreshed(
        (), Moved(("head_1", "left"), np.zeros(6), 0.0, 1.0), None, np.array([0.0, difference]) * ARCMIN, 0.0,
        3, known_rig(), 2.0, np.array([0.0, -change]) * ARCMIN,
    )  # fmt: skip
    old = (0.01 * ARCMIN, 0.02 * ARCMIN)
    reason = judge_refreshed(found, old, (0.005 * ARCMIN, new_u95 * ARCMIN), 0.2 * ARCMIN)
    assert (reason is None) == written
