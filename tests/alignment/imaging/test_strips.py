"""Known lines looked for again are the lines that a whole search finds."""

from __future__ import annotations

import numpy as np
import pytest

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.imaging.lines import LightLines, extract_light_lines
from alignment.imaging.strips import REACH, Strips, look_again
from alignment.values import Image
from tests import rendered


def image(flat: bool) -> Image:
    """One image of the shared wheel; turned over the diagonal its steep lines are flat."""
    seen = rendered.images()[0].left
    return np.ascontiguousarray(seen.T) if flat else seen


def strips_of(lines: LightLines) -> Strips:
    return Strips.of(lines, np.ones(len(lines.points), dtype=np.bool_))


def lines_of(seen: Image) -> LightLines:
    lines = extract_light_lines(seen)
    assert lines is not None
    return lines


def aside(seen: Image, flat: bool, pixels: int) -> Image:
    return np.ascontiguousarray(np.roll(seen, pixels, axis=0 if flat else 1))


def across(points: Array, tangents: Array, other: Array) -> Array:
    off = points - other
    return np.abs(off[:, 0] * tangents[:, 1] - off[:, 1] * tangents[:, 0])


@pytest.mark.parametrize("flat", [False, True])
def test_lines_of_the_same_image_are_found_where_the_search_found_them(flat: bool) -> None:
    seen = image(flat)
    lines = lines_of(seen)
    (again,) = look_again([seen], [strips_of(lines)])
    assert len(again.numbers) > 0.99 * len(lines.points)
    expected = lines.points[again.numbers]
    assert np.abs(again.lines.points - expected).max() < 1e-3
    assert np.median(again.lines.sigma / lines.sigma[again.numbers]) == pytest.approx(1.0, abs=0.05)
    assert np.median(again.lines.strength / lines.strength[again.numbers]) == pytest.approx(1.0, abs=1e-3)
    assert np.abs(again.lines.tangents - lines.tangents[again.numbers]).max() < 0.2


@pytest.mark.parametrize("pixels", [-4, 3])
def test_lines_that_moved_are_found_as_far_as_they_may_move(pixels: int) -> None:
    seen = image(False)
    strips = strips_of(lines_of(seen))
    (again,) = look_again([aside(seen, False, pixels)], [strips])
    moved = again.strips.places[again.numbers] - strips.places[again.numbers]
    assert np.median(moved) == pytest.approx(pixels, abs=1e-3)
    # Where they move on alike they are expected there, which is farther than they may be off.
    assert 2 * abs(pixels) > REACH
    (further,) = look_again([aside(seen, False, 2 * pixels)], [again.strips])
    assert len(further.numbers) > 0.98 * len(again.numbers)


def test_a_line_that_is_hidden_has_no_points_and_is_found_again_later() -> None:
    seen = image(False)
    lines = lines_of(seen)
    strips = strips_of(lines)
    longest = int(np.argmax(np.diff(strips.starts[: strips.steep_lines + 1])))
    first, last = strips.starts[longest], strips.starts[longest + 1]
    spoilt = seen.copy()
    for row, place in zip(strips.rows[first:last], strips.places[first:last], strict=True):
        spoilt[row, round(place) - 12 : round(place) + 13] = 8
    (without,) = look_again([spoilt], [strips])
    assert without.lines.starts[longest] == without.lines.starts[longest + 1]
    (again,) = look_again([seen], [without.strips])
    assert len(again.numbers) > 0.99 * len(strips.rows)


def test_lines_at_the_border_of_an_image_and_dark_images_are_no_fault() -> None:
    seen = image(False)
    strips = strips_of(lines_of(seen))
    for other in (np.zeros_like(seen), aside(seen, False, 700), np.full_like(seen, 255)):
        (again,) = look_again([other], [strips])
        assert len(again.numbers) <= len(strips.rows)
        assert np.isfinite(again.strips.places).all()


def test_lines_of_no_search_cannot_be_looked_for_again() -> None:
    lines = lines_of(image(False))
    unknown = LightLines(
        lines.points, lines.tangents, lines.sigma, lines.strength, lines.starts, lines.width, lines.crosses
    )
    with pytest.raises(DegenerateInputError, match="lines of a search"):
        strips_of(unknown)
