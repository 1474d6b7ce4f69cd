"""A tyre with a second harmonic looks like heads that moved; its signs turn, and theirs do not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from alignment.measure import measure_wheel
from alignment.measure_heads import HeadSigns, judged_together
from alignment.measure_spin import SeriesUnderWay, series_settings
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, Refusal, RefusalCode, StereoImages, WheelMeasurement
from alignment.wheel.agreement import MOVES
from alignment.wheel.series import SeriesRules
from sensors.simulation import RIG_SPECS, Wobble, build_rig, draw_pose, draw_scene, simulate_shot
from tests import rendered

ARCMIN = math.radians(1.0 / 60.0)
LEAN = 6e-4  # radians along a head's patch, as of a second harmonic of 0.3 mm peak to peak


def signs_of_an_intact_wheel(rig: PreparedRig) -> HeadSigns:
    found = measure_wheel(rendered.images(), rig, replace(MeasureSettings(), judge_heads=False))
    assert isinstance(found, WheelMeasurement)
    assert isinstance(found.signs, HeadSigns)
    assert found.signs.refusal is None
    return found.signs


def uneven(signs: HeadSigns, phase: float, stays: float = 0.0) -> HeadSigns:
    """The same with patches that lean as a second harmonic at this phase does, and one that always leans."""
    amounts = np.zeros(signs.moves.target.shape)
    for head in range(3):
        at = math.pi / 2.0 + 2.0 * math.pi / 3.0 * head
        along = LEAN * math.sin(2.0 * (at - phase))
        amounts[MOVES * head + 1] = -math.sin(at) * along
        amounts[MOVES * head + 2] = math.cos(at) * along
    amounts[1] += stays
    target = signs.moves.target + signs.moves.normal @ amounts
    alone = Refusal(RefusalCode.HEAD_MOVED, "alone")
    return replace(signs, moves=replace(signs.moves, target=target), refusal=alone)


def test_signs_that_turn_with_the_wheel_are_its_own_and_those_that_stay_a_head_s() -> None:
    """Each exposure alone was refused as a moved head, and with it the series."""
    rig = PreparedRig.of(rendered.rig(), MeasureSettings())
    signs = signs_of_an_intact_wheel(rig)
    phases = 2.0 * math.pi / 8.0 * np.arange(16)
    assert not isinstance(judged_together([uneven(signs, phase) for phase in phases], rig), Refusal)
    # The same signs in every exposure are no tyre's.
    still = judged_together([uneven(signs, 0.3) for _ in phases], rig)
    assert isinstance(still, Refusal)
    assert still.code is RefusalCode.HEAD_MOVED
    knocked = judged_together([uneven(signs, phase, stays=4.0 * LEAN) for phase in phases], rig)
    assert isinstance(knocked, Refusal)
    assert knocked.code is RefusalCode.HEAD_MOVED


def test_a_knocked_head_before_a_wheel_that_turns_is_refused_by_all_exposures_together() -> None:
    """What one exposure refuses at once may not pass because it is judged later."""
    moved = rendered.turned_head(rendered.rig(), 1, 0.1)
    rig = PreparedRig.of(moved, MeasureSettings())
    alone = measure_wheel(rendered.images(), rig, MeasureSettings())
    assert isinstance(alone, Refusal)
    found = measure_wheel(rendered.images(), rig, series_settings(MeasureSettings()))
    assert isinstance(found, WheelMeasurement)
    series = SeriesUnderWay(rig, MeasureSettings(), SeriesRules(), lambda images, rig, settings: found)
    for number in range(1, 17):
        assert series.take(number, _marked(number)) is None
    refused = series.result()
    assert isinstance(refused, Refusal)
    assert refused.code is RefusalCode.HEAD_MOVED
    assert refused.reason.startswith("all exposures together: ")


def test_where_a_head_may_be_left_out_each_exposure_is_judged_alone() -> None:
    assert not series_settings(MeasureSettings()).judge_heads
    assert series_settings(MeasureSettings(allow_lost_head=True)).judge_heads


def _marked(number: int) -> Sequence[StereoImages]:
    image = np.full((64, 64), number, dtype=np.uint8)
    return [StereoImages(image, image)]


@pytest.mark.slow
def test_a_rendered_tyre_with_three_tenths_of_second_harmonic_is_left_to_its_series() -> None:
    """Refused as head_moved in its first exposure: real tyres have as much."""
    rng = np.random.default_rng(5)
    spec = RIG_SPECS["ccir"]
    rig = build_rig(spec, "front_left", "left", rng)
    drawn = draw_scene(spec, "left", draw_pose(rng, -0.01, 0.002), rng, seed=5)
    images = simulate_shot(replace(drawn, wobble=Wobble(second_mm=0.3)), rig, rng).images
    prepared = PreparedRig.of(rig, MeasureSettings())
    alone = measure_wheel(images, prepared, MeasureSettings())
    assert isinstance(alone, Refusal)
    assert alone.code is RefusalCode.HEAD_MOVED
    found = measure_wheel(images, prepared, series_settings(MeasureSettings()))
    assert isinstance(found, WheelMeasurement)
    assert isinstance(found.signs, HeadSigns)
    assert found.signs.refusal == alone
    # How the heads disagree is not yet in the uncertainty of this exposure: the series judges it.
    assert max(found.camber_u, found.toe_u) < 0.2 * ARCMIN
