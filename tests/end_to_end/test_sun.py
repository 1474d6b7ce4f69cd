"""Sun on a wet tyre: what a dark exposure beside the lit one gains, and what it costs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, WheelMeasurement
from sensors.shot import WheelShot
from sensors.simulation.render import simulate_shot
from sensors.simulation.rigs import RIG_SPECS
from sensors.simulation.scene import Sun, draw_pose, draw_scene, truth_of
from sensors.simulation.simulated_rig import true_calibration
from tests.once import once

SEED = 1
WET = {"gloss": 0.3, "roughness": 0.15}


@once
def shots(wet: bool, sun: bool) -> tuple[WheelShot, tuple[float, float]]:
    """A shot with its dark exposure, and the true angles, degrees."""
    calibration = true_calibration("front_left", "left", "standard", SEED)
    rng = np.random.default_rng(SEED)
    scene = draw_scene(RIG_SPECS["standard"], "left", draw_pose(rng, -0.01, 0.003), rng)
    if wet:
        scene = replace(scene, tyre=replace(scene.tyre, rubber=replace(scene.tyre.rubber, **WET)))
    if sun:
        scene = replace(scene, sun=Sun(level=3.0, radius_mm=300.0))
    lit = simulate_shot(scene, calibration, rng)
    dark = simulate_shot(replace(scene, projectors=()), calibration, rng, trigger_counter=2)
    truth = truth_of(scene)
    return replace(lit, dark=dark.heads), (truth.camber_deg, truth.toe_deg)


def measured(shot: WheelShot) -> WheelMeasurement:
    rig = PreparedRig.of(true_calibration("front_left", "left", "standard", SEED), MeasureSettings())
    found = measure_wheel(shot.images, rig, MeasureSettings())
    assert isinstance(found, WheelMeasurement), found
    return found


def error_arcmin(found: WheelMeasurement, truth: tuple[float, float]) -> float:
    return 60.0 * math.hypot(math.degrees(found.camber) - truth[0], math.degrees(found.toe) - truth[1])


@pytest.mark.slow(9)
def test_highlights_of_the_sun_on_a_wet_tyre_are_gone_with_a_dark_exposure() -> None:
    """They lie elsewhere for each camera: 0.26′ wrong without the subtraction, where 0.06′ was claimed."""
    shot, truth = shots(wet=True, sun=True)
    subtracted, plain = measured(shot), measured(replace(shot, dark=()))
    assert error_arcmin(subtracted, truth) < 0.08
    assert error_arcmin(plain, truth) > 2.0 * error_arcmin(subtracted, truth)
    u95 = 60.0 * math.degrees(math.hypot(subtracted.camber_u95, subtracted.toe_u95))
    assert error_arcmin(subtracted, truth) < 2.0 * u95


@pytest.mark.slow
def test_a_dark_exposure_without_sun_costs_what_the_noise_of_two_exposures_does() -> None:
    shot, truth = shots(wet=False, sun=False)
    subtracted, plain = measured(shot), measured(replace(shot, dark=()))
    # Read noise alone doubles where nothing shines: √2 at most.
    assert 1.0 < subtracted.toe_u / plain.toe_u < 1.45
    assert error_arcmin(subtracted, truth) < 0.03
    for head, without in zip(subtracted.heads, plain.heads, strict=True):
        assert head.line_strength == pytest.approx(without.line_strength, rel=0.1)
