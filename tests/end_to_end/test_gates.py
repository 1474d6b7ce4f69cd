"""Rendered wheels with something wrong: what the gates of a measurement refuse, and what they let pass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.measure import measure_wheel
from alignment.values import (
    MeasureSettings,
    Refusal,
    RefusalCode,
    RigCalibration,
    WheelMeasurement,
)
from sensors.simulation.render import simulate_shot
from sensors.simulation.scene import WheelScene, lump, truth_of
from sensors.simulation.tyre import Material
from tests import rendered
from tests.assertions import assert_angle_within

SPEC = rendered.SPEC


@pytest.fixture(scope="module")
def rig() -> RigCalibration:
    """True cameras that are known as well as a good plate makes them known."""
    return rendered.known_rig()


@pytest.fixture(scope="module")
def scene() -> WheelScene:
    return rendered.scene()


@pytest.mark.slow
def test_a_head_knocked_by_a_twentieth_of_a_degree_is_named_where_the_calibration_is_known_well(
    rig: RigCalibration, scene: WheelScene
) -> None:
    knocked = rendered.turned_head(rig, 2, 0.05)
    images = simulate_shot(scene, knocked, np.random.default_rng(1)).images
    result = measure_wheel(images, rig, MeasureSettings())
    assert isinstance(result, Refusal)
    assert result.code is RefusalCode.HEAD_MOVED
    assert "check that it has not been knocked" in result.reason


def test_heads_that_stand_where_they_were_calibrated_pass(rig: RigCalibration) -> None:
    result = measure_wheel(rendered.images(), rig, MeasureSettings())
    assert isinstance(result, WheelMeasurement)


@pytest.mark.slow
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
    assert_angle_within(result.camber, math.radians(truth.camber_deg), 0.03, "camber")
    assert_angle_within(result.toe, math.radians(truth.toe_deg), 0.03, "toe")
