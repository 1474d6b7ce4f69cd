"""`truewheel camera` and `truewheel capture` as a maintainer calls them, on cameras that play recordings."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from alignment.values import SIDES
from sensors.camera import Frame
from sensors.formats import read_plate_session, read_shot, write_image, write_shot
from sensors.shot import HeadFrames, WheelShot
from tests.end_to_end.conftest import Truewheel, change, simulated

PLATE = Path(__file__).parents[2] / "configs" / "plates" / "rig.toml"


@pytest.fixture(scope="session")
def plate_shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the line's mode calibrate leaves behind: a folder for each start, a shot for each rig."""
    session = read_plate_session(simulated("plate-session --seed 5 --views 4") / "made")
    folder = tmp_path_factory.mktemp("starts")
    for number, view in enumerate(session.views, 1):
        heads = tuple(
            HeadFrames(
                head,
                *(
                    Frame(f"front_left/{head}/{side}", view.images[head, side], number, 0.0, 0.0, 5.0)
                    for side in SIDES
                ),
            )
            for head in session.heads
        )
        write_shot(
            folder / f"2026-11-30T12-00-0{number}-00{number}" / "front_left",
            WheelShot("front_left", session.time_utc, heads),
        )
    return folder


@pytest.fixture
def bare(configs: Path, rendered_wheel: Path) -> Path:
    """A station whose one rig has bare cameras that play a wheel: no calibration, the names of its heads."""
    path = configs / "station.toml"
    shutil.copytree(rendered_wheel, configs / "shots" / "001")
    text = path.read_text().split("[[rigs]]")[0]
    rig = 'name = "front_left"\nheads = ["head_1", "head_2", "head_3"]\n'
    path.write_text(f"{text}\n[[rigs]]\n{rig}recorded = {{ shots = 'shots', at_end = 'repeat' }}\n")
    return path


@pytest.mark.slow
def test_bare_cameras_are_shown_and_captured_with_and_the_station_says_what_it_lacks(
    truewheel: Truewheel, bare: Path, rendered_wheel: Path, tmp_path: Path
) -> None:
    shown = truewheel("camera", "show", "front_left", "--config", bare, "--out", tmp_path / "show", "--json")
    assert shown.status == 0, shown
    assert [camera["lines"] > 10 for camera in shown.json["cameras"]] == [True] * 6
    assert (tmp_path / "show" / "cameras.html").is_file()
    taken = truewheel("capture", "shot", "front_left", "--config", bare, "--out", tmp_path / "shot")
    assert taken.status == 0, taken
    images = zip(read_shot(tmp_path / "shot").frames, read_shot(rendered_wheel).frames, strict=True)
    assert all((one.image == other.image).all() for one, other in images)
    checked = truewheel("config", "check", bare)
    assert checked.status == 2
    assert "rigs[0].calibration" in checked.err
    assert "Capture a plate session" in checked.err


def test_a_shot_in_the_dark_is_not_written(truewheel: Truewheel, bare: Path, tmp_path: Path) -> None:
    image = bare.parent / "shots" / "001" / "head_2_right.png"
    write_image(image, np.full((1024, 1280), 6, np.uint8))
    taken = truewheel("capture", "shot", "front_left", "--config", bare, "--out", tmp_path / "shot")
    assert taken.status == 1
    assert "front_left/head_2/right: hardly any light" in taken.out
    assert not (tmp_path / "shot").exists()
    assert truewheel("camera", "show", "front_left", "--config", bare).status == 1


@pytest.mark.slow
def test_images_of_the_line_s_mode_calibrate_become_the_session_that_calibrate_reads(
    truewheel: Truewheel, bare: Path, plate_shots: Path, tmp_path: Path
) -> None:
    options = ("--config", bare, "--plate", PLATE, "--shots", plate_shots, "--out", tmp_path / "session")
    made = truewheel("capture", "plate-session", "front_left", "--views", 4, *options, "--json")
    assert made.status == 0, made
    assert made.json["views"] == ["z0", "z-30", "z30", "tilted_1"]
    assert made.json["missing"] == []
    session = read_plate_session(tmp_path / "session")
    assert [view.stage_mm is None for view in session.views] == [False, False, False, True]
    assert len(session.sizes) == 6


@pytest.mark.slow
def test_a_session_that_lacks_something_is_written_and_says_what(
    truewheel: Truewheel, bare: Path, plate_shots: Path, tmp_path: Path
) -> None:
    two = tmp_path / "two"
    for folder in sorted(plate_shots.iterdir())[:2]:
        shutil.copytree(folder, two / folder.name)
    options = ("--config", bare, "--plate", PLATE, "--shots", two, "--out", tmp_path / "session")
    made = truewheel("capture", "plate-session", "front_left", "--views", 4, *options)
    assert made.status == 1
    assert "the recording ends here" in made.out
    assert "missing: 2 views so far, at least 3 are needed" in made.out
    assert len(json.loads((tmp_path / "session" / "session.json").read_text())["views"]) == 2


@pytest.mark.slow
def test_views_that_are_taken_outlive_a_camera_that_is_lost(
    truewheel: Truewheel, bare: Path, plate_shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.rmtree(bare.parent / "shots")
    for number, folder in enumerate(sorted(plate_shots.iterdir())[:2]):
        shutil.copytree(folder / "front_left", bare.parent / "shots" / f"{number:03d}")
    change(bare, "at_end = 'repeat'", "at_end = 'stop'")
    monkeypatch.setattr("sys.stdin", io.StringIO("\n7.5 7.5 -30.002\n\n\n"))
    options = ("--config", bare, "--plate", PLATE, "--out", tmp_path / "session")
    made = truewheel("capture", "plate-session", "front_left", *options)
    assert made.status == 3
    assert "the recording ended after 2 shots" in made.err
    assert "kept 2 views" in made.err
    session = read_plate_session(tmp_path / "session")
    assert session.views[1].stage_mm is not None
    assert session.views[1].stage_mm.tolist() == [7.5, 7.5, -30.002]


def test_a_wheel_in_place_of_the_plate_is_no_view(truewheel: Truewheel, bare: Path, tmp_path: Path) -> None:
    options = ("--config", bare, "--plate", PLATE, "--auto", "--wait", 0, "--out", tmp_path / "session")
    made = truewheel("capture", "plate-session", "front_left", "--views", 3, *options)
    assert made.status == 1
    assert "not taken: no good view of the plate within 0 s" in made.out
    assert "nothing written" in made.err
    assert not (tmp_path / "session").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("camera", "show", "middle_left"), "a rig of"),
        (("camera", "live", "middle_left"), "'middle_left'"),
        (("camera", "exposure", "front_left", "--shortest-ms", 5, "--longest-ms", 1), "--longest-ms"),
        (("capture", "shot", "middle_left", "--out", "new"), "'middle_left'"),
        (("capture", "plate-session", "front_left", "--plate", "no.toml", "--out", "new"), "no.toml"),
        (("capture", "plate-session", "front_left", "--shots", "no", "--out", "new"), "recorded shots"),
        (("capture", "gauge-session", "--out", "new"), "the rigs of the gauge frame"),
        (("capture", "gauge-session", "--out", "full"), "full"),
    ],
)
def test_bad_input_is_told_with_what_to_do_and_leaves_nothing(
    arguments: tuple[object, ...],
    told: str,
    truewheel: Truewheel,
    bare: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    ended = truewheel(*arguments, "--config", bare)
    assert ended.status == 2, ended
    assert told in ended.err
    assert not (tmp_path / "new").exists()


def test_a_projector_that_is_not_there_is_a_station_fault_that_names_its_rig(
    truewheel: Truewheel, bare: Path
) -> None:
    heads = 'heads = ["head_1", "head_2"'
    change(bare, heads, f"projector = {{ serial = {{ port = '/dev/no-such-port' }} }}\n{heads}")
    shown = truewheel("camera", "show", "front_left", "--config", bare)
    assert shown.status == 3
    assert "projector of front_left: expected to open /dev/no-such-port" in shown.err
