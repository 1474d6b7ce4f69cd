"""A wheel on rollers: it turns, wanders slowly, carries its run-out along and leaves its load where it is."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from alignment.geometry.cameras import CameraModel
from sensors.camera import CameraSettings
from sensors.formats.truth import TyreLoad
from sensors.simulation import simulated_rig
from sensors.simulation.deformation import Wobble
from sensors.simulation.render import light_on_chip
from sensors.simulation.rigs import RIG_SPECS, build_rig
from sensors.simulation.scene import WheelPose, WheelScene, draw_scene, truth_of
from sensors.simulation.simulated_rig import Road, SimulatedRig, angles_about, true_calibration
from sensors.simulation.turning import Rollers, TurningWheel, mean_truth
from sensors.simulation.tyre import MADE_SHAPES, draw_tyre

SMALL = CameraModel(320, 256, 750.0, 751.0, 158.0, 129.0, "brown", (-0.08, 0.01, 1e-4, -1e-4, 0.0))
SPEC = replace(RIG_SPECS["standard"], camera=SMALL)
POSE = WheelPose(0.02, -0.01, 0.3, 0.003, 1.0, (2.0, -3.0, 1.0))


@pytest.fixture(scope="module")
def scene() -> WheelScene:
    drawn = draw_scene(SPEC, "left", POSE, np.random.default_rng(6))
    return replace(drawn, load=TyreLoad(6.0), wobble=Wobble(second_mm=0.4))


def turning(scene: WheelScene, rollers: Rollers, seed: int = 1) -> TurningWheel:
    return TurningWheel(scene, rollers, np.random.default_rng(seed))


def test_a_wheel_turns_on_with_every_exposure_and_wanders_slowly_within_bounds(scene: WheelScene) -> None:
    wheel = turning(scene, Rollers(interval_s=0.14))
    poses = [wheel.exposure(k).pose for k in range(1, 33)]
    steps = np.diff([pose.spin for pose in poses])
    assert steps.mean() == pytest.approx(3.0 * 0.14, rel=0.02)
    assert 0.03 < np.ptp(steps) < 3.0 * 0.14  # unknown angles: exposures are not evenly spaced
    places = np.array([pose.offset_mm for pose in poses]) - POSE.offset_mm
    angles = np.array([(pose.camber - POSE.camber, pose.toe - POSE.toe) for pose in poses])
    for wander, most in ((places, 1.0), (angles, math.radians(0.05))):
        assert np.abs(wander).max() <= most
        assert np.ptp(wander, axis=0).min() > 0.5 * most
        assert np.abs(np.diff(wander, axis=0)).max() < 0.35 * most


def test_an_exposure_is_the_same_whenever_it_is_asked_for(scene: WheelScene) -> None:
    first, again = turning(scene, Rollers()), turning(scene, Rollers())
    later = first.exposure(9).pose
    assert first.exposure(2).pose == again.exposure(2).pose
    assert again.exposure(9).pose == later
    assert turning(scene, Rollers(), seed=2).exposure(9).pose != later


def test_the_truth_of_a_series_is_the_mean_of_its_spin_axes(scene: WheelScene) -> None:
    wheel = turning(scene, Rollers())
    truths = [truth_of(wheel.exposure(k)) for k in range(1, 17)]
    mean = mean_truth(truths)
    assert mean.spin_camber_deg == pytest.approx(np.mean([t.spin_camber_deg for t in truths]), abs=1e-6)
    assert mean.spin_toe_deg == pytest.approx(np.mean([t.spin_toe_deg for t in truths]), abs=1e-6)
    assert (mean.camber_deg, mean.toe_deg) == (mean.spin_camber_deg, mean.spin_toe_deg)
    assert mean.spin_angle_deg == pytest.approx(math.degrees(15 * 3.0 * 0.28), rel=0.05)
    assert (mean.load, mean.second_harmonic_mm) == (scene.load, 0.4)
    # The tyre plane runs around it on a cone.
    assert np.ptp([t.camber_deg for t in truths]) == pytest.approx(math.degrees(2 * 0.003), rel=0.3)


def test_the_load_stays_over_the_rollers_and_the_second_harmonic_turns(scene: WheelScene) -> None:
    """Seen from the road: what is there at every turn is the load's, what comes round is the tyre's."""
    angle = np.radians(np.arange(0.0, 360.0, 10.0))
    seen = []
    for moment in (replace(scene, pose=replace(POSE, spin=s, run_out=0.0)) for s in (0.0, 0.5 * math.pi)):
        at = moment.contact.angle + angle
        points = 300.0 * np.column_stack([np.cos(at), np.sin(at)])
        seen.append(moment.deformed_tyre.height(points)[0] - moment.tyre.height(points)[0])
    half, second = 0.5 * (seen[0] + seen[1]), 0.5 * (seen[0] - seen[1])  # a quarter turn: opposite signs
    assert angle[half.argmax()] == 0.0
    assert np.ptp(second) == pytest.approx(0.4, rel=0.15)
    np.testing.assert_allclose(second[:18], second[18:], atol=1e-3)


@pytest.mark.parametrize("letters", [True, False])
def test_motion_blurs_the_letters_and_not_the_light_lines(letters: bool) -> None:
    """Lines are fixed in space: a smooth tyre looks the same however fast it turns."""
    shape = replace(MADE_SHAPES["touring"], letters=15.0 if letters else 0.0)
    drawn = draw_scene(SPEC, "left", replace(POSE, run_out=0.0), np.random.default_rng(6))
    tyre = draw_tyre(np.random.default_rng(3), shape)
    still = replace(drawn, tyre=replace(tyre, texture=np.ones_like(tyre.texture), valve=None))
    rig = build_rig(SPEC, "front_left", "left", np.random.default_rng(5))
    sharp, blurred = (
        light_on_chip(s, rig, 1, "left") for s in (still, replace(still, turning=math.radians(3.0)))
    )
    difference = np.abs(blurred - sharp)
    assert (difference.max() > 0.02) == letters
    if not letters:
        assert difference.max() < 2e-3


def test_every_shot_after_arming_is_the_next_exposure_of_one_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[WheelScene] = []

    def image(scene: WheelScene, *_: Any) -> np.ndarray:
        seen.append(scene)
        return np.full((4, 4), len(seen) % 256, dtype=np.uint8)

    monkeypatch.setattr(simulated_rig, "camera_image", image)
    road = Road(load=TyreLoad(5.0), rollers=Rollers(jitter=0.0, wander_mm=0.0, wander=0.0))
    rig = SimulatedRig(
        true_calibration("front_left", "left", "ccir", 1), "ccir", 1,
        angles_about(-0.5, 0.1, 0.1, 0.2), CameraSettings(exposure_ms=4.0), road=road,
    )  # fmt: skip
    rig.connect()
    rig.arm()
    truths = []
    for _ in range(3):
        rig.shoot(1.0)
        truths.append(rig.truth)
    assert len(seen) == 18
    assert len({id(scene) for scene in seen}) == 3
    assert seen[0].tyre is seen[-1].tyre
    assert seen[0].turning == pytest.approx(0.012)
    turns = np.diff([math.radians(t.spin_angle_deg) for t in truths])
    np.testing.assert_allclose(turns, 0.84, atol=1e-9)
    assert rig.series_truth.spin_camber_deg == pytest.approx(truths[0].spin_camber_deg)
    assert rig.series_truth.spin_angle_deg == pytest.approx(math.degrees(1.68))
    assert rig.series_truth.load == road.load
    rig.arm()
    rig.shoot(1.0)
    assert seen[-1].tyre is not seen[0].tyre
    assert rig.truth.spin_camber_deg != truths[0].spin_camber_deg
    rig.close()
