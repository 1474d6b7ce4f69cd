"""Descriptions of plates without ring marks: what is read, and what is refused with its field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment.errors import ConfigurationError, FormatError
from alignment.imaging import Orientation, PatternKind, YAxis
from sensors.formats import PatternPlateFile, dump_json, read_plate, validate
from sensors.formats.plate import certified, describe_plate
from sensors.formats.plate_session import PlateSessionFile

PLATES = Path(__file__).parents[2] / "configs" / "plates"
CIRCLES: dict[str, Any] = {
    "schema": "truewheel.pattern-plate/1", "name": "dots", "pattern": "circles",
    "columns": (0, 9), "rows": (0, 8),
    "pitch_x_mm": 10.0, "pitch_y_mm": 12.0, "mark_diameter_mm": 5.0, "orientation": "stage",
}  # fmt: skip
BOARD = {key: CIRCLES[key] for key in ("schema", "name", "columns", "rows", "pitch_x_mm")} | {
    "pitch_y_mm": 10.0
}
CHESSBOARD = BOARD | {"pattern": "chessboard"}
CHARUCO = BOARD | {"pattern": "charuco", "dictionary": "DICT_4X4_50", "marker_mm": 7.0}

LARGE_CHARUCO = CHARUCO | {"dictionary": "DICT_4X4_250"}


def toml_of(fields: dict[str, Any]) -> str:
    plain = {key: value for key, value in fields.items() if not isinstance(value, dict)}
    text = "\n".join(f"{key} = {json.dumps(value)}" for key, value in plain.items()) + "\n"
    for key, table in fields.items():
        if isinstance(table, dict):
            text += f"[{key}]\n" + "\n".join(f"{name} = {json.dumps(v)}" for name, v in table.items()) + "\n"
    return text


def written(folder: Path, fields: dict[str, Any]) -> Path:
    path = folder / "plate.toml"
    path.write_text(toml_of(fields), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", ["charuco", "circles", "asymmetric_circles", "chessboard"])
def test_the_plates_that_are_delivered_are_read(name: str) -> None:
    described = read_plate(PLATES / f"{name}.toml")
    plate = described.plate
    assert plate.pattern.kind is PatternKind(name)
    assert (plate.mark_radius_mm == 0.0) == plate.pattern.has_squares
    assert np.allclose(plate.points[:, :2], plate.indices * described.file.grid_pitch_mm)
    assert np.allclose(plate.sigma_mm, 0.01 / 3**0.5)


def test_pitch_differs_in_x_and_y_and_corners_are_none_of_the_marks(tmp_path: Path) -> None:
    corner = {"index": [9, 8], "look": "missing"}
    plate = read_plate(written(tmp_path, CIRCLES | {"orientation": "corner", "corner": corner})).plate
    assert len(plate.points) == 89
    assert plate.points[-1].tolist() == [80.0, 96.0, 0.0]
    ring = corner | {"look": "ring", "diameter_mm": 2.0}
    plate = read_plate(written(tmp_path, CIRCLES | {"orientation": "corner", "corner": ring})).plate
    assert plate.indices[plate.hollow].tolist() == [[9, 8]]
    assert plate.hollow_radius_mm == 1.0


def test_heads_may_hold_the_plate_another_way(tmp_path: Path) -> None:
    text = toml_of(CIRCLES | {"orientation": "upright"})
    path = tmp_path / "plate.toml"
    path.write_text(text + '[[directions]]\nheads = ["head_2"]\ny_axis = "left"\n', encoding="utf-8")
    described = read_plate(path)
    assert described.seen_by("head_1").pattern.y_axis is YAxis.UP
    assert described.seen_by("head_2").pattern.y_axis is YAxis.LEFT
    assert described.plate.pattern.orientation is Orientation.UPRIGHT


def test_a_certificate_states_the_marks_of_any_plate(tmp_path: Path) -> None:
    file = validate(PatternPlateFile, CHESSBOARD, file=None)
    plain = describe_plate(file).plate
    points = plain.points + np.array([0.01, -0.02, 0.03])
    made = certified(file, points, np.full(len(points), 0.001), "c.csv")
    assert made.certificate is not None
    (tmp_path / "c.csv").write_bytes(made.certificate)
    read = read_plate(written(tmp_path, CHESSBOARD | {"certificate": "c.csv"}))
    assert np.array_equal(read.plate.points, points)
    assert read.plate.pattern.kind is PatternKind.CHESSBOARD


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        (CIRCLES | {"orientation": "marks"}, "field 'orientation': expected 'corner', 'stage' or 'upright'"),
        (CHESSBOARD | {"columns": (0, 8)}, "the pattern looks the same turned by 180°"),
        (CHESSBOARD | {"columns": (0, 7), "rows": (0, 7)}, "turned by 180° and 90° and 270°"),
        (CIRCLES | {"pattern": "asymmetric_circles", "columns": (0, 8), "orientation": "marks"}, "by 180°"),
        (CIRCLES | {"orientation": "corner"}, "field 'corner': expected a value"),
        (
            CIRCLES
            | {"columns": (0, 8), "orientation": "corner", "corner": {"index": [4, 4], "look": "missing"}},
            "field 'corner.index': expected a place that no turn",
        ),
        (
            CIRCLES | {"orientation": "corner", "corner": {"index": [10, 0], "look": "missing"}},
            "corner.index",
        ),
        (
            CIRCLES
            | {"orientation": "corner", "corner": {"index": [0, 0], "look": "large", "diameter_mm": 6.0}},
            "field 'corner.diameter_mm': expected at least 6.75",
        ),
        (
            CIRCLES | {"orientation": "corner", "corner": {"index": [0, 0], "look": "ring"}},
            "field 'corner.diameter_mm'",
        ),
        (CIRCLES | {"mark_diameter_mm": 10.0}, "field 'mark_diameter_mm': expected less than the distance"),
        (CIRCLES | {"pitch_y_mm": 26.0}, "expected one at most 2.5 times the other"),
        ({k: v for k, v in CIRCLES.items() if k != "mark_diameter_mm"}, "field 'mark_diameter_mm'"),
        (CIRCLES | {"first_square": "light"}, "field 'first_square': expected nothing here"),
        (CIRCLES | {"marker_mm": 3.0}, "field 'marker_mm': expected nothing here"),
        (CHESSBOARD | {"mark_diameter_mm": 3.0}, "field 'mark_diameter_mm': expected nothing here"),
        (CHESSBOARD | {"rows": (3, 3)}, "field 'rows': expected the first index, then the last one"),
        (CHARUCO | {"dictionary": "DICT_3X3"}, "field 'dictionary': expected a dictionary of OpenCV's"),
        (CHARUCO | {"first_id": 1}, "field 'first_id': expected 55 markers"),
        (LARGE_CHARUCO | {"marker_mm": 10.0}, "field 'marker_mm': expected less than"),
        (LARGE_CHARUCO | {"pitch_y_mm": 11.0}, "field 'pitch_y_mm': expected squares"),
        (CHESSBOARD | {"pich": 1}, "no such field"),
        (CHESSBOARD | {"pattern": "dots"}, "field 'pattern'"),
    ],
)
def test_a_wrong_description_is_refused_with_its_field(
    tmp_path: Path, fields: dict[str, Any], expected: str
) -> None:
    path = written(tmp_path, fields)
    with pytest.raises(ConfigurationError) as caught:
        read_plate(path)
    assert expected in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_described_plate_reads_back_the_same() -> None:
    for fields in (CIRCLES, CHESSBOARD, LARGE_CHARUCO):
        file = validate(PatternPlateFile, fields, file=None)
        assert validate(PatternPlateFile, json.loads(dump_json(file)), file=None) == file


def test_a_session_holds_either_kind_of_plate_and_names_the_wrong_field() -> None:
    session = {
        "schema": "truewheel.plate-session/1", "rig": "r", "side": "left", "time_utc": "2026-03-01T12:00:00Z",
        "plate": CHESSBOARD, "heads": [{"name": "h", "left": {"width": 64, "height": 48}}],
        "views": [{"name": "a", "stage_mm": None, "images": [{"head": "h", "left": "a.png"}]}],
    }  # fmt: skip
    found = validate(PlateSessionFile, session, file="session.json")
    assert isinstance(found.plate, PatternPlateFile)
    with pytest.raises(FormatError, match=r"field 'plate\.pitch_x_mm': expected a number from 0\.1 upward"):
        validate(PlateSessionFile, session | {"plate": CHESSBOARD | {"pitch_x_mm": 0}}, file="session.json")
    with pytest.raises(FormatError, match=r"Did you mean 'first_square'\?"):
        validate(PlateSessionFile, session | {"plate": CHESSBOARD | {"first_squar": "dark"}}, file="s.json")
    with pytest.raises(FormatError, match=r"field 'plate': expected a table whose schema is"):
        validate(
            PlateSessionFile, session | {"plate": CHESSBOARD | {"schema": "truewheel.plate/9"}}, file="s"
        )
