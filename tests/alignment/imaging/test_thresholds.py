import numpy as np
import pytest

from alignment.imaging.mark_detection import find_marks
from alignment.imaging.mark_location import locate_marks
from alignment.imaging.thresholds import THRESHOLDS, chow_kaneko, p_tile
from tests.alignment.imaging.plates import photograph, plate, view

GLOBAL = [name for name in THRESHOLDS if name not in ("p_tile", "chow_kaneko")]


def two_classes(seed: int = 0, dark: float = 60.0, bright: float = 180.0, sigma: float = 8.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    image = rng.normal(bright, sigma, (120, 160))
    image[40:80, 50:110] = rng.normal(dark, sigma, (40, 60))
    return image.clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("name", GLOBAL)
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_two_classes_are_parted_without_error(name: str, depth: type) -> None:
    image = two_classes().astype(depth) * (256 if depth is np.uint16 else 1)
    dark = image < THRESHOLDS[name](image)
    expected = np.zeros(image.shape, dtype=bool)
    expected[40:80, 50:110] = True
    # The entropy takes some of the broad bright class for dark: that is the criterion, not an error.
    assert (dark != expected).mean() < (0.05 if name == "entropy" else 0.002)


@pytest.mark.parametrize("name", GLOBAL)
def test_classes_of_unlike_size_are_parted(name: str) -> None:
    rng = np.random.default_rng(4)
    image = rng.normal(170.0, 5.0, (120, 160))
    image[50:66, 60:76] = rng.normal(50.0, 5.0, (16, 16))
    threshold = THRESHOLDS[name](image.clip(0, 255).astype(np.uint8))
    assert 62.0 < threshold < 158.0


@pytest.mark.parametrize("name", THRESHOLDS)
@pytest.mark.parametrize("level", [0, 77, 255])
def test_an_even_image_has_nothing_dark(name: str, level: int) -> None:
    image = np.full((80, 96), level, np.uint8)
    assert not (image < THRESHOLDS[name](image)).any()


@pytest.mark.parametrize("fraction", [0.13, 0.196, 0.5])
def test_p_tile_parts_the_asked_share(fraction: float) -> None:
    image = np.random.default_rng(1).integers(0, 65536, (200, 200)).astype(np.uint16)
    assert (image < p_tile(image, fraction)).mean() == pytest.approx(fraction, abs=1e-3)


def test_the_regional_threshold_follows_uneven_light() -> None:
    x = np.arange(320)
    light = 60.0 + 170.0 * x / 319
    image = np.tile(light, (192, 1))
    truth = np.zeros(image.shape, dtype=bool)
    for cx in range(24, 320, 40):
        for cy in range(24, 192, 40):
            truth[cy - 8 : cy + 8, cx - 8 : cx + 8] = True
    image = np.where(truth, 0.25 * image, image)
    image = (image + np.random.default_rng(2).normal(0.0, 1.5, image.shape)).clip(0, 255).astype(np.uint8)
    assert ((image < chow_kaneko(image)) != truth).mean() < 0.002


@pytest.mark.parametrize("name", THRESHOLDS)
def test_every_threshold_locates_marks(name: str) -> None:
    image = photograph(plate(), view(distance=380.0))
    exact = locate_marks(image, find_marks(image))
    marks = locate_marks(image, find_marks(image), "centroid", threshold=name)
    # Windows of the p-tile are not the ones that its share belongs to: it cuts deeply or not at all.
    assert len(marks) == len(exact) == 99
    assert np.sqrt(((marks.points - exact.points) ** 2).mean()) < (0.3 if name == "p_tile" else 0.12)


@pytest.mark.parametrize("name", ["otsu", "iterative", "chow_kaneko", "edge_pixels"])
def test_marks_may_be_searched_with_a_threshold_of_choice(name: str) -> None:
    image = photograph(plate(), view(distance=380.0))
    assert len(find_marks(image, threshold=name)) == 99
