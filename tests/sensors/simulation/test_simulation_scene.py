"""Poses, truth and rigs follow the conventions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from alignment.values import Side
from alignment.vehicle.angles import camber_toe
from sensors.simulation.rigs import RIG_SPECS, RigSpec, Tolerances, build_projectors, build_rig
from sensors.simulation.scene import WheelPose, cable, draw_pose, draw_scene, lump, truth_of

SIDES: tuple[Side, Side] = ("left", "right")


@pytest.mark.parametrize("side", SIDES)
def test_the_tyre_in_the_rig_frame_has_the_angles_of_the_truth(side: Side) -> None:
    rng = np.random.default_rng(1)
    spec = RIG_SPECS["standard"]
    calibration = build_rig(spec, f"front_{side}", side, rng)
    tilted = replace(
        calibration,
        vehicle_from_rig=calibration.vehicle_from_rig.perturbed(np.array([0.01, -0.02, 0.03]), np.zeros(3)),
    )
    scene = draw_scene(spec, side, draw_pose(rng, math.radians(2), math.radians(-3), 8.0, 0.01), rng, seed=9)
    truth = truth_of(scene)
    assert (truth.side, truth.seed) == (side, 9)
    assert (truth.spin_camber_deg, truth.spin_toe_deg) == pytest.approx((2.0, -3.0))
    for rig in (calibration, tilted):
        pose = scene.rig_from_tyre(rig)
        normal = rig.vehicle_from_rig.apply_vectors(pose.rotation[:, 2])
        camber, toe = camber_toe(normal, side)
        assert math.degrees(camber) == pytest.approx(truth.camber_deg, abs=1e-9)
        assert math.degrees(toe) == pytest.approx(truth.toe_deg, abs=1e-9)
        np.testing.assert_allclose(pose.translation, truth.centre_mm)


@pytest.mark.parametrize("side", SIDES)
def test_run_out_turns_with_the_wheel_about_the_spin_axis(side: Side) -> None:
    run_out = math.radians(0.5)
    poses = [WheelPose(0.02, -0.03, spin, run_out, 0.7) for spin in np.linspace(0, 2 * math.pi, 13)[:-1]]
    normals = np.array([pose.vehicle_from_tyre(side)[:, 2] for pose in poses])
    axis = normals.mean(axis=0)
    camber, toe = camber_toe(axis, side)
    assert (camber, toe) == pytest.approx((0.02, -0.03), abs=1e-12)
    angles = np.arccos(normals @ (axis / np.linalg.norm(axis)))
    np.testing.assert_allclose(angles, run_out, rtol=1e-6)
    assert np.ptp([camber_toe(normal, side)[0] for normal in normals]) == pytest.approx(2 * run_out, rel=0.05)


def test_without_run_out_the_spin_changes_no_angle() -> None:
    for spin in (0.0, 1.0, 4.0):
        pose = WheelPose(0.05, 0.04, spin)
        assert camber_toe(pose.vehicle_from_tyre("right")[:, 2], "right") == pytest.approx((0.05, 0.04))


def test_the_truth_of_a_run_out_is_stated_at_a_radius() -> None:
    scene = draw_scene(
        RIG_SPECS["standard"], "left", WheelPose(run_out=math.radians(0.5)), np.random.default_rng(0)
    )
    truth = truth_of(scene)
    assert truth.runout_mm == pytest.approx(2 * 300 * math.sin(math.radians(0.5)))
    assert truth.camber_deg != pytest.approx(
        truth.spin_camber_deg, abs=1e-3
    ) or truth.toe_deg != pytest.approx(truth.spin_toe_deg, abs=1e-3)


@pytest.mark.parametrize("name", sorted(RIG_SPECS))
def test_heads_stand_around_the_wheel_and_see_the_sidewall(name: str) -> None:
    spec = RIG_SPECS[name]
    rig = build_rig(spec, "rear_left", "left", np.random.default_rng(2))
    assert [head.name for head in rig.heads] == ["head_1", "head_2", "head_3"]
    assert (rig.rig, rig.side) == ("rear_left", "left")
    others = {"upper": (30.0, 90.0, 150.0), "turned": (60.0, 180.0, 300.0), "lifted": (90.0, 195.0, 345.0)}
    stand = others.get(name, (90.0, 210.0, 330.0))
    for degrees, head in zip(stand, rig.heads, strict=True):
        angle = math.radians(degrees)
        outward = np.array([math.cos(angle), math.sin(angle), 0.0])
        middle = (head.left.rig_from_camera.translation + head.right.rig_from_camera.translation) / 2
        np.testing.assert_allclose(middle, 266.0 * outward + [0, 0, 400.0], atol=4.0)
        for camera in head.cameras:
            axes = camera.rig_from_camera.rotation
            assert axes[:, 1] @ outward > 0.999
            assert axes[2, 2] < -0.999
            u, v = camera.project(262.0 * outward[None])[0]
            assert 0.2 < u / camera.model.width < 0.8
            assert 0.2 < v / camera.model.height < 0.8
        left, right = (camera.project(262.0 * outward[None])[0, 0] for camera in head.cameras)
        assert left > right  # what is in front lies further right in the left image


def test_every_head_has_an_angle_or_none_has() -> None:
    with pytest.raises(DegenerateInputError, match="3 heads"):
        RigSpec(angles=(0.5, 1.5))


def test_rigs_differ_by_their_tolerances_and_repeat_by_their_seed() -> None:
    spec = RIG_SPECS["ccir"]
    first, again, other = (build_rig(spec, "r", "left", np.random.default_rng(seed)) for seed in (3, 3, 4))
    model = first.heads[0].left.model
    assert model == again.heads[0].left.model
    assert first.id == again.id != other.id
    assert model != other.heads[0].left.model
    assert (model.width, model.height, model.model) == (752, 582, "division")
    assert model.fy / model.fx == pytest.approx(120.248 / 116.589, rel=2e-3)
    exact = replace(spec, tolerances=Tolerances(0, 0, 0, 0, 0))
    nominal = build_rig(exact, "r", "left", np.random.default_rng(3)).heads[0].right
    assert nominal.model == spec.camera
    np.testing.assert_allclose(nominal.rig_from_camera.translation, [-40.0, 266.0, 400.0], atol=1e-12)


def test_projectors_stand_in_the_heads_or_on_the_axis() -> None:
    heads = build_projectors(RigSpec(), np.random.default_rng(0))
    assert len(heads) == 3
    (central,) = build_projectors(RIG_SPECS["central"], np.random.default_rng(0))
    np.testing.assert_allclose(central.rig_from_projector.translation, [0, 0, 700.0], atol=8.0)
    assert isinstance(central.rig_from_projector, RigidTransform)
    assert central.rig_from_projector.rotation[2, 2] < -0.99


def test_obstacles_have_their_size_and_place() -> None:
    wire = cable(np.array([-100.0, 250.0, 60.0]), np.array([100.0, 250.0, 60.0]), 6.0)
    np.testing.assert_allclose(wire.vertices.max(axis=0), [100, 253, 63], atol=0.05)
    np.testing.assert_allclose(wire.vertices.min(axis=0), [-100, 247, 57], atol=0.05)
    hand = lump(np.array([1.0, 2.0, 3.0]), (10.0, 20.0, 30.0))
    np.testing.assert_allclose(np.ptp(hand.vertices, axis=0), [20, 40, 60], rtol=0.01)
