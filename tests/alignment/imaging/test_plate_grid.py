from dataclasses import replace

import cv2
import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.imaging.mark_detection import find_marks
from alignment.imaging.mark_grid import walk_grid
from alignment.imaging.mark_location import locate_marks
from alignment.imaging.mark_plane import fit_grid_homography, map_points
from alignment.imaging.marks import Marks
from alignment.imaging.plate_grid import PlateRefusal, PlateRefusalCode, identify_marks, observe_plate
from tests.alignment.imaging.plates import PITCH, RADIUS, photograph, plate, project, view


def observed(image: np.ndarray, homography: np.ndarray, **arguments: object) -> np.ndarray:
    """Indices of the marks that were identified, after every one was found where it is."""
    seen = plate()
    result = observe_plate(image, seen, **arguments)
    assert result, getattr(result, "reason", "")
    error = result.pixels - project(homography, seen.points[result.marks])
    assert np.abs(error).max() < 0.05
    return seen.indices[result.marks]


@pytest.mark.parametrize("turn", [0.0, 40.0, 90.0, 137.0, 180.0, 251.0, 300.0])
def test_every_orientation_is_identified(turn: float) -> None:
    homography = view(turn=turn, distance=380.0)
    assert len(observed(photograph(plate(), homography), homography)) == 99


@pytest.mark.parametrize("tilt", [15.0, 30.0, 45.0])
@pytest.mark.parametrize("azimuth", [20.0, 200.0])
def test_tilted_plates_show_the_centres_and_not_the_ellipses(tilt: float, azimuth: float) -> None:
    seen, homography = plate(), view(tilt=tilt, azimuth=azimuth, turn=25.0, distance=280.0)
    result = observe_plate(photograph(seen, homography, noise=0.5), seen)
    assert result
    error = result.pixels - project(homography, seen.points[result.marks])
    assert np.sqrt((error**2).mean()) < 0.003
    assert np.abs(error.mean(axis=0)).max() < 0.0008


def test_covariance_is_honest_on_a_whole_plate() -> None:
    seen, homography = plate(), view(tilt=25.0, distance=330.0)
    result = observe_plate(photograph(seen, homography), seen)
    assert result
    error = result.pixels - project(homography, seen.points[result.marks])
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(result.covariance), error)
    assert np.mean(squared) / 2 == pytest.approx(1.0, abs=0.3)


def test_missing_marks_and_foreign_blobs_are_borne() -> None:
    homography = view(tilt=20.0, distance=380.0)
    row = [(i, 6) for i in range(11)]
    without = (*row, (0, 0), (3, 2), (9, 3))
    image = photograph(plate(), homography, without=without)
    for centre, radius in [((60, 60), 9), ((570, 420), 30)]:
        cv2.circle(image, centre, radius, (40,), -1, cv2.LINE_AA)
    found = {tuple(index) for index in observed(image, homography).tolist()}
    assert found == {(i, j) for i in range(11) for j in range(9)} - set(without)


def test_a_part_of_the_plate_is_enough() -> None:
    homography = view(target=(85.0, 62.0), distance=150.0)
    indices = observed(photograph(plate(), homography), homography)
    assert 12 <= len(indices) <= 40


def test_one_covered_ring_mark_is_borne() -> None:
    homography = view(distance=380.0)
    image = photograph(plate(), homography, without=((5, 5),))
    assert len(observed(image, homography)) == 98


def refusal(image: np.ndarray, **arguments: object) -> PlateRefusal:
    result = observe_plate(image, plate(), **arguments)
    assert isinstance(result, PlateRefusal)
    assert not result
    assert result.reason.endswith(".")
    return result


def test_mirrored_images_are_named() -> None:
    image = photograph(plate(), view(turn=20.0))
    assert refusal(np.ascontiguousarray(image[:, ::-1])).code is PlateRefusalCode.MIRRORED


def test_a_blurred_image_is_named() -> None:
    image = photograph(plate(), view(distance=380.0))
    for sigma in (7.0, 12.0, 25.0):
        assert refusal(cv2.GaussianBlur(image, (0, 0), sigma)).code is PlateRefusalCode.BLURRED, sigma


def test_a_saturated_image_is_named() -> None:
    bright = photograph(plate(), view(), ground=400.0, mark=60.0)
    assert refusal(bright).code is PlateRefusalCode.SATURATED
    assert refusal(np.full((480, 640), 255, np.uint8)).code is PlateRefusalCode.SATURATED


def test_a_dark_image_is_named() -> None:
    rng = np.random.default_rng(1)
    assert (
        refusal(rng.normal(6.0, 2.0, (480, 640)).clip(0, 255).astype(np.uint8)).code is PlateRefusalCode.DARK
    )
    assert refusal(photograph(plate(), view(), ground=11.0, mark=4.0)).code is PlateRefusalCode.DARK


def test_a_half_covered_plate_is_named() -> None:
    homography = view(distance=340.0)
    image = photograph(plate(), homography)
    image[:, 340:] = 15
    covered = refusal(image)
    assert covered.code in (PlateRefusalCode.COVERED, PlateRefusalCode.NO_RING_MARKS)
    image = photograph(plate(), homography)
    x, y = np.rint(project(homography, np.array([[67.0, 52.0, 0.0], [110.0, 82.0, 0.0]]))).astype(int).T
    left, right, top, bottom = x.min() - 20, x.max() + 20, y.min() - 20, y.max() + 20
    partly = np.full_like(image, 15)
    partly[top:bottom, left:right] = image[top:bottom, left:right]
    assert refusal(partly).code is PlateRefusalCode.COVERED


def test_a_plate_without_visible_ring_marks_is_named() -> None:
    image = photograph(plate(rings=()), view())
    assert refusal(image).code is PlateRefusalCode.NO_RING_MARKS


def test_another_plate_is_named() -> None:
    other = plate(rings=((2, 2), (3, 5), (8, 1)))
    assert refusal(photograph(other, view(distance=420.0))).code is PlateRefusalCode.NOT_THIS_PLATE
    wide = plate()
    wide = replace(wide, points=wide.points * [1.5, 1.5, 1.0])
    code = refusal(photograph(wide, view(target=(110.0, 90.0), distance=500.0))).code
    assert code is PlateRefusalCode.NO_GRID


def test_other_scenes_have_no_plate() -> None:
    image = np.full((480, 640), 120, np.uint8)
    cv2.rectangle(image, (100, 100), (300, 300), (20,), -1)
    assert refusal(image).code is PlateRefusalCode.NO_MARKS


def test_equal_groups_need_to_be_named() -> None:
    rings = ((6, 3), (8, 3), (6, 4), (16, 3), (18, 3), (16, 4))
    seen = plate(25, 9, rings)
    homography = view(target=(250.0, 60.0), distance=150.0)
    image = photograph(seen, homography)
    several = observe_plate(image, seen)
    assert isinstance(several, PlateRefusal)
    assert several.code is PlateRefusalCode.AMBIGUOUS
    result = observe_plate(image, seen, ring_group=np.array(rings[3:]))
    assert result
    assert np.abs(result.pixels - project(homography, seen.points[result.marks])).max() < 0.05
    with pytest.raises(DegenerateInputError, match="ring marks"):
        observe_plate(image, seen, ring_group=np.array([[0, 0]]))


def test_plates_that_cannot_be_identified_are_refused_at_once() -> None:
    seen = plate()
    marks = locate_marks(image := photograph(seen, view()), find_marks(image))
    with pytest.raises(DegenerateInputError, match="hollow"):
        identify_marks(marks, replace(seen, hollow=np.zeros(99, dtype=bool)))
    with pytest.raises(DegenerateInputError, match="same pitch"):
        identify_marks(marks, replace(seen, points=seen.points * [1.0, 1.3, 1.0]))
    with pytest.raises(DegenerateInputError, match="do not touch"):
        identify_marks(marks, replace(seen, mark_radius_mm=8.0))


def test_the_grid_is_walked_without_ring_marks() -> None:
    seen = plate(rings=())
    homography = view(tilt=40.0, turn=33.0, distance=330.0)
    image = photograph(seen, homography)
    marks = locate_marks(image, find_marks(image))
    grid = walk_grid(marks, PITCH / RADIUS)
    assert len(grid.rows) == len(marks) > 60
    assert len(np.unique(grid.places, axis=0)) == len(marks)
    found = fit_grid_homography(grid.places.astype(float), marks.points[grid.rows])
    np.testing.assert_allclose(
        map_points(found, grid.places.astype(float)), marks.points[grid.rows], atol=0.2
    )


def test_a_few_marks_make_no_grid() -> None:
    seen = plate()
    image = photograph(seen, view())
    marks = locate_marks(image, find_marks(image))
    few = Marks(
        **{name: value[:4] if isinstance(value, np.ndarray) else value for name, value in vars(marks).items()}
    )
    assert len(walk_grid(few, PITCH / RADIUS).rows) <= 4
    refused = identify_marks(few, seen)
    assert isinstance(refused, PlateRefusal)
    assert refused.code is PlateRefusalCode.NO_MARKS
