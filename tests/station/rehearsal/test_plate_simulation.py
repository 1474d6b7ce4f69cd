"""`truewheel simulate plate-session`: what it writes is read, repeats itself, fits the wheels of its seed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sensors.formats import read_calibration, read_plate_session, read_plate_truth
from sensors.simulation.simulated_rig import true_calibration
from station.calibration.observing import observe_session
from station.cli import main


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "simulation.toml"
    path.write_text('rig = "ccir"\n', encoding="utf-8")
    return path


def test_a_simulated_session_of_one_head(
    tmp_path: Path, small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = "simulate", "plate-session", "--seed", 5, "--config", small, "--views", 3, "--head", "head_2"
    assert run(*common, "--out", tmp_path / "a", "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["views"] == ["z0", "z-30", "z30"]
    assert said["images"] == 6

    session = read_plate_session(said["session"])
    assert session.plate.file.name == "head"
    assert session.heads == ("head_2",)
    assert session.views[0].stage_mm.tolist() == [-230.4, -133.0, 0.0]
    truth = read_plate_truth(said["truth"])
    assert np.abs(truth.rig_from_plate["z30"].translation - [-230.4, -133.0, 30.0]).max() <= 0.01
    calibration = read_calibration(said["calibration"])
    assert calibration.id == said["calibration_id"]
    assert calibration.id == true_calibration("front_left", "left", "ccir", 5).id

    assert run(*common, "--out", tmp_path / "b") == 0
    assert "6 images" in capsys.readouterr().out
    again = read_plate_session(tmp_path / "b")
    for one, other in zip(session.views, again.views, strict=True):
        assert all(np.array_equal(image, other.images[key]) for key, image in one.images.items())


def test_a_plate_that_people_own_is_rendered_and_may_be_moved_farther(
    tmp_path: Path, small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plate = tmp_path / "board.toml"
    plate.write_text(
        'schema = "truewheel.pattern-plate/1"\nname = "board"\npattern = "charuco"\n'
        "columns = [-5, 5]\nrows = [-5, 5]\npitch_x_mm = 9.0\npitch_y_mm = 9.0\n"
        'dictionary = "DICT_4X4_100"\nmarker_mm = 7.0\n',
        encoding="utf-8",
    )
    common = "simulate", "plate-session", "--seed", 5, "--config", small, "--views", 3, "--head", "head_2"
    moved = "--plate", plate, "--shift-mm", 20, "--out", tmp_path / "a", "--json"
    assert run(*common, *moved) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["plate"] == "board"
    session = read_plate_session(said["session"])
    assert session.plate.plate.pattern.kind.value == "charuco"
    assert session.views[1].stage_mm is not None
    assert (session.views[1].stage_mm - session.views[0].stage_mm).tolist() == [20.0, 20.0, -30.0]
    views, refusals = observe_session(session, lambda _share, _what: None)
    assert not refusals
    truth, cameras = read_plate_truth(said["truth"]), read_calibration(said["calibration"])
    for view in views:
        for (head, side), seen in view.observations.items():
            camera = getattr(next(one for one in cameras.heads if one.name == head), side)
            points = truth.rig_from_plate[view.name].apply(truth.points[seen.marks])
            assert np.abs(camera.project(points) - seen.pixels).max() < 0.1


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--head", "head_9"], "field '--head': expected one of head_1, head_2, head_3, found 'head_9'"),
        (["--plate", "lost.toml"], "lost.toml: expected the description of a plate, found no such file"),
        (["--views", "2"], "--views"),
    ],
)
def test_a_wrong_wish_ends_with_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    out = tmp_path / "session"
    assert run("simulate", "plate-session", "--seed", 1, "--out", out, *arguments) == 2
    said = capsys.readouterr().err
    assert expected in said
    assert "Traceback" not in said
    assert not out.exists()
