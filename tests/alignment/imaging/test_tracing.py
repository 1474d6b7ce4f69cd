import numpy as np
import pytest

from alignment.imaging import ridges
from alignment.imaging.extraction import contrast_of, line_width
from alignment.imaging.lines import extract_light_lines
from alignment.imaging.tracing import follow
from tests.alignment.imaging.grids import slanted_grid


def scanned(image: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray, int, np.ndarray, float]:
    view = ridges.whole(image)
    contrast = contrast_of(image, view, 8)
    width, _ = line_width(image, view, contrast, 32)
    weights, box = ridges.derivative_weights(1.4 * width), max(2, round(1.6 * width))
    table, rows = ridges.scan_rows(image, view, box, weights, contrast, step)
    order, starts = ridges.link_rows(table, rows, step, 1.5, 12, 4)
    return table[order], starts, box, weights, contrast


@pytest.mark.parametrize("slope", [0.0, 0.3, -0.6, 0.9])
@pytest.mark.parametrize("step", [2, 4, 8])
def test_followed_lines_have_the_points_that_a_scan_of_every_row_finds(slope: float, step: int) -> None:
    image = slanted_grid(slope, noise=1.5, flat=False)
    every, _, _, _, _ = scanned(image, 1)
    coarse, starts, box, weights, contrast = scanned(image, step)
    table, _ = follow(image, ridges.whole(image), box, weights, contrast, step, coarse, starts)
    known = {(int(y), round(x, 3)) for x, y in every[:, :2]}
    found = {(int(y), round(x, 3)) for x, y in table[:, :2]}
    assert len(found & known) > 0.99 * len(found)
    assert len(found) > 0.95 * len(known)


def test_no_point_is_found_twice() -> None:
    image = slanted_grid(0.2, noise=1.5)
    coarse, starts, box, weights, contrast = scanned(image, 4)
    table, _ = follow(image, ridges.whole(image), box, weights, contrast, 4, coarse, starts)
    assert len(np.unique(table[:, :2], axis=0)) == len(table)


@pytest.mark.parametrize("side", ["left", "right"])
def test_lines_near_the_border_are_followed_on_either_side(side: str) -> None:
    image = slanted_grid(0.0, noise=1.0, flat=False)
    line = int(np.argmax(image[:, 20:-20].mean(axis=0))) + 20
    cut = image[:, line - 20 :] if side == "left" else image[:, : line + 21]
    lines = extract_light_lines(np.ascontiguousarray(cut))
    assert lines is not None
    at = 20 if side == "left" else cut.shape[1] - 21
    assert np.count_nonzero(abs(lines.points[:, 0] - at) < 1.0) > 0.8 * (len(image) - 60)


def test_a_chain_that_is_no_line_between_the_scanned_rows_is_left_out() -> None:
    image = slanted_grid(0.0, noise=1.0, flat=False)
    image[np.arange(len(image)) % 4 != 0] = 10
    coarse, starts, box, weights, contrast = scanned(image, 4)
    assert len(starts) > 1
    table, kept = follow(image, ridges.whole(image), box, weights, contrast, 4, coarse, starts)
    assert len(table) == 0
    assert len(kept) == 1
