"""Light of sun and lamps, taken off by a second exposure without the projector."""

import math

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.imaging import PEDESTAL_SHARE, full_scale, line_brightness, without_ambient
from alignment.imaging.lines import extract_light_lines

KINDS = [(np.uint8, 255), (np.uint16, 1023), (np.uint16, 4095), (np.uint16, 65520), (np.uint16, 65535)]


def of_range(kind, top, shares):
    """An image whose first pixel is at full scale, so that its range is known."""
    return np.rint(np.array([[1.0, *shares]]) * top).astype(kind)


@pytest.mark.parametrize(("kind", "top"), KINDS)
def test_the_range_of_a_camera_is_told_from_its_saturated_pixels(kind, top):
    assert full_scale(of_range(kind, top, [0.2])) == top


@pytest.mark.parametrize(("kind", "top"), KINDS)
def test_what_both_exposures_show_is_gone_and_what_the_projector_adds_is_left(kind, top):
    dark = of_range(kind, top, [0.1, 0.4, 0.6])
    lit = of_range(kind, top, [0.1, 0.7, 0.6])
    _, nothing, light, bright = without_ambient(lit, dark)[0].astype(int)
    assert nothing == bright == round(PEDESTAL_SHARE * top)
    assert light - nothing == int(lit[0, 2]) - int(dark[0, 2])


@pytest.mark.parametrize(("kind", "top"), KINDS)
def test_a_saturated_pixel_never_becomes_a_good_one(kind, top):
    """255 less 200 looked like a moderate light: a saturated line would have been measured."""
    lit = of_range(kind, top, [1.0, 0.3, 0.995])
    dark = of_range(kind, top, [0.8, 1.0, 0.0])
    found = without_ambient(lit, dark)[0]
    assert found[1] == top, "lit is saturated"
    assert found[2] == top, "dark is saturated"
    assert found[3] == top - 1, "very bright, and not saturated"
    assert found.dtype == kind


def test_a_bright_image_of_a_deep_camera_that_saturates_nowhere_is_not_cut_off():
    """Twelve bits of which no pixel exceeds the range of ten."""
    lit, dark = np.full((2, 2), 1010, np.uint16), np.full((2, 2), 20, np.uint16)
    assert (without_ambient(lit, dark) == 990 + 64).all()


def test_noise_about_nothing_is_not_bent_upward_and_grows_by_the_root_of_two():
    """Cut off at zero, the mean of no light would be 0.56 of the noise above none."""
    rng = np.random.default_rng(3)
    one, other = (np.rint(rng.normal(90.0, 3.0, (400, 400))).astype(np.uint8) for _ in range(2))
    found = without_ambient(one, other).astype(float) - round(PEDESTAL_SHARE * 255)
    assert abs(found.mean()) < 0.03
    assert found.std() == pytest.approx(math.sqrt(2.0) * np.hypot(3.0, math.sqrt(1 / 12)), rel=0.02)


def test_more_light_in_the_dark_exposure_stays_an_image():
    lit, dark = np.zeros((2, 2), np.uint8), np.full((2, 2), 254, np.uint8)
    assert (without_ambient(lit, dark) == 0).all()


@pytest.mark.parametrize("other", [np.zeros((4, 5), np.uint8), np.zeros((4, 4), np.uint16)])
def test_exposures_that_differ_in_size_or_kind_are_not_subtracted(other):
    with pytest.raises(DegenerateInputError, match="dark"):
        without_ambient(np.zeros((4, 4), np.uint8), other)


def lines_of_light(light, ground):
    """Lines each way, a little aslant, Gaussian, deviation 2 px, 24 px apart."""
    y, x = np.mgrid[:400, :400].astype(float)
    across = [0.995 * a + 0.1 * b for a, b in ((x, y), (y, -x))]
    away = [np.abs((a + 12.0) % 24.0 - 12.0) for a in across]
    image = ground + light * np.exp(-0.5 * (np.minimum(*away) / 2.0) ** 2)
    return np.rint(image + np.random.default_rng(1).normal(0, 1, image.shape)).astype(np.uint8)


@pytest.mark.parametrize("ground", [10, 60])
@pytest.mark.parametrize("light", [40, 120])
def test_brightness_of_lines_is_their_light_and_not_the_ground(light, ground):
    image = lines_of_light(light, ground)
    lines = extract_light_lines(image)
    assert line_brightness(image, lines) == pytest.approx(light / 255, rel=0.05)
