"""A wheel followed from image to image: the same angles as measured whole, and never a guess."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from alignment.follow import FollowedWheel, FollowResult, FollowRules, follow_wheel
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import (
    MeasureSettings,
    Refusal,
    RefusalCode,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
)
from sensors.simulation.render import simulate_shot
from tests import rendered
from tests.once import once

SETTINGS, RULES = MeasureSettings(), FollowRules()


@once
def _turned() -> tuple[tuple[StereoImages, ...], tuple[StereoImages, ...]]:
    """The shared wheel, its toe turned by 0.05° and by 1°."""
    out = []
    for seed, turn_deg in ((2, 0.05), (3, 1.0)):
        pose = replace(rendered.scene().pose, toe=rendered.scene().pose.toe + math.radians(turn_deg))
        scene = replace(rendered.scene(), pose=pose)
        out.append(tuple(simulate_shot(scene, rendered.rig(), np.random.default_rng(seed)).images))
    return out[0], out[1]


def a_little() -> list[StereoImages]:
    return [StereoImages(pair.left.copy(), pair.right.copy()) for pair in _turned()[0]]


@cache
def rig() -> PreparedRig:
    return PreparedRig.of(rendered.rig(), SETTINGS)


def measured(result: WheelMeasurement | Refusal) -> WheelMeasurement:
    assert isinstance(result, WheelMeasurement), result.reason
    return result


@cache
def first() -> FollowResult:
    return follow_wheel(rendered.images(), rig(), SETTINGS, None, RULES)


def wheel() -> FollowedWheel:
    found = first().wheel
    assert found is not None
    return found


def next_of(images: list[StereoImages]) -> FollowResult:
    return follow_wheel(images, rig(), SETTINGS, wheel(), RULES)


def same_as_whole(found: FollowResult, images: list[StereoImages]) -> None:
    whole = measure_wheel(images, rig(), SETTINGS)
    if isinstance(whole, Refusal):
        assert isinstance(found.result, Refusal)
        assert (found.result.code, found.result.head) == (whole.code, whole.head)
        assert found.wheel is None
    else:
        assert measured(found.result).camber == whole.camber
        assert measured(found.result).toe == whole.toe


def test_the_first_images_are_measured_whole() -> None:
    assert first().whole == "nothing to follow yet"
    same_as_whole(first(), rendered.images())


def test_a_wheel_that_turns_a_little_is_followed_to_the_same_angles_uncertainty_and_place() -> None:
    found, whole = next_of(a_little()), measured(measure_wheel(a_little(), rig(), SETTINGS))
    assert found.whole is None
    mine = measured(found.result)
    assert abs(mine.camber - whole.camber) < 0.01 * ARCMIN
    assert abs(mine.toe - whole.toe) < 0.01 * ARCMIN
    assert np.allclose([mine.camber_u, mine.toe_u], [whole.camber_u, whole.toe_u], rtol=0.25)
    assert mine.reference is not None
    assert whole.reference is not None
    assert np.linalg.norm(mine.reference.point - whole.reference.point) < 0.05
    assert mine.points_used > 0.9 * whole.points_used
    assert mine.knock_evidence == pytest.approx(whole.knock_evidence, abs=2.0)
    assert (mine.method, mine.degraded, mine.load_mm) == (whole.method, False, None)


def test_a_jump_of_a_degree_is_measured_whole_at_once_and_followed_from_there() -> None:
    jumped = list(_turned()[1])
    found = next_of(jumped)
    assert found.whole is not None
    same_as_whole(found, jumped)
    after = follow_wheel(jumped, rig(), SETTINGS, found.wheel, RULES)
    assert after.whole is None
    assert abs(measured(after.result).toe - measured(found.result).toe) < 0.01 * ARCMIN


def hidden(images: list[StereoImages]) -> None:
    """Something dark stands before a part of one head."""
    images[0].left[300:640, :] = 5


def dark(images: list[StereoImages]) -> None:
    images[1].right[:] = 0


def shifted(images: list[StereoImages]) -> None:
    """A camera was knocked: its picture stands three pixels aside."""
    images[1].left[:] = np.roll(images[1].left, 3, axis=1)


def bright(images: list[StereoImages]) -> None:
    images[2].left[:] = 255


def swapped(images: list[StereoImages]) -> None:
    images[0], images[1] = images[1], images[0]


@pytest.mark.parametrize("spoil", [hidden, dark, shifted, bright, swapped])
def test_what_is_in_doubt_is_measured_whole_with_its_result_or_its_refusal(
    spoil: Callable[[list[StereoImages]], None],
) -> None:
    images = a_little()
    spoil(images)
    found = next_of(images)
    assert found.whole is not None
    same_as_whole(found, images)


def test_images_of_other_cameras_are_refused() -> None:
    images = [StereoImages(pair.left[:-1], pair.right[:-1]) for pair in a_little()]
    found = next_of(images)
    assert isinstance(found.result, Refusal)
    assert found.result.code is RefusalCode.WRONG_IMAGES
    assert found.wheel is None


def test_each_so_many_th_result_is_measured_whole() -> None:
    followed: FollowedWheel | None = None
    whole = []
    for _ in range(7):
        found = follow_wheel(rendered.images(), rig(), SETTINGS, followed, FollowRules(3))
        followed = found.wheel
        whole.append(found.whole is not None)
    assert whole == [True, False, False, True, False, False, True]


def test_a_station_may_measure_everything_whole() -> None:
    assert follow_wheel(rendered.images(), rig(), SETTINGS, None, FollowRules(1)).wheel is None


@pytest.mark.parametrize(
    ("calibration", "settings"),
    [
        (replace(rendered.rig(), id="another"), SETTINGS),
        (rendered.rig(), MeasureSettings(coverage_factor=3.0)),
    ],
)
def test_nothing_is_followed_with_another_calibration_or_other_settings(
    calibration: RigCalibration, settings: MeasureSettings
) -> None:
    other = PreparedRig.of(calibration, settings)
    assert follow_wheel(a_little(), other, settings, wheel(), RULES).whole is not None


@once
def _loaded_again() -> tuple[StereoImages, ...]:
    """Another exposure of the shared wheel under load."""
    return tuple(simulate_shot(rendered.loaded_scene(), rendered.rig(), np.random.default_rng(4)).images)


def test_a_load_is_kept_until_the_next_whole_measurement() -> None:
    begun = follow_wheel(rendered.loaded_images(), rig(), SETTINGS, None, RULES)
    known = measured(begun.result)
    assert known.load_mm is not None
    found = follow_wheel(list(_loaded_again()), rig(), SETTINGS, begun.wheel, RULES)
    assert found.whole is None
    mine = measured(found.result)
    assert mine.load_mm == known.load_mm
    assert abs(mine.camber - known.camber) < 0.03 * ARCMIN
    assert abs(mine.toe - known.toe) < 0.03 * ARCMIN
    assert mine.camber_u == pytest.approx(known.camber_u, rel=0.2)


def test_a_wheel_goes_on_to_be_followed_when_one_head_was_lost() -> None:
    settings = MeasureSettings(allow_lost_head=True)
    rig = PreparedRig.of(rendered.rig(), settings)
    images = rendered.images()
    dark(images)
    begun = follow_wheel(images, rig, settings, None, RULES)
    assert measured(begun.result).degraded
    again = a_little()
    dark(again)
    found = follow_wheel(again, rig, settings, begun.wheel, RULES)
    whole = measured(measure_wheel(again, rig, settings))
    assert found.whole is None
    assert measured(found.result).degraded
    assert abs(measured(found.result).toe - whole.toe) < 0.01 * ARCMIN


def test_sixteen_bit_images_are_followed_as_eight_bit_ones() -> None:
    def deep(images: list[StereoImages]) -> list[StereoImages]:
        return [StereoImages(*(one.astype(np.uint16) * 257 for one in (p.left, p.right))) for p in images]

    begun = follow_wheel(deep(rendered.images()), rig(), SETTINGS, None, RULES)
    found = follow_wheel(deep(a_little()), rig(), SETTINGS, begun.wheel, RULES)
    assert found.whole is None
    assert measured(found.result).toe == pytest.approx(measured(next_of(a_little()).result).toe, abs=1e-8)
