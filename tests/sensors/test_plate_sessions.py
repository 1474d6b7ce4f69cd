"""Plate sessions: exact round trips, and one clear error for each kind of bad session."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment.errors import ConfigurationError, FormatError
from alignment.geometry.transforms import RigidTransform
from sensors.formats import (
    PlateSession,
    PlateTruth,
    SessionView,
    read_plate,
    read_plate_session,
    read_plate_truth,
    write_image,
    write_plate_session,
    write_plate_truth,
)
from sensors.formats.plate import certified
from tests import path_traced_plate
from tests.sensors.samples import HEIGHT, TIME, WIDTH

PLATES = Path(__file__).parents[2] / "configs" / "plates"
CAMERAS = [(head, side) for head in ("head_1", "head_2") for side in ("left", "right")]


def session(depth: type = np.uint8) -> PlateSession:
    rng = np.random.default_rng(3)

    def images(keys: list[Any]) -> dict[Any, Any]:
        top = np.iinfo(depth).max
        return {key: rng.integers(0, top, (HEIGHT, WIDTH), dtype=depth, endpoint=True) for key in keys}

    return PlateSession(
        rig="front_left",
        side="left",
        time_utc=TIME,
        plate=read_plate(PLATES / "head.toml"),
        sizes=dict.fromkeys(CAMERAS, (WIDTH, HEIGHT)),
        views=(
            SessionView("z0", np.array([0.0, 0.0, 0.0]), images(CAMERAS)),
            SessionView("z-30", np.array([7.5, 1 / 3, -30.0]), images(CAMERAS)),
            SessionView("by_hand", None, images(CAMERAS[:1] + CAMERAS[3:])),
        ),
        stage_tolerance_mm=0.02,
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_plate_session(tmp_path / "session", session())
    return tmp_path / "session"


def assert_same(one: PlateSession, other: PlateSession) -> None:
    for name in ("rig", "side", "time_utc", "sizes", "stage_tolerance_mm", "heads"):
        assert getattr(one, name) == getattr(other, name)
    assert one.plate.file.model_copy(update={"certificate": None}) == other.plate.file.model_copy(
        update={"certificate": None}
    )
    assert np.array_equal(one.plate.plate.points, other.plate.plate.points)
    assert len(one.views) == len(other.views)
    for a, b in zip(one.views, other.views, strict=True):
        assert a.name == b.name
        assert (a.stage_mm is None) == (b.stage_mm is None)
        assert a.stage_mm is None or np.array_equal(a.stage_mm, b.stage_mm)
        assert list(a.images) == list(b.images)
        for key, image in a.images.items():
            assert image.dtype == b.images[key].dtype
            assert np.array_equal(image, b.images[key])


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_a_session_reads_back_exactly(tmp_path: Path, depth: type) -> None:
    write_plate_session(tmp_path / "session", session(depth))
    read = read_plate_session(tmp_path / "session")
    assert_same(read, session(depth))
    assert read.stage_sigma_mm == pytest.approx(0.02 / np.sqrt(3))
    assert read.heads == ("head_1", "head_2")


def test_a_session_carries_the_certificate_of_its_plate(tmp_path: Path) -> None:
    made = session()
    points = made.plate.plate.points + 1 / 300
    made = replace(made, plate=certified(made.plate.file, points, np.full(121, 0.002), "of_the_maker.csv"))
    write_plate_session(tmp_path / "session", made)
    assert_same(read_plate_session(tmp_path / "session"), made)


def test_a_session_may_name_a_plate_file(folder: Path) -> None:
    def refer(data: dict[str, Any]) -> None:
        data["plate"] = None
        data["plate_file"] = "../head.toml"

    change(folder, refer)
    (folder.parent / "head.toml").write_bytes((PLATES / "head.toml").read_bytes())
    assert_same(read_plate_session(folder), session())
    (folder.parent / "head.toml").unlink()
    with pytest.raises(ConfigurationError, match=r"head\.toml.*no such file"):
        read_plate_session(folder)


def test_the_path_traced_plate_comes_into_the_format(tmp_path: Path, published_data: Path) -> None:
    made = path_traced_plate.session(published_data / "path_traced")
    write_plate_session(tmp_path / "session", made)
    read = read_plate_session(tmp_path / "session")
    assert_same(read, made)
    assert [view.stage_mm.tolist() for view in read.views] == [[0, 0, -30], [0, 0, 0], [0, 0, 30]]
    assert sum(len(view.images) for view in read.views) == 18
    # Its groups of ring marks are arranged alike: the description says which head sees which.
    assert read.plate.plate.hollow.sum() == 9
    plate = read.plate.seen_by("head_2")
    assert plate.indices[plate.hollow].tolist() == [[-15, -9], [-13, -9], [-15, -8]]


def change(folder: Path, how: Callable[[dict[str, Any]], object]) -> None:
    path = folder / "session.json"
    data = json.loads(path.read_text())
    how(data)
    path.write_text(json.dumps(data))


def refused(folder: Path, *parts: str) -> None:
    with pytest.raises(FormatError) as caught:
        read_plate_session(folder)
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("how", "parts"),
    [
        (lambda d: d.pop("rig"), ["field 'rig': expected a value"]),
        (lambda d: d.update(rigs=1), ["field 'rigs': expected no such field", "Did you mean 'rig'?"]),
        (lambda d: d.update(schema="truewheel.plate-session/2"), ["field 'schema'"]),
        (lambda d: d.update(side="front"), ["field 'side'"]),
        (lambda d: d.update(time_utc="2026-03-01T12:00:00"), ["field 'time_utc'"]),
        (lambda d: d.update(plate_file="x.toml"), ["field 'plate': expected either", "found both"]),
        (lambda d: d.update(plate=None), ["field 'plate': expected either", "found neither"]),
        (lambda d: d["plate"].update(pitch_mm=-1), ["field 'plate.pitch_mm'"]),
        (lambda d: d["plate"].update(certificate="lost.csv"), ["lost.csv", "no such file"]),
        (lambda d: d.update(stage_tolerance_mm=0), ["field 'stage_tolerance_mm'"]),
        (lambda d: d["heads"][1].update(name="head_1"), ["field 'heads'", "'head_1' twice"]),
        (lambda d: d["heads"][1].update(left=None, right=None), ["field 'heads[1].left'"]),
        (lambda d: d["heads"].pop(), ["field 'views[0].images[1].left'", "one of head_2 left"]),
        (lambda d: d["heads"].append({"name": "head_3", "left": d["heads"][0]["left"]}), ["head_3 left"]),
        (lambda d: d["heads"][0]["left"].update(width=0), ["field 'heads[0].left.width'"]),
        (lambda d: d.update(views=[]), ["field 'views': expected at least 1 items, found 0"]),
        (lambda d: d["views"][1].update(name="z0"), ["field 'views'", "'z0' twice"]),
        (lambda d: d["views"][0].pop("stage_mm"), ["field 'views[0].stage_mm': expected a value"]),
        (lambda d: d["views"][0].update(stage_mm=[0, 0]), ["field 'views[0].stage_mm"]),
        (lambda d: d["views"][0].update(stage_mm=[0, 0, 1e9]), ["field 'views[0].stage_mm[2]'"]),
        (lambda d: d["views"][0]["images"][1].update(head="head_1"), ["field 'views[0].images'", "twice"]),
        (
            lambda d: d["views"][0]["images"][0].update(left="z-30_head_1_left.png"),
            ["images with different names, found 'z-30_head_1_left.png' twice"],
        ),
        (lambda d: d["views"][0]["images"][0].update(left="../a.png"), ["field 'views[0].images[0].left'"]),
        (lambda d: d["heads"][0]["left"].update(width=41), ["z0_head_1_left.png", "41 × 30", "40 × 30"]),
    ],
)
def test_a_wrong_field_is_named(
    folder: Path, how: Callable[[dict[str, Any]], object], parts: list[str]
) -> None:
    change(folder, how)
    refused(folder, *parts)


def test_a_missing_view_image_is_named_with_its_view(folder: Path) -> None:
    (folder / "z-30_head_2_left.png").unlink()
    refused(folder, "z-30_head_2_left.png", "expected an image of view 'z-30', found no such file")


def test_a_cut_image_is_named(folder: Path) -> None:
    path = folder / "z0_head_2_right.png"
    path.write_bytes(path.read_bytes()[:-200])
    refused(folder, "z0_head_2_right.png", "cut short")


def test_an_image_of_another_size_is_named(folder: Path) -> None:
    (folder / "by_hand_head_1_left.png").unlink()
    write_image(folder / "by_hand_head_1_left.png", np.zeros((HEIGHT, WIDTH + 2), np.uint8))
    refused(folder, "by_hand_head_1_left.png", "expected an image of 40 × 30 pixels", "found 42 × 30")


def test_an_unreadable_certificate_is_named(folder: Path) -> None:
    change(folder, lambda data: data["plate"].update(certificate="c.csv"))
    (folder / "c.csv").write_text("Mark;X;Y\n1;2;3\n", encoding="utf-8")
    refused(folder, "c.csv", "line 1", "expected a header with the columns")


def test_what_is_no_session_is_named(tmp_path: Path, folder: Path) -> None:
    refused(tmp_path / "none", "none", "expected a folder with session.json", "no such folder")
    refused(tmp_path, "session.json", "no such file")
    refused(folder / "session.json", "found a file")
    (folder / "session.json").write_text('{"schema": ', encoding="utf-8")
    refused(folder, "session.json", "line 1")


def test_a_recorded_session_is_never_replaced(folder: Path) -> None:
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(FormatError, match="a new or empty folder"):
        write_plate_session(folder, session())
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_session_that_the_format_cannot_hold_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="stage_tolerance_mm"):
        write_plate_session(tmp_path / "session", replace(session(), stage_tolerance_mm=-1.0))
    assert not list(tmp_path.iterdir())


def test_the_truth_of_a_session_reads_back_exactly(tmp_path: Path) -> None:
    plate = read_plate(PLATES / "head.toml").plate
    rng = np.random.default_rng(1)
    pose = RigidTransform.from_rotvec(rng.normal(size=3), rng.normal(size=3))
    truth = PlateTruth(7, plate.indices, plate.points + rng.normal(size=(121, 3)), {"z0": pose})
    write_plate_truth(tmp_path / "truth.json", truth)
    read = read_plate_truth(tmp_path / "truth.json")
    assert read.seed == 7
    assert np.array_equal(read.indices, truth.indices)
    assert np.array_equal(read.points, truth.points)
    assert list(read.rig_from_plate) == ["z0"]
    assert np.array_equal(read.rig_from_plate["z0"].rotation, pose.rotation)
    assert np.array_equal(read.rig_from_plate["z0"].translation, pose.translation)
