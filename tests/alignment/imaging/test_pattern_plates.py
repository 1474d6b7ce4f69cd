"""Plates that people own: found, numbered right or refused, located as well as our own marks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.imaging.numbering import Numberings
from alignment.imaging.pattern_plates import number_marks
from alignment.imaging.plate import MarkObservations, Plate
from alignment.imaging.plate_grid import observe_plate
from alignment.imaging.plate_refusal import PlateRefusal, PlateRefusalCode
from tests.alignment.imaging.boards import PATTERNS, board, image_of, looking_at, projected
from tests.alignment.imaging.plates import plate as ringed

REAL = Path(__file__).parents[4] / "shared" / "data" / "foreign_plates"


def seen(image, plate: Plate, **arguments) -> MarkObservations:
    result = observe_plate(image, plate, **arguments)
    assert isinstance(result, MarkObservations), result
    return result


def refused(image, plate: Plate) -> PlateRefusal:
    result = observe_plate(image, plate)
    assert isinstance(result, PlateRefusal)
    return result


def assert_numbered_right(found: MarkObservations, plate: Plate, camera, within_px: float = 2.0) -> None:
    off = found.pixels - projected(plate, camera)[found.marks]
    assert np.abs(off).max() < within_px


@pytest.mark.parametrize("name", PATTERNS)
def test_every_mark_is_found_numbered_right_and_as_exact_as_our_own(name: str) -> None:
    plate = board(name)
    camera = looking_at(plate, tilt=20.0, azimuth=40.0, turn=15.0, bend=0.0)
    found = seen(image_of(plate, camera), plate)
    assert len(found.marks) == len(plate.points)
    assert_numbered_right(found, plate, camera)
    off = found.pixels - projected(plate, camera)[found.marks]
    own = ringed(9, 8)
    own_camera = looking_at(own, tilt=20.0, azimuth=40.0, turn=15.0, bend=0.0)
    ours = seen(image_of(own, own_camera), own)
    own_off = ours.pixels - projected(own, own_camera)[ours.marks]
    assert np.sqrt(np.mean(off**2)) < 1.5 * np.sqrt(np.mean(own_off**2))
    assert np.sqrt(np.mean(off[:, 0] ** 2 / found.covariance[:, 0, 0])) < 1.5


@pytest.mark.parametrize("name", ["circles", "white", "asymmetric", "chessboard", "charuco"])
@pytest.mark.parametrize(
    "view",
    [
        {"tilt": 50.0, "azimuth": 25.0},
        {"tilt": 50.0, "azimuth": 90.0},
        {"tilt": 15.0, "azimuth": 10.0, "turn": 40.0, "bend": -0.35, "distance": 380.0},
        {"tilt": 10.0, "fall_off": 0.85, "top": (-0.9, 0.8)},
        {"tilt": 25.0, "azimuth": 200.0, "blur": 2.5},
    ],
)
def test_tilt_bent_lenses_uneven_light_and_blur_are_borne(name: str, view: dict) -> None:
    plate = board(name)
    look = {key: view[key] for key in ("blur", "fall_off", "top") if key in view}
    camera = looking_at(plate, **{key: value for key, value in view.items() if key not in look})
    found = seen(image_of(plate, camera, **look), plate, corrected=False)
    assert len(found.marks) >= 0.9 * len(plate.points)
    assert_numbered_right(found, plate, camera)


def test_marks_of_five_pixels_are_found() -> None:
    plate = board("circles", mark_diameter_mm=4.0, pitch_x_mm=12.0, pitch_y_mm=12.0)
    camera = looking_at(plate, tilt=15.0, distance=360.0)
    found = seen(image_of(plate, camera), plate)
    assert len(found.marks) == len(plate.points)
    assert_numbered_right(found, plate, camera)


@pytest.mark.parametrize("name", ["circles", "white", "wide", "asymmetric", "chessboard"])
def test_a_plate_that_is_seen_in_part_is_refused_and_never_guessed(name: str) -> None:
    plate = board(name)
    camera = looking_at(plate, aside=(60.0, 0.0))
    result = refused(image_of(plate, camera), plate)
    if name == "chessboard":
        assert result.code is PlateRefusalCode.NO_MARKS
    else:
        assert result.code is PlateRefusalCode.AMBIGUOUS
        assert "part" in result.reason


def test_a_part_of_a_charuco_board_is_numbered_by_its_markers() -> None:
    plate = board("charuco")
    camera = looking_at(plate, aside=(60.0, 40.0), turn=130.0)
    found = seen(image_of(plate, camera), plate)
    assert 20 < len(found.marks) < len(plate.points)
    assert_numbered_right(found, plate, camera)


@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0, -100.0])
@pytest.mark.parametrize("name", ["asymmetric", "chessboard", "charuco"])
def test_patterns_that_tell_are_numbered_whichever_way_they_lie(name: str, turn: float) -> None:
    plate = board(name)
    camera = looking_at(plate, turn=turn, distance=340.0)
    found = seen(image_of(plate, camera), plate)
    assert len(found.marks) == len(plate.points)
    assert_numbered_right(found, plate, camera)


@pytest.mark.parametrize(
    "corner",
    [
        {"index": (0, 0), "look": "missing"},
        {"index": (8, 0), "look": "ring", "diameter_mm": 3.0},
        {"index": (0, 7), "look": "large", "diameter_mm": 12.0},
    ],
)
@pytest.mark.parametrize("turn", [20.0, 200.0])
def test_a_corner_mark_tells_which_way_round_a_grid_lies(corner: dict, turn: float) -> None:
    plate = board("circles", orientation="corner", corner=corner)
    camera = looking_at(plate, tilt=20.0, turn=turn, distance=330.0)
    found = seen(image_of(plate, camera), plate)
    assert len(found.marks) == len(plate.points)
    assert_numbered_right(found, plate, camera)


@pytest.mark.parametrize("look", ["ring", "large"])
def test_a_grid_without_the_corner_mark_of_its_file_is_refused(look: str) -> None:
    corner = {"index": (0, 0), "look": look, "diameter_mm": 3.0 if look == "ring" else 12.0}
    plate = board("circles", orientation="corner", corner=corner)
    without = board("circles")
    result = refused(image_of(without, looking_at(without)), plate)
    assert result.code in (PlateRefusalCode.AMBIGUOUS, PlateRefusalCode.NOT_THIS_PLATE)


@pytest.mark.parametrize(("y_axis", "turn"), [("up", 5.0), ("left", 90.0), ("down", 170.0), ("right", -80.0)])
def test_a_grid_is_numbered_by_the_way_it_is_held(y_axis: str, turn: float) -> None:
    plate = board("circles", columns=(0, 7))
    plate = replace(plate, pattern=replace(plate.pattern, y_axis=y_axis))
    camera = looking_at(plate, tilt=10.0, turn=-turn)
    assert_numbered_right(seen(image_of(plate, camera), plate), plate, camera)


def test_a_grid_half_way_between_two_ways_round_is_refused() -> None:
    plate = board("circles", columns=(0, 7))
    result = refused(image_of(plate, looking_at(plate, turn=45.0)), plate)
    assert result.code is PlateRefusalCode.AMBIGUOUS
    assert "half-way" in result.reason


def test_one_image_of_a_grid_that_the_stage_must_tell_of_is_refused() -> None:
    plate = board("circles", orientation="stage")
    image = image_of(plate, looking_at(plate))
    assert "looks the same turned by 180°" in refused(image, plate).reason
    ways = number_marks(image, plate)
    assert isinstance(ways, Numberings)
    assert len(ways) == 2


@pytest.mark.parametrize("name", ["circles", "chessboard"])
def test_two_plates_alike_in_one_image_are_refused(name: str) -> None:
    plate = board(name)
    one = image_of(plate, looking_at(plate, distance=420.0))
    other = image_of(plate, looking_at(plate, distance=420.0, turn=15.0))
    result = refused(np.hstack([one, other]), plate)
    assert result.code is PlateRefusalCode.AMBIGUOUS
    assert "two" in result.reason


def test_another_plate_in_the_image_does_not_matter() -> None:
    plate = board("circles")
    other = board("circles", mark_diameter_mm=5.0, columns=(0, 4), rows=(0, 3))
    camera = looking_at(plate, distance=420.0)
    beside = image_of(other, looking_at(other, distance=420.0))
    found = seen(np.hstack([image_of(plate, camera), beside]), plate)
    assert_numbered_right(found, plate, camera)
    board_ = board("charuco")
    third = board("charuco", dictionary="DICT_5X5_100")
    camera = looking_at(board_, distance=420.0)
    beside = image_of(third, looking_at(third, distance=420.0))
    found = seen(np.hstack([image_of(board_, camera), beside]), board_)
    assert_numbered_right(found, board_, camera)


def test_clutter_in_the_background_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    for name in ("circles", "chessboard", "charuco", "asymmetric"):
        plate = board(name)
        camera = looking_at(plate, distance=400.0, turn=3.0)
        image = image_of(plate, camera)
        behind = cv2.GaussianBlur(rng.uniform(0, 255, image.shape).astype(np.float32), (0, 0), 3.0)
        behind = np.clip((behind - 127.0) * 6.0 + 110.0, 0, 255).astype(np.uint8)
        for _ in range(40):
            at = tuple(int(v) for v in rng.uniform(0, image.shape[1], 2))
            cv2.circle(behind, at, int(rng.uniform(4, 20)), int(rng.uniform(0, 255)), -1)
        on_plate = cv2.erode(
            (image_of(plate, camera, seed=None, mark=0.7) > 40).astype(np.uint8), np.ones((5, 5))
        )
        found = seen(np.where(on_plate > 0, image, behind), plate)
        assert len(found.marks) >= 0.9 * len(plate.points)
        assert_numbered_right(found, plate, camera)


def test_a_spot_on_the_grid_beside_the_plate_is_no_mark_of_it() -> None:
    """With a column hidden on the other side the marks would have fitted the plate, one place off."""
    plate = board("circles", columns=(0, 7))
    camera = looking_at(plate, distance=360.0)
    image = image_of(plate, camera)
    beside = camera.project(np.array([[-15.0, 45.0, 0.0]]))[0]
    x, y = (int(v) for v in np.rint(beside))
    cv2.circle(image, (x, y), 18, 180, -1)
    cv2.circle(image, (x, y), 10, 11, -1)
    found = seen(image, plate)
    assert len(found.marks) == len(plate.points)
    assert_numbered_right(found, plate, camera)
    last = camera.project(np.array([[105.0 - 7.5, -30.0, 0.0], [105.0 + 15.0, 140.0, 0.0]]))
    (left, bottom), (right, top) = np.rint(last).astype(int)
    image[top:bottom, left:right] = 180
    assert refused(image, plate).code is PlateRefusalCode.AMBIGUOUS


@pytest.mark.parametrize(
    "larger", [{"columns": (0, 10)}, {"rows": (0, 9)}, {"columns": (0, 9), "rows": (0, 8)}]
)
def test_a_larger_chessboard_than_the_file_s_is_refused(larger: dict) -> None:
    plate = board("chessboard")
    image = image_of(board("chessboard", **larger), looking_at(plate, distance=420.0))
    assert refused(image, plate).code in (PlateRefusalCode.NOT_THIS_PLATE, PlateRefusalCode.NO_MARKS)


def test_a_mirrored_image_is_told_where_the_pattern_tells() -> None:
    plate = board("circles", orientation="corner", corner={"index": (0, 0), "look": "missing"})
    image = np.ascontiguousarray(image_of(plate, looking_at(plate))[:, ::-1])
    assert refused(image, plate).code is PlateRefusalCode.MIRRORED
    plate = board("charuco")
    image = np.ascontiguousarray(image_of(plate, looking_at(plate))[:, ::-1])
    assert refused(image, plate).code in (PlateRefusalCode.NO_MARKS, PlateRefusalCode.NOT_THIS_PLATE)


def test_a_chessboard_with_the_other_colours_is_refused() -> None:
    plate = board("chessboard", first_square="light")
    image = image_of(plate, looking_at(plate))
    assert_numbered_right(seen(image, plate), plate, looking_at(plate))
    plate = board("chessboard", columns=(0, 8), rows=(0, 8), orientation="upright", first_square="light")
    other = board("chessboard", columns=(0, 8), rows=(0, 8), orientation="upright")
    assert_numbered_right(seen(image_of(plate, looking_at(plate)), plate), plate, looking_at(plate))
    assert refused(image_of(plate, looking_at(plate)), other).code is PlateRefusalCode.AMBIGUOUS


def test_a_plate_of_other_marks_is_refused() -> None:
    plate = board("circles")
    image = image_of(plate, looking_at(plate))
    for other in (
        board("circles", columns=(0, 7)),
        board("circles", mark_diameter_mm=5.0),
        board("chessboard"),
    ):
        assert refused(image, other).code in (
            PlateRefusalCode.NOT_THIS_PLATE,
            PlateRefusalCode.NO_GRID,
            PlateRefusalCode.NO_MARKS,
        )


@pytest.mark.parametrize("name", ["circles", "chessboard", "charuco"])
@pytest.mark.parametrize(("level", "code"), [(3, PlateRefusalCode.DARK), (255, PlateRefusalCode.SATURATED)])
def test_an_image_without_contrast_is_explained(name: str, level: int, code: PlateRefusalCode) -> None:
    assert refused(np.full((240, 320), level, np.uint8), board(name)).code is code


@pytest.mark.parametrize("name", ["circles", "chessboard", "charuco"])
def test_images_of_other_kinds_are_wrong_input(name: str) -> None:
    with pytest.raises(DegenerateInputError, match="one channel"):
        observe_plate(np.zeros((240, 320, 3), np.uint8), board(name))


@pytest.mark.parametrize("name", ["chessboard", "charuco"])
def test_boards_in_images_of_twelve_bits_are_located_the_same(name: str) -> None:
    plate = board(name)
    camera = looking_at(plate)
    image = image_of(plate, camera, seed=None)
    eight = seen(image, plate)
    twelve = seen(image.astype(np.uint16) * 16, plate)
    assert np.array_equal(eight.marks, twelve.marks)
    assert np.abs(eight.pixels - twelve.pixels).max() < 1e-3


@pytest.mark.skipif(not REAL.exists(), reason="needs ../shared/data/foreign_plates")
def test_all_161_dots_of_a_real_plate_are_found_and_numbered() -> None:
    image = cv2.imread(str(REAL / "asymmetric_23x7.png"), cv2.IMREAD_GRAYSCALE)
    plate = board(
        "asymmetric",
        rows=(0, 22),
        pitch_x_mm=2.5,
        pitch_y_mm=2.5,
        mark_diameter_mm=2.0,
        mark_tolerance_mm=0.05,
    )
    listed = np.loadtxt(REAL / "asymmetric_23x7_world.txt")[:, 1:3]
    assert sorted(map(tuple, plate.points[:, :2])) == sorted(map(tuple, listed))
    found = seen(image, plate, corrected=False)
    assert found.marks.tolist() == list(range(161))
