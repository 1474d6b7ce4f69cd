"""What a person is told of a camera's image: dark, saturated, out of focus."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from station.maintenance.figures import BINS, bars, edge_width, image_figures, picture, sparkline
from station.maintenance.remarks import advice
from station.maintenance.show import figures_as_text


def grid(light: float = 150.0, blur: float = 1.2, kind: type = np.uint8, scale: int = 1) -> np.ndarray:
    y, x = np.mgrid[:240, :320].astype(float)
    across = [0.995 * a + 0.1 * b for a, b in ((x, y), (y, -x))]
    near = np.minimum(*[np.abs((a + 15.0) % 30.0 - 15.0) for a in across])
    image = cv2.GaussianBlur((near < 1.5) * light, (0, 0), blur)
    noise = np.random.default_rng(2).normal(10.0, 1.0, image.shape)
    return np.clip(np.rint((image + noise) * scale), 0, np.iinfo(kind).max).astype(kind)


@pytest.mark.parametrize(("kind", "scale"), [(np.uint8, 1), (np.uint16, 257)])
def test_edges_are_narrowest_in_focus_whatever_the_light(kind: type, scale: int) -> None:
    widths = [edge_width(grid(blur=blur, kind=kind, scale=scale)) for blur in (1.0, 1.5, 2.5, 4.0)]
    assert None not in widths
    assert widths == sorted(widths)
    dimmer, brighter = edge_width(grid(80.0, 1.5)), edge_width(grid(220.0, 1.5))
    assert dimmer == pytest.approx(brighter, rel=0.1)


def test_an_image_without_anything_in_it_has_no_focus() -> None:
    assert edge_width(np.full((100, 100), 7, np.uint8)) is None


def test_what_is_wrong_is_said_in_a_sentence() -> None:
    said = {
        "good": grid(),
        "saturated": np.clip(grid(150.0).astype(int) * 3, 0, 255).astype(np.uint8),
        "hardly any light": np.full((100, 100), 6, np.uint8),
        "hardly any contrast": np.full((100, 100), 90, np.uint8),
        "faint light lines": grid(30.0),
    }
    for what, image in said.items():
        text = advice(image_figures("front_left/head_1/left", image))
        assert (what in text) if what != "good" else text == "", (what, text)


def test_figures_of_a_camera_of_twelve_bits_are_shares_of_its_range() -> None:
    image = grid(kind=np.uint16, scale=16)
    figures = image_figures("c", image)
    assert figures.full_scale == 4095
    assert figures.histogram.sum() == pytest.approx(1.0)
    eight = image_figures("c", grid())
    assert figures.bright == pytest.approx(eight.bright, abs=0.01)
    assert figures.brightness == pytest.approx(eight.brightness, abs=0.01)


def test_a_histogram_is_told_in_a_line_and_in_bars() -> None:
    figures = image_figures("front_left/head_1/left", grid())
    assert len(sparkline(figures)) == 16
    heights = bars(figures)
    assert len(heights) == BINS
    assert max(heights) <= 1.0
    assert min(heights) >= 0.0
    text = "\n".join(figures_as_text((figures,)))
    assert "front_left/head_1/left" in text
    assert f"|{sparkline(figures)}|" in text


def test_what_is_saturated_is_red_in_the_picture() -> None:
    image = np.full((100, 120), 60, np.uint8)
    image[40:60, 50:70] = 255
    shown = cv2.imdecode(np.frombuffer(picture(image), np.uint8), cv2.IMREAD_COLOR)
    blue, green, red = (int(level) for level in shown[50, 60])
    assert red > 200
    assert max(blue, green) < 80
    assert cv2.imdecode(np.frombuffer(picture(np.zeros((1000, 2000), np.uint8)), np.uint8), 1).shape[1] == 640
