"""`docs/formats.md` against the program: its examples are read, its tables name every field."""

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel

from sensors.formats import (
    SCHEMAS,
    check_shot_matches,
    read_calibration,
    read_calibration_input,
    read_gauge_frame,
    read_plate,
    read_plate_session,
    read_shot,
    read_truth,
    read_vehicle_facts,
    read_vehicle_truth,
    write_image,
)

CONFIGS = Path(__file__).parents[2] / "configs"
DOCUMENT = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
JSON_BLOCKS = {
    json.loads(block)["schema"].split(".")[1].split("/")[0]: block
    for block in re.findall(r"```json\n(.*?)```", DOCUMENT, re.DOTALL)
}
(PYTHON_BLOCK,) = re.findall(r"```python\n(.*?)```", DOCUMENT, re.DOTALL)


def example(name, tmp_path):
    path = tmp_path / f"{name}.json"
    path.write_text(JSON_BLOCKS[name], encoding="utf-8")
    return path


def test_the_program_of_the_document_writes_a_shot_that_matches_its_calibration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(PYTHON_BLOCK, "docs/formats.md", "exec"), {})
    calibration = read_calibration(example("calibration", tmp_path))
    shot = read_shot(tmp_path / "shot_0001", calibration)
    check_shot_matches(shot, calibration)
    assert shot.images[0].left.shape == (1024, 1280)

    # The listed shot.json describes those images too.
    (tmp_path / "shot_0001" / "shot.json").write_text(JSON_BLOCKS["shot"], encoding="utf-8")
    listed = read_shot(tmp_path / "shot_0001", calibration)
    assert listed.heads[0].left.device_time_s == 81.204117


def test_the_pose_of_the_example_looks_from_outboard_at_the_wheel(tmp_path):
    calibration = read_calibration(example("calibration", tmp_path))
    for camera in calibration.heads[0].cameras:
        optical_axis = camera.rig_from_camera.apply_vectors([0.0, 0.0, 1.0])
        assert camera.rig_from_camera.translation[2] > 0 > optical_axis[2]


def test_the_truth_of_the_document_is_read(tmp_path):
    assert read_truth(example("truth", tmp_path)).camber_deg == -1.0


def test_the_vehicle_of_the_document_and_its_truth_are_read(tmp_path):
    assert read_vehicle_facts(example("vehicle", tmp_path)).rigs["rear_left"] == "rear_left"
    assert read_vehicle_truth(example("vehicle-truth", tmp_path)).wheels["front_left"].toe_deg == 0.1


def test_the_calibration_input_of_the_document_is_read(tmp_path):
    data = read_calibration_input(example("calibration-input", tmp_path))
    assert data.cameras == (("head_1", "left"),)
    assert data.views[0].observations["head_1", "left"].pixels.shape == (4, 2)


def test_the_plate_of_the_document_is_read_with_its_certificate(tmp_path):
    toml, _, _ = re.findall(r"```toml\n(.*?)```", DOCUMENT, re.DOTALL)
    (certificate,) = re.findall(r"```csv\n(.*?)```", DOCUMENT, re.DOTALL)
    listed = {tuple(line.split(",")[:2]) for line in certificate.splitlines()[2:]}
    grid = itertools.product(range(-5, 6), repeat=2)
    others = [f"{i},{j},{15.0 * i},{15.0 * j},0.0005" for i, j in grid if (str(i), str(j)) not in listed]
    (tmp_path / "head.toml").write_text(toml, encoding="utf-8")
    (tmp_path / "head_certificate.csv").write_text(certificate + "\n".join(others) + "\n", encoding="utf-8")
    plate = read_plate(tmp_path / "head.toml").plate
    assert plate.points[0].tolist() == [-74.9983, -75.0021, 0.0]
    assert plate.sigma_mm[0, 0] == 0.0005 < plate.sigma_mm[0, 2]


def test_the_pattern_plate_of_the_document_is_read(tmp_path):
    _, toml, _ = re.findall(r"```toml\n(.*?)```", DOCUMENT, re.DOTALL)
    (tmp_path / "dots.toml").write_text(toml, encoding="utf-8")
    plate = read_plate(tmp_path / "dots.toml").plate
    assert len(plate.points) == 100
    assert plate.points[-1].tolist() == [90.0, 90.0, 0.0]


def test_the_session_of_the_document_is_read(tmp_path):
    session_json = json.loads(
        example("plate-session", tmp_path).rename(tmp_path / "session.json").read_text()
    )
    for view in session_json["views"]:
        for side in ("left", "right"):
            write_image(tmp_path / view["images"][0][side], np.zeros((1024, 1280), np.uint8))
    session = read_plate_session(tmp_path)
    assert session.sizes["head_1", "left"] == (1280, 1024)
    assert [view.stage_mm is None for view in session.views] == [False, True]


def test_the_gauge_frame_of_the_document_is_read(tmp_path):
    _, _, toml = re.findall(r"```toml\n(.*?)```", DOCUMENT, re.DOTALL)
    path = CONFIGS / "plates" / "rig.toml"
    (tmp_path / "gauge.toml").write_text(toml.replace('"rig.toml"', json.dumps(str(path))), encoding="utf-8")
    seen = read_gauge_frame(tmp_path / "gauge.toml").plates["front_left"]
    assert seen.vehicle_from_plate.apply([0.0, 0.0, 1.0]).tolist() == [1350.0, 801.0, 0.0]


def fields_in(model):
    for name, field in model.model_fields.items():
        yield field.alias or name
        for candidate in (field.annotation, *getattr(field.annotation, "__args__", ())):
            # A file that holds another kind of file is explained there.
            if (
                isinstance(candidate, type)
                and issubclass(candidate, BaseModel)
                and candidate not in SCHEMAS.values()
            ):
                yield from fields_in(candidate)


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_field_is_explained_in_the_table_of_its_file(name):
    start = re.search(rf"^## {name.capitalize().replace('-', ' ')}\b", DOCUMENT, re.MULTILINE).start()
    section = DOCUMENT[start:].split("\n## ")[0]
    cells = re.findall(r"^\| (`[^|]*) \|", section, re.MULTILINE)
    explained = {field for cell in cells for field in re.findall(r"`([^`]+)`", cell)}
    expected = set(fields_in(SCHEMAS[name]))
    assert expected <= explained, f"not explained: {expected - explained}"
    values = {"brown", "division"}  # the table of camera models lists values, not fields
    assert explained - expected <= values, f"explained, but not in the file: {explained - expected}"
