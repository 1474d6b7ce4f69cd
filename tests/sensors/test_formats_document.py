"""`docs/formats.md` against the program: its examples are read, its tables name every field."""

import json
import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from sensors.formats import SCHEMAS, check_shot_matches, read_calibration, read_shot, read_truth

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


def fields_in(model):
    for name, field in model.model_fields.items():
        yield field.alias or name
        for candidate in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                yield from fields_in(candidate)


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_field_is_explained_in_the_table_of_its_file(name):
    start = re.search(rf"^## {name.capitalize()}\b", DOCUMENT, re.MULTILINE).start()
    section = DOCUMENT[start:].split("\n## ")[0]
    cells = re.findall(r"^\| (`[^|]*) \|", section, re.MULTILINE)
    explained = {field for cell in cells for field in re.findall(r"`([^`]+)`", cell)}
    expected = set(fields_in(SCHEMAS[name]))
    assert expected <= explained, f"not explained: {expected - explained}"
    values = {"brown", "division"}  # the table of camera models lists values, not fields
    assert explained - expected <= values, f"explained, but not in the file: {explained - expected}"
