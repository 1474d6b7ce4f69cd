"""Wheels that are steered before a rig: measured in full images as far as they go, and the load told once."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.posed_wheels import posed_axis_sensitivity
from alignment.calibration.prediction import axis_sensitivity
from alignment.geometry.transforms import RigidTransform
from alignment.measure_steering import (
    LARGEST_STEER,
    errors_at_positions,
    measure_steered,
    rig_from_wheel,
    steered_settings,
)
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, Refusal, RefusalCode, RigCalibration
from sensors.formats import TyreLoad
from sensors.simulation import WheelPose, WheelScene, draw_scene
from station.studies.knocked import plate_covariance
from station.studies.wheels import StudyRig, exposed, lights, study_rig

SETTINGS = steered_settings(MeasureSettings())


@pytest.fixture(scope="module")
def rig() -> StudyRig:
    return study_rig("standard", 3)


@pytest.fixture(scope="module")
def calibrated(rig: StudyRig) -> RigCalibration:
    return replace(rig.true, covariance=plate_covariance(rig.true, np.random.default_rng(1)))


def steered_scene(rig: StudyRig, toe: float, seed: int = 1) -> WheelScene:
    """A wheel whose reference point is 160 mm outboard of its steering axis, as on a car."""
    x, z = 160.0 * math.sin(toe), -160.0 * (1.0 - math.cos(toe))
    pose = WheelPose(math.radians(-0.5), toe, 0.3, 0.0, 0.0, (x, 0.0, z))
    return draw_scene(rig.spec, rig.side, pose, np.random.default_rng(seed), seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("toe_deg", [-12.0, 12.0])
def test_a_wheel_steered_to_the_end_of_the_volume_is_measured_in_full_images(
    rig: StudyRig, toe_deg: float
) -> None:
    """With the volume of wheels that stand straight it was refused as outside."""
    scene = steered_scene(rig, math.radians(toe_deg))
    images = exposed(lights(scene, rig.true), scene, np.random.default_rng(2))
    usual = MeasureSettings()
    refused = measure_steered([images], PreparedRig.of(rig.true, usual), usual)
    assert isinstance(refused, Refusal)
    assert refused.code is RefusalCode.OUTSIDE_VOLUME
    assert refused.reason.startswith("position 1: ")
    found = measure_steered([images], PreparedRig.of(rig.true, SETTINGS), SETTINGS)
    assert not isinstance(found, Refusal), found
    axis = found[0].axis
    assert axis.camber == pytest.approx(math.radians(-0.5), abs=0.03 * ARCMIN)
    assert axis.toe == pytest.approx(math.radians(toe_deg), abs=0.03 * ARCMIN)


@pytest.mark.slow
def test_a_load_that_all_positions_tell_together_scatters_less_than_one_that_each_tells(
    rig: StudyRig,
) -> None:
    """Each exposure told it anew: camber at 10° scattered by 0.03′, which is 1′ of kingpin inclination."""
    scene = replace(steered_scene(rig, math.radians(-10.0)), load=TyreLoad(5.0))
    light, rng = lights(scene, rig.true), np.random.default_rng(4)
    alone: list[float] = []
    series = measure_steered(
        (exposed(light, scene, rng) for _ in range(8)),
        PreparedRig.of(rig.true, SETTINGS),
        SETTINGS,
        lambda plane: alone.append(plane.camber),
    )
    assert not isinstance(series, Refusal), series
    together = [wheel.axis.camber for wheel in series]
    assert np.std(together) < 0.5 * np.std(alone)
    assert np.mean(together) == pytest.approx(math.radians(-0.5), abs=0.06 * ARCMIN)
    # What is not known of the load is no position's own any more, and stands beside.
    assert math.sqrt(series[0].axis.covariance[0, 0]) < 0.01 * ARCMIN
    assert series[0].load_covariance is not None
    assert math.sqrt(series[0].load_covariance[0, 0]) > 0.01 * ARCMIN


def test_the_volume_of_a_sweep_is_no_smaller_than_the_station_s_own() -> None:
    wide = MeasureSettings(depth_range_mm=(-90.0, 70.0), maximum_angle=math.radians(15.0))
    steered = steered_settings(wide)
    assert steered.depth_range_mm == (-90.0, 80.0)
    assert steered.maximum_angle == wide.maximum_angle
    assert SETTINGS.maximum_angle > LARGEST_STEER
    # A head that may be left out has to be judged in each exposure.
    assert steered_settings(MeasureSettings(allow_lost_head=True)).judge_heads


def test_errors_of_a_calibration_are_those_of_a_straight_wheel_where_it_stands_straight(
    calibrated: RigCalibration,
) -> None:
    np.testing.assert_allclose(
        posed_axis_sensitivity(calibrated, RigidTransform.identity()),
        axis_sensitivity(calibrated),
        atol=1e-12,
    )


def test_a_rig_that_is_turned_as_a_whole_turns_a_steered_wheel_with_it(calibrated: RigCalibration) -> None:
    """All cameras turned about the rig's x: the wheel turns with them, wherever it stands."""
    turn = np.array([1e-6, 0.0, 0.0])
    size = len(calibrated.parameter_names)
    move, at = np.zeros(size), 0
    for head in calibrated.heads:
        for camera in head.cameras:
            pose = camera.rig_from_camera
            move[at : at + 3] = pose.rotation.T @ turn
            move[at + 3 : at + 6] = np.cross(turn, pose.translation)
            at += 6 + len(camera.model.parameters)
    normal = np.array([math.sin(0.15), -0.01, math.cos(0.15)])
    normal /= np.linalg.norm(normal)
    point = np.array([25.0, 3.0, -2.0])
    change = posed_axis_sensitivity(calibrated, rig_from_wheel(normal, point)) @ move
    to_vehicle = calibrated.vehicle_from_rig.rotation
    expected = to_vehicle @ np.cross(turn, point)
    # The place of the nominal wheel's axis is known to its crown, 6 mm.
    np.testing.assert_allclose(change[2:], expected, atol=6.0 * 1e-6)
    turned = to_vehicle @ (normal + np.cross(turn, normal))
    n = to_vehicle @ normal
    assert change[0] == pytest.approx(-math.asin(turned[2]) + math.asin(n[2]), abs=2e-9)


def test_errors_between_computed_positions_are_smooth(calibrated: RigCalibration) -> None:
    toes = np.radians(np.linspace(-10.0, 10.0, 21))
    poses = [
        rig_from_wheel(np.array([math.sin(-toe), 0.0, math.cos(toe)]), np.array([160.0 * toe, 0.0, 0.0]))
        for toe in toes
    ]
    found = errors_at_positions(calibrated, poses, toes)
    assert found.shape[:2] == (21, 5)
    rng = np.random.default_rng(1)
    shuffled = rng.permutation(21)
    again = errors_at_positions(calibrated, [poses[k] for k in shuffled], toes[shuffled])
    np.testing.assert_allclose(again, found[shuffled], atol=1e-9)
    few = errors_at_positions(calibrated, poses[:5][::-1], toes[:5][::-1])
    whole = np.einsum("nam,nbm->nab", found, found)
    alone = np.einsum("nam,nbm->nab", few[::-1], few[::-1])
    np.testing.assert_allclose(np.sqrt(alone[:, 0, 0]), np.sqrt(whole[:5, 0, 0]), rtol=0.1)
    assert errors_at_positions(replace(calibrated, covariance=None), poses, toes).shape == (21, 5, 0)
