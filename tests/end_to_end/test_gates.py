"""Rendered wheels with something wrong: what the gates of a measurement refuse, and what they let pass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.measure import measure_wheel
from alignment.values import (
    HeadCalibration,
    MeasureSettings,
    Refusal,
    RefusalCode,
    RigCalibration,
    WheelMeasurement,
)
from sensors.simulation.render import simulate_shot
from sensors.simulation.rigs import RIG_SPECS, build_rig
from sensors.simulation.scene import WheelScene, draw_pose, draw_scene, lump, truth_of
from sensors.simulation.tyre import Material
from tests.assertions import assert_angle_within

SPEC = RIG_SPECS["standard"]


@pytest.fixture(scope="module")
def rig() -> RigCalibration:
    """True cameras that are known as well as a good plate makes them known."""
    true = build_rig(SPEC, "rig", "left", np.random.default_rng(5))
    small = 1e-7 * np.ones(len(true.parameter_names))
    return replace(true, covariance=np.diag(small**2))


@pytest.fixture(scope="module")
def scene(rig: RigCalibration) -> WheelScene:
    rng = np.random.default_rng(6)
    return draw_scene(SPEC, "left", draw_pose(rng, math.radians(0.7), math.radians(-0.4)), rng, seed=6)


def with_moved_head(rig: RigCalibration, turn_deg: float) -> RigCalibration:
    """The third head turned about its middle, as a knock turns it."""
    head = rig.heads[2]
    middle = np.mean([camera.rig_from_camera.translation for camera in head.cameras], axis=0)
    turn = Rotation.from_rotvec([math.radians(turn_deg), 0.0, 0.0]).as_matrix()
    knock = RigidTransform(turn, middle) @ RigidTransform(np.eye(3), -middle)
    left, right = (PosedCamera(camera.model, knock @ camera.rig_from_camera) for camera in head.cameras)
    return replace(rig, heads=(*rig.heads[:2], HeadCalibration(head.name, left, right)))


def test_a_head_knocked_by_a_twentieth_of_a_degree_is_named_where_the_calibration_is_known_well(
    rig: RigCalibration, scene: WheelScene
) -> None:
    images = simulate_shot(scene, with_moved_head(rig, 0.05), np.random.default_rng(1)).images
    result = measure_wheel(images, rig, MeasureSettings())
    assert isinstance(result, Refusal)
    assert result.code is RefusalCode.HEAD_MOVED
    assert "check that it has not been knocked" in result.reason


def test_heads_that_stand_where_they_were_calibrated_pass(rig: RigCalibration, scene: WheelScene) -> None:
    result = measure_wheel(simulate_shot(scene, rig, np.random.default_rng(1)).images, rig, MeasureSettings())
    assert isinstance(result, WheelMeasurement)


def test_a_bright_obstacle_before_half_of_one_head_leaves_the_angles_right(
    rig: RigCalibration, scene: WheelScene
) -> None:
    place = SPEC.rig_from_head(1)
    body = lump(np.zeros(3), (55.0, 35.0, 10.0), Material(0.5))
    centre = place.apply(np.array([15.0, 0.0, SPEC.distance_mm - 60.0]))
    obstacle = replace(body, vertices=body.vertices @ place.rotation.T + centre)
    images = simulate_shot(replace(scene, obstacles=(obstacle,)), rig, np.random.default_rng(2)).images
    result = measure_wheel(images, rig, MeasureSettings())
    assert isinstance(result, WheelMeasurement), result
    hidden = result.heads[1]
    assert hidden.points < 0.8 * result.heads[0].points
    truth = truth_of(scene)
    assert_angle_within(result.camber, math.radians(truth.camber_deg), 0.06, "camber")
    assert_angle_within(result.toe, math.radians(truth.toe_deg), 0.06, "toe")


def test_an_overexposed_head_is_refused_as_saturated(rig: RigCalibration, scene: WheelScene) -> None:
    bright = replace(scene, projectors=tuple(replace(p, level=20.0 * p.level) for p in scene.projectors))
    result = measure_wheel(
        simulate_shot(bright, rig, np.random.default_rng(3)).images, rig, MeasureSettings()
    )
    assert isinstance(result, Refusal)
    assert result.code is RefusalCode.HEAD_SATURATED
