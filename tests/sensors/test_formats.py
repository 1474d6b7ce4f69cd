"""Recorded formats: exact round trips, and one clear error for each kind of bad file."""

import contextlib
import errno
import json
import os
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from alignment.errors import ConfigurationError, FormatError
from alignment.geometry.cameras import PosedCamera
from alignment.values import Placing
from sensors.formats import (
    SCHEMAS,
    WheelTruth,
    check_shot_matches,
    files,
    read_calibration,
    read_calibration_file,
    read_shot,
    read_truth,
    write_calibration,
    write_shot,
    write_truth,
)
from sensors.formats.validation import StrictModel, dump_json, load_json, validate
from tests.sensors.samples import HEIGHT, TIME, WIDTH, calibration, shot

TRUTH = WheelTruth("right", 42, -1.2, 0.3, -1.25, 1 / 3, 77.0, 0.4, 300.0, (1.0, -2.5, 1 / 7))
HEADS = ("head_1", "head_2", "head_3")
NUMBERS_OF_LENS = ("width", "height", "fx", "fy", "cx", "cy")


@pytest.fixture
def calibration_file(tmp_path):
    path = tmp_path / "calibration.json"
    write_calibration(path, calibration(), method="simulated, true", created_utc=TIME)
    return path


@pytest.fixture
def shot_folder(tmp_path):
    write_shot(tmp_path / "shot", shot())
    return tmp_path / "shot"


@pytest.fixture
def truth_file(tmp_path):
    write_truth(tmp_path / "truth.json", TRUTH)
    return tmp_path / "truth.json"


def change(path, *keys, to):
    """Set the value at `keys` of a JSON file; `to` may be `del`."""
    data = json.loads(path.read_text())
    place = data
    for key in keys[:-1]:
        place = place[key]
    if to is del_:
        del place[keys[-1]]
    else:
        place[keys[-1]] = to
    path.write_text(json.dumps(data))


def del_():
    """Mark a key to be removed by `change`."""


def refused(act, *parts):
    with pytest.raises(FormatError) as caught:
        act()
    for part in parts:
        assert part in str(caught.value)
    return caught.value


# Round trips


def test_a_calibration_reads_back_to_the_last_bit(calibration_file):
    wrote, read = calibration(), read_calibration(calibration_file)
    assert (read.id, read.rig, read.side) == (wrote.id, wrote.rig, wrote.side)
    assert read.vehicle_from_rig_measured is wrote.vehicle_from_rig_measured
    assert (read.vehicle_from_rig.rotation == wrote.vehicle_from_rig.rotation).all()
    assert (read.covariance == wrote.covariance).all()
    for a, b in zip(read.heads, wrote.heads, strict=True):
        assert a.name == b.name
        for x, y in zip(a.cameras, b.cameras, strict=True):
            assert x.model == y.model
            assert (x.rig_from_camera.rotation == y.rig_from_camera.rotation).all()
            assert (x.rig_from_camera.translation == y.rig_from_camera.translation).all()


@pytest.mark.parametrize("side", ["left", "right"])
def test_every_number_of_a_lens_is_in_the_file(tmp_path, side):
    """Skewed pixels must not come back square, nor any other number at its default."""
    bare = calibration(covariance=False)
    head = bare.heads[1]
    camera = getattr(head, side)
    lens = replace(
        camera.model, skew=0.75, **{name: getattr(camera.model, name) + 1 for name in NUMBERS_OF_LENS}
    )
    skewed = replace(head, **{side: PosedCamera(lens, camera.rig_from_camera)})
    wrote = replace(bare, heads=(bare.heads[0], skewed, bare.heads[2]))
    write_calibration(tmp_path / "c.json", wrote, method="plate", created_utc=TIME)
    read = getattr(read_calibration(tmp_path / "c.json").heads[1], side)
    assert read.model == lens
    points = np.array([[20.0, 30.0, 400.0], [-50.0, 10.0, 500.0]])
    assert (read.model.project(points) == lens.project(points)).all()
    assert np.abs(read.model.project(points) - replace(lens, skew=0.0).project(points)).max() > 0.01


def test_a_measured_pose_of_the_rig_has_its_rows_in_the_covariance(tmp_path):
    bare = calibration(covariance=False)
    size = len(bare.parameter_names)
    covariance = np.diag(np.arange(1.0, size + 7.0))
    wrote = replace(bare, vehicle_from_rig_measured=True, covariance=covariance)
    path = tmp_path / "c.json"
    write_calibration(path, wrote, method="gauge", created_utc=datetime(2026, 3, 1, tzinfo=UTC))
    read = read_calibration(path)
    assert read.parameter_names[-6:] == tuple(
        f"vehicle_from_rig.{name}" for name in ("rx", "ry", "rz", "x_mm", "y_mm", "z_mm")
    )
    assert (read.covariance == covariance).all()

    # A file that leaves these rows out takes the pose as exact.
    data = json.loads(path.read_text())
    data["covariance"]["parameters"] = data["covariance"]["parameters"][:-6]
    data["covariance"]["matrix"] = [row[:-6] for row in data["covariance"]["matrix"][:-6]]
    path.write_text(json.dumps(data))
    exact = read_calibration(path).covariance
    assert (exact[:size, :size] == covariance[:size, :size]).all()
    assert (exact[size:] == 0.0).all()
    assert (exact[:, size:] == 0.0).all()


def placed(**changes):
    shared = np.diag([1e-5, 1e-5, 1e-4, 0.5, 0.5, 0.5, 1e-5]) ** 2
    pose = np.diag([1e-5, 2e-5, 3e-5, 0.02, 0.02, 0.02]) ** 2 + 1e-13
    return Placing(
        **({"view": "gauge, seen 2026-11-30", "pose_covariance": pose, "shared_covariance": shared} | changes)
    )


def test_what_a_view_of_the_gauge_frame_leaves_unknown_reads_back_to_the_last_bit(tmp_path):
    """No file said it: a station took its rigs for independent of each other."""
    known = replace(calibration(covariance=False), vehicle_from_rig_measured=True, placing=placed())
    write_calibration(tmp_path / "c.json", known, method="gauge", created_utc=TIME)
    found = read_calibration(tmp_path / "c.json").placing
    assert found.view == known.placing.view
    np.testing.assert_array_equal(found.pose_covariance, known.placing.pose_covariance)
    np.testing.assert_array_equal(found.shared_covariance, known.placing.shared_covariance)


def test_a_calibration_of_an_earlier_program_says_nothing_of_its_placing(calibration_file):
    content = json.loads(calibration_file.read_text())
    content.pop("placing", None)
    calibration_file.write_text(json.dumps(content))
    assert read_calibration(calibration_file).placing is None


@pytest.mark.parametrize(
    ("field", "rows"),
    [
        ("pose_covariance", np.eye(5)),
        ("shared_covariance", np.eye(6)),
        ("shared_covariance", -np.eye(7)),
        ("pose_covariance", np.triu(np.ones((6, 6)))),
    ],
)
def test_a_placing_that_is_no_covariance_is_one_clear_error(calibration_file, field, rows):
    content = json.loads(calibration_file.read_text())
    good = {"view": "v", "pose_covariance": np.eye(6).tolist(), "shared_covariance": np.eye(7).tolist()}
    content["placing"] = good | {field: rows.tolist()}
    calibration_file.write_text(json.dumps(content))
    with pytest.raises(FormatError, match=rf"placing.*{field}"):
        read_calibration(calibration_file)


def test_a_calibration_file_says_when_and_how_it_was_made(tmp_path):
    path = tmp_path / "made" / "on the way" / "c.json"
    noon_in_berlin = datetime(2026, 3, 1, 13, 0, tzinfo=timezone(timedelta(hours=1)))
    write_calibration(path, calibration(covariance=False), method="plate", created_utc=noon_in_berlin)
    found = read_calibration_file(path)
    assert found.method == "plate"
    assert found.created_utc == datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
    assert '"created_utc": "2026-03-01T12:00:00Z"' in path.read_text()
    assert found.calibration().covariance is None


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_a_shot_reads_back_to_the_last_bit(tmp_path, depth):
    wrote = shot(depth=depth)
    write_shot(tmp_path / "s", wrote)
    read = read_shot(tmp_path / "s", calibration())
    assert (read.rig, read.time_utc) == (wrote.rig, wrote.time_utc)
    assert [h.name for h in read.heads] == [h.name for h in wrote.heads]
    for a, b in zip(read.frames, wrote.frames, strict=True):
        assert a.image.dtype == depth
        assert (a.image == b.image).all()
        assert (a.camera, a.trigger_counter, a.device_time_s, a.host_time_s, a.exposure_ms) == (
            b.camera,
            b.trigger_counter,
            b.device_time_s,
            b.host_time_s,
            b.exposure_ms,
        )


def test_a_truth_reads_back_to_the_last_bit(truth_file):
    assert read_truth(truth_file) == TRUTH


@given(st.floats(-45, 45), st.floats(-1000, 1000), st.integers(0, 2**64 - 1))
@settings(max_examples=50, deadline=None)
def test_every_number_survives_writing(angle, millimetres, seed):
    truth = replace(TRUTH, camber_deg=angle, centre_mm=(millimetres, 0.0, -millimetres), seed=seed)
    data = {"schema": "truewheel.truth/1", **truth.__dict__}
    model = validate(SCHEMAS["truth"], data, file=None)
    back = validate(SCHEMAS["truth"], json.loads(dump_json(model)), file=None)
    assert (back.camber_deg, back.centre_mm, back.seed) == (angle, truth.centre_mm, seed)


# Bad files: one sentence that names file, field, what was expected and what was found


def test_missing_file_and_folder(tmp_path):
    refused(
        lambda: read_calibration(tmp_path / "no.json"), "no.json: expected a calibration, found no such file"
    )
    refused(lambda: read_calibration(tmp_path), "expected a calibration, found a folder")
    refused(
        lambda: read_shot(tmp_path / "no"), "no: expected a folder with shot.json", "found no such folder"
    )
    refused(lambda: read_shot(tmp_path), "shot.json: expected the description of a shot, found no such file")
    (tmp_path / "file").touch()
    refused(lambda: read_shot(tmp_path / "file"), "found a file")


def test_an_error_of_syntax_is_named_with_its_line(calibration_file):
    lines = calibration_file.read_text().splitlines()
    lines[2] = lines[2].replace(",", "")
    calibration_file.write_text("\n".join(lines))
    refused(
        lambda: read_calibration(calibration_file),
        "calibration.json: expected",
        "an error in line 4, column 3",
    )


@pytest.mark.parametrize("content", [b"", b"\xff\xfe{}", b"[" * 100_000, b"[1, 2]", b"null", b"3", b'"text"'])
def test_what_is_no_calibration_at_all(calibration_file, content):
    calibration_file.write_bytes(content)
    refused(lambda: read_calibration(calibration_file), "calibration.json: expected")


def test_a_byte_order_mark_is_no_error(calibration_file):
    calibration_file.write_bytes(b"\xef\xbb\xbf" + calibration_file.read_bytes())
    assert read_calibration(calibration_file).rig == "front_left"


def test_a_key_twice_is_refused_not_the_last_one_taken(truth_file):
    truth_file.write_text(truth_file.read_text().replace('"toe_deg": 0.3', '"toe_deg": 0.3,\n"toe_deg": 3.0'))
    refused(lambda: read_truth(truth_file), "field 'toe_deg': expected each key once, found the key twice")


FX = ("heads", 1, "left", "fx")
ROTATION = ("heads", 2, "right", "rig_from_camera", "rotation")


@pytest.mark.parametrize(
    ("keys", "to", "parts"),
    [
        (FX, del_, ["field 'heads[1].left.fx': expected a value, found none"]),
        (FX, -3.5, ["field 'heads[1].left.fx': expected a number above 0, found -3.5"]),
        (FX, 1e300, ["field 'heads[1].left.fx': expected a number of at most 1e+07, found 1e+300"]),
        (FX, "90", ["field 'heads[1].left.fx': expected a valid number, found '90'"]),
        (FX, float("nan"), ["field 'heads[1].left.fx'", "nan"]),
        (FX, float("inf"), ["field 'heads[1].left.fx'", "inf"]),
        (FX, None, ["field 'heads[1].left.fx': expected a valid number, found null"]),
        (("heads", 0, "left", "width"), 40.0, ["field 'heads[0].left.width': expected a valid integer"]),
        (("heads", 0, "left", "width"), 0, ["field 'heads[0].left.width'", "from 1 upward"]),
        (
            ("heads", 0, "left", "coefficients"),
            [0.1, 0.2],
            ["coefficients': expected 5 or 8 or 12 or 14 numbers"],
        ),
        (("heads", 0, "left", "coefficients"), [], ["coefficients': expected at least 1 items, found 0"]),
        (("heads", 0, "left", "model"), "fisheye", ["heads[0].left.model': expected 'division' or 'brown'"]),
        (
            ("heads", 0, "left", "fxx"),
            1.0,
            ["'heads[0].left.fxx': expected no such field", "Did you mean 'fx'?"],
        ),
        (("colour",), 1.0, ["field 'colour': expected no such field", "Known here: schema, id, rig, side"]),
        (
            ROTATION,
            [[1, 0, 0], [0, 1, 0], [0, 0, 0.9]],
            ["heads[2].right.rig_from_camera.rotation", "orthonormal"],
        ),
        (
            ROTATION,
            [[1, 0, 0], [0, 1, 0], [0, 0, -1]],
            ["heads[2].right.rig_from_camera.rotation", "orthonormal"],
        ),
        (ROTATION, [[1, 0, 0], [0, 1, 0]], ["heads[2].right.rig_from_camera.rotation"]),
        (("vehicle_from_rig", "translation_mm"), [0, 0], ["field 'vehicle_from_rig.translation_mm[2]'"]),
        (("vehicle_from_rig", "measured"), 1, ["field 'vehicle_from_rig.measured'"]),
        (("side",), "middle", ["field 'side': expected 'left' or 'right', found 'middle'"]),
        (("heads",), [], ["field 'heads': expected at least 1 items, found 0"]),
        (("heads",), {}, ["field 'heads'", "found a table"]),
        (("heads", 1, "name"), "head_1", ["field 'heads': expected heads with different names"]),
        (("rig",), "../left", ["field 'rig': expected text of the form"]),
        (("id",), "", ["field 'id': expected at least 1 characters"]),
        (("created_utc",), "2026-03-01T12:00:00", ["field 'created_utc': expected a time with its zone"]),
        (("created_utc",), "yesterday", ["field 'created_utc'", "'yesterday'"]),
        (
            ("covariance", "matrix"),
            [[1.0]],
            ["field 'covariance.matrix': expected 63 × 63".replace("63", "60")],
        ),
        (("covariance", "matrix", 0, 1), 1e9, ["field 'covariance.matrix': expected a symmetric matrix"]),
        (("covariance", "matrix", 0, 0), -1.0, ["field 'covariance.matrix': expected a symmetric matrix"]),
        (("covariance", "parameters", 3), "head_1.left.x", ["parameters[3]': expected 'head_1.left.cx_mm'"]),
        (
            ("schema",),
            "truewheel.calibration/2",
            ["field 'schema': expected 'truewheel.calibration/1'", "version"],
        ),
        (("schema",), del_, ["field 'schema': expected a value"]),
    ],
)
def test_a_calibration_with_one_mistake(calibration_file, keys, to, parts):
    size = len(calibration().parameter_names)
    change(calibration_file, *keys, to=to)
    parts = [part.replace("60 × 60", f"{size} × {size}") for part in parts]
    error = refused(lambda: read_calibration(calibration_file), str(calibration_file), *parts)
    assert error.file == str(calibration_file)
    assert "\n" not in str(error)


def test_all_mistakes_of_a_file_come_in_one_message(calibration_file):
    change(calibration_file, *FX, to=-1)
    change(calibration_file, "heads", 0, "left", "fyy", to=2)
    change(calibration_file, "side", to=del_)
    error = refused(
        lambda: read_calibration(calibration_file),
        "'heads[1].left.fx': expected a number above 0, found -1",
        "'heads[0].left.fyy': expected no such field, found 2 (Did you mean 'fy'?)",
        "'side': expected a value, found none",
    )
    assert error.field == "side"


def test_a_file_of_another_kind_is_told_by_its_schema_alone(calibration_file, truth_file):
    error = refused(
        lambda: read_calibration(truth_file), "expected 'truewheel.calibration/1', found 'truewheel.truth/1'"
    )
    assert error.field == "schema"
    assert "Also" not in str(error)


@pytest.mark.parametrize(
    ("keys", "to", "parts"),
    [
        (
            ("heads", 0, "left", "image"),
            "../a.png",
            ["field 'heads[0].left.image': expected text of the form"],
        ),
        (("heads", 0, "left", "image"), "/etc/a.png", ["field 'heads[0].left.image'"]),
        (("heads", 0, "left", "image"), "a.jpg", ["field 'heads[0].left.image'"]),
        (
            ("heads", 0, "left", "image"),
            "gone.png",
            ["gone.png: expected an 8- or 16-bit image", "no such file"],
        ),
        (("heads", 0, "left", "image"), "head_2_left.png", ["field 'heads'", "'head_2_left.png' twice"]),
        (
            ("heads", 1, "right", "trigger_counter"),
            2,
            ["'heads[1].right.trigger_counter': expected 1, the trigger"],
        ),
        (("heads", 1, "right", "trigger_counter"), 0, ["'heads[1].right.trigger_counter'"]),
        (
            ("heads", 1, "right", "exposure_ms"),
            0,
            ["'heads[1].right.exposure_ms': expected a number above 0"],
        ),
        (
            ("heads", 2, "name"),
            "head_1",
            ["field 'heads': expected heads with different names, found 'head_1' twice"],
        ),
        (("heads", 2, "right"), del_, ["field 'heads[2].right': expected a value, found none"]),
        (("time_utc",), "2026-03-01", ["field 'time_utc'"]),
        (("rig",), 7, ["field 'rig'", "found 7"]),
        (("exposure",), 7, ["field 'exposure': expected no such field"]),
        (
            ("schema",),
            "truewheel.shot/9",
            ["expected 'truewheel.shot/1' or 'truewheel.shot/2', found 'truewheel.shot/9'"],
        ),
    ],
)
def test_a_shot_with_one_mistake(shot_folder, keys, to, parts):
    change(shot_folder / "shot.json", *keys, to=to)
    refused(lambda: read_shot(shot_folder), str(shot_folder), *parts)


@pytest.mark.parametrize(
    ("key", "to"),
    [
        ("camber_deg", 90.0),
        ("seed", -1),
        ("seed", 1.5),
        ("side", "up"),
        ("centre_mm", [0, 0]),
        ("runout_mm", -1),
    ],
)
def test_a_truth_with_one_mistake(truth_file, key, to):
    change(truth_file, key, to=to)
    refused(lambda: read_truth(truth_file), str(truth_file), f"field '{key}")


@given(st.data())
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_stands_in_a_calibration_only_a_format_error_comes_out(tmp_path, data):
    path = tmp_path / "calibration.json"
    write_calibration(path, calibration(heads=("head_1",)), method="m", created_utc=TIME)
    tree = json.loads(path.read_text())
    place, key = tree, data.draw(st.sampled_from(sorted(tree)))
    while isinstance(place[key], dict | list) and place[key] and data.draw(st.booleans()):
        place = place[key]
        key = data.draw(st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place))))
    scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(st.characters(codec=None))
    place[key] = data.draw(
        st.recursive(scalars, lambda s: st.lists(s) | st.dictionaries(st.text(), s), max_leaves=4)
    )
    path.write_text(json.dumps(tree))
    # Anything but a FormatError fails the test; its message must be printable.
    with contextlib.suppress(FormatError):
        try:
            read_calibration(path)
        except FormatError as error:
            print(str(error).encode())
            raise


def test_numbers_too_large_for_any_type_are_refused(calibration_file):
    text = calibration_file.read_text()
    calibration_file.write_text(text.replace('"width": 40', '"width": 1' + "0" * 5000, 1))
    refused(lambda: read_calibration(calibration_file), "calibration.json")
    calibration_file.write_text(text.replace('"width": 40', '"width": 1' + "0" * 400, 1))
    refused(lambda: read_calibration(calibration_file), "field 'heads[0].left.width'")


# Shot against calibration


def test_a_shot_of_another_rig(shot_folder):
    other = calibration(rig="rear_right")
    parts = "'rig': expected 'rear_right', which calibration 2026-03-01/front_left is of, found 'front_left'"
    error = refused(lambda: read_shot(shot_folder, other), str(shot_folder / "shot.json"), parts)
    assert error.field == "rig"
    refused(lambda: check_shot_matches(shot(), other), parts)


@pytest.mark.parametrize("heads", [("head_2", "head_1", "head_3"), ("head_1", "head_2"), (*HEADS, "head_4")])
def test_a_shot_with_other_heads(shot_folder, heads):
    other = calibration(heads=heads)
    parts = f"field 'heads': expected the heads {', '.join(heads)} in this order"
    refused(lambda: read_shot(shot_folder, other), parts, "found head_1, head_2, head_3")
    refused(lambda: check_shot_matches(shot(), other, "here"), "here, " + parts)


def test_a_shot_of_another_size_names_the_image(tmp_path):
    turned = shot(shape=(WIDTH, HEIGHT))
    write_shot(tmp_path / "turned", turned)
    refused(
        lambda: read_shot(tmp_path / "turned", calibration()),
        "head_1_left.png: expected an image of 40 × 30 pixels, found 30 × 40",
    )
    refused(
        lambda: check_shot_matches(turned, calibration()),
        "'head_1.left': expected an image of 40 × 30",
        "30 × 40",
    )
    assert read_shot(tmp_path / "turned").images[0].left.shape == (WIDTH, HEIGHT)


@pytest.mark.parametrize("head", [0, 2])
@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("width", "height"), [(WIDTH, HEIGHT + 1), (WIDTH, HEIGHT - 1), (WIDTH + 1, HEIGHT), (WIDTH - 1, HEIGHT)]
)
def test_one_row_or_column_of_one_image_makes_another_size(tmp_path, head, side, width, height):
    """A cropped image of the right width must not be measured, nor one of the right height."""
    whole = shot()
    frame = getattr(whole.heads[head], side)
    cut = replace(frame, image=np.zeros((height, width), np.uint8))
    heads = list(whole.heads)
    heads[head] = replace(heads[head], **{side: cut})
    wrong = replace(whole, heads=tuple(heads))
    sizes = f"expected an image of {WIDTH} × {HEIGHT} pixels", f"found {width} × {height}"
    error = refused(lambda: check_shot_matches(wrong, calibration()), *sizes)
    assert error.field == f"{HEADS[head]}.{side}"
    write_shot(tmp_path / "s", wrong)
    refused(lambda: read_shot(tmp_path / "s", calibration()), f"{HEADS[head]}_{side}.png", *sizes)


def test_a_shot_that_matches_passes(shot_folder):
    check_shot_matches(read_shot(shot_folder), calibration())


# Writing


def test_what_is_recorded_is_never_replaced(shot_folder):
    before = sorted((p.name, p.read_bytes()) for p in shot_folder.iterdir())
    refused(lambda: write_shot(shot_folder, shot(trigger=2)), str(shot_folder), "a folder with files in it")
    assert sorted((p.name, p.read_bytes()) for p in shot_folder.iterdir()) == before


def test_an_empty_folder_is_filled(tmp_path):
    (tmp_path / "s").mkdir()
    write_shot(tmp_path / "s", shot())
    assert len(list((tmp_path / "s").iterdir())) == 7


def test_a_relative_folder_is_one_below_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_shot("s", shot())
    write_truth("truth.json", TRUTH)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["s", "truth.json"]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_disk_that_fails_while_writing_leaves_what_was_there(
    calibration_file, shot_folder, tmp_path, monkeypatch, step
):
    before = calibration_file.read_bytes()
    names = sorted(p.name for p in tmp_path.iterdir())

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(*((os, "fsync") if step == "fsync" else (Path, "replace")), full)
    again = calibration(covariance=False)
    refused(
        lambda: write_calibration(calibration_file, again, method="m", created_utc=TIME),
        "calibration.json: expected a file that can be written, found No space left on device",
    )
    refused(
        lambda: write_shot(tmp_path / "new", shot()), "new: expected a folder that can be written", "No space"
    )
    monkeypatch.undo()
    assert calibration_file.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == names


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_read_only_folder(tmp_path):
    tmp_path.chmod(0o500)
    try:
        refused(lambda: write_shot(tmp_path / "s", shot()), "Permission denied")
        refused(lambda: write_truth(tmp_path / "t.json", TRUTH), "Permission denied")
    finally:
        tmp_path.chmod(0o700)


def test_a_read_only_file_system(tmp_path, monkeypatch):
    def read_only(self, *_, **__):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "open", read_only)
    monkeypatch.setattr(Path, "mkdir", read_only)
    refused(lambda: write_shot(tmp_path / "s", shot()), "Read-only file system", "make this one writable")
    refused(lambda: write_truth(tmp_path / "t.json", TRUTH), "t.json: expected", "Read-only file system")


def test_below_a_file_there_is_no_folder(calibration_file):
    refused(lambda: write_truth(calibration_file / "t.json", TRUTH), "expected a file that can be written")
    refused(lambda: write_shot(calibration_file / "s", shot()), "expected a folder that can be written")
    refused(lambda: write_shot(calibration_file, shot()), "found a file")


def test_a_value_out_of_the_format_is_refused_before_anything_is_written(tmp_path):
    wrong = replace(calibration(), rig="front left")
    refused(
        lambda: write_calibration(tmp_path / "c.json", wrong, method="m", created_utc=TIME), "field 'rig'"
    )
    naive = datetime(2026, 3, 1)
    refused(
        lambda: write_calibration(tmp_path / "c.json", calibration(), method="m", created_utc=naive),
        "'created_utc'",
    )
    refused(lambda: write_shot(tmp_path / "s", shot(rig="a/b")), "field 'rig'")
    colour = shot()
    object.__setattr__(colour.heads[0].left, "image", np.zeros((3, 4, 3), np.uint8))
    refused(lambda: write_shot(tmp_path / "s", colour), "shape (3, 4, 3)")
    refused(lambda: write_truth(tmp_path / "t.json", replace(TRUTH, toe_deg=float("nan"))), "field 'toe_deg'")
    assert list(tmp_path.iterdir()) == []


def test_a_process_killed_while_writing_leaves_no_shot(tmp_path):
    """Death between two files of a shot: no folder of that name, so nothing can take the half for a whole."""
    code = """
import os, sys
from tests.sensors.samples import shot
from sensors.formats import files, write_shot
real, count = files._write_durably, 0
def dies(path, content):
    global count
    count += 1
    if count == 4:
        os._exit(9)
    real(path, content)
files._write_durably = dies
write_shot(sys.argv[1], shot())
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "s")], env=environment, check=False, capture_output=True
    )
    assert done.returncode == 9, done.stderr
    assert not (tmp_path / "s").exists()
    write_shot(tmp_path / "s", shot())
    assert len(read_shot(tmp_path / "s").frames) == 6


def test_files_reach_the_disk_before_they_get_their_name(tmp_path, monkeypatch):
    events = []
    fsync, replace_path = os.fsync, Path.replace
    monkeypatch.setattr(files.os, "fsync", lambda handle: (events.append("fsync"), fsync(handle))[1])
    monkeypatch.setattr(Path, "replace", lambda a, b: (events.append("rename"), replace_path(a, b))[1])
    write_shot(tmp_path / "s", shot())
    assert events == ["fsync"] * 8 + ["rename", "fsync"]


# The models


def models_in(model):
    yield model
    for field in model.model_fields.values():
        for candidate in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                yield from models_in(candidate)


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_schema_describes_and_bounds_every_field(name):
    schema = SCHEMAS[name].model_json_schema()
    versions = schema["properties"]["schema"]
    known = ["truewheel.shot/1", "truewheel.shot/2"] if name == "shot" else [f"truewheel.{name}/1"]
    assert versions.get("enum", [versions.get("const")]) == known

    def numbers_are_bounded(node, where):
        if isinstance(node, dict):
            if node.get("type") in ("number", "integer"):
                assert {"minimum", "exclusiveMinimum"} & node.keys(), where
                assert {"maximum", "exclusiveMaximum"} & node.keys(), where
            for key, value in node.items():
                numbers_are_bounded(value, f"{where}.{key}")
        elif isinstance(node, list):
            for value in node:
                numbers_are_bounded(value, where)

    numbers_are_bounded(schema, name)
    for model in models_in(SCHEMAS[name]):
        assert issubclass(model, StrictModel)
        assert model.__doc__
        for key, field in model.model_fields.items():
            assert field.description, f"{model.__name__}.{key}"


def test_validate_serves_other_files_and_other_errors_too():
    class Station(StrictModel):
        rigs: tuple[str, ...]
        started: datetime

    found = validate(
        Station, {"rigs": ["a"], "started": datetime(2026, 3, 1, tzinfo=UTC)}, file="station.toml"
    )
    assert found.rigs == ("a",)
    with pytest.raises(
        ConfigurationError, match=r"station\.toml, field 'rigz': .* Did you mean 'rigs'\?|'rigs'"
    ):
        validate(Station, {"rigz": []}, file="station.toml", error=ConfigurationError)
    with pytest.raises(ConfigurationError, match="plain values"):
        validate(Station, {"rigs": object()}, file="station.toml", error=ConfigurationError)


def test_load_json_names_what_the_file_should_be(tmp_path):
    refused(lambda: load_json(tmp_path / "x", "a plate"), "expected a plate, found no such file")
