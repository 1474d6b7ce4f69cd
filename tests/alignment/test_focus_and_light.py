"""What a measurement tells of focus and light of each camera, before either refuses it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from alignment.measure import measure_wheel
from alignment.values import HeadQuality, MeasureSettings, StereoImages, WheelMeasurement
from tests import rendered


def heads(pairs: list[StereoImages]) -> tuple[HeadQuality, ...]:
    found = measure_wheel(pairs, rendered.known_rig(), MeasureSettings())
    assert isinstance(found, WheelMeasurement)
    return found.heads


def test_soft_image_has_wider_lines_and_a_dim_one_darker_ones_and_only_that_camera() -> None:
    good = heads(rendered.images())
    pairs = rendered.images()
    pairs[1] = StereoImages(pairs[1].left, cv2.GaussianBlur(pairs[1].right, (0, 0), 2.5))
    pairs[2] = StereoImages((0.6 * pairs[2].left).astype(np.uint8), pairs[2].right)
    spoiled = heads(pairs)
    for k, head in enumerate(spoiled):
        assert head.line_width_px is not None
        assert head.line_strength is not None
        for side in (0, 1):
            was_width, was_light = good[k].line_width_px, good[k].line_strength
            assert was_width is not None
            assert was_light is not None
            width, light = (
                head.line_width_px[side] / was_width[side],
                head.line_strength[side] / was_light[side],
            )
            if (k, side) == (1, 1):
                assert 1.15 < width < 2.0
            elif (k, side) == (2, 0):
                assert light == pytest.approx(0.6, abs=0.05)
                assert width == pytest.approx(1.0, abs=0.03)
            else:
                assert (width, light) == (1.0, 1.0)
