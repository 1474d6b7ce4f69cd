"""A shot with a second exposure that the projector did not light."""

from dataclasses import replace

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from sensors.camera import Frame
from sensors.shot import HeadFrames, WheelShot
from tests.sensors.samples import TIME


def frames(counter, grey, exposure_ms=5.0, shape=(4, 6)):
    left, right = (
        Frame(f"front_left/head_1/{side}", np.full(shape, grey, np.uint8), counter, 0.0, 0.0, exposure_ms)
        for side in ("left", "right")
    )
    return (HeadFrames("head_1", left, right),)


def test_a_dark_exposure_is_subtracted_from_what_is_measured_and_stays_in_the_shot():
    shot = WheelShot("front_left", TIME, frames(3, 100), frames(4, 70))
    [pair] = shot.images
    assert (pair.left == 30 + 16).all()
    assert (shot.frames[0].image == 100).all()
    assert (shot.dark_frames[1].image == 70).all()


def test_without_a_dark_exposure_the_images_are_those_of_the_cameras():
    shot = WheelShot("front_left", TIME, frames(3, 100))
    assert shot.images[0].left is shot.frames[0].image
    assert shot.dark_frames == ()


def test_exposures_of_a_series_are_counted_whether_or_not_dark_ones_lie_between():
    """Counted by triggers, every second exposure of a turning wheel would be missing."""
    plain = [WheelShot("front_left", TIME, frames(n, n)).number for n in (1, 2, 3)]
    beside = [WheelShot("front_left", TIME, frames(n, n), frames(n + 1, 0)).number for n in (1, 3, 5)]
    assert plain == beside == [1, 2, 3]


@pytest.mark.parametrize("dark", [frames(2, 10, exposure_ms=4.0), frames(2, 10, shape=(4, 7))])
def test_a_dark_exposure_of_another_kind_is_refused(dark):
    with pytest.raises(DegenerateInputError, match="dark"):
        WheelShot("front_left", TIME, frames(1, 100), dark)


def test_a_dark_exposure_of_other_heads_is_refused():
    other = (replace(frames(2, 10)[0], name="head_2"),)
    with pytest.raises(DegenerateInputError, match="dark"):
        WheelShot("front_left", TIME, frames(1, 100), other)
