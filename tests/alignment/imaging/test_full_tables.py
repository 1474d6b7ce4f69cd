"""Patterns with more lines, points or crosses than the tables hold: thinned evenly, or refused as that."""

from __future__ import annotations

import numpy as np
import pytest

from alignment.arrays import Array
from alignment.imaging import extraction
from alignment.imaging.lines import LightLines, extract_light_lines
from alignment.measure import measure_wheel
from alignment.values import Image, MeasureSettings, Refusal, RefusalCode, StereoImages, WheelMeasurement
from tests import rendered
from tests.alignment.imaging.grids import slanted_grid
from tests.assertions import assert_angle_within


def found(image: Image) -> LightLines:
    lines = extract_light_lines(image)
    assert lines is not None
    return lines


def per_line(lines: LightLines) -> Array:
    return np.diff(lines.starts).astype(np.float64)


def close_lines(count: int, pitch: float = 20.0, height: int = 100) -> Image:
    """Upright lines beside each other, each between two columns."""
    x = np.arange(round((count + 4) * pitch))
    profile = np.zeros(len(x))
    for k in range(count):
        profile += 150.0 * np.exp(-0.5 * ((x - (k + 2) * pitch - 0.3) / 1.2) ** 2)
    return np.clip(np.rint(np.tile(profile + 8.0, (height, 1))), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("count", [150, 400])
def test_lines_on_the_right_are_found_however_many_stand_on_their_left(count: int) -> None:
    """A row took its first 192 ridges, and 256 lines were open at once: the right was lost."""
    lines = found(close_lines(count))
    places = np.unique(np.rint((lines.points[:, 0] - 0.3) / 20.0).astype(int)) - 2
    # Lines at the border are left out, on both sides alike.
    assert places.min() <= 2
    assert places.max() >= count - 3
    assert len(places) >= count - 5
    assert lines.share == 1.0
    assert not lines.crowded


def test_too_many_points_are_thinned_along_all_lines_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points beyond the table's end were dropped: the flat lines, which come last, got none."""
    image = slanted_grid(0.1, noise=1.0)
    every = found(image)
    monkeypatch.setattr(extraction, "MAX_POINTS", round(0.6 * len(every.points)))
    some = found(image)
    assert 0 <= round(0.6 * len(every.points)) - len(some.points) <= 1
    assert every.share == 1.0
    assert some.share == pytest.approx(0.6, abs=1e-3)
    assert per_line(some) == pytest.approx(0.6 * per_line(every), abs=1.01)
    # What is left is what was found, and no gap is wider than thinning makes it.
    known = {tuple(point) for point in every.points}
    assert all(tuple(point) in known for point in some.points)


def test_all_points_are_kept_where_they_just_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    image = slanted_grid(0.1, noise=1.0)
    every = found(image)
    monkeypatch.setattr(extraction, "MAX_POINTS", len(every.points))
    same = found(image)
    np.testing.assert_array_equal(same.points, every.points)
    np.testing.assert_array_equal(same.starts, every.starts)
    assert same.share == 1.0


@pytest.mark.parametrize("name", ["MAX_LINES", "MAX_POINTS"])
def test_what_cannot_be_thinned_is_crowded_and_not_dark(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pattern of too many lines was said to show no light lines at all."""
    image = slanted_grid(0.1, noise=1.0)
    every = found(image)
    limit = {"MAX_LINES": every.count, "MAX_POINTS": len(every.points) // 4 - 1}[name]
    monkeypatch.setattr(extraction, name, limit)
    lines = found(image)
    assert lines.crowded
    assert len(lines.points) == lines.count == 0
    monkeypatch.setattr(extraction, name, limit + 2)
    assert not found(image).crowded


def test_a_wheel_with_too_many_lines_is_refused_as_that(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extraction, "MAX_LINES", 8)
    refusal = measure_wheel(rendered.images(), rendered.rig(), MeasureSettings())
    assert isinstance(refusal, Refusal)
    assert (refusal.code, refusal.head) == (RefusalCode.TOO_MANY_LINES, "head_1")
    assert "more light lines than can be looked at" in refusal.reason
    assert "head_1 left" in refusal.reason


def test_a_wheel_of_thinned_points_is_measured_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = measure_wheel(rendered.images(), rendered.rig(), MeasureSettings())
    assert isinstance(whole, WheelMeasurement)
    assert {head.share_looked_at for head in whole.heads} == {1.0}
    pairs = rendered.images()
    numbers = [len(found(image).points) for pair in pairs for image in (pair.left, pair.right)]
    monkeypatch.setattr(extraction, "MAX_POINTS", min(numbers) // 4)
    thinned = measure_wheel(pairs, rendered.rig(), MeasureSettings())
    assert isinstance(thinned, WheelMeasurement)
    for head in thinned.heads:
        assert 0.25 < head.share_looked_at < 0.7
        assert head.points > 1000
    assert_angle_within(thinned.camber, rendered.CAMBER, 0.05, "camber")
    assert_angle_within(thinned.toe, rendered.TOE, 0.05, "toe")


def test_too_many_crosses_are_thinned_over_the_whole_image(monkeypatch: pytest.MonkeyPatch) -> None:
    """Crosses beyond the table's end were dropped: those of the lines on the right."""
    image = slanted_grid(0.02, pitch=60.0, noise=1.0)
    every = found(image).crosses
    assert len(every.points) > 40
    monkeypatch.setattr(extraction, "MAX_CROSSES", 16)
    some = found(image).crosses
    assert 8 <= len(some.points) <= 16
    known = {tuple(point) for point in every.points}
    assert all(tuple(point) in known for point in some.points)
    for axis in (0, 1):
        middle = np.median(every.points[:, axis])
        assert min((some.points[:, axis] < middle).sum(), (some.points[:, axis] > middle).sum()) >= 2


def test_pairs_of_images_are_thinned_each_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    image = slanted_grid(0.1, noise=1.0)
    half = np.where(np.arange(image.shape[1]) < 320, image, 8).astype(np.uint8)
    pair = StereoImages(image, half)
    monkeypatch.setattr(extraction, "MAX_POINTS", round(0.6 * len(found(image).points)))
    assert found(pair.left).share < 1.0
    assert found(pair.right).share == 1.0
