"""Plates and gauge frames: what their files say, and one clear error for each thing that is wrong."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import ConfigurationError, FormatError
from alignment.values import nominal_vehicle_from_rig
from sensors.formats import read_gauge_frame, read_plate
from sensors.formats.plate import PlateFile, certified

PLATES = Path(__file__).parents[2] / "configs" / "plates"
HEAD = (PLATES / "head.toml").read_text(encoding="utf-8")
WITH_CERTIFICATE = HEAD.replace("[[hollow", 'certificate = "c.csv"\n\n[[hollow')


def small_plate(tmp_path: Path, text: str = "", certificate: str | bytes | None = None) -> Path:
    path = tmp_path / "plate.toml"
    path.write_text(text or WITH_CERTIFICATE.replace("5]", "2]").replace("-5,", "-2,"), encoding="utf-8")
    if certificate is not None:
        content = certificate if isinstance(certificate, bytes) else certificate.encode()
        (tmp_path / "c.csv").write_bytes(content)
    return path


def certificate_lines() -> list[str]:
    grid = [(i, j) for j in range(-2, 3) for i in range(-2, 3)]
    return ["i,j,x_mm,y_mm,sigma_mm", *(f"{i},{j},{15 * i + 0.001},{15 * j},0.002" for i, j in grid)]


def test_the_plate_of_one_head_has_121_marks_around_its_origin() -> None:
    plate = read_plate(PLATES / "head.toml").plate
    assert len(plate.points) == 121
    assert plate.points.mean(axis=0) == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(plate.points[:, 0]) == 150.0
    assert plate.indices[plate.hollow].tolist() == [[-1, 0], [1, 0], [-1, 1]]
    assert (plate.mark_radius_mm, plate.hollow_radius_mm) == (4.0, 1.5)
    assert plate.sigma_mm[0] == pytest.approx(0.01 / np.sqrt(3))


def test_the_plate_of_a_rig_has_ring_marks_of_its_own_for_each_head() -> None:
    described = read_plate(PLATES / "rig.toml")
    assert len(described.plate.points) == 45 * 45
    assert described.plate.hollow.sum() == 9
    # Nothing says which head sees which: the arrangements differ.
    assert (described.seen_by("head_2").hollow == described.plate.hollow).all()
    for angle, group in zip((90, 210, 330), described.file.hollow_marks, strict=True):
        centre = 266 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        assert np.abs(15 * np.array(group.marks).mean(axis=0) - centre).max() < 15


def test_the_gauge_frame_has_a_plate_for_each_rig_with_axes_along_the_rigs() -> None:
    frame = read_gauge_frame(PLATES / "gauge.toml")
    assert list(frame.plates) == ["front_left", "front_right", "rear_left", "rear_right"]
    for rig, gauge in frame.plates.items():
        side = "left" if rig.endswith("left") else "right"
        assert np.array_equal(gauge.vehicle_from_plate.rotation, nominal_vehicle_from_rig(side).rotation)
        forward, left, _ = gauge.vehicle_from_plate.translation
        assert (forward > 0) == rig.startswith("front")
        assert (left > 0) == (side == "left")
        assert len(gauge.plate.plate.points) == 45 * 45


def test_heads_that_see_groups_arranged_alike_are_told_apart_by_name(tmp_path: Path) -> None:
    text = (
        HEAD + '\nheads = ["a"]\n\n[[hollow_marks]]\nmarks = [[1, 3], [3, 3], [1, 4]]\nheads = ["b", "c"]\n'
    )
    described = read_plate(small_plate(tmp_path, text))
    assert described.plate.hollow.sum() == 6
    assert described.plate.indices[described.seen_by("c").hollow].tolist() == [[1, 3], [3, 3], [1, 4]]
    assert described.seen_by("d").hollow.sum() == 0
    assert (described.seen_by("a").points == described.plate.points).all()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("columns = [-5, 5]", "columns = [5, -5]", "field 'columns': expected the first index"),
        ("columns = [-5, 5]", "columns = 11", "field 'columns'"),
        ("rows = [-5, 5]", "rows = [-5, 1000]", "field 'rows[1]': expected a number of at most 200"),
        ("rows = [-5, 5]", "rows = [-5.5, 5]", "field 'rows[0]'"),
        ("pitch_mm = 15.0", "pitch_mm = 0", "field 'pitch_mm': expected a number from 0.5 upward"),
        ("pitch_mm = 15.0", "pitch = 15.0", "field 'pitch_mm': expected a value"),
        ("pitch_mm = 15.0", "pitch_mm = nan", "pitch_mm"),
        ("pitch_mm = 15.0", "pitch_mm = 7.5", "field 'mark_diameter_mm': expected more than the hollow"),
        ("hollow_diameter_mm = 3.0", "hollow_diameter_mm = 9", "field 'mark_diameter_mm'"),
        ("[1, 0]", "[1, 7]", "field 'hollow_marks': expected marks of the plate, found [1, 7]"),
        ("[1, 0]", "[-1, 0]", "field 'hollow_marks': expected each mark once, found [-1, 0] twice"),
        ("[1, 0]", "[0, 0]", "field 'hollow_marks[0].marks': expected an arrangement that no turn"),
        ("[-1, 1]", "[3, 0]", "a symmetrical one"),
        (", [-1, 1]]", "]", "field 'hollow_marks[0].marks': expected at least 3 items, found 2"),
        ("[[hollow_marks]]\n", "[[rings]]\n", "field 'hollow_marks'"),
        ("plate/1", "plate/2", "field 'schema'"),
        ("name =", "name", "an error"),
    ],
)
def test_a_wrong_description_is_named_with_file_and_field(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    assert old in HEAD
    path = small_plate(tmp_path, HEAD.replace(old, new))
    with pytest.raises(ConfigurationError) as caught:
        read_plate(path)
    assert expected in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "marks",
    ["[[1, 3], [3, 3], [1, 4]]", "[[1, 1], [1, 3], [0, 1]]", "[[2, 2], [4, 2], [4, 3]]"],
    ids=["shifted", "turned", "mirrored"],
)
def test_groups_arranged_alike_that_one_head_may_see_are_refused(tmp_path: Path, marks: str) -> None:
    with pytest.raises(ConfigurationError, match="another arrangement than group 0") as caught:
        read_plate(small_plate(tmp_path, f"{HEAD}\n[[hollow_marks]]\nmarks = {marks}\n"))
    assert caught.value.field == "hollow_marks[1].marks"
    assert "heads" in str(caught.value.cure)


def test_a_description_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"none\.toml.*no such file"):
        read_plate(tmp_path / "none.toml")


def test_a_certificate_moves_the_marks(tmp_path: Path) -> None:
    lines = certificate_lines()
    text = "# Certificate 4711\r\n" + "\r\n".join([lines[0], "", *reversed(lines[1:])]) + "\r\n"
    plate = read_plate(small_plate(tmp_path, certificate="\ufeff" + text)).plate
    assert plate.points[0].tolist() == [-29.999, -30.0, 0.0]
    assert plate.sigma_mm[0] == pytest.approx([0.002, 0.002, 0.01 / np.sqrt(3)])


def test_a_certificate_with_heights_moves_the_marks_off_the_plane(tmp_path: Path) -> None:
    bare = read_plate(small_plate(tmp_path, HEAD))
    points = bare.plate.points + np.random.default_rng(1).normal(0, 0.01, bare.plate.points.shape)
    sigma = np.full(len(points), 1 / 3000)
    made = certified(bare.file, points, sigma, "c.csv")
    assert np.array_equal(made.plate.points, points)
    assert made.certificate is not None
    read = read_plate(small_plate(tmp_path, WITH_CERTIFICATE, made.certificate))
    assert read.file == made.file
    assert np.array_equal(read.plate.points, points)
    assert (read.plate.sigma_mm == 1 / 3000).all()


@pytest.mark.parametrize(
    ("line", "to", "expected"),
    [
        (0, "i,j,x,y,sigma", "line 1': expected a header with the columns i, j, x_mm, y_mm, sigma_mm"),
        (3, "0,-2,0,-30", "line 4': expected 5 cells, as the header has, found 4"),
        (3, "0,-2,zero,-30,0.002", "line 4, column x_mm': expected a number, found 'zero'"),
        (3, "0.0,-2,0,-30,0.002", "line 4, column i': expected a whole number, found '0.0'"),
        (3, "0,-2,0,-30,0", "line 4, column sigma_mm': expected a number above 0"),
        (3, "0,-2,0,nan,0.002", "line 4, column y_mm': expected a finite number, found 'nan'"),
        (3, "0,-2,0,-3.0,0.002", "line 4': expected mark [0, -2] near its place in the grid, found 27 mm"),
        (3, "1,-2,15,-30,0.002", "line 5': expected each mark of the plate once"),
        (3, "7,-2,105,-30,0.002", "found none of its marks: [7, -2]"),
        (3, "", "expected all 25 marks of the plate, found 1 missing, the first [0, -2]"),
        (3, '0,-2,"0,-30,0.002', "CSV"),
    ],
)
def test_an_unreadable_certificate_is_named_with_its_line(
    tmp_path: Path, line: int, to: str, expected: str
) -> None:
    lines = certificate_lines()
    lines[line] = to
    with pytest.raises(FormatError) as caught:
        read_plate(small_plate(tmp_path, certificate="\n".join(lines)))
    assert expected in str(caught.value)
    assert "c.csv" in str(caught.value)


def test_a_misspelt_column_of_a_certificate_is_no_column_to_pass_over(tmp_path: Path) -> None:
    lines = certificate_lines()
    heights = [f"{lines[0]},z_um", *(f"{line},3" for line in lines[1:])]
    with pytest.raises(FormatError, match=r"line 1': expected no other columns than .*z_mm, found 'z_um'"):
        read_plate(small_plate(tmp_path, certificate="\n".join(heights)))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("head", ["# Kalibrierschein für Platte 7; gemessen, bei 20 °C", "", "sep=;"])
def test_a_certificate_as_a_german_excel_saves_it(
    tmp_path: Path, encoding: str, ends: str, head: str
) -> None:
    """One reader for all tables: semicolons and a decimal comma were refused in a certificate alone."""
    plain = read_plate(small_plate(tmp_path, certificate="\n".join(certificate_lines()))).plate
    lines = [line.replace(",", ";").replace(".", ",") for line in certificate_lines()]
    content = ends.join([head, *lines]).encode(encoding)
    plate = read_plate(small_plate(tmp_path, certificate=content)).plate
    assert np.array_equal(plate.points, plain.points)
    assert np.array_equal(plate.sigma_mm, plain.sigma_mm)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"\x89PNG\r\n\x1a\n\x00\x00"])
def test_a_certificate_that_is_another_kind_of_file_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(FormatError, match=r"c\.csv"):
        read_plate(small_plate(tmp_path, certificate=content))


def test_a_missing_certificate_is_named(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"c\.csv: expected the certificate of a plate, found no such file"):
        read_plate(small_plate(tmp_path))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('rig = "front_right"', 'rig = "front_left"', "one plate for each rig"),
        ("[0.0, 1.0, 0.0]]", "[0.0, 1.1, 0.0]]", "vehicle_from_plate"),
        ('plate_file = "rig.toml"', 'plate_file = "lost.toml"', "lost.toml"),
        ("angle_sigma_arcmin = 0.05", "angle_sigma_arcmin = 0", "angle_sigma_arcmin"),
    ],
)
def test_a_wrong_gauge_frame_is_named(tmp_path: Path, old: str, new: str, expected: str) -> None:
    text = (PLATES / "gauge.toml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "rig.toml").write_text(HEAD, encoding="utf-8")
    (tmp_path / "gauge.toml").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=re.escape(expected)):
        read_gauge_frame(tmp_path / "gauge.toml")


def test_every_arrangement_counts_whatever_the_order_of_its_marks() -> None:
    file = read_plate(PLATES / "head.toml").file
    turned = replace_marks(file, tuple(reversed(file.hollow_marks[0].marks)))
    assert (turned.hollow() == file.hollow()).all()


def replace_marks(file: PlateFile, marks: tuple[tuple[int, int], ...]) -> PlateFile:
    group = file.hollow_marks[0].model_copy(update={"marks": marks})
    return file.model_copy(update={"hollow_marks": (group,)})
