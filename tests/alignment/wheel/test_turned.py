"""Whether a wheel turned, by what its surface looks like: letters move on, light lines and noise do not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from alignment.values import StereoImages
from alignment.wheel.turned import has_turned, look_of

SHAPE = (240, 320)


def views(
    rng: np.random.Generator, *, turning: bool, texture: float, wander_px: float, noise: float = 3.0
) -> list[np.ndarray]:
    """What two heads see of a tyre with so much texture under light lines, in sixteen exposures."""
    lines = 60.0 + 50.0 * (np.arange(SHAPE[1]) % 16 < 4) * np.ones(SHAPE)
    tyre = texture * gaussian_filter(rng.normal(size=(SHAPE[0] * 17, SHAPE[1])), 6.0) * 12.0
    looks = []
    for k in range(16):
        at = SHAPE[0] * k if turning else 0
        seen = shift(tyre[at : at + SHAPE[0]], wander_px * np.sin(0.45 * k), order=1, mode="nearest")
        images = [
            np.clip(lines + seen + noise * rng.normal(size=SHAPE), 0, 255).astype(np.uint8) for _ in range(4)
        ]
        looks.append(look_of([StereoImages(*images[:2]), StereoImages(*images[2:])]))
    return looks


@pytest.mark.parametrize("wander_px", [0.0, 3.0])
@pytest.mark.parametrize("texture", [1.0, 3.0])
def test_letters_that_move_on_show_that_the_wheel_turned(texture: float, wander_px: float) -> None:
    rng = np.random.default_rng(1)
    assert has_turned(views(rng, turning=True, texture=texture, wander_px=wander_px))


@pytest.mark.parametrize("wander_px", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("texture", [0.0, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_noise_and_a_slow_wander_of_a_wheel_that_stands_are_no_turn(
    seed: int, texture: float, wander_px: float
) -> None:
    rng = np.random.default_rng(seed)
    assert not has_turned(views(rng, turning=False, texture=texture, wander_px=wander_px))


def test_a_tyre_without_anything_to_see_is_not_known_to_have_turned() -> None:
    assert not has_turned(views(np.random.default_rng(2), turning=True, texture=0.0, wander_px=0.0))


def test_a_lamp_that_flickers_is_no_turn() -> None:
    rng = np.random.default_rng(3)
    tyre = 20.0 * gaussian_filter(rng.normal(size=SHAPE), 6.0) + 100.0
    looks = []
    for k in range(16):
        bright = tyre * (1.0 + 0.1 * (-1) ** k)
        pair = [(bright + 2.0 * rng.normal(size=SHAPE)).astype(np.uint8) for _ in range(2)]
        looks.append(look_of([StereoImages(*pair)]))
    assert not has_turned(looks)


@pytest.mark.parametrize("shape", [(30, 40), (291, 376), (7, 9)])
def test_images_of_any_size_have_a_look(shape: tuple[int, int]) -> None:
    """Of a height that is no multiple of four one half had a row of blocks more than the other."""
    images = np.random.default_rng(4).integers(0, 255, (2, *shape), dtype=np.uint8)
    assert look_of([StereoImages(*images)]).shape[0] == 2
